//! Digests of bytes and of plain structs.

use std::{fmt, str::FromStr};

use serde::{Deserialize, Serialize};

/// The BLAKE3 digest of some bytes, written as 64 hexadecimal digits.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(try_from = "Hex", into = "String")]
pub struct Digest([u8; 32]);

/// Text that is not a digest.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("`{0}` is not a digest: expected 64 hexadecimal digits")]
pub struct InvalidDigest(String);

impl Digest {
    /// Digests bytes.
    pub fn of_bytes(bytes: &[u8]) -> Self {
        Self(*blake3::hash(bytes).as_bytes())
    }

    /// Digests a plain struct by its JSON, in which maps are ordered by key.
    pub(crate) fn of_json(value: &serde_json::Value) -> Self {
        Self::of_bytes(value.to_string().as_bytes())
    }

    /// Returns the 32 bytes.
    pub fn as_bytes(&self) -> &[u8; 32] {
        &self.0
    }

    /// Returns the 64 digits.
    pub fn to_hex(self) -> String {
        blake3::Hash::from_bytes(self.0).to_hex().to_string()
    }

    /// Returns the first 12 digits: enough for people to tell digests apart.
    pub fn short(self) -> String {
        let mut digits = self.to_hex();
        digits.truncate(12);
        digits
    }
}

impl From<[u8; 32]> for Digest {
    fn from(bytes: [u8; 32]) -> Self {
        Self(bytes)
    }
}

impl FromStr for Digest {
    type Err = InvalidDigest;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        blake3::Hash::from_hex(text)
            .map(|hash| Self(*hash.as_bytes()))
            .map_err(|_malformed| InvalidDigest(text.to_owned()))
    }
}

/// Digits as written in a file.
#[derive(Deserialize)]
struct Hex<'a>(#[serde(borrow)] std::borrow::Cow<'a, str>);

impl TryFrom<Hex<'_>> for Digest {
    type Error = InvalidDigest;

    fn try_from(digits: Hex<'_>) -> Result<Self, Self::Error> {
        digits.0.parse()
    }
}

impl From<Digest> for String {
    fn from(digest: Digest) -> Self {
        digest.to_hex()
    }
}

impl fmt::Display for Digest {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.to_hex())
    }
}

impl fmt::Debug for Digest {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Digest({})", self.short())
    }
}

/// Digests fields one after the other, each with its length, so that different lists of fields
/// never give the same bytes.
pub(crate) struct Fields(blake3::Hasher);

impl Fields {
    /// Starts with a name for what is digested.
    pub(crate) fn new(what: &str) -> Self {
        let mut fields = Self(blake3::Hasher::new());
        fields.text(what);
        fields
    }

    pub(crate) fn number(&mut self, number: u64) {
        self.0.update(&number.to_le_bytes());
    }

    pub(crate) fn text(&mut self, text: &str) {
        self.number(text.len() as u64);
        self.0.update(text.as_bytes());
    }

    pub(crate) fn digest(&mut self, digest: &Digest) {
        self.0.update(digest.as_bytes());
    }

    pub(crate) fn finish(self) -> Digest {
        Digest(*self.0.finalize().as_bytes())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn digits_read_back_and_other_text_is_refused() {
        let digest = Digest::of_bytes(b"bytes");
        assert_eq!(digest.to_hex().parse(), Ok(digest));
        let json = serde_json::to_string(&digest).unwrap();
        assert_eq!(serde_json::from_str::<Digest>(&json).unwrap(), digest);
        assert!("12".parse::<Digest>().is_err());
        assert!("g".repeat(64).parse::<Digest>().is_err());
    }

    #[test]
    fn moving_a_letter_between_fields_changes_the_digest() {
        let of = |a: &str, b: &str| {
            let mut fields = Fields::new("test");
            fields.text(a);
            fields.text(b);
            fields.finish()
        };
        assert_ne!(of("ab", "c"), of("a", "bc"));
    }
}
