//! Canonical forms of files.

use std::fmt;

use crate::digest::{Digest, Fields};

/// A canonical form of a file's content, digested in place of its bytes: files of equal form are
/// equivalent to their reader, whatever their comments and spaces.
#[derive(Clone, Copy)]
pub struct Form {
    /// The form's unique name, e.g. `robot`.
    pub name: &'static str,
    /// Canonicalizes the bytes; `None` if they cannot be parsed, so that every byte counts.
    pub of: fn(&[u8]) -> Option<Vec<u8>>,
}

impl Form {
    /// Returns the digest of a file's canonical form.
    pub(crate) fn digest(self, bytes: &[u8]) -> Digest {
        let Some(form) = (self.of)(bytes) else {
            return Digest::of_bytes(bytes);
        };
        let mut fields = Fields::new("form");
        fields.text(self.name);
        fields.digest(&Digest::of_bytes(&form));
        fields.finish()
    }
}

impl PartialEq for Form {
    fn eq(&self, other: &Self) -> bool {
        self.name == other.name
    }
}

impl Eq for Form {}

impl fmt::Debug for Form {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_tuple("Form").field(&self.name).finish()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_of_equal_canonical_form_have_equal_digests() {
        let words = Form {
            name: "words",
            of: |bytes| {
                let text = std::str::from_utf8(bytes).ok()?;
                let words: Vec<&str> = text.split_whitespace().collect();
                Some(words.join(" ").into_bytes())
            },
        };
        assert_eq!(words.digest(b"a  b"), words.digest(b"a b\n"));
        assert_ne!(words.digest(b"a b"), words.digest(b"ab"));
        assert_ne!(words.digest(b"a b"), Digest::of_bytes(b"a b"));
        assert_eq!(words.digest(b"\xff"), Digest::of_bytes(b"\xff"));
    }
}
