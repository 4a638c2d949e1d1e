//! An image of a scene: its depths, its camera, and the pixels of an object.

use dataflow::SourceFile;
use depth_view::DepthView;
use serde_json::Value;
use spatial::Pose;

use crate::{
    config::ViewsConfig,
    error::Fault,
    file::{self, MAX_IMAGE_BYTES},
    object,
    png::GrayImage,
    scene_camera::SceneCamera,
    world::Image,
};

/// The greatest number of 16 bits stands for no measurement: sensors write it where they are saturated.
pub(crate) const SATURATED: u16 = u16::MAX;

/// Reads an image from its files, with its entry in `scene_camera.json`.
pub(crate) fn read(
    name: String,
    entry: &Value,
    depth: &SourceFile,
    mask: Option<&SourceFile>,
    config: &ViewsConfig,
) -> Result<Image, Fault> {
    let camera = SceneCamera::parse(entry)?;
    let gray = read_gray(depth)?;
    if gray.bits != 16 {
        let few = Fault::unsupported("numbers of 8 bits", "depths of 16 bits");
        return Err(few.in_file(&depth.name));
    }
    let mask = match mask {
        Some(file) => {
            let mask = read_gray(file)?;
            if mask.size != gray.size {
                let ([a, b], [c, d]) = (mask.size, gray.size);
                return Err(Fault::new(
                    format!("the mask has {a} by {b} pixels, the depth image {c} by {d}"),
                    "register the depths to the image of the mask, or the reverse",
                ));
            }
            Some(mask.values.iter().map(|&value| value > 0).collect())
        }
        None => None,
    };
    let depths_m = gray.values.iter().map(|&value| match value {
        SATURATED => 0.0,
        steps => f64::from(steps) * camera.depth_step_m,
    });
    let view = DepthView {
        intrinsics: camera.intrinsics(gray.size)?,
        world_from_camera: camera.world_from_camera.unwrap_or_else(Pose::identity),
        depth_m: depths_m.collect(),
        mask: vec![false; gray.values.len()],
    };
    let scale_mm = 1e3 * camera.depth_step_m;
    object::check_unit(view.depth_m.iter().copied(), "depth_scale", scale_mm)?;
    let (view, table) = object::found(view, mask, config.known_table())?;
    Ok(Image {
        name,
        view,
        depth_step_m: camera.depth_step_m,
        table,
    })
}

fn read_gray(file: &SourceFile) -> Result<GrayImage, Fault> {
    let bytes = file::read(&file.path, MAX_IMAGE_BYTES);
    let gray = bytes.and_then(|bytes| GrayImage::parse(&bytes));
    gray.map_err(|fault| fault.in_file(&file.name))
}
