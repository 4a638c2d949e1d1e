//! The camera of a recorded image: a `sensor_msgs/msg/CameraInfo`.
//!
//! Binning and the region of interest are applied as the package `image_geometry` of ROS 2 does it.

use depth_view::Intrinsics;
use schemas::ros2::CameraInfo;

use crate::{error::Fault, scene_camera::pinhole, transforms::plain};

/// What to do about a `CameraInfo` of other images.
const OTHER: &str = "record the CameraInfo of the depth images, or choose their `topic`";

/// An image that a `CameraInfo` is looked up for.
pub(crate) struct ImageOf<'a> {
    pub(crate) topic: &'a str,
    /// Columns and rows.
    pub(crate) size: [usize; 2],
    pub(crate) frame: &'a str,
}

/// Returns the name of the topic that has the `CameraInfo` of a topic of images, beside it as `image_transport` has it.
pub(crate) fn topic_beside(images: &str) -> String {
    let plain = ["/compressedDepth", "/compressed"]
        .into_iter()
        .find_map(|transport| images.strip_suffix(transport))
        .unwrap_or(images);
    let (namespace, _) = plain.rsplit_once('/').unwrap_or(("", plain));
    format!("{namespace}/camera_info")
}

/// Returns the intrinsics of an image, from the `CameraInfo` on a topic.
///
/// # Errors
///
/// Fails if it is of another image, or of one that is not rectified.
pub(crate) fn intrinsics(
    info: &CameraInfo,
    topic: &str,
    image: &ImageOf<'_>,
) -> Result<Intrinsics, Fault> {
    let [width, height] = size(info);
    let [columns, rows] = image.size;
    if [width, height] != [columns as u64, rows as u64] {
        let problem = format!(
            "the CameraInfo on `{topic}` is of {width} by {height} pixels, the image has {columns} by {rows}"
        );
        return Err(Fault::new(problem, OTHER));
    }
    let frames = [plain(&info.header.frame_id), plain(image.frame)];
    if frames[0] != frames[1] && frames.iter().all(|frame| !frame.is_empty()) {
        let [of_info, of_image] = frames;
        let problem = format!(
            "the CameraInfo on `{topic}` is of the frame `{of_info}`, the image of `{of_image}`"
        );
        return Err(Fault::new(problem, OTHER));
    }
    let (mut matrix, key) = matrix(info, topic, image.topic)?;
    let [fx, skew, cx, _, fy, cy, ..] = &mut matrix;
    let [bin_x, bin_y] = binning(info);
    *cx = (*cx - f64::from(info.roi.x_offset)) / f64::from(bin_x);
    *cy = (*cy - f64::from(info.roi.y_offset)) / f64::from(bin_y);
    *fx /= f64::from(bin_x);
    *skew /= f64::from(bin_x);
    *fy /= f64::from(bin_y);
    let fault = |fault: Fault| fault.on_topic(topic);
    pinhole(&matrix, image.size, key).map_err(fault)
}

/// Returns the matrix of intrinsics of the rectified image at full resolution, and the field that has it.
fn matrix(info: &CameraInfo, topic: &str, images: &str) -> Result<([f64; 9], &'static str), Fault> {
    let [fx, skew, cx, _, below, fy, cy, _, x, y, one, _] = info.p;
    let projection = [fx, skew, cx, below, fy, cy, x, y, one];
    let is_rectified = images.to_ascii_lowercase().contains("rect");
    let is_straight = info.d.iter().all(|&number| number == 0.0);
    let is_set = |matrix: &[f64; 9]| matrix[0] != 0.0;
    if is_rectified && is_set(&projection) {
        return Ok((projection, "p"));
    }
    if !is_set(&info.k) {
        return Err(Fault::new(
            format!(
                "the CameraInfo on `{topic}` is of no calibrated camera: its `k` begins with 0"
            ),
            "calibrate the camera, e.g. with the package `camera_calibration`, and record anew",
        ));
    }
    if is_straight {
        return Ok((info.k, "k"));
    }
    let d: Vec<String> = info.d.iter().take(8).map(ToString::to_string).collect();
    Err(Fault::new(
        format!(
            "the images on `{images}` are distorted: `d` of the CameraInfo on `{topic}` is [{}]",
            d.join(", ")
        ),
        "record the rectified depth images, `image_rect`, which the package `image_proc` makes",
    ))
}

/// Returns how many pixels of the full resolution a pixel stands for, along both sides.
fn binning(info: &CameraInfo) -> [u32; 2] {
    [info.binning_x, info.binning_y].map(|n| n.max(1))
}

