//! `HO-Cap`: metadata, a zero byte, and the objects' poses.
#![no_main]

use libfuzzer_sys::{Corpus, fuzz_target};
use stage_ingest::read;

fuzz_target!(|bytes: &[u8]| -> Corpus {
    let Some(end) = bytes.iter().position(|&byte| byte == 0) else {
        return Corpus::Reject;
    };
    if let Ok(Some(first)) = read::hocap(&bytes[..end], &bytes[end + 1..]) {
        assert!(first < 64);
    }
    Corpus::Keep
});
