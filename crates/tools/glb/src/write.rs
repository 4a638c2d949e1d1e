//! A scene's bytes: glTF 2.0, binary (*glTF 2.0 Specification*, section 4).

use nalgebra::UnitQuaternion;

use crate::{
    GlbError,
    file::{
        Accessor, Animation, Asset, Attributes, Buffer, Channel, FLOAT, INDICES, MaterialEntry,
        MeshEntry, NodeEntry, Pbr, Primitive, Root, SHORT, Sampler, SceneEntry, Target,
        UNSIGNED_INT, UNSIGNED_SHORT, VERTICES, View,
    },
    scene::{Geometry, Node, Scene, Values, single, single_rotation},
};

/// `glTF` in ASCII.
pub(crate) const MAGIC: u32 = 0x4654_6C67;
/// Chunk of JSON.
pub(crate) const JSON: u32 = 0x4E4F_534A;
/// Chunk of bytes.
pub(crate) const BIN: u32 = 0x004E_4942;

/// Greatest number of 16 bits: it stands for 1.
const WHOLE: f64 = 32767.0;

/// Writes a scene with an animation of this name.
pub(crate) fn to_glb(
    scene: &Scene,
    name: &str,
    about: &[(&str, String)],
) -> Result<Vec<u8>, GlbError> {
    let mut buffer = Packed::default();
    let accessors: Vec<[usize; 2]> = scene
        .geometries
        .iter()
        .map(|geometry| buffer.geometry(geometry))
        .collect();
    let animation = animation(scene, name, &mut buffer);
    let meshes = scene.meshes.iter().filter_map(|mesh| {
        let &[position, indices] = accessors.get(mesh.geometry)?;
        Some(MeshEntry {
            name: mesh.name.clone(),
            primitives: vec![Primitive {
                attributes: Attributes { position },
                indices,
                material: mesh.material,
            }],
        })
    });
    let is_scaled = |node: usize| {
        let tracks = scene.tracks.iter();
        let mut of_node = tracks.filter(|track| track.node == node);
        of_node.any(|track| matches!(track.values, Values::Scale(_)))
    };
    let roots = scene.nodes.iter().enumerate();
    let roots = roots.filter(|(_, node)| node.parent.is_none());
    let root = Root {
        asset: Asset {
            version: "2.0".to_owned(),
            generator: "pipeline".to_owned(),
        },
        scene: 0,
        scenes: vec![SceneEntry {
            name: name.to_owned(),
            nodes: roots.map(|(idx, _)| idx).collect(),
            extras: about
                .iter()
                .map(|(key, value)| ((*key).to_owned(), value.clone()))
                .collect(),
        }],
        nodes: scene
            .nodes
            .iter()
            .enumerate()
            .map(|(idx, node)| entry(scene, idx, node, is_scaled(idx)))
            .collect(),
        materials: scene.materials.iter().map(material).collect(),
        meshes: meshes.collect(),
        animations: vec![animation],
        accessors: buffer.accessors,
        buffer_views: buffer.views,
        buffers: vec![Buffer {
            byte_length: buffer.bytes.len(),
        }],
    };
    let json = serde_json::to_vec(&root).map_err(|err| GlbError::Malformed(err.to_string()))?;
    binary(json, &buffer.bytes)
}

/// Packs the tracks of a scene into the buffer, and returns them as an animation of this name.
fn animation(scene: &Scene, name: &str, buffer: &mut Packed) -> Animation {
    let times: Vec<usize> = scene
        .times
        .iter()
        .map(|times| buffer.times(times))
        .collect();
    let mut animation = Animation {
        name: name.to_owned(),
        channels: Vec::new(),
        samplers: Vec::new(),
    };
    for track in &scene.tracks {
        let (path, interpolation) = match track.values {
            Values::Translation(_) => ("translation", "LINEAR"),
            Values::Jump(_) => ("translation", "STEP"),
            Values::Scale(_) => ("scale", "STEP"),
            Values::Rotation(_) | Values::RotationOfJoint(_) => ("rotation", "LINEAR"),
        };
        let Some(&input) = times.get(track.times) else {
            continue;
        };
        animation.samplers.push(Sampler {
            input,
            interpolation: interpolation.to_owned(),
            output: buffer.values(&track.values),
        });
        animation.channels.push(Channel {
            sampler: animation.samplers.len() - 1,
            target: Target {
                node: track.node,
                path: path.to_owned(),
            },
        });
    }
    animation
}

/// Returns a rotation in 16 bits, `w ≥ 0`.
#[expect(
    clippy::cast_possible_truncation,
    reason = "parts of a unit quaternion times the greatest number"
)]
pub(crate) fn sixteen_bits(rotation: &UnitQuaternion<f64>) -> [i16; 4] {
    spatial::xyzw(rotation).map(|part| (part * WHOLE).round() as i16)
}

fn entry(scene: &Scene, idx: usize, node: &Node, is_scaled: bool) -> NodeEntry {
    let children = scene.nodes.iter().enumerate();
    let children = children.filter(|(_, child)| child.parent == Some(idx));
    NodeEntry {
        name: node.name.clone(),
        children: children.map(|(child, _)| child).collect(),
        mesh: node.mesh,
        translation: single(node.pose_in_parent.translation.vector),
        rotation: single_rotation(&node.pose_in_parent.rotation),
        // Until it is there.
        scale: is_scaled.then_some([0.0; 3]),
    }
}

