//! The JSON of a glTF file, as far as it is written here.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

/// `FLOAT`, by glTF's number.
pub(crate) const FLOAT: u32 = 5126;
/// `SHORT`.
pub(crate) const SHORT: u32 = 5122;
/// `UNSIGNED_SHORT`.
pub(crate) const UNSIGNED_SHORT: u32 = 5123;
/// `UNSIGNED_INT`.
pub(crate) const UNSIGNED_INT: u32 = 5125;
/// `ARRAY_BUFFER`.
pub(crate) const VERTICES: u32 = 34962;
/// `ELEMENT_ARRAY_BUFFER`.
pub(crate) const INDICES: u32 = 34963;

/// The root.
#[derive(Debug, Serialize, Deserialize)]
#[serde(rename_all = "camelCase")]
pub(crate) struct Root {
    pub(crate) asset: Asset,
    pub(crate) scene: usize,
    pub(crate) scenes: Vec<SceneEntry>,
    pub(crate) nodes: Vec<NodeEntry>,
    pub(crate) materials: Vec<MaterialEntry>,
    pub(crate) meshes: Vec<MeshEntry>,
    pub(crate) animations: Vec<Animation>,
    pub(crate) accessors: Vec<Accessor>,
    pub(crate) buffer_views: Vec<View>,
    pub(crate) buffers: Vec<Buffer>,
}

#[derive(Debug, Serialize, Deserialize)]
pub(crate) struct Asset {
    pub(crate) version: String,
    pub(crate) generator: String,
}

#[derive(Debug, Serialize, Deserialize)]
pub(crate) struct SceneEntry {
    pub(crate) name: String,
    pub(crate) nodes: Vec<usize>,
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub(crate) extras: BTreeMap<String, String>,
}

#[derive(Debug, Serialize, Deserialize)]
pub(crate) struct NodeEntry {
    pub(crate) name: String,
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub(crate) children: Vec<usize>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) mesh: Option<usize>,
    pub(crate) translation: [f32; 3],
    pub(crate) rotation: [f32; 4],
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) scale: Option<[f32; 3]>,
}

#[derive(Debug, Serialize, Deserialize)]
#[serde(rename_all = "camelCase")]
pub(crate) struct MaterialEntry {
    pub(crate) name: String,
    pub(crate) pbr_metallic_roughness: Pbr,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) alpha_mode: Option<String>,
}

#[derive(Debug, Serialize, Deserialize)]
pub(crate) struct Pbr {
    #[serde(rename = "baseColorFactor")]
    pub(crate) base_color: [f32; 4],
    #[serde(rename = "metallicFactor")]
    pub(crate) metallic: f32,
    #[serde(rename = "roughnessFactor")]
    pub(crate) roughness: f32,
}

#[derive(Debug, Serialize, Deserialize)]
pub(crate) struct MeshEntry {
    pub(crate) name: String,
    pub(crate) primitives: Vec<Primitive>,
}

#[derive(Debug, Serialize, Deserialize)]
pub(crate) struct Primitive {
    pub(crate) attributes: Attributes,
    pub(crate) indices: usize,
    pub(crate) material: usize,
}

#[derive(Debug, Serialize, Deserialize)]
pub(crate) struct Attributes {
    #[serde(rename = "POSITION")]
    pub(crate) position: usize,
}

#[derive(Debug, Serialize, Deserialize)]
pub(crate) struct Animation {
    pub(crate) name: String,
    pub(crate) channels: Vec<Channel>,
    pub(crate) samplers: Vec<Sampler>,
}

#[derive(Debug, Serialize, Deserialize)]
pub(crate) struct Channel {
    pub(crate) sampler: usize,
    pub(crate) target: Target,
}

#[derive(Debug, Serialize, Deserialize)]
pub(crate) struct Target {
    pub(crate) node: usize,
    pub(crate) path: String,
}

#[derive(Debug, Serialize, Deserialize)]
pub(crate) struct Sampler {
    pub(crate) input: usize,
    pub(crate) interpolation: String,
    pub(crate) output: usize,
}

#[derive(Debug, Serialize, Deserialize)]
#[serde(rename_all = "camelCase")]
pub(crate) struct Accessor {
    pub(crate) buffer_view: usize,
    pub(crate) component_type: u32,
    pub(crate) count: usize,
    #[serde(rename = "type")]
    pub(crate) shape: String,
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub(crate) normalized: bool,
    /// Exactly the numbers in the buffer, therefore double.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub(crate) min: Vec<f64>,
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub(crate) max: Vec<f64>,
}

#[derive(Debug, Serialize, Deserialize)]
#[serde(rename_all = "camelCase")]
pub(crate) struct View {
    pub(crate) buffer: usize,
    pub(crate) byte_offset: usize,
    pub(crate) byte_length: usize,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) target: Option<u32>,
}

#[derive(Debug, Serialize, Deserialize)]
#[serde(rename_all = "camelCase")]
pub(crate) struct Buffer {
    pub(crate) byte_length: usize,
}
