//! The header of a `.npy` file.
//!
//! After `numpy.lib.format`, versions 1.0 to 3.0: a signature, a length, and a Python dictionary
//! with exactly the keys `descr`, `fortran_order` and `shape`, in any order.

/// Bytes of the longest prefix before the text: signature, version and length.
pub(super) const PREFIX_BYTES: usize = 12;
/// Maximum number of accepted axes; the arrays of this dataset have three.
const MAX_AXES: usize = 8;

/// Header of an array file: type, order and shape.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Header<'a> {
    /// The elements' type in `numpy`'s words, without quotes.
    pub(super) descr: &'a str,
    /// Whether the first axis is the fastest.
    pub(super) fortran_order: bool,
    /// Length of each axis.
    shape: Shape,
}

/// Lengths of axes, kept in place: reserving memory for them takes as long as reading them.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
struct Shape {
    lengths: [u64; MAX_AXES],
    n_axes: usize,
}

/// A floating-point element.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Element {
    /// Four bytes, little-endian.
    F4,
    /// Eight bytes, little-endian.
    F8,
    /// Four bytes, big-endian.
    F4Big,
    /// Eight bytes, big-endian.
    F8Big,
}

impl<'a> Header<'a> {
    /// Parses the header and returns it with the bytes after it; `None` if it is none, or its text
    /// is longer than `max_text` bytes.
    pub(super) fn parse(file: &'a [u8], max_text: usize) -> Option<(Self, &'a [u8])> {
        let (len, rest) = match file.strip_prefix(b"\x93NUMPY")? {
            [1, 0, a, b, rest @ ..] => (u32::from(u16::from_le_bytes([*a, *b])), rest),
            [2 | 3, 0, a, b, c, d, rest @ ..] => (u32::from_le_bytes([*a, *b, *c, *d]), rest),
            _ => return None,
        };
        let len = usize::try_from(len).ok().filter(|&len| len <= max_text)?;
        let (text, data) = rest.split_at_checked(len)?;
        Some((Self::from_text(text)?, data))
    }

    fn from_text(text: &'a [u8]) -> Option<Self> {
        let mut text = Text(text);
        let mut descr = None;
        let mut fortran_order = None;
        let mut shape = None;
        text.take(b"{")?;
        while text.take(b"}").is_none() {
            let key = text.quoted()?;
            text.take(b":")?;
            let is_new = match key {
                b"descr" => descr.replace(text.descr()?).is_none(),
                b"fortran_order" => fortran_order.replace(text.boolean()?).is_none(),
                b"shape" => shape.replace(text.tuple()?).is_none(),
                _ => false,
            };
            if !is_new {
                return None;
            }
            if text.take(b",").is_none() {
                text.take(b"}")?;
                break;
            }
        }
        text.is_over().then_some(Self {
            descr: std::str::from_utf8(descr?).ok()?,
            fortran_order: fortran_order?,
            shape: shape?,
        })
    }

    /// Returns the length of each axis.
    pub(super) fn shape(&self) -> &[u64] {
        self.shape.lengths.get(..self.shape.n_axes).unwrap_or(&[])
    }

    /// Returns the elements' type, `None` for everything but floating-point numbers of 4 or 8 bytes.
    pub(super) fn element(&self) -> Option<Element> {
        match self.descr {
            "<f4" => Some(Element::F4),
            "<f8" => Some(Element::F8),
            ">f4" => Some(Element::F4Big),
            ">f8" => Some(Element::F8Big),
            _ => None,
        }
    }
}

impl Element {
    /// Returns the element's length in bytes.
    pub(super) fn bytes(self) -> usize {
        match self {
            Self::F4 | Self::F4Big => 4,
            Self::F8 | Self::F8Big => 8,
        }
    }

    /// Replaces `numbers` by the elements in `data`, exactly.
    pub(super) fn widen_into(self, data: &[u8], numbers: &mut Vec<f64>) {
        numbers.clear();
        let (fours, _) = data.as_chunks::<4>();
        let (eights, _) = data.as_chunks::<8>();
        match self {
            Self::F4 => numbers.extend(fours.iter().map(|b| f64::from(f32::from_le_bytes(*b)))),
            Self::F4Big => numbers.extend(fours.iter().map(|b| f64::from(f32::from_be_bytes(*b)))),
            Self::F8 => numbers.extend(eights.iter().map(|b| f64::from_le_bytes(*b))),
            Self::F8Big => numbers.extend(eights.iter().map(|b| f64::from_be_bytes(*b))),
        }
    }
}

/// Rest of a dictionary's text.
struct Text<'a>(&'a [u8]);

impl<'a> Text<'a> {
    /// Passes over white space.
    fn skip_space(&mut self) {
        while let [b' ' | b'\n' | b'\t', rest @ ..] = self.0 {
            self.0 = rest;
        }
    }

    /// Passes over `token`, if it comes next.
    fn take(&mut self, token: &[u8]) -> Option<()> {
        self.skip_space();
        self.0 = self.0.strip_prefix(token)?;
        Some(())
    }

    /// Returns whether only white space is left: up to 63 spaces, so that many at once are looked
    /// at.
    fn is_over(&self) -> bool {
        let is_other = |byte: &&u8| !matches!(byte, b' ' | b'\n' | b'\t');
        self.0.iter().filter(is_other).count() == 0
    }

