//! Meshes in Wavefront OBJ.
#![no_main]

use geometry::TriMesh;
use libfuzzer_sys::{Corpus, fuzz_target};

fuzz_target!(|bytes: &[u8]| -> Corpus {
    let Ok(text) = std::str::from_utf8(bytes) else {
        return Corpus::Reject;
    };
    if let Ok(mesh) = TriMesh::from_obj(text) {
        let n_vertices = mesh.vertices_m.len();
        for corner in mesh.triangles.as_flattened() {
            assert!((*corner as usize) < n_vertices);
        }
        // What is written reads back, unless nine digits are too few for it.
        let _ = TriMesh::from_obj(&mesh.to_obj());
    }
    Corpus::Keep
});
