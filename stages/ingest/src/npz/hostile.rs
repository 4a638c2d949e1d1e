//! Tests: archives that are damaged, or made to do damage, are refused or read right, in bounded
//! memory.

use std::io::{Cursor, Write};

use npyz::zip::{CompressionMethod, ZipWriter, write::FileOptions};

use super::{header, *};

/// The shape of the array `a` in every archive here.
const SHAPE: [u64; 2] = [2, 3];
const NUMBERS: [f64; 6] = [0.1, -2.0, 3.5, 0.0, 1e30, 7.0];

fn text(descr: &str, fortran_order: &str, shape: &str) -> String {
    format!("{{'descr': {descr}, 'fortran_order': {fortran_order}, 'shape': {shape}, }}")
}

fn npy(text: &str, data: &[u8]) -> Vec<u8> {
    let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
    bytes.extend(u16::try_from(text.len()).unwrap().to_le_bytes());
    bytes.extend(text.as_bytes());
    bytes.extend(data);
    bytes
}

/// The array of [`NUMBERS`].
fn good() -> Vec<u8> {
    let data = NUMBERS.map(f64::to_le_bytes);
    npy(&text("'<f8'", "False", "(2, 3)"), data.as_flattened())
}

/// An archive of these files.
fn archive(method: CompressionMethod, files: &[(&str, &[u8])]) -> Vec<u8> {
    let mut bytes = Cursor::new(Vec::new());
    let mut zip = ZipWriter::new(&mut bytes);
    for (name, content) in files {
        let options = FileOptions::default().compression_method(method);
        zip.start_file(*name, options).unwrap();
        zip.write_all(content).unwrap();
    }
    zip.finish().unwrap();
    drop(zip);
    bytes.into_inner()
}

fn stored(content: &[u8]) -> Vec<u8> {
    archive(CompressionMethod::Stored, &[("a.npy", content)])
}

fn deflated(content: &[u8]) -> Vec<u8> {
    archive(CompressionMethod::Deflated, &[("a.npy", content)])
}

fn read(file: &[u8]) -> Result<Vec<f64>, NpzError> {
    let numbers = Arrays::open(file)?.numbers("a", &SHAPE);
    // One that has read other archives before sees the same.
    let mut used = Unpacker::new();
    for other in [deflated(&[7; 300]), deflated(&good())] {
        let _ = Arrays::open_with(&other, &mut used).and_then(|mut a| a.numbers("a", &SHAPE));
    }
    let again = Arrays::open_with(file, &mut used).and_then(|mut a| a.numbers("a", &SHAPE));
    match (&numbers, &again) {
        (Ok(numbers), Ok(again)) => assert_eq!(numbers, again),
        (Err(numbers), Err(again)) => assert_eq!(numbers.to_string(), again.to_string()),
        _ => panic!("{numbers:?}, then {again:?}"),
    }
    numbers
}

fn refuses(file: &[u8], expected: &str) {
    let message = read(file).unwrap_err().to_string();
    assert!(message.contains(expected), "`{message}` lacks `{expected}`");
}

/// Replaces the bytes at a place after the first `signature`.
fn patch(file: &[u8], signature: &[u8], at: usize, new: &[u8]) -> Vec<u8> {
    let start = file
        .windows(signature.len())
        .position(|w| w == signature)
        .unwrap();
    let mut file = file.to_vec();
    file[start + at..start + at + new.len()].copy_from_slice(new);
    file
}

fn patch_directory(file: &[u8], at: usize, new: &[u8]) -> Vec<u8> {
    patch(file, b"PK\x01\x02", at, new)
}

fn patch_local(file: &[u8], at: usize, new: &[u8]) -> Vec<u8> {
    patch(file, b"PK\x03\x04", at, new)
}

/// Replaces the bytes both in the directory and before the data.
fn patch_both(file: &[u8], in_local: usize, new: &[u8]) -> Vec<u8> {
    patch_directory(&patch_local(file, in_local, new), in_local + 2, new)
}

#[test]
fn every_way_of_storing_gives_the_same_numbers() {
    assert_eq!(read(&stored(&good())).unwrap(), NUMBERS);
    assert_eq!(read(&deflated(&good())).unwrap(), NUMBERS);
    let big = NUMBERS.map(f64::to_be_bytes);
    let big = npy(&text("'>f8'", "False", "(2, 3)"), big.as_flattened());
    assert_eq!(read(&deflated(&big)).unwrap(), NUMBERS);
    // First axis fastest: columns one after another.
    let columns = [0, 3, 1, 4, 2, 5].map(|n: usize| NUMBERS[n].to_le_bytes());
    let fortran = npy(&text("'<f8'", "True", "(2, 3)"), columns.as_flattened());
    assert_eq!(read(&deflated(&fortran)).unwrap(), NUMBERS);
    for (descr, data) in [
        ("'<f4'", NUMBERS.map(|v| (v as f32).to_le_bytes())),
        ("'>f4'", NUMBERS.map(|v| (v as f32).to_be_bytes())),
    ] {
        let file = npy(&text(descr, "False", "(2, 3)"), data.as_flattened());
        let widened = NUMBERS.map(|v| f64::from(v as f32));
        assert_eq!(read(&stored(&file)).unwrap(), widened, "{descr}");
    }
    // Versions 2 and 3 have longer lengths.
    let mut second = good();
    second[6] = 2;
    second.splice(10..10, [0, 0]);
    assert_eq!(read(&stored(&second)).unwrap(), NUMBERS);
}

