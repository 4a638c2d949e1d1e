//! An object's folder, as the evaluator and the viewers of the bench read it.

use geometry::TriMesh;
use nalgebra::Point3;
use serde_json::json;

use crate::FormatError;

/// Properties of an object in the bench, in the object's frame and in meters.
#[derive(Debug, Clone, PartialEq)]
pub struct BenchObject {
    /// True mass, in kilograms.
    pub mass_kg: f64,
    /// Center of mass.
    pub center_of_mass_m: [f64; 3],
    /// The mesh.
    pub mesh: TriMesh,
    /// Vertices of its convex parts.
    pub parts_m: Vec<Vec<[f64; 3]>>,
}

impl BenchObject {
    /// Returns its files, by their paths in its folder.
    ///
    /// The density is the mass by the volume of the convex parts together, because the evaluator splits the mass
    /// among the parts by their volumes: all parts together then have the given mass.
    pub(super) fn files(&self, name: &str) -> Result<Vec<(String, String)>, FormatError> {
        let hull = |part: &Vec<[f64; 3]>| {
            let cloud = TriMesh {
                vertices_m: part.iter().map(|&vertex| Point3::from(vertex)).collect(),
                triangles: Vec::new(),
            };
            cloud.convex_hull().map_err(|source| FormatError::Part {
                object: name.to_owned(),
                source,
            })
        };
        let parts = self
            .parts_m
            .iter()
            .map(hull)
            .collect::<Result<Vec<_>, _>>()?;
        let volume_m3: f64 = parts.iter().map(TriMesh::volume_m3).sum();
        let info = json!({
            "gravity_center": self.center_of_mass_m,
            "scale": 1.0,
            "density": self.mass_kg / volume_m3,
            "mass": self.mass_kg,
        });
        let mut files = vec![
            ("info/simplified.json".to_owned(), format!("{info:#}\n")),
            ("mesh/simplified.obj".to_owned(), self.mesh.to_obj()),
        ];
        let parts = parts.iter().enumerate();
        files.extend(parts.map(|(idx, part)| {
            (
                format!("urdf/meshes/convex_piece_{idx:03}.obj"),
                part.to_obj(),
            )
        }));
        Ok(files)
    }
}

#[cfg(test)]
mod tests {
    use serde_json::Value;

    use super::*;

    #[test]
    fn the_parts_have_the_mass_that_the_density_gives_them() {
        let cube = |x: f64| TriMesh::cuboid([x, 0.0, 0.0].into(), [x + 0.1, 0.1, 0.1].into());
        let object = BenchObject {
            mass_kg: 0.4,
            center_of_mass_m: [0.1, 0.05, 0.05],
            mesh: cube(0.0),
            parts_m: [0.0, 0.1]
                .map(|x| {
                    cube(x)
                        .vertices_m
                        .iter()
                        .map(|&vertex| vertex.into())
                        .collect()
                })
                .to_vec(),
        };
        let files = object.files("box").unwrap();
        let names: Vec<&str> = files.iter().map(|(name, _)| name.as_str()).collect();
        assert_eq!(
            names[2..],
            [
                "urdf/meshes/convex_piece_000.obj",
                "urdf/meshes/convex_piece_001.obj"
            ]
        );
        let info: Value = serde_json::from_str(&files[0].1).unwrap();
        assert!((info["density"].as_f64().unwrap() / 200.0 - 1.0).abs() < 1e-6);
        let part = TriMesh::from_obj(&files[2].1).unwrap();
        assert!((part.volume_m3() - 1e-3).abs() < 1e-9);
    }

    #[test]
    fn a_flat_part_is_refused() {
        let object = BenchObject {
            mass_kg: 0.4,
            center_of_mass_m: [0.0; 3],
            mesh: TriMesh::cuboid([0.0; 3].into(), [1.0; 3].into()),
            parts_m: vec![vec![[0.0; 3], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]],
        };
        assert!(matches!(
            object.files("leaf"),
            Err(FormatError::Part { .. })
        ));
    }
}
