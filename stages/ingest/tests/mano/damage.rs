//! Files that are not hand models: each gives an error that names what is wrong, quickly and in
//! little memory.

use stage_ingest::{ManoError, ManoModel};

use super::files;

fn error(bytes: &[u8]) -> ManoError {
    match ManoModel::from_pickle(bytes) {
        Err(err) => err,
        Ok(_) => panic!("accepted"),
    }
}

fn check(bytes: &[u8], expected: &str) {
    let message = error(bytes).to_string();
    assert!(message.contains(expected), "`{message}` lacks `{expected}`");
}

/// Returns where bytes are first found, from a place on.
fn find(bytes: &[u8], from: usize, wanted: &[u8]) -> usize {
    let found = bytes[from..]
        .windows(wanted.len())
        .position(|window| window == wanted);
    from + found.unwrap_or_else(|| panic!("no {wanted:?}"))
}

/// The right hand with one thing changed.
struct Changed(Vec<u8>);

impl Changed {
    fn right() -> Self {
        Self(files::made_up("right.pkl"))
    }

    /// Replaces the first `from` after a key by as many bytes.
    fn replace(mut self, key: &str, from: &[u8], to: &[u8]) -> Self {
        assert_eq!(from.len(), to.len());
        let at = find(&self.0, find(&self.0, 0, key.as_bytes()), from);
        self.0[at..at + to.len()].copy_from_slice(to);
        self
    }

    /// Replaces number `idx` in the array of `n` items of a key.
    fn set(mut self, key: &str, n: usize, idx: usize, item: [u8; 8]) -> Self {
        let mut header = b"T".to_vec();
        header.extend(u32::try_from(8 * n).unwrap().to_le_bytes());
        let start = find(&self.0, find(&self.0, 0, key.as_bytes()), &header) + header.len();
        self.0[start + 8 * idx..][..8].copy_from_slice(&item);
        self
    }
}

#[test]
fn reports_missing_or_misshapen_fields() {
    for key in [
        "kintree_table",
        "v_template",
        "shapedirs",
        "J_regressor",
        "weights",
        "hands_mean",
        "hands_components",
        "posedirs",
    ] {
        let other = format!("{}?", &key[..key.len() - 1]);
        let changed = Changed::right().replace(key, key.as_bytes(), other.as_bytes());
        let expected = format!("the hand model has no `{key}`");
        check(&changed.0, &expected);
    }
    let changed = |key, from: &[u8], to: &[u8]| Changed::right().replace(key, from, to).0;
    // 778 = 0x30a, 779 = 0x30b.
    let shape = changed("v_template", b"M\x0a\x03K\x03", b"M\x0b\x03K\x03");
    check(&shape, "not as many bytes");
    let shape = changed("v_template", b"M\x0a\x03K\x03", b"K\x03M\x0a\x03");
    check(&shape, "shape [3, 778], expected [778, 3]");
    let shape = changed("hands_mean", b"K\x2d\x85", b"K\x2e\x85");
    check(&shape, "not as many bytes");
    // The first array has the type that the others refer to.
    let kind = |to| changed("hands_components", b"U\x02f8", to);
    check(&kind(b"U\x02i8"), "holds whole numbers");
    check(&kind(b"U\x02f4"), "not as many bytes");
    check(&kind(b"U\x02O8"), "is not an array of numbers");
    check(&kind(b"U\x02f2"), "is not an array of numbers");
    let order = changed("hands_components", b"U\x01<", b"U\x01|");
    check(&order, "is not an array of numbers");
    // Places that the selection of shape directions takes: beyond the array's end.
    let places = Changed::right().set("idxs", 23340, 9, 46680_u64.to_le_bytes());
    check(&places.0, "takes numbers from where there are none");
    // A sparse matrix's row beyond the last, and columns that run backward.
    let row = changed(
        "indices",
        &[0, 0, 0, 0, 1, 0, 0, 0],
        &[16, 0, 0, 0, 1, 0, 0, 0],
    );
    check(&row, "is not a sparse matrix");
    let start = changed(
        "indptr",
        &[1, 0, 0, 0, 1, 0, 0, 0],
        &[9, 0, 0, 0, 1, 0, 0, 0],
    );
    check(&start, "is not a sparse matrix");
}

#[test]
fn refuses_numbers_that_are_not_those_of_a_hand() {
    let set = |key, n, idx, number: f64| Changed::right().set(key, n, idx, number.to_le_bytes()).0;
    let numbers = [
        ("v_template", 778 * 3),
        ("weights", 778 * 16),
        ("posedirs", 778 * 3 * 135),
        ("hands_mean", 45),
        ("hands_components", 45 * 45),
        ("shapedirs", 778 * 3 * 20),
    ];
    for (key, n) in numbers {
        for number in [f64::NAN, f64::INFINITY] {
            let expected = format!("`{key}` of the hand model holds a number that is not finite");
            check(&set(key, n, n - 1, number), &expected);
        }
    }
    check(&set("v_template", 778 * 3, 7, 1e3), "not within a meter");
    check(
        &set("weights", 778 * 16, 5, 0.5),
        "weights do not sum to one",
    );
    // Vertex 0 gives a quarter of the wrist.
    check(&set("v_template", 778 * 3, 0, 0.1), "`J` is not where");
    let tree = Changed::right().set("kintree_table", 32, 2 * 3, 1_u64.to_le_bytes());
    check(&tree.0, "the tree of joints is another");
    let mut flat = Changed::right();
    for angle in 0..45 {
        flat = flat.set("hands_mean", 45, angle, [0; 8]);
    }
    check(&flat.0, "does not bend the fingers");
}

