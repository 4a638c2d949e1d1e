//! Motions inside a page: compressed, as text.

use std::io::Write;

use base64::{Engine as _, engine::general_purpose::STANDARD};
use flate2::{Compression, GzBuilder};

use crate::ReportError;

/// Returns bytes compressed (gzip, without a clock) as text.
pub(crate) fn embedded(bytes: &[u8]) -> Result<String, ReportError> {
    let mut encoder = GzBuilder::new()
        .mtime(0)
        .write(Vec::new(), Compression::best());
    encoder.write_all(bytes).map_err(ReportError::Compress)?;
    let compressed = encoder.finish().map_err(ReportError::Compress)?;
    Ok(STANDARD.encode(&compressed))
}
