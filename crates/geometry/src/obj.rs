//! Reading and writing Wavefront OBJ.

use std::fmt::Write;

use nalgebra::Point3;

use crate::{GeometryError, TriMesh};

/// Maximum number of characters of a word that a message quotes.
const MAX_QUOTED: usize = 40;

impl TriMesh {
    /// Reads the vertices and faces of a Wavefront OBJ file.
    ///
    /// Polygons become fans, texture and normal indices are dropped, lines of other kinds are
    /// passed over, triangles that name a vertex twice are left out, and a closed mesh that winds
    /// inward is turned outward.
    ///
    /// # Errors
    ///
    /// Fails with the line's number on a number that is not finite, a vertex or face that is too
    /// short, and an index that is zero or beyond the vertices read so far; and if there is no
    /// triangle at all.
    pub fn from_obj(text: &str) -> Result<Self, GeometryError> {
        let mut mesh = Self {
            vertices_m: Vec::new(),
            triangles: Vec::new(),
        };
        for (idx, content) in text.lines().enumerate() {
            let line = idx + 1;
            let content = content.split('#').next().unwrap_or_default();
            let mut words = content.split_whitespace();
            match words.next() {
                Some("v") => mesh.vertices_m.push(vertex(words, line)?),
                Some("f") => {
                    let corners = words
                        .map(|word| corner(word, line, mesh.vertices_m.len()))
                        .collect::<Result<Vec<_>, _>>()?;
                    let [first, rest @ ..] = corners.as_slice() else {
                        return Err(GeometryError::ShortFace { line, found: 0 });
                    };
                    if rest.len() < 2 {
                        let found = corners.len();
                        return Err(GeometryError::ShortFace { line, found });
                    }
                    let fan = rest.iter().zip(rest.iter().skip(1));
                    mesh.triangles.extend(
                        fan.map(|(&b, &c)| [*first, b, c])
                            .filter(|[a, b, c]| a != b && b != c && c != a),
                    );
                }
                _ => {}
            }
        }
        if mesh.triangles.is_empty() {
            return Err(GeometryError::NoTriangles);
        }
        mesh.turn_outward();
        Ok(mesh)
    }

    /// Writes the mesh as Wavefront OBJ, coordinates in meters with nine digits.
    pub fn to_obj(&self) -> String {
        let mut text = String::with_capacity(40 * (self.vertices_m.len() + self.triangles.len()));
        for v in &self.vertices_m {
            // Writing to a string cannot fail.
            let _ = writeln!(text, "v {:.9} {:.9} {:.9}", v.x + 0.0, v.y + 0.0, v.z + 0.0);
        }
        for triangle in &self.triangles {
            let [a, b, c] = triangle.map(|idx| idx + 1);
            let _ = writeln!(text, "f {a} {b} {c}");
        }
        text
    }
}

/// Reads the three coordinates of a vertex's line; weights and colors after them are ignored.
pub(crate) fn vertex<'a>(
    words: impl Iterator<Item = &'a str>,
    line: usize,
) -> Result<Point3<f64>, GeometryError> {
    let numbers = words
        .take(3)
        .map(|word| {
            word.parse::<f64>()
                .ok()
                .filter(|number| number.is_finite())
                .ok_or_else(|| GeometryError::NotANumber {
                    line,
                    found: quoted(word),
                })
        })
        .collect::<Result<Vec<_>, _>>()?;
    match numbers.as_slice() {
        &[x, y, z] => Ok(Point3::new(x, y, z)),
        short => Err(GeometryError::ShortVertex {
            line,
            found: short.len(),
        }),
    }
}

/// Reads one corner of an `f` line, `v`, `v/vt`, `v//vn` or `v/vt/vn`, as an index from zero.
fn corner(word: &str, line: usize, vertices: usize) -> Result<u32, GeometryError> {
    let written = word.split('/').next().unwrap_or_default();
    let index: i64 = written
        .parse()
        .map_err(|_unreadable| GeometryError::NotAnIndex {
            line,
            found: quoted(word),
        })?;
    let count = i64::try_from(vertices).unwrap_or(i64::MAX);
    // Negative indices count back from the last vertex read.
    let from_zero = if index < 0 {
        count.saturating_add(index)
    } else {
        index - 1
    };
    u32::try_from(from_zero)
        .ok()
        .filter(|_| from_zero < count)
        .ok_or(GeometryError::IndexOutOfRange {
            line,
            index,
            vertices,
        })
}