#[test]
fn fortran_order_is_transposed_in_three_dimensions() {
    // Element (i, j, k) of shape (2, 3, 4) is 100 i + 10 j + k.
    let number = |i: u32, j: u32, k: u32| f64::from(100 * i + 10 * j + k);
    let mut columns = Vec::new();
    let mut expected = Vec::new();
    for k in 0..4 {
        for j in 0..3 {
            columns.extend((0..2).map(|i| number(i, j, k)));
        }
    }
    for i in 0..2 {
        for j in 0..3 {
            expected.extend((0..4).map(|k| number(i, j, k)));
        }
    }
    assert_eq!(last_axis_fastest(&columns, &[2, 3, 4]), expected);
}

#[test]
fn every_cut_is_refused() {
    for file in [stored(&good()), deflated(&good())] {
        for len in 0..file.len() {
            assert!(read(&file[..len]).is_err(), "{len} of {}", file.len());
        }
        let longer = [&file, &b"x"[..]].concat();
        refuses(&longer, "damaged archive");
    }
}

#[test]
fn every_flipped_bit_is_noticed_or_changes_nothing() {
    let other = npy(&text("'|u1'", "False", "(4,)"), &[1, 2, 3, 4]);
    for method in [CompressionMethod::Stored, CompressionMethod::Deflated] {
        let file = archive(method, &[("seg.npy", &other), ("a.npy", &good())]);
        let mut n_noticed = 0;
        for position in 0..file.len() {
            for bit in 0..8 {
                let mut file = file.clone();
                file[position] ^= 1 << bit;
                match read(&file) {
                    Ok(numbers) => assert_eq!(numbers, NUMBERS, "bit {bit} of byte {position}"),
                    Err(_) => n_noticed += 1,
                }
            }
        }
        // Nearly all bits outside the other array, of times and of attributes matter.
        assert!(n_noticed > 8 * file.len() / 2, "{n_noticed}");
    }
}

#[test]
fn corrupt_compressed_bytes_are_noticed_or_harmless() {
    let file = deflated(&good());
    let data = 30 + "a.npy".len();
    let end = file.windows(4).position(|w| w == b"PK\x01\x02").unwrap();
    let mut n_noticed = 0;
    for position in data..end {
        for value in 0..=255 {
            let mut file = file.clone();
            file[position] = value;
            match read(&file) {
                Ok(numbers) => assert_eq!(numbers, NUMBERS, "{value} at {position}"),
                Err(_) => n_noticed += 1,
            }
        }
    }
    // All but the unused bits of the last byte, and the byte itself.
    assert!(n_noticed > 255 * (end - data) - 256, "{n_noticed}");
}

#[test]
fn elements_of_other_types_are_named() {
    for descr in [
        "'<i4'",
        "'<i8'",
        "'<u4'",
        "'|u1'",
        "'|b1'",
        "'<f2'",
        "'<f16'",
        "'<c8'",
        "'|O'",
        "'<U3'",
        "'|S4'",
        "'<M8[ns]'",
        "'f4'",
        "'|f4'",
        "[('x', '<f4')]",
    ] {
        let file = stored(&npy(&text(descr, "False", "(2, 3)"), &[0; 96]));
        let found = descr.trim_matches('\'');
        refuses(&file, &format!("`a` holds {found}, expected f4 or f8"));
    }
}

#[test]
fn wrong_shapes_are_refused() {
    for (shape, found) in [
        ("(3, 2)", "[3, 2]"),
        ("(6,)", "[6]"),
        ("()", "[]"),
        ("(2, 3, 1)", "[2, 3, 1]"),
        ("(0, 3)", "[0, 3]"),
        // Ten gigabytes of numbers.
        ("(1250000000,)", "[1250000000]"),
        (
            "(18446744073709551615, 18446744073709551615)",
            "[18446744073709551615, ",
        ),
    ] {
        let file = deflated(&npy(&text("'<f8'", "False", shape), &[0; 48]));
        refuses(&file, &format!("shape {found}"));
    }
}

