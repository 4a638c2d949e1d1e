//! Bytes that are made to exhaust memory do not, measured on the whole process.

use std::{
    fs,
    io::{Cursor, Write},
};

use npyz::zip::{ZipWriter, write::FileOptions};
use stage_ingest::read;

/// Most memory that reading all of the files below may need in all, in bytes.
const LIMIT: u64 = 32 << 20;

/// Returns the most memory that the process has held so far, in bytes; `None` where the system does
/// not tell.
fn peak() -> Option<u64> {
    let status = fs::read_to_string("/proc/self/status").ok()?;
    let line = status
        .lines()
        .find_map(|line| line.strip_prefix("VmHWM:"))?;
    let kib: u64 = line.split_whitespace().next()?.parse().ok()?;
    Some(kib << 10)
}

/// Returns an archive of an array `a` whose header announces `shape` and after which a gigabyte of
/// zeros follows, 1 MB long, and of another array `b`.
fn bomb(shape: &str) -> Vec<u8> {
    let header = |shape: &str| {
        let text = format!("{{'descr': '<f8', 'fortran_order': False, 'shape': {shape}, }}\n");
        let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
        bytes.extend(u16::try_from(text.len()).unwrap().to_le_bytes());
        bytes.extend(text.as_bytes());
        bytes
    };
    let mut bytes = Cursor::new(Vec::new());
    let mut zip = ZipWriter::new(&mut bytes);
    zip.start_file("a.npy", FileOptions::default()).unwrap();
    zip.write_all(&header(shape)).unwrap();
    let zeros = vec![0; 1 << 20];
    for _ in 0..1 << 10 {
        zip.write_all(&zeros).unwrap();
    }
    zip.start_file("b.npy", FileOptions::default()).unwrap();
    zip.write_all(&header("(2,)")).unwrap();
    zip.write_all(&[0; 16]).unwrap();
    zip.finish().unwrap();
    drop(zip);
    bytes.into_inner()
}

#[test]
fn hostile_files_are_read_in_little_memory() {
    let bombs = ["(2,)", "(134217728,)", "(1250000000,)"].map(bomb);
    let yaml = [
        "[", "{a: ", "- ", "a: 1\n", "&a [", "'", "\"", "|\n a\n", "? ", "x, ",
    ]
    .map(|text| text.repeat((1 << 20) / text.len()));
    let list = format!("serials: [{}]", yaml[9]);
    let Some(before) = peak() else {
        eprintln!("skipped: this system does not tell how much memory a process held");
        return;
    };
    for bomb in &bombs {
        assert!(bomb.len() < 2 << 20);
        assert!(read::npz(bomb, "a", &[2]).is_err());
        assert!(read::npz(bomb, "a", &[1, 21, 3]).is_err());
        assert_eq!(read::npz(bomb, "b", &[2]).unwrap(), [0.0, 0.0]);
    }
    for text in yaml.iter().chain([&list]) {
        assert!(read::meta_serials(text.as_bytes()).is_err());
        assert!(read::extrinsics(text.as_bytes()).is_err());
    }
    let needed = peak().unwrap() - before;
    assert!(needed < LIMIT, "{needed} bytes");
}
