//! A scene before it is written: nodes, meshes, materials and tracks.

use nalgebra::{Isometry3, UnitQuaternion, Vector3};

/// A scene with one animation.
#[derive(Debug, Clone, Default)]
pub(crate) struct Scene {
    pub(crate) nodes: Vec<Node>,
    pub(crate) geometries: Vec<Geometry>,
    pub(crate) meshes: Vec<Mesh>,
    pub(crate) materials: Vec<Material>,
    /// Key times of tracks, in seconds.
    pub(crate) times: Vec<Vec<f32>>,
    pub(crate) tracks: Vec<Track>,
}

/// A node, placed in its parent; parents come first.
#[derive(Debug, Clone)]
pub(crate) struct Node {
    pub(crate) name: String,
    pub(crate) parent: Option<usize>,
    /// From its own frame to its parent's.
    pub(crate) pose_in_parent: Isometry3<f64>,
    pub(crate) mesh: Option<usize>,
}

/// Triangles, in meters.
#[derive(Debug, Clone, Default, PartialEq)]
pub(crate) struct Geometry {
    pub(crate) positions: Vec<[f32; 3]>,
    pub(crate) triangles: Vec<[u32; 3]>,
}

/// A geometry in a material.
#[derive(Debug, Clone)]
pub(crate) struct Mesh {
    pub(crate) name: String,
    pub(crate) geometry: usize,
    pub(crate) material: usize,
}

/// A color.
#[derive(Debug, Clone)]
pub(crate) struct Material {
    pub(crate) name: &'static str,
    /// Red, green, blue and opacity, linear, in 0..=1.
    pub(crate) color: [f32; 4],
}

/// Motion of a node.
#[derive(Debug, Clone)]
pub(crate) struct Track {
    pub(crate) node: usize,
    /// Its key times, by their place in [`Scene::times`].
    pub(crate) times: usize,
    pub(crate) values: Values,
}

/// The values of a track, one for each key time.
#[derive(Debug, Clone)]
pub(crate) enum Values {
    /// Meters, linear.
    Translation(Vec<[f32; 3]>),
    /// Meters, constant up to the next key.
    Jump(Vec<[f32; 3]>),
    /// Factors, constant up to the next key.
    Scale(Vec<[f32; 3]>),
    /// Quaternions `xyzw`, spherical linear, in full precision.
    Rotation(Vec<[f32; 4]>),
    /// The same in 16 bits.
    RotationOfJoint(Vec<[i16; 4]>),
}

impl Geometry {
    /// Adds another geometry, moved.
    pub(crate) fn add(&mut self, other: &Self, here_from_other: &Isometry3<f64>) {
        let first = u32::try_from(self.positions.len()).unwrap_or(u32::MAX);
        let place = |&[x, y, z]: &[f32; 3]| {
            let point = nalgebra::Point3::new(f64::from(x), f64::from(y), f64::from(z));
            single((here_from_other * point).coords)
        };
        self.positions.extend(other.positions.iter().map(place));
        let triangles = other.triangles.iter();
        self.triangles
            .extend(triangles.map(|corners| corners.map(|corner| first.saturating_add(corner))));
    }
}

impl Scene {
    pub(crate) fn add_node(&mut self, node: Node) -> usize {
        self.nodes.push(node);
        self.nodes.len() - 1
    }

    /// Adds a mesh of a geometry; `None` of one without triangles.
    pub(crate) fn add_mesh(
        &mut self,
        name: &str,
        geometry: Geometry,
        material: usize,
    ) -> Option<usize> {
        if geometry.triangles.is_empty() {
            return None;
        }
        self.geometries.push(geometry);
        self.meshes.push(Mesh {
            name: name.to_owned(),
            geometry: self.geometries.len() - 1,
            material,
        });
        Some(self.meshes.len() - 1)
    }

    /// Adds the mesh of the same triangles in another material.
    pub(crate) fn add_alike(&mut self, name: &str, mesh: usize, material: usize) -> Option<usize> {
        let geometry = self.meshes.get(mesh)?.geometry;
        self.meshes.push(Mesh {
            name: name.to_owned(),
            geometry,
            material,
        });
        Some(self.meshes.len() - 1)
    }

    pub(crate) fn add_times(&mut self, times_s: Vec<f32>) -> usize {
        self.times.push(times_s);
        self.times.len() - 1
    }
}

/// Returns a vector in single precision, as glTF stores numbers.
#[expect(
    clippy::cast_possible_truncation,
    reason = "meters in a scene; the file's numbers are single"
)]
pub(crate) fn single(vector: Vector3<f64>) -> [f32; 3] {
    [vector.x as f32, vector.y as f32, vector.z as f32]
}

/// Returns a rotation in single precision, `w ≥ 0`.
#[expect(
    clippy::cast_possible_truncation,
    reason = "parts of a unit quaternion"
)]
pub(crate) fn single_rotation(rotation: &UnitQuaternion<f64>) -> [f32; 4] {
    spatial::xyzw(rotation).map(|part| part as f32)
}