/// Returns a word for a message, cut where it is too long for one.
fn quoted(word: &str) -> String {
    match word.char_indices().nth(MAX_QUOTED) {
        Some((end, _)) => format!("{}…", word.get(..end).unwrap_or_default()),
        None => word.to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const CORNERS: &str = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n";

    fn refuses(text: &str, expected: &GeometryError) {
        assert_eq!(TriMesh::from_obj(text).unwrap_err(), *expected, "{text}");
    }

    #[test]
    fn reads_every_way_of_writing_a_face() {
        for faces in [
            "f 1 2 3 4",
            "f 1/1 2/7 3/3 4/4",
            "f 1//1 2//9 3//1 4//1",
            "f 1/1/1 2/2/2 3/3/3 4/4/4",
            "f -4 -3 -2 -1 # a quad",
        ] {
            let text = format!(
                "# comment\nmtllib a.mtl\no thing\n{CORNERS}vt 0 0\nvn 0 0 1\ns off\n{faces}\r\n\n"
            );
            let mesh = TriMesh::from_obj(&text).unwrap();
            assert_eq!(mesh.triangles, [[0, 1, 2], [0, 2, 3]], "{faces}");
        }
    }

    #[test]
    fn refuses_unusable_lines_with_their_place() {
        let number = |line, found: &str| GeometryError::NotANumber {
            line,
            found: found.to_owned(),
        };
        refuses("v 0 0 nan\n", &number(1, "nan"));
        refuses("\nv 0 inf 0\n", &number(2, "inf"));
        refuses("v 0 x 0\n", &number(1, "x"));
        refuses("v 0 0\n", &GeometryError::ShortVertex { line: 1, found: 2 });
        let index = |index| GeometryError::IndexOutOfRange {
            line: 5,
            index,
            vertices: 4,
        };
        refuses(&format!("{CORNERS}f 1 2 5\n"), &index(5));
        refuses(&format!("{CORNERS}f 0 1 2\n"), &index(0));
        refuses(&format!("{CORNERS}f -5 1 2\n"), &index(-5));
        refuses(
            &format!("{CORNERS}f 1 9999999999 2\n"),
            &index(9_999_999_999),
        );
        refuses(
            &format!("{CORNERS}f 1 2\n"),
            &GeometryError::ShortFace { line: 5, found: 2 },
        );
        refuses(
            &format!("{CORNERS}f 1 2 a\n"),
            &GeometryError::NotAnIndex {
                line: 5,
                found: "a".to_owned(),
            },
        );
        refuses(CORNERS, &GeometryError::NoTriangles);
        refuses("", &GeometryError::NoTriangles);
        refuses(&format!("{CORNERS}f 1 1 2\n"), &GeometryError::NoTriangles);
    }

    #[test]
    fn refuses_numbers_and_indices_of_every_other_kind() {
        for number in [
            "NaN", "-inf", "infinity", "1e999", "0x1", "1,5", "1_0", "١", "",
        ] {
            let said = TriMesh::from_obj(&format!("v 0 0 0\nv 0 {number} 0\n")).unwrap_err();
            assert!(said.to_string().starts_with("line 2: "), "{number}: {said}");
        }
        for index in [
            "1.0",
            "1e0",
            "",
            "/1",
            "//1",
            "+",
            "-",
            "9223372036854775808",
            "-9223372036854775809",
        ] {
            let said = TriMesh::from_obj(&format!("{CORNERS}f 1 2 {index}x/1\n")).unwrap_err();
            assert!(said.to_string().starts_with("line 5: "), "{index}: {said}");
        }
        let limits = [
            i64::MIN,
            i64::MIN + 1,
            -4_294_967_297,
            -5,
            0,
            5,
            4_294_967_296,
            4_294_967_297,
            i64::MAX,
        ];
        for index in limits {
            refuses(
                &format!("{CORNERS}f 1 2 {index}\n"),
                &GeometryError::IndexOutOfRange {
                    line: 5,
                    index,
                    vertices: 4,
                },
            );
        }
        // A face before its vertices.
        refuses(
            &format!("f 1 2 3\n{CORNERS}"),
            &GeometryError::IndexOutOfRange {
                line: 1,
                index: 1,
                vertices: 0,
            },
        );
    }

    #[test]
    fn long_lines_and_large_polygons_are_read_and_quoted_in_short() {
        let polygon = format!("{CORNERS}f{}\n", " 1 2 3 4".repeat(250_000));
        // Of every four triangles of the fan about corner 1, two have that corner twice.
        let mesh = TriMesh::from_obj(&polygon).unwrap();
        assert_eq!(mesh.triangles.len(), 500_000);
        let long = "x".repeat(4 << 20);
        let message = TriMesh::from_obj(&format!("{CORNERS}f 1 2 {long}\n"))
            .unwrap_err()
            .to_string();
        assert!(message.len() < 200, "{}", message.len());
        let message = TriMesh::from_obj(&format!("v 0 {long} 0\n"))
            .unwrap_err()
            .to_string();
        assert!(message.len() < 200, "{}", message.len());
        refuses(&long, &GeometryError::NoTriangles);
        refuses(&" ".repeat(4 << 20), &GeometryError::NoTriangles);
        refuses(&"\n".repeat(4 << 20), &GeometryError::NoTriangles);
        refuses(&"#".repeat(4 << 20), &GeometryError::NoTriangles);
    }

    #[test]
    fn written_text_reads_back_equal() {
        let mesh = TriMesh::from_obj(&format!("{CORNERS}f 1 2 3 4\n")).unwrap();
        assert_eq!(TriMesh::from_obj(&mesh.to_obj()).unwrap(), mesh);
    }

    #[test]
    fn turns_a_closed_mesh_outward() {
        let inward = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 2 3\nf 1 4 2\nf 1 3 4\nf 2 4 3\n";
        assert!(TriMesh::from_obj(inward).unwrap().volume_m3() > 0.0);
    }
}