    /// Reads a string without escapes.
    fn quoted(&mut self) -> Option<&'a [u8]> {
        self.skip_space();
        let (quote, rest) = self.0.split_first()?;
        let len = rest.iter().position(|byte| byte == quote)?;
        let (text, rest) = rest.split_at_checked(len)?;
        self.0 = rest.get(1..)?;
        (matches!(quote, b'\'' | b'"') && !text.contains(&b'\\')).then_some(text)
    }

    /// Reads a type: a string, or a list of fields as it is written.
    fn descr(&mut self) -> Option<&'a [u8]> {
        self.skip_space();
        if !self.0.starts_with(b"[") {
            return self.quoted();
        }
        let mut depth = 0_usize;
        let end = self.0.iter().position(|byte| {
            match byte {
                b'[' => depth += 1,
                b']' => depth -= 1,
                _ => {}
            }
            depth == 0
        })?;
        let (list, rest) = self.0.split_at_checked(end + 1)?;
        self.0 = rest;
        Some(list)
    }

    fn boolean(&mut self) -> Option<bool> {
        match self.take(b"False") {
            Some(()) => Some(false),
            None => self.take(b"True").map(|()| true),
        }
    }

    /// Reads a tuple of lengths; one of a single length ends with a comma.
    fn tuple(&mut self) -> Option<Shape> {
        let mut shape = Shape::default();
        self.take(b"(")?;
        while self.take(b")").is_none() {
            *shape.lengths.get_mut(shape.n_axes)? = self.length()?;
            shape.n_axes += 1;
            if self.take(b",").is_none() {
                self.take(b")")?;
                return (shape.n_axes > 1).then_some(shape);
            }
        }
        Some(shape)
    }

    /// Reads decimal digits, and the `L` with which Python 2 writes a long integer.
    fn length(&mut self) -> Option<u64> {
        self.skip_space();
        let (digits, mut length) = (self.0, 0_u64);
        while let [digit @ b'0'..=b'9', rest @ ..] = self.0 {
            length = length
                .checked_mul(10)?
                .checked_add(u64::from(digit - b'0'))?;
            self.0 = rest;
        }
        if self.0.len() == digits.len() {
            return None;
        }
        self.0 = self.0.strip_prefix(b"L").unwrap_or(self.0);
        Some(length)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parse(text: &str) -> Option<Header<'_>> {
        Header::from_text(text.as_bytes())
    }

    #[test]
    fn reads_numpy_files() {
        let check = |text: &str, descr: &str, fortran_order: bool, shape: &[u64]| {
            let found = parse(text).unwrap();
            assert_eq!(found.descr, descr, "{text}");
            assert_eq!(found.fortran_order, fortran_order, "{text}");
            assert_eq!(found.shape(), shape, "{text}");
        };
        check(
            "{'descr': '<f4', 'fortran_order': False, 'shape': (1, 21, 3), }           \n",
            "<f4",
            false,
            &[1, 21, 3],
        );
        check(
            "{'shape': (3,), 'fortran_order': True, \"descr\": '>f8'}",
            ">f8",
            true,
            &[3],
        );
        check(
            "{'descr': '<f8', 'fortran_order': False, 'shape': (70L, 21L, 3L), }",
            "<f8",
            false,
            &[70, 21, 3],
        );
        check(
            "{'descr': '<f4', 'fortran_order': False, 'shape': (7L,), }",
            "<f4",
            false,
            &[7],
        );
        check(
            "{'descr': '|b1', 'fortran_order': False, 'shape': ()}",
            "|b1",
            false,
            &[],
        );
        check(
            "{'descr': [('a', '<f4'), ('b', [('c', '|O')])], 'fortran_order': False, 'shape': (0, 2)}",
            "[('a', '<f4'), ('b', [('c', '|O')])]",
            false,
            &[0, 2],
        );
    }

    #[test]
    fn refuses_headers_numpy_does_not_write() {
        for text in [
            "",
            "{}",
            "{'descr': '<f4', 'fortran_order': False}",
            "{'descr': '<f4', 'fortran_order': False, 'shape': (1,)",
            "{'descr': '<f4', 'fortran_order': False, 'shape': (1)}",
            "{'descr': '<f4', 'fortran_order': False, 'shape': (1,,)}",
            "{'descr': '<f4', 'fortran_order': False, 'shape': (-1,)}",
            "{'descr': '<f4', 'fortran_order': False, 'shape': (L,)}",
            "{'descr': '<f4', 'fortran_order': False, 'shape': (1LL,)}",
            "{'descr': '<f4', 'fortran_order': False, 'shape': (1l,)}",
            "{'descr': '<f4', 'fortran_order': False, 'shape': (+1,)}",
            "{'descr': '<f4', 'fortran_order': False, 'shape': (99999999999999999999,)}",
            "{'descr': '<f4', 'fortran_order': False, 'shape': [1]}",
            "{'descr': '<f4', 'fortran_order': 0, 'shape': (1,)}",
            "{'descr': '<f\\x34', 'fortran_order': False, 'shape': (1,)}",
            "{'descr': [[['<f4', 'fortran_order': False, 'shape': (1,)}",
            "{'descr': '<f4', 'descr': '<f4', 'fortran_order': False, 'shape': (1,)}",
            "{'descr': '<f4', 'fortran_order': True, 'fortran_order': False, 'shape': (1,)}",
            "{'descr': '<f4', 'fortran_order': False, 'shape': (1,), 'shape': (2,)}",
            "{'descr': '<f4', 'fortran_order': False, 'shape': (1,), 'more': 1}",
            "{'descr': '<f4', 'fortran_order': False, 'shape': (1,)} x",
            "{'descr': '<f4' 'fortran_order': False, 'shape': (1,)}",
        ] {
            assert_eq!(parse(text), None, "{text}");
        }
        let axes = "1, ".repeat(MAX_AXES + 1);
        let text = format!("{{'descr': '<f4', 'fortran_order': False, 'shape': ({axes})}}");
        assert_eq!(parse(&text), None);
    }
}
