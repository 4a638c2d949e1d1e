//! Points of a PLY file, text and binary (Turk, "The PLY polygon file format", 1994).

use crate::error::Fault;

/// Ends the header.
const END: &[u8] = b"end_header";
/// Longest accepted header, in bytes.
const MAX_HEADER_BYTES: usize = 1 << 16;
/// What a file is expected to be, for messages.
const EXPECTED: &str = "PLY whose first element is `vertex`, with numbers x, y and z";

/// Returns the coordinates of the vertices, as they are. Their other properties are passed over, and so are the elements
/// after them, as the faces of a meshed depth image.
pub(crate) fn points(bytes: &[u8]) -> Result<Vec<[f64; 3]>, Fault> {
    if !bytes.starts_with(b"ply") {
        return Err(Fault::unsupported("no PLY signature", EXPECTED));
    }
    let start = bytes.get(..MAX_HEADER_BYTES).unwrap_or(bytes);
    let length = start.windows(END.len()).position(|window| window == END);
    let (head, after) = length
        .and_then(|length| bytes.split_at_checked(length + END.len()))
        .ok_or_else(Fault::cut_off)?;
    let after = after.strip_prefix(b"\r").unwrap_or(after);
    let body = after.strip_prefix(b"\n").unwrap_or(after);
    let header = Header::parse(&String::from_utf8_lossy(head))?;
    // Memory grows with what is read, not with what is announced.
    match header.form {
        Form::Text => {
            let text = str::from_utf8(body).ok();
            let mut words = text
                .ok_or_else(|| Fault::damaged("its text"))?
                .split_whitespace();
            let mut next = |_| {
                let number = words.next().ok_or_else(Fault::cut_off)?.parse();
                number
                    .ok()
                    .ok_or_else(|| Fault::damaged("a word is no number"))
            };
            (0..header.vertices_n)
                .map(|_| header.point(&mut next))
                .collect()
        }
        form => {
            let mut rest = body;
            let mut next = |scalar: Scalar| {
                let own = rest.split_at_checked(scalar.bytes_n());
                let (own, after) = own.ok_or_else(Fault::cut_off)?;
                rest = after;
                let join = |bits: u64, &byte: &u8| bits << 8 | u64::from(byte);
                Ok(scalar.number(match form {
                    Form::BigEndian => own.iter().fold(0, join),
                    Form::LittleEndian | Form::Text => own.iter().rev().fold(0, join),
                }))
            };
            (0..header.vertices_n)
                .map(|_| header.point(&mut next))
                .collect()
        }
    }
}

/// How numbers are written.
#[derive(Clone, Copy)]
enum Form {
    Text,
    LittleEndian,
    BigEndian,
}

/// Kind of a number; whole ones have this many bits.
#[derive(Clone, Copy)]
enum Scalar {
    Signed(u32),
    Unsigned(u32),
    Float,
    Double,
}

impl Scalar {
    fn parse(name: &str) -> Option<Self> {
        Some(match name {
            "char" | "int8" => Self::Signed(8),
            "short" | "int16" => Self::Signed(16),
            "int" | "int32" => Self::Signed(32),
            "uchar" | "uint8" => Self::Unsigned(8),
            "ushort" | "uint16" => Self::Unsigned(16),
            "uint" | "uint32" => Self::Unsigned(32),
            "float" | "float32" => Self::Float,
            "double" | "float64" => Self::Double,
            _ => return None,
        })
    }

    fn bytes_n(self) -> usize {
        match self {
            Self::Signed(bits) | Self::Unsigned(bits) => bits as usize / 8,
            Self::Float => 4,
            Self::Double => 8,
        }
    }

    /// Returns the number of these bits, in the low end of `bits`.
    fn number(self, bits: u64) -> f64 {
        #[expect(
            clippy::cast_possible_truncation,
            reason = "a float has 32 bits, and no more are read"
        )]
        match self {
            Self::Unsigned(_) => bits as f64,
            // The sign moves to the top and back.
            Self::Signed(n) => ((bits << (64 - n)).cast_signed() >> (64 - n)) as f64,
            Self::Float => f64::from(f32::from_bits(bits as u32)),
            Self::Double => f64::from_bits(bits),
        }
    }
}

struct Header {
    form: Form,
    vertices_n: u64,
    /// Kinds of a vertex's numbers, and the axis if it is a coordinate.
    properties: Vec<(Scalar, Option<usize>)>,
}