#[test]
fn non_finite_values_are_refused() {
    for bad in [f64::NAN, f64::INFINITY, f64::NEG_INFINITY] {
        let mut numbers = NUMBERS;
        numbers[4] = bad;
        let data = numbers.map(f64::to_le_bytes);
        let file = npy(&text("'<f8'", "False", "(2, 3)"), data.as_flattened());
        refuses(&deflated(&file), "expected a finite number");
    }
}

#[test]
fn malformed_headers_are_refused() {
    let long = format!("{}{}", text("'<f8'", "False", "(2, 3)"), " ".repeat(5000));
    for content in [
        Vec::new(),
        b"\x93NUMPY".to_vec(),
        b"\x93NUMPY\x01\x00".to_vec(),
        b"\x93NUMPY\x02\x00\xff\xff\xff\xff{".to_vec(),
        b"\x93NUMPY\x04\x00\x10\x00{".to_vec(),
        npy(&long, &[0; 48]),
        npy("", &[0; 48]),
        npy("import os", &[0; 48]),
    ] {
        refuses(&stored(&content), "no array header");
        refuses(&deflated(&content), "no array header");
    }
    let header = text("'<f8'", "False", "(2, 3)");
    for n_bytes in [0, 47, 49, 96] {
        let file = deflated(&npy(&header, &vec![0; n_bytes]));
        refuses(&file, "its length does not fit its shape");
    }
}

#[test]
fn zip_bomb_is_not_unpacked() {
    let mut bomb = Cursor::new(Vec::new());
    let mut zip = ZipWriter::new(&mut bomb);
    let options = FileOptions::default().large_file(true);
    zip.start_file("a.npy", options).unwrap();
    let header = text("'<f8'", "False", "(2, 3)");
    zip.write_all(&npy(&header, &[])).unwrap();
    let zeros = vec![0; 1 << 20];
    for _ in 0..1024 {
        zip.write_all(&zeros).unwrap();
    }
    zip.start_file("b.npy", FileOptions::default()).unwrap();
    zip.write_all(&good()).unwrap();
    zip.finish().unwrap();
    drop(zip);
    let bomb = bomb.into_inner();
    assert!(bomb.len() < 2 << 20);

    let mut unpacker = Unpacker::new();
    let mut arrays = Arrays::open_with(&bomb, &mut unpacker).unwrap();
    // Beside the bomb lies what it does not touch.
    assert_eq!(arrays.numbers("b", &SHAPE).unwrap(), NUMBERS);
    let message = arrays.numbers("a", &SHAPE).unwrap_err().to_string();
    assert!(message.contains("its length does not fit"), "{message}");
    let most = 6 * 8 + header::PREFIX_BYTES + MAX_HEADER_BYTES + INFLATER_ROOM_BYTES;
    assert!(
        unpacker.content.capacity() <= 2 * most,
        "{}",
        unpacker.content.capacity()
    );

    // One that keeps its size to itself is stopped at the size that it announces.
    let honest = deflated(&npy(&header, &vec![0; 1 << 20]));
    let len = u32::try_from(header.len() + 10 + 48).unwrap().to_le_bytes();
    let liar = patch_directory(&patch_local(&honest, 22, &len), 24, &len);
    refuses(&liar, "its length is not the announced one");
}

#[test]
fn a_directory_that_promises_much_reserves_nothing() {
    let file = deflated(&good());
    for len in [u32::MAX - 1, 1 << 30] {
        let len = len.to_le_bytes();
        let liar = patch_directory(&patch_local(&file, 22, &len), 24, &len);
        // As far as it goes it is right, so that only its end tells.
        refuses(&liar, "its length does not fit its shape");
    }
    let mut unpacker = Unpacker::new();
    let end = file.len() - 22;
    let mut many = file.clone();
    many[end + 8..end + 12].fill(0xff);
    assert!(Arrays::open_with(&many, &mut unpacker).is_err());
    assert!(unpacker.directory.capacity() == 0);
}

#[test]
fn mismatched_zip_directory_and_header_are_refused() {
    let file = deflated(&good());
    let differs = "its header differs";
    refuses(&patch_local(&file, 30, b"b"), differs);
    refuses(&patch_local(&file, 8, &[0, 0]), differs);
    refuses(&patch_local(&file, 14, &[0; 4]), differs);
    refuses(&patch_local(&file, 18, &[1, 0, 0, 0]), differs);
    refuses(&patch_local(&file, 22, &[1, 0, 0, 0]), differs);
    refuses(&patch_directory(&file, 16, &[0; 4]), differs);
    // As `numpy` writes it: the lengths stand in ZIP64's extra field.
    let lengths_elsewhere = patch_local(&file, 18, &[0xff; 8]);
    assert_eq!(read(&lengths_elsewhere).unwrap(), NUMBERS);
    // As a program writes it that cannot go back: they follow the data.
    let lengths_later = patch_local(&patch_both(&file, 6, &[8, 0]), 14, &[0; 12]);
    assert_eq!(read(&lengths_later).unwrap(), NUMBERS);
    // A checksum that is wrong in both places.
    refuses(
        &patch_both(&file, 14, &[1, 2, 3, 4]),
        "its checksum is wrong",
    );
}

