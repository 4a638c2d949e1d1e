//! Reading and writing Wavefront OBJ.

use std::{borrow::Cow, fmt::Write};

use nalgebra::Point3;

use crate::{GeometryError, TriMesh, polygon, repair::repaired};

/// Maximum number of characters of a word that a message quotes.
const MAX_QUOTED: usize = 40;

impl TriMesh {
    /// Reads the vertices and faces of the text of a Wavefront OBJ file, as [`TriMesh::read`] does.
    ///
    /// # Errors
    ///
    /// Fails as [`TriMesh::read`].
    pub fn from_obj(text: &str) -> Result<Self, GeometryError> {
        Ok(repaired(parsed(text)?).0)
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

/// Reads the vertices and faces, as they are.
///
/// Texture and normal indices are dropped, and so are lines of other kinds and triangles that name a
/// vertex twice.
pub(crate) fn parsed(text: &str) -> Result<TriMesh, GeometryError> {
    let mut mesh = TriMesh {
        vertices_m: Vec::new(),
        triangles: Vec::new(),
    };
    let mut lines = lines(text);
    while let Some((line, content)) = lines.next() {
        let content = without_comment(content);
        // Of the other lines nothing is read, and a `\` at their end may be half a character.
        if !matches!(content.split_whitespace().next(), Some("v" | "f")) {
            continue;
        }
        let mut joined = Cow::Borrowed(content);
        while let Some(begun) = joined.trim_end().strip_suffix('\\') {
            let (_, more) = lines.next().unwrap_or_default();
            joined = Cow::Owned(format!("{begun} {}", without_comment(more)));
        }
        let mut words = joined.split_whitespace();
        if words.next() == Some("v") {
            mesh.vertices_m.push(vertex(words, line)?);
            continue;
        }
        let corners = words
            .map(|word| corner(word, line, mesh.vertices_m.len()))
            .collect::<Result<Vec<_>, _>>()?;
        add_face(&mut mesh, &corners, line)?;
    }
    if mesh.triangles.is_empty() {
        return Err(GeometryError::NoTriangles);
    }
    Ok(mesh)
}

fn without_comment(line: &str) -> &str {
    line.split('#').next().unwrap_or_default()
}

/// Returns the lines of a text with their numbers, from one, however they end.
pub(crate) fn lines(text: &str) -> impl Iterator<Item = (usize, &str)> {
    // The end of line of old Macs, in a file without the other.
    let end = if text.contains('\n') { '\n' } else { '\r' };
    (1..).zip(text.split(end))
}

/// Adds a polygon of a line.
pub(crate) fn add_face(
    mesh: &mut TriMesh,
    corners: &[u32],
    line: usize,
) -> Result<(), GeometryError> {
    let found = corners.len();
    if found < 3 {
        return Err(GeometryError::ShortFace { line, found });
    }
    let triangles = polygon::triangles(corners, &mesh.vertices_m);
    mesh.triangles
        .extend(triangles.ok_or(GeometryError::LargeFace { line, found })?);
    Ok(())
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
pub(crate) fn quoted(word: &str) -> String {
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

    /// An angle bar of 3 by 3 by 1, its two ends as concave faces.
    const ANGLE_BAR: &str = "v 0 0 0\nv 3 0 0\nv 3 1 0\nv 1 1 0\nv 1 3 0\nv 0 3 0\n\
                             v 0 0 1\nv 3 0 1\nv 3 1 1\nv 1 1 1\nv 1 3 1\nv 0 3 1\n\
                             f 6 5 4 3 2 1\nf 7 8 9 10 11 12\nf 1 2 8 7\nf 2 3 9 8\n\
                             f 3 4 10 9\nf 4 5 11 10\nf 5 6 12 11\nf 6 1 7 12\n";

    #[test]
    fn concave_faces_have_no_area_in_their_notch() {
        for text in [
            ANGLE_BAR.to_owned(),
            ANGLE_BAR.replace("f 6 5 4 3 2 1", "f 3 2 1 6 5 4"),
        ] {
            let mesh = TriMesh::from_obj(&text).unwrap();
            assert!(mesh.is_watertight());
            assert!(
                (mesh.volume_m3() - 5.0).abs() < 1e-12,
                "{}",
                mesh.volume_m3()
            );
            let (points, _) = mesh.sample_surface(2000, 7);
            assert!(
                points
                    .iter()
                    .all(|point| point.x <= 1.0 + 1e-9 || point.y <= 1.0 + 1e-9)
            );
        }
        let comb: Vec<String> = (0..6000).map(|k| format!("v {k} {} 0", k % 2)).collect();
        let face: Vec<String> = (1..=6000).map(|k: u32| k.to_string()).collect();
        let [comb, face] = [comb.join("\n"), face.join(" ")];
        let said = TriMesh::from_obj(&format!("{comb}\nv 3000 9 0\nf {face} 6001\n")).unwrap_err();
        assert_eq!(
            said,
            GeometryError::LargeFace {
                line: 6002,
                found: 6001
            }
        );
    }

    #[test]
    fn text_of_other_programs_is_read_alike() {
        let plain = TriMesh::from_obj(ANGLE_BAR).unwrap();
        let check = |what: &str, bytes: &[u8]| {
            let read = TriMesh::read(bytes, crate::MeshFormat::Obj);
            assert_eq!(read.as_ref().map(|(mesh, _)| mesh), Ok(&plain), "{what}");
        };
        check("byte order mark", format!("\u{feff}{ANGLE_BAR}").as_bytes());
        check("Windows", ANGLE_BAR.replace('\n', "\r\n").as_bytes());
        check("old Mac", ANGLE_BAR.replace('\n', "\r").as_bytes());
        for big in [false, true] {
            let order = |unit: u16| {
                if big {
                    unit.to_be_bytes()
                } else {
                    unit.to_le_bytes()
                }
            };
            let marked = format!("\u{feff}{ANGLE_BAR}");
            let bytes: Vec<u8> = marked.encode_utf16().flat_map(order).collect();
            check("UTF-16", &bytes);
        }
        for (what, before) in [
            ("Latin-1", &b"# Geh\xe4use\no Griffst\xfcck\n"[..]),
            ("GBK", b"# \xb2\xe2\xca\xd4\ng \xc4\xa3\xd0\xcd\n"),
            // The second half of its last character is a backslash.
            ("Shift-JIS", b"# \x95\x5c\no \x83\x5c\nusemtl \x94\x5c\n"),
            ("a Windows path in a comment", b"# C:\\parts\\\n"),
        ] {
            check(what, &[before, ANGLE_BAR.as_bytes()].concat());
        }
        let long = "f 7 8 9 10 11 12";
        for wrapped in [
            "f 7 8 9 \\\n10 11 12",
            "f 7 8 9 10\\\n 11 12",
            "f 7/1 8/1 \\\r\n9/1 10/1 \\\r\n11/1 12/1",
            "f 7 8 9 10 11 12 \\\n",
            "f 7 8 \\  \n  9 10 11 12 # and \\",
        ] {
            check(wrapped, ANGLE_BAR.replace(long, wrapped).as_bytes());
        }
        let vertex = ANGLE_BAR.replacen("v 3 0 0", "v 3 \\\n0 0", 1);
        check("a wrapped vertex", vertex.as_bytes());
        // Lines after a wrapped one keep their numbers.
        let said = TriMesh::from_obj(&vertex.replace("f 6 1 7 12", "f 6 1 7 13")).unwrap_err();
        assert!(said.to_string().starts_with("line 21: "), "{said}");
    }

    #[test]
    fn a_pointer_in_place_of_a_mesh_is_named() {
        let pointer = b"version https://git-lfs.github.com/spec/v1\noid sha256:4d7a\nsize 12345\n";
        for format in [
            crate::MeshFormat::Obj,
            crate::MeshFormat::Stl,
            crate::MeshFormat::Ply,
        ] {
            let said = TriMesh::read(pointer, format).unwrap_err();
            assert!(said.hint().unwrap().contains("`git lfs pull`"), "{said}");
        }
    }
}
