//! Reading a mesh from the bytes of a file.

use std::{borrow::Cow, path::Path};

use crate::{GeometryError, Repairs, TriMesh, obj, ply, repair::repaired, stl};

/// How a pointer of Git LFS begins
/// (<https://github.com/git-lfs/git-lfs/blob/main/docs/spec.md>).
const LFS_POINTER: &[u8] = b"version https://git-lfs.github.com/spec/";

/// File format of a mesh.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
#[non_exhaustive]
pub enum MeshFormat {
    /// Wavefront OBJ.
    Obj,
    /// STL, binary or text.
    Stl,
    /// PLY, binary or text.
    Ply,
}

impl MeshFormat {
    /// Names of the formats that are read, for messages.
    pub const NAMES: &str = "OBJ, STL or PLY";

    /// Returns the format that a file's extension names, in whatever case.
    pub fn of(path: &Path) -> Option<Self> {
        match path.extension()?.to_str()?.to_ascii_lowercase().as_str() {
            "obj" => Some(Self::Obj),
            "stl" => Some(Self::Stl),
            "ply" => Some(Self::Ply),
            _ => None,
        }
    }

    /// Returns the usual extension, in lower case.
    pub fn extension(self) -> &'static str {
        match self {
            Self::Obj => "obj",
            Self::Stl => "stl",
            Self::Ply => "ply",
        }
    }
}

impl TriMesh {
    /// Reads a mesh from a file's bytes, mends it, and says what was mended.
    ///
    /// Polygons become triangles, convex ones as a fan about their first corner; triangles that name
    /// a vertex twice are left out, and so are vertices that no triangle uses. Triangles that share an
    /// edge are made to wind alike, and a body that winds inward is turned outward.
    /// Text may begin with a byte order mark, and need be UTF-8 or UTF-16 in its numbers alone.
    ///
    /// # Errors
    ///
    /// Fails with the line's number on a number that is not finite, a vertex or face that is too
    /// short, and an index out of range; if a binary file ends too early; if there is no triangle at
    /// all; and if the file is a pointer of Git LFS.
    pub fn read(bytes: &[u8], format: MeshFormat) -> Result<(Self, Repairs), GeometryError> {
        if bytes.starts_with(LFS_POINTER) {
            return Err(GeometryError::LfsPointer);
        }
        let mesh = match format {
            MeshFormat::Obj => obj::parsed(&text_of(bytes)),
            MeshFormat::Stl => stl::parsed(bytes),
            MeshFormat::Ply => ply::parsed(bytes),
        }?;
        Ok(repaired(mesh))
    }
}

/// Returns bytes as text, by their byte order mark or as UTF-8; what is not, as names and comments of
/// other encodings, becomes replacement characters.
pub(crate) fn text_of(bytes: &[u8]) -> Cow<'_, str> {
    encoding_rs::UTF_8.decode(bytes).0
}
