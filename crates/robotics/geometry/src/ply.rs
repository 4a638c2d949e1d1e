//! Reading PLY, text and binary.

use nalgebra::Point3;

use crate::{
    GeometryError, TriMesh,
    obj::{add_face, quoted},
    read::text_of,
};

/// Ends the header.
const END: &[u8] = b"end_header";

/// Reads the vertices and faces, as they are; all else, e.g. colors and normals, is passed over
/// (Turk, "The PLY polygon file format", 1994).
pub(crate) fn parsed(bytes: &[u8]) -> Result<TriMesh, GeometryError> {
    let head_length = bytes.windows(END.len()).position(|window| window == END);
    let cut_off = GeometryError::CutOff {
        expected: bytes.len() + 1,
        found: bytes.len(),
    };
    let (head, after) = head_length
        .and_then(|length| bytes.split_at_checked(length + END.len()))
        .ok_or_else(|| cut_off.clone())?;
    let after = after.strip_prefix(b"\r").unwrap_or(after);
    let body = after.strip_prefix(b"\n").unwrap_or(after);
    let header = Header::parse(&text_of(head))?;
    let mut mesh = TriMesh {
        vertices_m: Vec::new(),
        triangles: Vec::new(),
    };
    let text;
    let mut numbers = match header.form {
        Form::Text => {
            text = text_of(body);
            Numbers::Text {
                words: text.split_whitespace(),
            }
        }
        form => Numbers::Binary { bytes: body, form },
    };
    for element in &header.elements {
        for idx in 0..element.count {
            let entry = element.read(&mut numbers).ok_or_else(|| cut_off.clone())?;
            // Lines of a text, and elements of a binary file, count from the header on.
            let line = header.lines + idx + 1;
            match element.name.as_str() {
                "vertex" => {
                    let [Some(x), Some(y), Some(z)] = entry.place else {
                        return Err(GeometryError::ShortVertex { line, found: 0 });
                    };
                    let numbers = [x, y, z];
                    if let Some(&found) = numbers.iter().find(|number| !number.is_finite()) {
                        return Err(GeometryError::NotFinite { found });
                    }
                    mesh.vertices_m.push(Point3::from(numbers));
                }
                "face" => {
                    let vertices = mesh.vertices_m.len();
                    let corner = |&index: &f64| {
                        #[expect(
                            clippy::cast_possible_truncation,
                            clippy::cast_sign_loss,
                            reason = "checked against the number of vertices"
                        )]
                        if index >= 0.0 && index < vertices as f64 {
                            Ok(index as u32)
                        } else {
                            let index = index as i64;
                            Err(GeometryError::IndexOutOfRange {
                                line,
                                index,
                                vertices,
                            })
                        }
                    };
                    let corners: Result<Vec<u32>, _> = entry.corners.iter().map(corner).collect();
                    add_face(&mut mesh, &corners?, line)?;
                }
                _ => {}
            }
        }
    }
    if mesh.triangles.is_empty() {
        return Err(GeometryError::NoTriangles);
    }
    Ok(mesh)
}

/// How numbers are written.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Form {
    Text,
    LittleEndian,
    BigEndian,
}

/// Bytes and kind of a number.
#[derive(Debug, Clone, Copy)]
enum Scalar {
    Signed(usize),
    Unsigned(usize),
    Float(usize),
}

impl Scalar {
    fn parse(name: &str) -> Option<Self> {
        Some(match name {
            "char" | "int8" => Self::Signed(1),
            "short" | "int16" => Self::Signed(2),
            "int" | "int32" => Self::Signed(4),
            "uchar" | "uint8" => Self::Unsigned(1),
            "ushort" | "uint16" => Self::Unsigned(2),
            "uint" | "uint32" => Self::Unsigned(4),
            "float" | "float32" => Self::Float(4),
            "double" | "float64" => Self::Float(8),
            _ => return None,
        })
    }
}

struct Property {
    name: String,
    /// What a list's length is written as, where it is a list.
    length: Option<Scalar>,
    scalar: Scalar,
}

struct Element {
    name: String,
    count: usize,
    properties: Vec<Property>,
}

/// What is read of one vertex or face.
#[derive(Default)]
struct Entry {
    place: [Option<f64>; 3],
    corners: Vec<f64>,
}