/// Returns the columns and rows of an image with a `CameraInfo`.
fn size(info: &CameraInfo) -> [u64; 2] {
    let full = [info.width, info.height];
    let part = [info.roi.width, info.roi.height];
    let bins = binning(info);
    [0, 1].map(|side| {
        let shown = if part[side] == 0 {
            full[side]
        } else {
            part[side]
        };
        u64::from(shown / bins[side])
    })
}

#[cfg(test)]
mod tests {
    use schemas::ros2::{Header, RegionOfInterest};

    use super::*;

    fn info() -> CameraInfo {
        CameraInfo {
            header: Header {
                frame_id: "optical".to_owned(),
                ..Header::default()
            },
            height: 480,
            width: 640,
            d: vec![0.0; 5],
            k: [600.0, 0.0, 310.0, 0.0, 610.0, 250.0, 0.0, 0.0, 1.0],
            p: [
                500.0, 0.0, 320.0, -25.0, 0.0, 510.0, 240.0, 0.0, 0.0, 0.0, 1.0, 0.0,
            ],
            ..CameraInfo::default()
        }
    }

    fn found(info: &CameraInfo, topic: &str, size: [usize; 2]) -> Result<Intrinsics, Fault> {
        let frame = "/optical";
        let image = ImageOf { topic, size, frame };
        intrinsics(info, "/depth/camera_info", &image)
    }

    #[test]
    fn a_rectified_image_has_the_projection_and_a_straight_one_the_matrix() {
        let check = |info: &CameraInfo, topic: &str, size, focal: [f64; 2], center: [f64; 2]| {
            let found = found(info, topic, size).unwrap();
            assert_eq!((found.focal, found.center), (focal, center));
        };
        let full = [640, 480];
        let [raw, rectified] = ["/depth/image_raw", "/depth/image_rect_raw"];
        check(&info(), raw, full, [600.0, 610.0], [310.0, 250.0]);
        check(&info(), rectified, full, [500.0, 510.0], [320.0, 240.0]);
        let mut distorted = info();
        distorted.d[0] = 0.1;
        check(&distorted, rectified, full, [500.0, 510.0], [320.0, 240.0]);
        let mut no_projection = info();
        no_projection.p = [0.0; 12];
        check(
            &no_projection,
            rectified,
            full,
            [600.0, 610.0],
            [310.0, 250.0],
        );
        let mut halved = info();
        (halved.binning_x, halved.binning_y) = (2, 2);
        check(&halved, raw, [320, 240], [300.0, 305.0], [155.0, 125.0]);
        halved.roi = RegionOfInterest {
            x_offset: 100,
            y_offset: 50,
            width: 500,
            height: 400,
            do_rectify: true,
        };
        check(&halved, raw, [250, 200], [300.0, 305.0], [105.0, 100.0]);
    }

    #[test]
    fn a_camera_of_another_image_is_refused() {
        let check = |change: &dyn Fn(&mut CameraInfo), topic: &str, expected: &str| {
            let mut info = info();
            change(&mut info);
            let said = found(&info, topic, [640, 480]).unwrap_err().reason();
            assert!(said.contains(expected), "{expected}: {said}");
        };
        let raw = "/depth/image_raw";
        check(
            &|it| it.width = 1280,
            raw,
            "is of 1280 by 480 pixels, the image has 640 by 480",
        );
        check(&|it| it.binning_x = u32::MAX, raw, "is of 0 by 480 pixels");
        check(
            &|it| "color".clone_into(&mut it.header.frame_id),
            raw,
            "is of the frame `color`, the image of `optical`; record the CameraInfo",
        );
        check(
            &|it| it.d[1] = -0.2,
            raw,
            "`d` of the CameraInfo on `/depth/camera_info` is [0, -0.2,",
        );
        check(&|it| it.d[1] = f64::NAN, raw, "are distorted");
        check(&|it| it.k = [0.0; 9], raw, "is of no calibrated camera");
        check(&|it| it.k[0] = 0.6, raw, "a focal length is 0.6 px");
        check(
            &|it| it.k[2] = f64::NAN,
            raw,
            "the principal point (NaN, 250) is outside",
        );
        check(
            &|it| it.k[1] = 3.0,
            raw,
            "`k` is that of no rectified image",
        );
        check(
            &|it| it.p[0] = -1.0,
            "/image_rect",
            "a focal length is -1 px",
        );
    }

    #[test]
    fn the_camera_of_images_is_beside_them() {
        for (images, expected) in [
            ("/camera/depth/image_rect_raw", "/camera/depth/camera_info"),
            (
                "/camera/depth/image_raw/compressedDepth",
                "/camera/depth/camera_info",
            ),
            ("/image", "/camera_info"),
            ("image", "/camera_info"),
        ] {
            assert_eq!(topic_beside(images), expected);
        }
    }
}