fn material(material: &crate::scene::Material) -> MaterialEntry {
    MaterialEntry {
        name: material.name.to_owned(),
        pbr_metallic_roughness: Pbr {
            base_color: material.color,
            metallic: 0.0,
            roughness: 0.75,
        },
        alpha_mode: (material.color[3] < 1.0).then(|| "BLEND".to_owned()),
    }
}

/// The buffer and what lies where in it.
#[derive(Default)]
struct Packed {
    bytes: Vec<u8>,
    views: Vec<View>,
    accessors: Vec<Accessor>,
}

impl Packed {
    /// Adds bytes, aligned to 4, and an accessor to them.
    fn add(&mut self, bytes: &[u8], target: Option<u32>, accessor: Accessor) -> usize {
        let byte_offset = self.bytes.len();
        self.bytes.extend_from_slice(bytes);
        self.bytes.resize(self.bytes.len().next_multiple_of(4), 0);
        self.views.push(View {
            buffer: 0,
            byte_offset,
            byte_length: bytes.len(),
            target,
        });
        self.accessors.push(Accessor {
            buffer_view: self.views.len() - 1,
            ..accessor
        });
        self.accessors.len() - 1
    }

    fn geometry(&mut self, geometry: &Geometry) -> [usize; 2] {
        let of = |fold: fn(f32, f32) -> f32, start: f32| -> Vec<f64> {
            let ends = geometry.positions.iter().fold([start; 3], |end, point| {
                [0, 1, 2].map(|axis| fold(end[axis], point[axis]))
            });
            ends.map(f64::from).to_vec()
        };
        let position = self.add(
            &floats(geometry.positions.as_flattened()),
            Some(VERTICES),
            Accessor {
                min: of(f32::min, f32::INFINITY),
                max: of(f32::max, f32::NEG_INFINITY),
                ..accessor(FLOAT, geometry.positions.len(), "VEC3")
            },
        );
        let corners = geometry.triangles.as_flattened();
        // The greatest number of 16 bits would restart the primitive.
        let short: Option<Vec<u16>> = corners
            .iter()
            .map(|&corner| {
                u16::try_from(corner)
                    .ok()
                    .filter(|&corner| corner < u16::MAX)
            })
            .collect();
        let (bytes, kind): (Vec<u8>, u32) = match short {
            Some(short) => (
                short
                    .iter()
                    .flat_map(|corner| corner.to_le_bytes())
                    .collect(),
                UNSIGNED_SHORT,
            ),
            None => (
                corners
                    .iter()
                    .flat_map(|corner| corner.to_le_bytes())
                    .collect(),
                UNSIGNED_INT,
            ),
        };
        let indices = self.add(
            &bytes,
            Some(INDICES),
            accessor(kind, corners.len(), "SCALAR"),
        );
        [position, indices]
    }

    fn times(&mut self, times_s: &[f32]) -> usize {
        let end = |time: Option<&f32>| time.map(|&time| f64::from(time)).into_iter().collect();
        let accessor = Accessor {
            min: end(times_s.first()),
            max: end(times_s.last()),
            ..accessor(FLOAT, times_s.len(), "SCALAR")
        };
        self.add(&floats(times_s), None, accessor)
    }

    fn values(&mut self, values: &Values) -> usize {
        match values {
            Values::Translation(values) | Values::Jump(values) | Values::Scale(values) => self.add(
                &floats(values.as_flattened()),
                None,
                accessor(FLOAT, values.len(), "VEC3"),
            ),
            Values::Rotation(values) => self.add(
                &floats(values.as_flattened()),
                None,
                accessor(FLOAT, values.len(), "VEC4"),
            ),
            Values::RotationOfJoint(values) => {
                let numbers = values.as_flattened().iter();
                let bytes: Vec<u8> = numbers.flat_map(|number| number.to_le_bytes()).collect();
                let accessor = Accessor {
                    normalized: true,
                    ..accessor(SHORT, values.len(), "VEC4")
                };
                self.add(&bytes, None, accessor)
            }
        }
    }
}

fn accessor(component_type: u32, count: usize, shape: &str) -> Accessor {
    Accessor {
        buffer_view: 0,
        component_type,
        count,
        shape: shape.to_owned(),
        normalized: false,
        min: Vec::new(),
        max: Vec::new(),
    }
}

fn floats(numbers: &[f32]) -> Vec<u8> {
    numbers
        .iter()
        .flat_map(|number| number.to_le_bytes())
        .collect()
}

/// Returns header, JSON and bytes as one file.
fn binary(mut json: Vec<u8>, bytes: &[u8]) -> Result<Vec<u8>, GlbError> {
    json.resize(json.len().next_multiple_of(4), b' ');
    let word = |n: usize| u32::try_from(n).map_err(|_too_large| GlbError::TooLarge);
    let all = word(12 + 8 + json.len() + 8 + bytes.len())?;
    let mut file = Vec::with_capacity(all as usize);
    for number in [MAGIC, 2, all, word(json.len())?, JSON] {
        file.extend_from_slice(&number.to_le_bytes());
    }
    file.extend_from_slice(&json);
    for number in [word(bytes.len())?, BIN] {
        file.extend_from_slice(&number.to_le_bytes());
    }
    file.extend_from_slice(bytes);
    Ok(file)
}