impl Element {
    fn read(&self, numbers: &mut Numbers<'_>) -> Option<Entry> {
        let mut entry = Entry::default();
        for property in &self.properties {
            let Some(length) = property.length else {
                let number = numbers.next(property.scalar)?;
                let axis = ["x", "y", "z"]
                    .iter()
                    .position(|axis| *axis == property.name);
                if let Some(place) = axis.and_then(|axis| entry.place.get_mut(axis)) {
                    *place = Some(number);
                }
                continue;
            };
            let are_corners = matches!(property.name.as_str(), "vertex_indices" | "vertex_index");
            #[expect(
                clippy::cast_possible_truncation,
                clippy::cast_sign_loss,
                reason = "a length beyond the file ends it early"
            )]
            let length = numbers.next(length)?.max(0.0) as u64;
            for _ in 0..length {
                let number = numbers.next(property.scalar)?;
                if are_corners {
                    entry.corners.push(number);
                }
            }
        }
        Some(entry)
    }
}

struct Header {
    form: Form,
    elements: Vec<Element>,
    /// Number of its lines.
    lines: usize,
}

impl Header {
    fn parse(text: &str) -> Result<Self, GeometryError> {
        let mut form = None;
        let mut elements: Vec<Element> = Vec::new();
        let mut lines = 0;
        for content in text.lines() {
            lines += 1;
            let words: Vec<&str> = content.split_whitespace().collect();
            let understood = match *words.as_slice() {
                ["ply"] if lines == 1 => Some(()),
                ["end_header"] | ["comment" | "obj_info", ..] | [] => (lines > 1).then_some(()),
                ["format", name, _version] => {
                    form = match name {
                        "ascii" => Some(Form::Text),
                        "binary_little_endian" => Some(Form::LittleEndian),
                        "binary_big_endian" => Some(Form::BigEndian),
                        _ => None,
                    };
                    form.map(|_| ())
                }
                ["element", name, count] => count.parse().ok().map(|count| {
                    elements.push(Element {
                        name: name.to_owned(),
                        count,
                        properties: Vec::new(),
                    });
                }),
                ["property", "list", length, scalar, name] => {
                    add(&mut elements, name, Some(length), scalar)
                }
                ["property", scalar, name] => add(&mut elements, name, None, scalar),
                _ => None,
            };
            understood.ok_or_else(|| GeometryError::BadHeader {
                line: lines,
                found: quoted(content.trim()),
            })?;
        }
        match form {
            Some(form) if elements.iter().all(|element| !element.is_endless()) => Ok(Self {
                form,
                elements,
                lines,
            }),
            _ => Err(GeometryError::BadHeader {
                line: lines,
                found: "end_header".to_owned(),
            }),
        }
    }
}

impl Element {
    /// Says whether any number of them takes no bytes.
    fn is_endless(&self) -> bool {
        self.properties.is_empty() && self.count > 0
    }
}

/// Adds a property to the last element.
fn add(elements: &mut [Element], name: &str, length: Option<&str>, scalar: &str) -> Option<()> {
    let length = match length {
        Some(length) => Some(Scalar::parse(length)?),
        None => None,
    };
    elements.last_mut()?.properties.push(Property {
        name: name.to_owned(),
        length,
        scalar: Scalar::parse(scalar)?,
    });
    Some(())
}

/// The numbers after the header.
enum Numbers<'a> {
    Text {
        words: std::str::SplitWhitespace<'a>,
    },
    Binary {
        bytes: &'a [u8],
        form: Form,
    },
}

