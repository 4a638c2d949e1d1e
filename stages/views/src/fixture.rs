//! Files for tests, made in code.

use std::{fs, io::Write, path::Path};

use depth_view::{DepthView, Intrinsics, Rendered, RenderedObject, looking_at, render};
use flate2::{Compression, write::ZlibEncoder};
use geometry::TriMesh;
use nalgebra::Point3;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use serde_json::{Value, json};
use spatial::{Pose, World};

use crate::png::GrayImage;

/// A PNG file before it is written.
pub(crate) struct Png {
    pub(crate) header: Vec<u8>,
    /// The rows, not compressed, each after its filter.
    pub(crate) rows: Vec<u8>,
    /// Number of chunks among which the compressed rows are split.
    pub(crate) data_parts: usize,
    step: usize,
}

impl Png {
    pub(crate) fn of(image: &GrayImage) -> Self {
        let [width, height] = image.size.map(|side| u32::try_from(side).unwrap());
        let mut header = [width.to_be_bytes(), height.to_be_bytes()].concat();
        header.extend([image.bits, 0, 0, 0, 0]);
        let mut rows = Vec::new();
        for row in image.values.chunks(image.size[0]) {
            rows.push(0);
            for value in row {
                let bytes = value.to_be_bytes();
                rows.extend(if image.bits == 8 { &bytes[1..] } else { &bytes });
            }
        }
        Self {
            header,
            rows,
            data_parts: 1,
            step: usize::from(image.bits) / 8,
        }
    }

    /// Applies a filter to every row.
    pub(crate) fn filtered(mut self, filter: u8) -> Self {
        let width = u32::from_be_bytes(self.header[..4].try_into().unwrap()) as usize;
        let plain = self.rows.clone();
        let row_bytes = width * self.step + 1;
        for (idx, byte) in self.rows.iter_mut().enumerate() {
            let (row, column) = (idx / row_bytes, idx % row_bytes);
            if column == 0 {
                *byte = filter;
                continue;
            }
            let at = |is_above: bool, is_left: bool| {
                if (is_above && row == 0) || (is_left && column <= self.step) {
                    return 0;
                }
                let back = usize::from(is_above) * row_bytes + usize::from(is_left) * self.step;
                i32::from(plain[idx - back])
            };
            let (a, b, c) = (at(false, true), at(true, false), at(true, true));
            let nearest = [a, b, c]
                .into_iter()
                .min_by_key(|near| (a + b - c - near).abs());
            let predicted = match filter {
                0 => 0,
                1 => a,
                2 => b,
                3 => i32::midpoint(a, b),
                _ => nearest.unwrap(),
            };
            *byte = byte.wrapping_sub(u8::try_from(predicted).unwrap());
        }
        self
    }

    pub(crate) fn bytes(&self) -> Vec<u8> {
        let mut bytes = b"\x89PNG\r\n\x1a\n".to_vec();
        let mut chunk = |kind: &[u8], data: &[u8]| {
            bytes.extend(u32::try_from(data.len()).unwrap().to_be_bytes());
            bytes.extend(kind);
            bytes.extend(data);
            bytes.extend([0; 4]);
        };
        let mut compressed = ZlibEncoder::new(Vec::new(), Compression::fast());
        compressed.write_all(&self.rows).unwrap();
        let compressed = compressed.finish().unwrap();
        chunk(b"IHDR", &self.header);
        chunk(b"tEXt", b"Comment\0none");
        if self.data_parts > 0 {
            for part in compressed.chunks(compressed.len().div_ceil(self.data_parts)) {
                chunk(b"IDAT", part);
            }
        }
        chunk(b"IEND", b"");
        bytes
    }
}

/// How a PLY file is written.
#[derive(Clone, Copy, PartialEq)]
pub(crate) enum PlyForm {
    Text,
    Little,
    Big,
}

/// Returns a cloud as a PLY file with colors.
pub(crate) fn ply(points: &[[f64; 3]], form: PlyForm) -> Vec<u8> {
    let name = match form {
        PlyForm::Text => "ascii",
        PlyForm::Little => "binary_little_endian",
        PlyForm::Big => "binary_big_endian",
    };
    let mut bytes = format!(
        "ply\nformat {name} 1.0\ncomment a cloud\nelement vertex {}\nproperty uchar red\n\
         property double x\nproperty double y\nproperty float z\nend_header\n",
        points.len()
    )
    .into_bytes();
    for &[x, y, z] in points {
        #[expect(clippy::cast_possible_truncation, reason = "coordinates of tests")]
        let z = z as f32;
        match form {
            PlyForm::Text => bytes.extend(format!("200 {x} {y} {z}\n").into_bytes()),
            PlyForm::Little => {
                bytes.push(200);
                bytes.extend([x.to_le_bytes(), y.to_le_bytes()].concat());
                bytes.extend(z.to_le_bytes());
            }
            PlyForm::Big => {
                bytes.push(200);
                bytes.extend([x.to_be_bytes(), y.to_be_bytes()].concat());
                bytes.extend(z.to_be_bytes());
            }
        }
    }
    bytes
}

