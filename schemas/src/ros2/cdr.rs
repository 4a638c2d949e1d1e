//! XCDR1, the wire format of ROS 2 (OMG DDS-XTypes 1.3, §7.4.1): written little endian, read in both orders of bytes.

/// Encapsulation header of little-endian XCDR1; alignment counts from behind it.
const ENCAPSULATION: [u8; 4] = [0, 1, 0, 0];

/// A value that a message can contain.
pub trait Cdr: Sized {
    /// Appends the value, aligned.
    fn encode(&self, writer: &mut CdrWriter);

    /// Reads the value at the reader's position.
    ///
    /// # Errors
    ///
    /// Fails if the bytes end early or do not encode a value of this type.
    fn decode(reader: &mut CdrReader<'_>) -> Result<Self, CdrError>;
}

/// Why bytes do not decode as a message.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum CdrError {
    /// The first two bytes are neither `00 01` nor `00 00`.
    #[error("encapsulation is not XCDR1")]
    Encapsulation,
    /// The bytes end inside a value.
    #[error("message ends at byte {end}, {missing} bytes too early")]
    TooShort {
        /// Length of the message in bytes.
        end: usize,
        /// Number of further bytes that the next value needs.
        missing: usize,
    },
    /// A string lacks its final zero or is not UTF-8.
    #[error("string at byte {at} is not zero-terminated UTF-8")]
    NotAString {
        /// Offset of its first character.
        at: usize,
    },
    /// A bool is neither 0 nor 1.
    #[error("bool at byte {at} is {found}")]
    NotABool {
        /// Its offset.
        at: usize,
        /// The byte found.
        found: u8,
    },
}

/// Appends values to a message.
#[derive(Debug, Clone)]
pub struct CdrWriter {
    bytes: Vec<u8>,
}

impl CdrWriter {
    /// Returns a message with only the encapsulation header.
    pub fn new() -> Self {
        Self {
            bytes: ENCAPSULATION.to_vec(),
        }
    }

    /// Returns the message.
    pub fn into_bytes(self) -> Vec<u8> {
        self.bytes
    }

    fn put<const N: usize>(&mut self, number: [u8; N]) {
        let length = self.bytes.len() - ENCAPSULATION.len();
        let padded = length.next_multiple_of(N) + ENCAPSULATION.len();
        self.bytes.resize(padded, 0);
        self.bytes.extend_from_slice(&number);
    }

    /// Lengths are 32 bits wide in this format; no recording comes near that.
    fn put_length(&mut self, length: usize) {
        let length = u32::try_from(length);
        assert!(length.is_ok(), "a sequence of 2^32 or more elements");
        self.put(length.unwrap_or(0).to_le_bytes());
    }
}

impl Default for CdrWriter {
    fn default() -> Self {
        Self::new()
    }
}

/// Reads values of a message one after another.
#[derive(Debug, Clone)]
pub struct CdrReader<'a> {
    bytes: &'a [u8],
    at: usize,
    is_big_endian: bool,
}

impl<'a> CdrReader<'a> {
    /// Starts behind the encapsulation header.
    ///
    /// # Errors
    ///
    /// Fails if the message does not begin with that of XCDR1.
    pub fn new(message: &'a [u8]) -> Result<Self, CdrError> {
        // The last two bytes are options, which a reader ignores.
        match message.split_at_checked(ENCAPSULATION.len()) {
            Some(([0, order @ (0 | 1), _, _], bytes)) => Ok(Self {
                bytes,
                at: 0,
                is_big_endian: *order == 0,
            }),
            _ => Err(CdrError::Encapsulation),
        }
    }

    /// Returns how many bytes are left.
    pub fn remaining(&self) -> usize {
        self.bytes.len().saturating_sub(self.at)
    }

    fn take(&mut self, length: usize) -> Result<&'a [u8], CdrError> {
        let rest = self.bytes.get(self.at..).unwrap_or_default();
        let taken = rest.get(..length).ok_or_else(|| CdrError::TooShort {
            end: ENCAPSULATION.len() + self.bytes.len(),
            missing: length - rest.len(),
        })?;
        self.at += length;
        Ok(taken)
    }

    /// Returns the bytes of a number, the lowest first.
    fn number<const N: usize>(&mut self) -> Result<[u8; N], CdrError> {
        let padding = self.at.next_multiple_of(N) - self.at;
        self.take(padding)?;
        let mut number = [0; N];
        number.copy_from_slice(self.take(N)?);
        if self.is_big_endian {
            number.reverse();
        }
        Ok(number)
    }

    fn length(&mut self) -> Result<usize, CdrError> {
        Ok(u32::from_le_bytes(self.number()?) as usize)
    }
}