impl Header {
    fn parse(text: &str) -> Result<Self, Fault> {
        let damaged = || Fault::damaged("its header");
        let (mut form, mut vertices_n) = (None, None);
        let mut properties = Vec::new();
        for line in text.lines().skip(1) {
            let words: Vec<&str> = line.split_whitespace().collect();
            match *words.as_slice() {
                ["comment" | "obj_info", ..] | ["end_header"] | [] => {}
                ["format", "ascii", _] => form = Some(Form::Text),
                ["format", "binary_little_endian", _] => form = Some(Form::LittleEndian),
                ["format", "binary_big_endian", _] => form = Some(Form::BigEndian),
                ["element", "vertex", count] if vertices_n.is_none() => {
                    vertices_n = Some(count.parse().ok().ok_or_else(damaged)?);
                }
                // What comes after the vertices is not read.
                ["element", ..] if vertices_n.is_some() => break,
                ["element", name, ..] => {
                    let found = format!("an element `{name}` first");
                    return Err(Fault::unsupported(found, EXPECTED));
                }
                ["property", "list", ..] => {
                    return Err(Fault::unsupported("a list in each vertex", EXPECTED));
                }
                ["property", scalar, name] => {
                    let axis = ["x", "y", "z"].iter().position(|axis| *axis == name);
                    properties.push((Scalar::parse(scalar).ok_or_else(damaged)?, axis));
                }
                _ => return Err(damaged()),
            }
        }
        for (idx, axis) in ["x", "y", "z"].iter().enumerate() {
            if properties.iter().all(|&(_, axis)| axis != Some(idx)) {
                let found = format!("no number `{axis}` in a vertex");
                return Err(Fault::unsupported(found, EXPECTED));
            }
        }
        Ok(Self {
            form: form.ok_or_else(damaged)?,
            vertices_n: vertices_n.ok_or_else(damaged)?,
            properties,
        })
    }

    /// Reads a vertex from the numbers that `next` gives.
    fn point(
        &self,
        next: &mut impl FnMut(Scalar) -> Result<f64, Fault>,
    ) -> Result<[f64; 3], Fault> {
        let mut point = [0.0; 3];
        for &(scalar, axis) in &self.properties {
            let number = next(scalar)?;
            if let Some(axis) = axis {
                point[axis] = number;
            }
        }
        Ok(point)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fixture::{PlyForm, mutated, ply};

    const POINTS: [[f64; 3]; 3] = [[0.5, -1.25, 2.0], [0.0, 3.5, -4.0], [1.0, 2.0, 3.0]];
    const FORMS: [PlyForm; 3] = [PlyForm::Text, PlyForm::Little, PlyForm::Big];

    #[test]
    fn every_form_is_read_alike() {
        for form in FORMS {
            assert_eq!(points(&ply(&POINTS, form)).unwrap(), POINTS);
        }
        let text = String::from_utf8(ply(&POINTS, PlyForm::Text)).unwrap();
        let crlf = text.replace('\n', "\r\n");
        assert_eq!(points(crlf.as_bytes()).unwrap(), POINTS);
        // Faces, as of a meshed depth image, and numbers in another order.
        let text = "ply\nformat ascii 1.0\nelement vertex 1\nproperty double z\n\
                    property double y\nproperty int8 x\nelement face 1\n\
                    property list uchar int vertex_indices\nend_header\n\
                    3.5 2 -1\n3 0 0 0\n";
        assert_eq!(points(text.as_bytes()).unwrap(), [[-1.0, 2.0, 3.5]]);
        let nan = text.replace("3.5 2 -1", "nan nan nan");
        assert!(points(nan.as_bytes()).unwrap()[0][2].is_nan());
    }

    #[test]
    fn says_what_is_wrong_with_other_files() {
        let text = String::from_utf8(ply(&POINTS, PlyForm::Text)).unwrap();
        let endless = "element vertex 99999999999999999";
        for (from, to, expected) in [
            ("ply", "PLY!", "no PLY signature"),
            ("property double y", "property double v", "no number `y`"),
            ("property double y", "property quad y", "its header"),
            (
                "element vertex 3",
                "element point 3",
                "an element `point` first",
            ),
            ("element vertex 3", "element vertex 4", "ends early"),
            ("element vertex 3", endless, "ends early"),
            ("element vertex 3", "element vertex -3", "its header"),
            ("format ascii 1.0\n", "", "its header"),
            ("ascii", "gzip", "its header"),
            (
                "property double y",
                "property list uchar int y",
                "a list in each vertex",
            ),
            ("-1.25", "-1,25", "a word is no number"),
            ("end_header", "header_end", "ends early"),
        ] {
            let said = points(text.replacen(from, to, 1).as_bytes()).unwrap_err();
            let said = said.to_string();
            assert!(said.contains(expected), "{from} → {to}: {said}");
        }
        let binary = ply(&POINTS, PlyForm::Little);
        let said = points(&binary[..binary.len() - 1]).unwrap_err();
        assert_eq!(said.to_string(), "ends early");
    }

    #[test]
    fn no_byte_of_a_file_makes_it_panic() {
        for form in FORMS {
            for bytes in mutated(&ply(&POINTS, form), 3000) {
                if let Ok(points) = points(&bytes) {
                    assert!(points.len() <= bytes.len());
                }
            }
        }
    }
}
