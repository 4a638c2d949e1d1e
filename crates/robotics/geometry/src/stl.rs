//! Reading STL, both kinds.

use std::collections::BTreeMap;

use nalgebra::Point3;

use crate::{GeometryError, TriMesh, read::text_of, repair::repaired};

/// Bytes before the number of triangles of a binary file.
const HEADER: usize = 80;
/// Bytes of one triangle of a binary file: a normal, three corners and two bytes of anything.
const TRIANGLE: usize = 50;

impl TriMesh {
    /// Reads an STL file, binary or text, as [`TriMesh::read`] does.
    ///
    /// # Errors
    ///
    /// Fails as [`TriMesh::read`].
    pub fn from_stl(bytes: &[u8]) -> Result<Self, GeometryError> {
        Ok(repaired(parsed(bytes)?).0)
    }
}

/// Reads the triangles, as they are.
///
/// Corners at equal places become one, normals and names are dropped, and triangles with two equal
/// corners are left out.
pub(crate) fn parsed(bytes: &[u8]) -> Result<TriMesh, GeometryError> {
    let decoded = text_of(bytes);
    let is_text = || {
        let word = decoded.trim_start().get(..5);
        word.is_some_and(|word| word.eq_ignore_ascii_case("solid"))
    };
    let (corners, expected) = match binary_length(bytes) {
        Some(length) if length == bytes.len() => (binary(bytes), length),
        // Binary files may begin with `solid`, too, but then their length fits.
        Some(_) | None if is_text() => (text(&decoded)?, bytes.len()),
        Some(length) => (binary(bytes), length),
        None => (Vec::new(), HEADER + 4),
    };
    if expected > bytes.len() {
        return Err(GeometryError::CutOff {
            expected,
            found: bytes.len(),
        });
    }
    let mut known: BTreeMap<[u64; 3], u32> = BTreeMap::new();
    let mut mesh = TriMesh {
        vertices_m: Vec::new(),
        triangles: Vec::new(),
    };
    for corners in corners {
        let triangle = corners.map(|corner| {
            // `+ 0.0` makes −0 equal to 0.
            let key = [corner.x, corner.y, corner.z].map(|x| (x + 0.0).to_bits());
            *known.entry(key).or_insert_with(|| {
                mesh.vertices_m.push(corner);
                u32::try_from(mesh.vertices_m.len() - 1).unwrap_or(u32::MAX)
            })
        });
        let [a, b, c] = triangle;
        if a != b && b != c && c != a {
            mesh.triangles.push(triangle);
        }
    }
    let mut numbers = mesh.vertices_m.iter().flat_map(Point3::iter);
    if let Some(&found) = numbers.find(|number| !number.is_finite()) {
        return Err(GeometryError::NotFinite { found });
    }
    if mesh.triangles.is_empty() {
        return Err(GeometryError::NoTriangles);
    }
    Ok(mesh)
}

/// Returns how long a binary file with this beginning is; `None` if that is too short.
fn binary_length(bytes: &[u8]) -> Option<usize> {
    let count = bytes.get(HEADER..HEADER + 4)?;
    let count = u32::from_le_bytes(count.try_into().ok()?);
    let triangles = usize::try_from(count).ok()?.checked_mul(TRIANGLE)?;
    triangles.checked_add(HEADER + 4)
}

/// Returns the corners of the triangles of a binary file.
fn binary(bytes: &[u8]) -> Vec<[Point3<f64>; 3]> {
    let (triangles, _) = bytes
        .get(HEADER + 4..)
        .unwrap_or_default()
        .as_chunks::<TRIANGLE>();
    let corners = |triangle: &[u8; TRIANGLE]| {
        let (numbers, _) = triangle.as_chunks::<4>();
        let number = |idx: usize| {
            let bytes = numbers.get(idx).copied().unwrap_or_default();
            f64::from(f32::from_le_bytes(bytes))
        };
        // The first three are the normal.
        [3, 6, 9].map(|idx| Point3::new(number(idx), number(idx + 1), number(idx + 2)))
    };
    triangles.iter().map(corners).collect()
}