#[test]
fn a_file_that_ends_early_is_refused_wherever_it_ends() {
    for name in ["right.pkl", "right_protocol_5.pkl"] {
        let whole = files::made_up(name);
        let n = whole.len();
        let near_ends = (0..3000).chain(n - 3000..n);
        for len in near_ends.chain((3000..n - 3000).step_by(997)) {
            assert!(
                matches!(error(&whole[..len]), ManoError::Pickle { .. }),
                "{name} of {len} bytes"
            );
        }
    }
}

#[test]
fn a_changed_byte_never_panics() {
    for name in ["right_single.pkl", "right_protocol_5.pkl"] {
        let whole = files::made_up(name);
        // Instructions, not numbers: what is near to words.
        let is_word = |run: &[u8]| run.iter().all(u8::is_ascii_alphabetic);
        let places: Vec<usize> = (20..whole.len() - 20)
            .filter(|&at| whole[at - 20..at + 20].windows(6).any(is_word))
            .collect();
        assert!(places.len() > 400, "{}", places.len());
        let (mut n_refused, mut n_unharmed) = (0, 0);
        for (k, at) in places.into_iter().enumerate() {
            let mut changed = whole.clone();
            changed[at] ^= [1, 0x80, 0xff, 0x20][k % 4];
            match ManoModel::from_pickle(&changed) {
                Ok(_) => n_unharmed += 1,
                Err(_) => n_refused += 1,
            }
        }
        // A changed name that nothing reads, such as that of a module, does no damage.
        assert!(n_refused > n_unharmed, "{n_refused}, {n_unharmed}");
    }
}

#[test]
fn truncated_files_and_oversized_lengths_are_refused() {
    check(b"", "the end of the file at byte 0");
    check(b"PK\x03\x04", "none of a binary pickle's at byte 0");
    check(b"\x80\x01.", "a protocol other than 2 to 5");
    check(b"\x80\x02}.", "no `kintree_table`");
    check(b"\x80\x02N.", "no `kintree_table`");
    // Lengths beyond the file, also such that overflow.
    for head in [
        &b"\x80\x02T\xff\xff\xff\x7f"[..],
        b"\x80\x02T\xff\xff\xff\xff",
        b"\x80\x02X\xff\xff\xff\xff",
        b"\x80\x02B\xff\xff\xff\xff",
        b"\x80\x02\x8b\xff\xff\xff\x7f",
        b"\x80\x02\x8e\xff\xff\xff\xff\xff\xff\xff\xff",
        b"\x80\x02\x8d\xff\xff\xff\xff\xff\xff\xff\x7f",
        b"\x80\x02\x96\xff\xff\xff\xff\xff\xff\xff\xff",
        b"\x80\x02cnumpy",
    ] {
        check(head, "the end of the file");
    }
    check(b"\x80\x02h\x07.", "a reference to nothing");
    for short in [
        &b"\x80\x02."[..],
        b"\x80\x02\x85.",
        b"\x80\x02R.",
        b"\x80\x02(a.",
        b"\x80\x02t.",
    ] {
        check(short, "lacks its arguments");
    }
    check(b"\x80\x02}(Nu.", "a key without a value");
    check(b"\x80\x02NNb.", "a state for what is not an object");
    check(&vec![b'N'; (64 << 20) + 1], "more than the 67108864");
}

#[test]
fn deep_and_repeated_structures_take_memory_of_their_size() {
    let pickle = |body: &[u8]| [b"\x80\x02", body, b"."].concat();
    // Tuples in tuples, a list that is its own item, an object that is its own state.
    check(
        &pickle(&[b"N".to_vec(), vec![0x85; 100_000]].concat()),
        "no `kintree_table`",
    );
    check(&pickle(&vec![b']'; 100_000]), "no `kintree_table`");
    check(&pickle(b"]q\x00h\x00a"), "no `kintree_table`");
    check(
        &pickle(b"}q\x00U\x0dkintree_tableh\x00s"),
        "is not an array",
    );
    check(
        &pickle(b"}U\x0dkintree_tablecm\n_reconstruct\n)Rq\x00h\x00bs"),
        "is not an array",
    );
    // Each list holds the one before ten times: 10¹⁰⁰ items if they were copied.
    let mut bomb = b"]q\x00".to_vec();
    for level in 1..=100 {
        bomb.extend(b"](");
        bomb.extend([b'h', level - 1].repeat(10));
        bomb.extend([b'e', b'q', level]);
    }
    check(&pickle(&bomb), "no `kintree_table`");
    check(&pickle(&vec![b'N'; 1 << 17]), "more instructions");
    // An array of more dimensions than numbers.
    let mut shape = b"}U\x0dkintree_tablecm\n_reconstruct\n)R(K\x01(".to_vec();
    shape.extend(b"K\x01".repeat(50_000));
    shape.extend(b"tcm\ndtype\nU\x02f8\x85R(K\x03U\x01<tb\x89U\x0812345678tbs");
    check(&pickle(&shape), "is not an array");
}
