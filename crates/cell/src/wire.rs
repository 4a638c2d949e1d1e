//! Message format: lines of JSON, then rows of numbers.
//!
//! Numbers that must arrive exactly, and come in bulk, are `f64` in little endian after the last
//! line's newline. JSON is written without line breaks.

use serde::{Deserialize, Serialize, de::DeserializeOwned};

/// Why bytes are not a message of this protocol.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum WireError {
    /// A line of JSON is missing or is not what was expected.
    #[error("`{part}` is not the JSON expected: {message}")]
    Json {
        /// The part.
        part: &'static str,
        /// The parser's message.
        message: String,
    },
    /// The byte count is not a whole number of rows.
    #[error("{bytes} bytes of numbers are not whole rows of {width}")]
    Rows {
        /// Bytes found.
        bytes: usize,
        /// Numbers per row.
        width: usize,
    },
    /// Seven numbers are not a pose, or a number is not finite.
    #[error("row {row}: {message}")]
    Row {
        /// The row, from 0.
        row: usize,
        /// The problem.
        message: String,
    },
}

/// Header of a message on `state`: one row of numbers follows; in an answer to `state/history`, all
/// that there are.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct StateHeader {
    /// Name of the stream: a restarted cell begins another.
    pub epoch: String,
    /// The goal being executed; empty if nothing moves.
    pub goal_id: String,
    /// Number of the first row in the stream, from 0; a gap is a loss.
    pub seq: u64,
    /// Names of the joints, in the order of the row's numbers.
    pub joints: Vec<String>,
}

/// Returns the digest that identifies the robot to dispatcher and cell: BLAKE3 of its URDF's bytes,
/// in hexadecimal digits.
pub fn robot_digest(urdf: &str) -> String {
    blake3::hash(urdf.as_bytes()).to_hex().to_string()
}

/// Serializes a line of JSON.
pub(crate) fn line<T: Serialize>(value: &T) -> Vec<u8> {
    let mut bytes = match serde_json::to_vec(value) {
        Ok(bytes) => bytes,
        // An empty line would be signed, and digested into a goal's id.
        Err(err) => unreachable!("writing a plain struct into memory cannot fail: {err}"),
    };
    bytes.push(b'\n');
    bytes
}

/// Parses a line of JSON; returns it and the remaining bytes.
pub(crate) fn split_line<'a, T: DeserializeOwned>(
    part: &'static str,
    bytes: &'a [u8],
) -> Result<(T, &'a [u8]), WireError> {
    let end = bytes.iter().position(|&byte| byte == b'\n');
    let (line, rest) = match end {
        Some(end) => (
            bytes.get(..end).unwrap_or_default(),
            bytes.get(end + 1..).unwrap_or_default(),
        ),
        None => (bytes, &[][..]),
    };
    let value = serde_json::from_slice(line).map_err(|err| WireError::Json {
        part,
        message: err.to_string(),
    })?;
    Ok((value, rest))
}

/// Appends numbers.
pub(crate) fn push_numbers(bytes: &mut Vec<u8>, numbers: impl IntoIterator<Item = f64>) {
    for number in numbers {
        bytes.extend_from_slice(&number.to_le_bytes());
    }
}

/// Reads rows of `width` finite numbers.
pub(crate) fn rows(bytes: &[u8], width: usize) -> Result<Vec<Vec<f64>>, WireError> {
    let row_bytes = width * size_of::<f64>();
    if row_bytes == 0 || !bytes.len().is_multiple_of(row_bytes) {
        return Err(WireError::Rows {
            bytes: bytes.len(),
            width,
        });
    }
    bytes
        .chunks_exact(row_bytes)
        .enumerate()
        .map(|(row, chunk)| {
            let (numbers, _) = chunk.as_chunks();
            let numbers: Vec<f64> = numbers.iter().map(|&n| f64::from_le_bytes(n)).collect();
            if numbers.iter().all(|number| number.is_finite()) {
                Ok(numbers)
            } else {
                Err(WireError::Row {
                    row,
                    message: "a number is not finite".to_owned(),
                })
            }
        })
        .collect()
}

/// Takes a pose off the front of a row.
pub(crate) fn pose<To, From>(
    row: usize,
    numbers: &[f64],
) -> Result<(spatial::Pose<To, From>, &[f64]), WireError> {
    let (pose, rest) = numbers.split_first_chunk().ok_or_else(|| WireError::Row {
        row,
        message: format!("{} numbers, expected a pose", numbers.len()),
    })?;
    let pose = spatial::Pose::from_array(*pose).map_err(|err| WireError::Row {
        row,
        message: err.to_string(),
    })?;
    Ok((pose, rest))
}
