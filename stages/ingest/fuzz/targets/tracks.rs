//! Plain tracks: a description, a zero byte, and an archive; or a description of what a right archive holds.
#![no_main]

use std::sync::LazyLock;

use libfuzzer_sys::{Corpus, fuzz_target};
use stage_ingest::read;

/// An archive of two images, with each name that landmarks can have.
static ARCHIVE: LazyLock<Vec<u8>> = LazyLock::new(|| {
    std::fs::read(concat!(env!("CARGO_MANIFEST_DIR"), "/corpus/track.npz")).expect("`seeds` has run")
});

fuzz_target!(|bytes: &[u8]| -> Corpus {
    let Some(end) = bytes.iter().position(|&byte| byte == 0) else {
        return Corpus::Reject;
    };
    let (about, archive) = (&bytes[..end], &bytes[end + 1..]);
    let archive = if archive.is_empty() { ARCHIVE.as_slice() } else { archive };
    if let Ok(whole) = read::tracks(about, archive) {
        assert!(whole <= 100_000);
    }
    Corpus::Keep
});