/// Returns copies of a file with one to four changes each: bytes set, bits turned, parts cut out, repeated or cut off; as
/// many as `PIPELINE_CASES` says, or `n`, by the seed `PIPELINE_SEED`.
pub(crate) fn mutated(file: &[u8], n: usize) -> impl Iterator<Item = Vec<u8>> {
    let number = |name: &str| std::env::var(name).ok().map(|text| text.parse().unwrap());
    let mut random = ChaCha8Rng::seed_from_u64(number("PIPELINE_SEED").unwrap_or(11));
    let n = number("PIPELINE_CASES").map_or(n as u64, |cases| cases);
    (0..n).map(move |_| {
        let mut bytes = file.to_vec();
        for _ in 0..random.random_range(1..=4) {
            if bytes.is_empty() {
                break;
            }
            let at = random.random_range(0..bytes.len());
            let end = (at + random.random_range(1..9)).min(bytes.len());
            match random.random_range(0..6) {
                0 => bytes[at] = random.random(),
                1 => bytes[at] ^= 1 << random.random_range(0..8),
                2 => bytes[at] = [0, 0xff, b'9', b'-', b'{', b'['][random.random_range(0..6)],
                3 => drop(bytes.drain(at..end)),
                4 => {
                    let part = bytes[at..end].to_vec();
                    drop(bytes.splice(at..at, part));
                }
                _ => bytes.truncate(at.max(1)),
            }
        }
        bytes
    })
}

/// A box and the world in which images show it.
pub(crate) fn carton() -> TriMesh {
    TriMesh::cuboid(
        Point3::new(-0.04, -0.03, 0.0),
        Point3::new(0.04, 0.03, 0.12),
    )
}

/// Returns the exact image of a mesh on the table z = 0, from a place, of 320 by 240 pixels.
pub(crate) fn rendered(mesh: &TriMesh, eye: [f64; 3]) -> Rendered {
    let object = RenderedObject {
        mesh,
        world_from_object: Pose::identity(),
    };
    let camera = looking_at(eye.into(), Point3::new(0.0, 0.0, 0.05));
    render(&object, &Intrinsics::of_field(320, 240, 0.9), &camera)
}

/// An image of a scene before it is written.
#[derive(Clone)]
pub(crate) struct SceneImage {
    /// Its entry in `scene_camera.json`.
    pub(crate) entry: Value,
    pub(crate) depth: GrayImage,
    /// The masks of its objects.
    pub(crate) masks: Vec<GrayImage>,
}

impl SceneImage {
    /// Depths in tenths of a millimeter, one mask, and the camera's pose in its world.
    #[expect(
        clippy::cast_possible_truncation,
        clippy::cast_sign_loss,
        reason = "depths of tests"
    )]
    pub(crate) fn of(view: &DepthView) -> Self {
        let size = [view.intrinsics.width, view.intrinsics.height];
        let ([fx, fy], [cx, cy]) = (view.intrinsics.focal, view.intrinsics.center);
        let gray = |bits, values| GrayImage { size, bits, values };
        let steps = view.depth_m.iter();
        Self {
            entry: json!({
                "cam_K": [fx, 0, cx, 0, fy, cy, 0, 0, 1],
                "depth_scale": 0.1,
                "cam_R_w2c": rotation(&view.world_from_camera.inverse().reinterpret()),
                "cam_t_w2c": (view.world_from_camera.inverse().translation.vector * 1e3).as_slice(),
            }),
            depth: gray(
                16,
                steps
                    .map(|depth_m| (depth_m * 1e4).round() as u16)
                    .collect(),
            ),
            masks: vec![gray(
                8,
                view.mask.iter().map(|&own| 255 * u16::from(own)).collect(),
            )],
        }
    }

    /// The same without a camera's pose.
    pub(crate) fn without_pose(mut self) -> Self {
        let fields = self.entry.as_object_mut().unwrap();
        fields.retain(|field, _| !field.ends_with("w2c"));
        self
    }
}

/// Returns the nine numbers of a rotation, row by row.
fn rotation(pose: &Pose<World, World>) -> Vec<f64> {
    let matrix = pose.rotation.to_rotation_matrix();
    matrix.matrix().transpose().as_slice().to_vec()
}

/// Writes a scene with these images, numbered by `numbers`.
pub(crate) fn write_scene(folder: &Path, images: &[(u32, SceneImage)]) {
    for name in ["depth", "mask_visib"] {
        fs::create_dir_all(folder.join(name)).unwrap();
    }
    let mut entries = serde_json::Map::new();
    for (number, image) in images {
        entries.insert(number.to_string(), image.entry.clone());
        let depth = Png::of(&image.depth).filtered(2).bytes();
        fs::write(folder.join(format!("depth/{number:06}.png")), depth).unwrap();
        for (instance, mask) in image.masks.iter().enumerate() {
            let name = format!("mask_visib/{number:06}_{instance:06}.png");
            fs::write(folder.join(name), Png::of(mask).bytes()).unwrap();
        }
    }
    if images.iter().all(|(_, image)| image.masks.is_empty()) {
        fs::remove_dir(folder.join("mask_visib")).unwrap();
    }
    let text = Value::Object(entries).to_string();
    fs::write(folder.join("scene_camera.json"), text).unwrap();
}