macro_rules! numbers {
    ($($number:ty),*) => {$(
        impl Cdr for $number {
            fn encode(&self, writer: &mut CdrWriter) {
                writer.put(self.to_le_bytes());
            }

            fn decode(reader: &mut CdrReader<'_>) -> Result<Self, CdrError> {
                Ok(Self::from_le_bytes(reader.number()?))
            }
        }
    )*};
}

numbers!(u8, i32, u32, f32, f64);

impl Cdr for bool {
    fn encode(&self, writer: &mut CdrWriter) {
        writer.put([u8::from(*self)]);
    }

    fn decode(reader: &mut CdrReader<'_>) -> Result<Self, CdrError> {
        let at = ENCAPSULATION.len() + reader.at;
        match u8::decode(reader)? {
            0 => Ok(false),
            1 => Ok(true),
            found => Err(CdrError::NotABool { at, found }),
        }
    }
}

impl Cdr for String {
    fn encode(&self, writer: &mut CdrWriter) {
        writer.put_length(self.len() + 1);
        writer.bytes.extend_from_slice(self.as_bytes());
        writer.bytes.push(0);
    }

    fn decode(reader: &mut CdrReader<'_>) -> Result<Self, CdrError> {
        let length = reader.length()?;
        let at = ENCAPSULATION.len() + reader.at;
        let bytes = reader.take(length)?;
        bytes
            .split_last()
            .and_then(|(&last, text)| (last == 0).then_some(text))
            .and_then(|text| std::str::from_utf8(text).ok())
            .map(ToOwned::to_owned)
            .ok_or(CdrError::NotAString { at })
    }
}

impl<T: Cdr + Copy + Default, const N: usize> Cdr for [T; N] {
    fn encode(&self, writer: &mut CdrWriter) {
        for element in self {
            element.encode(writer);
        }
    }

    fn decode(reader: &mut CdrReader<'_>) -> Result<Self, CdrError> {
        let mut elements = [T::default(); N];
        for element in &mut elements {
            *element = T::decode(reader)?;
        }
        Ok(elements)
    }
}

impl<T: Cdr> Cdr for Vec<T> {
    fn encode(&self, writer: &mut CdrWriter) {
        writer.put_length(self.len());
        for element in self {
            element.encode(writer);
        }
    }

    fn decode(reader: &mut CdrReader<'_>) -> Result<Self, CdrError> {
        let length = reader.length()?;
        // A length from outside never reserves more than the message could hold: no element is
        // smaller than a byte.
        let mut elements = Self::with_capacity(length.min(reader.remaining()));
        for _ in 0..length {
            elements.push(T::decode(reader)?);
        }
        Ok(elements)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ros2::{JointState, JointTrajectory, JointTrajectoryPoint, Message};

    fn trajectory() -> JointTrajectory {
        JointTrajectory {
            joint_names: vec!["a".to_owned(), String::new()],
            points: vec![JointTrajectoryPoint {
                positions: vec![0.5, -0.0],
                ..JointTrajectoryPoint::default()
            }],
            ..JointTrajectory::default()
        }
    }

    #[test]
    fn a_message_cut_anywhere_is_an_error() {
        let bytes = trajectory().to_cdr();
        for end in 0..bytes.len() {
            assert!(
                JointTrajectory::from_cdr(&bytes[..end]).is_err(),
                "cut at {end}"
            );
        }
        assert_eq!(JointTrajectory::from_cdr(&bytes), Ok(trajectory()));
    }

    #[test]
    fn excessive_length_is_an_error_without_allocation() {
        let mut bytes = trajectory().to_cdr();
        // After the stamp (8 bytes) and the empty frame name (4 + 1, padded to 8): the number of
        // names.
        bytes[20..24].copy_from_slice(&u32::MAX.to_le_bytes());
        assert!(JointTrajectory::from_cdr(&bytes).is_err());
    }

    #[test]
    fn both_orders_of_bytes_are_read() {
        // Stamp, frame `a`, number of names, the name `bc`, and no numbers.
        let little = "00010000 01000000 02000000 02000000 61000000 01000000 03000000 62630000 \
                      00000000 00000000 00000000";
        let big = "00000000 00000001 00000002 00000002 61000000 00000001 00000003 62630000 \
                   00000000 00000000 00000000";
        let read = |hex: &str| {
            let digits: Vec<char> = hex.chars().filter(|c| !c.is_whitespace()).collect();
            let byte = |pair: &[char]| u8::from_str_radix(&String::from_iter(pair), 16).unwrap();
            let mut bytes: Vec<u8> = digits.chunks(2).map(byte).collect();
            let state = JointState::from_cdr(&bytes).unwrap();
            bytes[1] = 2;
            assert_eq!(JointState::from_cdr(&bytes), Err(CdrError::Encapsulation));
            state
        };
        assert_eq!(read(little), read(big));
        assert_eq!(read(big).header.stamp.nanosec, 2);
        assert_eq!(read(big).name, ["bc"]);
    }
}
