//! Array files: whole archives, and archives with a right checksum around any array.
#![no_main]

use libfuzzer_sys::{Corpus, fuzz_target};
use stage_ingest::read;

/// Arrays that are asked for, with their shapes.
const ARRAYS: [(&str, &[u64]); 3] = [
    ("joint_3d", &[1, 21, 3]),
    ("pose_y", &[2, 3, 4]),
    ("a", &[2, 2]),
];

fuzz_target!(|bytes: &[u8]| -> Corpus {
    let Some((&kind, rest)) = bytes.split_first() else {
        return Corpus::Reject;
    };
    if kind.is_multiple_of(2) {
        read_all(rest);
    } else {
        read_all(&stored(rest));
    }
    Corpus::Keep
});

/// Arrays that are read have as many numbers as their shape says, all finite.
fn read_all(archive: &[u8]) {
    for (array, shape) in ARRAYS {
        if let Ok(numbers) = read::npz(archive, array, shape) {
            let count: u64 = shape.iter().product();
            assert_eq!(numbers.len() as u64, count);
            assert!(numbers.iter().all(|number| number.is_finite()));
        }
    }
}

/// An archive whose array `a` has these bytes.
fn stored(content: &[u8]) -> Vec<u8> {
    let len = (content.len() as u32).to_le_bytes();
    let mut common = vec![20, 0, 0, 0, 0, 0, 0, 0, 0, 0];
    common.extend(crc32fast::hash(content).to_le_bytes());
    common.extend([len, len].as_flattened());
    common.extend([5, 0]);
    let mut archive = [b"PK\x03\x04", &common[..], &[0, 0], b"a.npy", content].concat();
    let directory = [b"PK\x01\x02\x14\x00", &common[..], &[0; 16], b"a.npy"].concat();
    let start = (archive.len() as u32).to_le_bytes();
    archive.extend(&directory);
    archive.extend(b"PK\x05\x06\0\0\0\0\x01\0\x01\0");
    archive.extend((directory.len() as u32).to_le_bytes());
    archive.extend(start);
    archive.extend([0, 0]);
    archive
}
