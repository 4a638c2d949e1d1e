//! Writes the few values of a grasp as Python's pickle, protocol 2 (PEP 307), in numpy's `.npy`.
//!
//! An array is the call `numpy.array([…])`, which every version of numpy answers with double precision.

/// A value of a grasp.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Value {
    /// A Python `float`.
    Number(f64),
    /// A Python `str`.
    Text(String),
    /// A numpy array of one dimension, double precision.
    Array(Vec<f64>),
    /// A Python `dict`.
    Dictionary(Vec<(&'static str, Self)>),
}

const PROTOCOL: [u8; 2] = [0x80, 2];
const NUMPY_ARRAY: &[u8] = b"cnumpy\narray\n";
const MARK: u8 = b'(';
const FLOAT: u8 = b'G';
const TEXT: u8 = b'X';
const EMPTY_LIST: u8 = b']';
const APPENDS: u8 = b'e';
const EMPTY_DICT: u8 = b'}';
const SET_ITEMS: u8 = b'u';
const TUPLE_1: u8 = 0x85;
const CALL: u8 = b'R';
const STOP: u8 = b'.';

/// Bytes that numpy's header is padded to.
const ALIGNMENT: usize = 64;
/// Bytes before the header's text: the magic, the version and the header's length.
const BEFORE_HEADER: usize = 10;

/// Writes a value as numpy saves an object: `numpy.load(…, allow_pickle=True).item()` gives it back.
pub(super) fn npy(value: &Value) -> Vec<u8> {
    let mut header = "{'descr': '|O', 'fortran_order': False, 'shape': (), }".to_owned();
    while !(BEFORE_HEADER + header.len() + 1).is_multiple_of(ALIGNMENT) {
        header.push(' ');
    }
    header.push('\n');
    let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
    // The header has 118 bytes.
    bytes.extend(
        u16::try_from(header.len())
            .unwrap_or(u16::MAX)
            .to_le_bytes(),
    );
    bytes.extend(header.bytes());
    bytes.extend(PROTOCOL);
    call_array(&mut bytes, |bytes| write(bytes, value));
    bytes.push(STOP);
    bytes
}

fn write(bytes: &mut Vec<u8>, value: &Value) {
    match value {
        Value::Number(number) => {
            bytes.push(FLOAT);
            bytes.extend(number.to_be_bytes());
        }
        Value::Text(text) => write_text(bytes, text),
        Value::Array(numbers) => call_array(bytes, |bytes| {
            bytes.extend([EMPTY_LIST, MARK]);
            for &number in numbers {
                write(bytes, &Value::Number(number));
            }
            bytes.push(APPENDS);
        }),
        Value::Dictionary(items) => {
            bytes.extend([EMPTY_DICT, MARK]);
            for (key, value) in items {
                write_text(bytes, key);
                write(bytes, value);
            }
            bytes.push(SET_ITEMS);
        }
    }
}

fn write_text(bytes: &mut Vec<u8>, text: &str) {
    bytes.push(TEXT);
    // Names and paths are far shorter than 4 GiB.
    bytes.extend(u32::try_from(text.len()).unwrap_or(u32::MAX).to_le_bytes());
    bytes.extend(text.bytes());
}

/// `numpy.array` of what `argument` writes.
fn call_array(bytes: &mut Vec<u8>, argument: impl FnOnce(&mut Vec<u8>)) {
    bytes.extend(NUMPY_ARRAY);
    argument(bytes);
    bytes.extend([TUPLE_1, CALL]);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn header_is_aligned_and_the_pickle_ends() {
        let bytes = npy(&Value::Array(vec![1.0]));
        assert_eq!(u16::from_le_bytes([bytes[8], bytes[9]]), 118);
        assert_eq!(bytes[127], b'\n');
        assert_eq!(bytes[128..143], *b"\x80\x02cnumpy\narray\n");
        assert!(bytes.ends_with(b"e\x85R\x85R."));
    }
}