#[test]
fn arrays_numpy_never_writes_are_refused() {
    let file = deflated(&good());
    for flag in [1, 1 << 5, 1 << 6] {
        refuses(&patch_both(&file, 6, &[flag, 0]), "encrypted or patched");
    }
    refuses(&patch_both(&file, 6, &[0, 1 << 5]), "encrypted or patched");
    for method in [1, 9, 12, 14, 93, 99] {
        refuses(
            &patch_both(&file, 8, &[method, 0]),
            "neither stored nor deflated",
        );
    }
    // Lengths and places that only ZIP64's directory holds, and other disks.
    for (at, len) in [(20, 4), (24, 4), (42, 4), (34, 2)] {
        refuses(
            &patch_directory(&file, at, &[0xff; 4][..len]),
            "damaged archive",
        );
    }
    let end = b"PK\x05\x06";
    for at in [4, 6, 8, 10, 12, 16] {
        refuses(&patch(&file, end, at, &[0xff, 0xff]), "damaged archive");
    }
    // Bytes before the archive move everything from where the directory says that it is.
    refuses(&[b"#!/bin/sh\n", &file[..]].concat(), "damaged archive");
}

#[test]
fn out_of_bounds_and_overlapping_parts_are_refused() {
    let file = deflated(&good());
    let outside = "damaged archive";
    for start in [1, 1000, u32::MAX - 1] {
        refuses(&patch_directory(&file, 42, &start.to_le_bytes()), outside);
    }
    refuses(
        &patch_directory(&file, 20, &1000_u32.to_le_bytes()),
        outside,
    );
    refuses(&patch_local(&file, 26, &[0xff, 0xff]), outside);
    refuses(&patch_local(&file, 28, &[0xff, 0xff]), outside);
    refuses(&patch_directory(&file, 28, &[0xff, 0xff]), outside);
    refuses(&patch_directory(&file, 30, &[0xff, 0xff]), outside);
    // Two entries that share their data.
    let two = archive(
        CompressionMethod::Deflated,
        &[("b.npy", &good()), ("a.npy", &good())],
    );
    let first = two.windows(4).position(|w| w == b"PK\x01\x02").unwrap();
    let mut shared = two.clone();
    shared[first + 46 + 5 + 42..][..4].fill(0);
    refuses(&shared, "its parts overlap");
}

#[test]
fn names_are_bytes_and_stand_for_one_array() {
    let twice = [("a.npy", &good()[..]), ("b.npy", &good()[..])];
    let mut twice = archive(CompressionMethod::Stored, &twice);
    assert_eq!(read(&twice).unwrap(), NUMBERS);
    for position in 0..twice.len() {
        if twice[position..].starts_with(b"b.npy") {
            twice[position] = b'a';
        }
    }
    refuses(&twice, "it is there twice");
    // Beside it, a name that is not UTF-8.
    let mut other = archive(
        CompressionMethod::Stored,
        &[("b.npy", &good()[..]), ("a.npy", &good()[..])],
    );
    for position in 0..other.len() {
        if other[position..].starts_with(b"b.npy") {
            other[position] = 0xff;
        }
    }
    assert_eq!(read(&other).unwrap(), NUMBERS);
    for name in ["a", "A.npy", "./a.npy", "a.npy.npy", "a.npy/"] {
        let file = archive(CompressionMethod::Stored, &[(name, &good())]);
        refuses(&file, "no array `a`");
    }
    refuses(&archive(CompressionMethod::Stored, &[]), "no array `a`");
}

#[test]
fn comments_and_many_arrays_are_read_up_to_a_limit() {
    let mut file = deflated(&good());
    let end = file.len() - 2;
    file[end..].copy_from_slice(&[4, 0]);
    // A comment that looks like an end is none, since it does not reach the file's end.
    file.extend(b"PK\x05\x06");
    assert_eq!(read(&file).unwrap(), NUMBERS);
    let good = good();
    let names: Vec<String> = (0..255).map(|n| format!("{n}.npy")).collect();
    let mut files: Vec<(&str, &[u8])> = names.iter().map(|name| (&**name, &good[..])).collect();
    files.push(("a.npy", &good));
    assert_eq!(
        read(&archive(CompressionMethod::Stored, &files)).unwrap(),
        NUMBERS
    );
    files.push(("b.npy", &good));
    refuses(
        &archive(CompressionMethod::Stored, &files),
        "more than 256 arrays",
    );
}