/// Returns the corners of the triangles of a file of text.
fn text(text: &str) -> Result<Vec<[Point3<f64>; 3]>, GeometryError> {
    let mut triangles = Vec::new();
    let mut corners: Vec<Point3<f64>> = Vec::new();
    for (line, content) in crate::obj::lines(text) {
        let mut words = content.split_whitespace();
        match words.next().map(str::to_ascii_lowercase).as_deref() {
            Some("vertex") => corners.push(crate::obj::vertex(words, line)?),
            Some("endloop") => match *corners.as_slice() {
                [a, b, c] => {
                    triangles.push([a, b, c]);
                    corners.clear();
                }
                ref other => {
                    return Err(GeometryError::ShortFace {
                        line,
                        found: other.len(),
                    });
                }
            },
            _ => {}
        }
    }
    Ok(triangles)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn cube() -> TriMesh {
        TriMesh::cuboid(Point3::new(-0.5, 0.0, 1.0), Point3::new(0.5, 0.25, 4.0))
    }

    /// Numbers that single precision holds, so that reading gives back what was written.
    fn as_binary(mesh: &TriMesh, header: &[u8]) -> Vec<u8> {
        let mut bytes = header.to_vec();
        bytes.resize(HEADER, b' ');
        bytes.extend(u32::try_from(mesh.triangles.len()).unwrap().to_le_bytes());
        for &triangle in &mesh.triangles {
            bytes.extend([0; 12]);
            for corner in mesh.corners(triangle) {
                for number in corner.iter() {
                    #[expect(clippy::cast_possible_truncation, reason = "as the format has it")]
                    bytes.extend((*number as f32).to_le_bytes());
                }
            }
            bytes.extend([7, 7]);
        }
        bytes
    }

    fn as_text(mesh: &TriMesh) -> String {
        let mut text = "solid a cube\n".to_owned();
        for &triangle in &mesh.triangles {
            text += "  facet normal 0 0 0\n    outer loop\n";
            for corner in mesh.corners(triangle) {
                text += &format!("      vertex {} {} {:e}\r\n", corner.x, corner.y, corner.z);
            }
            text += "    endloop\n  endfacet\n";
        }
        text + "endsolid a cube\n"
    }

    #[test]
    fn reads_both_kinds_alike() {
        let cube = cube();
        let mut longer = as_binary(&cube, b"made by hand");
        longer.extend(b"and something after it");
        for (kind, bytes) in [
            ("binary", as_binary(&cube, b"made by hand")),
            (
                "binary that says solid",
                as_binary(&cube, b"solid, and yet not text"),
            ),
            ("binary with a tail", longer),
            ("text", as_text(&cube).into_bytes()),
            (
                "text in upper case",
                as_text(&cube).to_uppercase().into_bytes(),
            ),
            (
                "text of mixed case",
                as_text(&cube)
                    .replace("vertex", "Vertex")
                    .replace("endloop", "EndLoop")
                    .into_bytes(),
            ),
            (
                "text after a byte order mark",
                format!("\u{feff}{}", as_text(&cube)).into_bytes(),
            ),
            (
                "text with a name in Latin-1",
                [b"solid Geh\xe4use\n", as_text(&cube).as_bytes()].concat(),
            ),
            (
                "indented text",
                format!("\n {}", as_text(&cube)).into_bytes(),
            ),
        ] {
            let mesh = TriMesh::from_stl(&bytes).unwrap();
            assert_eq!(
                (mesh.vertices_m.len(), mesh.triangles.len()),
                (8, 12),
                "{kind}"
            );
            assert!(mesh.is_watertight(), "{kind}");
            assert!((mesh.volume_m3() - 0.75).abs() < 1e-9, "{kind}");
            assert_eq!(mesh.bounds(), cube.bounds(), "{kind}");
        }
    }

    #[test]
    fn turns_a_mesh_that_winds_inward() {
        let mut inward = cube();
        for triangle in &mut inward.triangles {
            triangle.swap(0, 1);
        }
        let mesh = TriMesh::from_stl(as_text(&inward).as_bytes()).unwrap();
        assert!(mesh.volume_m3() > 0.0);
    }

    #[test]
    fn refuses_unusable_lines_with_their_place() {
        let refuses = |bytes: &[u8], expected: &GeometryError| {
            assert_eq!(TriMesh::from_stl(bytes).unwrap_err(), *expected);
        };
        let whole = as_binary(&cube(), b"");
        let cut = whole.len() - 1;
        refuses(
            &whole[..cut],
            &GeometryError::CutOff {
                expected: whole.len(),
                found: cut,
            },
        );
        for short in [&b""[..], b"PK", &whole[..60]] {
            refuses(
                short,
                &GeometryError::CutOff {
                    expected: 84,
                    found: short.len(),
                },
            );
        }
        let mut endless = whole.clone();
        endless[96..100].copy_from_slice(&f32::INFINITY.to_le_bytes());
        refuses(
            &endless,
            &GeometryError::NotFinite {
                found: f64::INFINITY,
            },
        );
        let text = as_text(&cube());
        refuses(
            text.replacen("-0.5", "x", 1).as_bytes(),
            &GeometryError::NotANumber {
                line: 4,
                found: "x".to_owned(),
            },
        );
        refuses(
            text.replacen("      vertex", "      ver", 1).as_bytes(),
            &GeometryError::ShortFace { line: 7, found: 2 },
        );
        refuses(b"solid nothing\nendsolid\n", &GeometryError::NoTriangles);
        refuses(
            &as_binary(
                &TriMesh {
                    vertices_m: vec![],
                    triangles: vec![],
                },
                b"",
            ),
            &GeometryError::NoTriangles,
        );
    }
}