impl Numbers<'_> {
    /// Returns the next number; `None` at the end. A word that is none is not a number.
    fn next(&mut self, scalar: Scalar) -> Option<f64> {
        let (bytes, form) = match self {
            Self::Text { words } => return Some(words.next()?.parse().unwrap_or(f64::NAN)),
            Self::Binary { bytes, form } => (bytes, *form),
        };
        let size = match scalar {
            Scalar::Signed(size) | Scalar::Unsigned(size) | Scalar::Float(size) => size,
        };
        let (own, rest) = bytes.split_at_checked(size)?;
        *bytes = rest;
        let mut wide = [0; 8];
        let ordered: Vec<u8> = match form {
            Form::BigEndian => own.iter().rev().copied().collect(),
            Form::LittleEndian | Form::Text => own.to_vec(),
        };
        for (to, from) in wide.iter_mut().zip(ordered) {
            *to = from;
        }
        let bits = u64::from_le_bytes(wide);
        let unused = 64 - 8 * u32::try_from(size).ok()?;
        Some(match scalar {
            Scalar::Unsigned(_) => bits as f64,
            // The sign moves to the top and back.
            Scalar::Signed(_) => ((bits << unused).cast_signed() >> unused) as f64,
            Scalar::Float(4) => f64::from(f32::from_bits(u32::try_from(bits).ok()?)),
            Scalar::Float(_) => f64::from_bits(bits),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cube() -> TriMesh {
        TriMesh::cuboid(Point3::new(-0.5, 0.0, 1.0), Point3::new(0.5, 0.25, 4.0))
    }

    const HEAD: &str = "comment Größe\nelement vertex 8\nproperty float x\nproperty double y\n\
                        property float z\nproperty uchar red\nelement edge 1\nproperty int a\n\
                        element face 12\nproperty list uchar int vertex_indices\n\
                        property short flags\nend_header\n";

    fn as_text(end: &str) -> Vec<u8> {
        let mut text = format!("ply\nformat ascii 1.0\n{HEAD}");
        for v in cube().vertices_m {
            text += &format!("{} {} {} 255\n", v.x, v.y, v.z);
        }
        text += "7\n";
        for [a, b, c] in cube().triangles {
            text += &format!("3 {a} {b} {c} -1\n");
        }
        text.replace('\n', end).into_bytes()
    }

    fn as_binary(big: bool) -> Vec<u8> {
        let order = if big { "big" } else { "little" };
        let mut bytes = format!("ply\nformat binary_{order}_endian 1.0\n{HEAD}").into_bytes();
        let mut put = |little: &[u8]| {
            if big {
                bytes.extend(little.iter().rev());
            } else {
                bytes.extend(little);
            }
        };
        for v in cube().vertices_m {
            put(&(v.x as f32).to_le_bytes());
            put(&v.y.to_le_bytes());
            put(&(v.z as f32).to_le_bytes());
            put(&[255]);
        }
        put(&7_i32.to_le_bytes());
        for triangle in cube().triangles {
            put(&[3]);
            for corner in triangle {
                put(&corner.to_le_bytes());
            }
            put(&(-1_i16).to_le_bytes());
        }
        bytes
    }

    #[test]
    fn reads_every_form_alike() {
        let files = [
            as_text("\n"),
            as_text("\r\n"),
            as_binary(false),
            as_binary(true),
        ];
        for bytes in files {
            assert_eq!(parsed(&bytes).unwrap(), cube());
        }
    }

    #[test]
    fn refuses_unusable_files() {
        let whole = as_binary(false);
        for end in [0, 3, 100, whole.len() - 1] {
            let said = parsed(&whole[..end]).unwrap_err();
            assert!(
                matches!(said, GeometryError::CutOff { .. }),
                "{end}: {said}"
            );
        }
        let text = String::from_utf8(as_text("\n")).unwrap();
        for (from, to, expected) in [
            (
                "double",
                "quadruple",
                "line 6: `property quadruple y` is not understood",
            ),
            (
                "ascii",
                "gzip",
                "line 2: `format gzip 1.0` is not understood",
            ),
            ("-0.5 0 1", "x 0 1", "a coordinate is NaN"),
            ("3 0 2 1", "3 0 2 8", "line 15: vertex 8 does not exist"),
            ("3 0 2 1", "3 0 2 -1", "line 15: vertex -1 does not exist"),
            (
                "3 0 2 1",
                "2 0 2 1",
                "line 15: a face needs three corners, found 2",
            ),
            (
                "property float x",
                "property float u",
                "line 15: a vertex needs three numbers",
            ),
            (
                "element vertex 8",
                "element vertex 99999999999",
                "bytes, expected",
            ),
        ] {
            let said = parsed(text.replacen(from, to, 1).as_bytes())
                .unwrap_err()
                .to_string();
            assert!(said.contains(expected), "{from} → {to}: {said}");
        }
        let endless = "ply\nformat ascii 1.0\nelement x 99999999999999\nend_header\n";
        assert!(parsed(endless.as_bytes()).is_err());
    }
}
