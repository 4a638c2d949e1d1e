//! Hand models: any pickle, and a made-up model with some of its instructions changed.
#![no_main]

use std::sync::OnceLock;

use libfuzzer_sys::{Corpus, fuzz_target};
use stage_ingest::ManoModel;

/// Distance of a position from a word, in bytes.
const NEAR: usize = 64;

fuzz_target!(|bytes: &[u8]| -> Corpus {
    let Some((&kind, rest)) = bytes.split_first() else {
        return Corpus::Reject;
    };
    if kind.is_multiple_of(2) {
        let _ = ManoModel::from_pickle(rest);
        return Corpus::Keep;
    }
    let Some(base) = base() else {
        return Corpus::Reject;
    };
    let mut model = base.bytes.clone();
    for change in rest.chunks_exact(3).take(8) {
        let place = usize::from(u16::from_le_bytes([change[0], change[1]]));
        model[base.places[place % base.places.len()]] = change[2];
    }
    let _ = ManoModel::from_pickle(&model);
    Corpus::Keep
});

/// A model to change.
struct Base {
    bytes: Vec<u8>,
    /// Byte offsets of its instructions.
    places: Vec<usize>,
}

/// Returns the model that `INGEST_FUZZ_MODEL` names, if it does.
fn base() -> Option<&'static Base> {
    static BASE: OnceLock<Option<Base>> = OnceLock::new();
    BASE.get_or_init(|| {
        let path = std::env::var_os("INGEST_FUZZ_MODEL")?;
        let bytes = std::fs::read(path).expect("INGEST_FUZZ_MODEL can be read");
        let places = places(&bytes);
        Some(Base { bytes, places })
    })
    .as_ref()
}

/// Returns the places near a word: where four small letters, underscores or line ends follow each
/// other. What lies between is the numbers of arrays.
fn places(bytes: &[u8]) -> Vec<usize> {
    let mut places = Vec::new();
    let is_text = |byte: &u8| byte.is_ascii_lowercase() || matches!(byte, b'_' | b'\n');
    let mut until = 0;
    for (start, window) in bytes.windows(4).enumerate() {
        if window.iter().all(is_text) {
            until = start + NEAR;
            let first = places.last().map_or(0, |last| last + 1);
            places.extend(first.max(start.saturating_sub(NEAR))..start);
        }
        if start < until && places.last() != Some(&start) {
            places.push(start);
        }
    }
    places
}
