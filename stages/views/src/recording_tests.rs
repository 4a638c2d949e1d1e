//! The stage on recordings of rendered images, and on odd ones.

#![expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "depths and numbers of tests"
)]

use std::{fs, path::Path};

use dataflow::{Output, Scope};
use depth_view::DepthView;
use lake::recording::Recording;
use nalgebra::{Isometry3, Point3};
use schemas::ros2::{CameraInfo, CompressedImage, Image, Message, PointCloud2, Text, TfMessage};
use serde_json::{Value, json};
use spatial::Pose;

use crate::{
    RecordedViews,
    fixture::{Png, carton, mutated, rendered},
    png::GrayImage,
    recording_fixture::{
        OPTICAL, Sent, camera_info, cloud_message, header, image_16, image_32, mcap, sent, tf,
    },
    tests::{EYES, as_depth_views, cloud, config, made, only, relative_volume, saved},
};

const DEPTH: &str = "/camera/depth/image_rect_raw";
const CAMERA: &str = "/camera/depth/camera_info";
const SIZE: [u32; 2] = [320, 240];

fn view(idx: usize) -> DepthView {
    rendered(&carton(), EYES[idx]).view
}

fn millimeters(view: &DepthView) -> Vec<u16> {
    let steps = view.depth_m.iter().map(|depth_m| (depth_m * 1e3).round());
    steps.map(|steps| steps.min(65_535.0) as u16).collect()
}

fn depth(time_ms: i32, view: &DepthView) -> Image {
    Image {
        header: header(time_ms, OPTICAL),
        ..image_16(SIZE, &millimeters(view))
    }
}

/// Returns the messages of an image at a time.
fn shown(time_ms: i32, view: &DepthView) -> Vec<Sent> {
    let mut info = camera_info(view);
    info.header = header(time_ms, OPTICAL);
    vec![
        sent(CAMERA, time_ms, &info),
        sent(DEPTH, time_ms, &depth(time_ms, view)),
    ]
}

fn points(view: &DepthView) -> Vec<[f64; 3]> {
    let camera_from_world = view.world_from_camera.inverse();
    let points = cloud(view).into_iter();
    points
        .map(|point| (camera_from_world * point).into())
        .collect()
}

/// Returns what becomes of the only object of a recording.
fn read(
    messages: &[Sent],
    more: &Value,
) -> Result<(Vec<DepthView>, Vec<String>, f64, String), String> {
    let (_folder, path) = saved("carton.mcap", &mcap(messages));
    let (views, metrics, said) = only(&config(&path, more))?;
    let names = views.iter().map(|view| view.view.clone()).collect();
    Ok((as_depth_views(&views), names, metrics.unused_n, said))
}

fn reason(messages: &[Sent], more: &Value) -> String {
    read(messages, more).unwrap_err()
}

#[test]
fn recorded_depths_are_read_back_as_they_were() {
    let view = view(0);
    let plain = depth(0, &view);
    let mut padded = plain.clone();
    padded.step += 6;
    padded.data = plain
        .data
        .chunks(plain.step as usize)
        .flat_map(|row| [row, &[255; 6]].concat())
        .collect();
    let mut turned = plain.clone();
    turned.is_bigendian = 1;
    for pair in turned.data.chunks_mut(2) {
        pair.reverse();
    }
    let meters: Vec<f32> = view.depth_m.iter().map(|&depth_m| depth_m as f32).collect();
    let png = Png::of(&GrayImage {
        size: [320, 240],
        bits: 16,
        values: millimeters(&view),
    });
    let packed = CompressedImage {
        header: header(0, OPTICAL),
        format: "16UC1; compressedDepth png".to_owned(),
        data: [vec![0; 12], png.filtered(4).bytes()].concat(),
    };
    let packed = sent(&format!("{DEPTH}/compressedDepth"), 5, &packed);
    for (message, tolerance_m) in [
        (sent(DEPTH, 5, &plain), 5.1e-4),
        (sent(DEPTH, 5, &padded), 5.1e-4),
        (sent(DEPTH, 5, &turned), 5.1e-4),
        (sent(DEPTH, 5, &image_32(SIZE, &meters)), 5.1e-5),
        (packed, 5.1e-4),
    ] {
        let messages = [sent(CAMERA, 0, &camera_info(&view)), message];
        let (read, names, unused_n, said) = read(&messages, &json!({})).unwrap();
        assert_eq!(
            (names, unused_n, said.as_str()),
            (vec!["000000".to_owned()], 0.0, "")
        );
        assert_eq!(read[0].intrinsics, view.intrinsics);
        assert_eq!(read[0].world_from_camera, Pose::identity());
        for (read_m, written_m) in read[0].depth_m.iter().zip(&view.depth_m) {
            assert!(
                (read_m - written_m).abs() < tolerance_m,
                "{read_m} {written_m}"
            );
        }
    }
}

/// The messages of three images whose camera a frame carries that tf tracks.
fn tracked() -> Vec<Sent> {
    let link_from_optical = Isometry3::translation(0.02, -0.01, 0.05);
    let link_from_optical = link_from_optical * Isometry3::rotation([0.3, -0.2, 0.9].into());
    let fixed = tf(0, ["camera_link", OPTICAL], &link_from_optical);
    let mut messages = vec![sent("/tf_static", 0, &fixed)];
    for (idx, time_ms) in (0..3).zip([1000, 2000, 3000]) {
        let view = view(idx);
        let map_from_link = *view.world_from_camera * link_from_optical.inverse();
        for off_ms in [-40, 60] {
            // It moves evenly along a line.
            let off = Isometry3::translation(0.0, 0.0, 1e-3 * f64::from(off_ms));
            let moved = tf(
                time_ms + off_ms,
                ["map", "camera_link"],
                &(off * map_from_link),
            );
            messages.push(sent("/tf", time_ms + off_ms, &moved));
        }
        messages.extend(shown(time_ms, &view));
    }
    messages
}

#[test]
fn images_that_tf_tracks_are_views_of_one_world() {
    let (read, names, unused_n, said) = read(&tracked(), &json!({"images": [2, 0, 1]})).unwrap();
    assert_eq!((unused_n, said.as_str()), (0.0, ""));
    assert_eq!(names, ["000000", "000001", "000002"]);
    for (idx, read) in read.iter().enumerate() {
        let off = read.world_from_camera.inv_mul(&view(idx).world_from_camera);
        assert!(off.translation.vector.norm() < 1e-9 && off.rotation.angle() < 1e-7);
    }
    let (_folder, path) = saved("carton.mcap", &mcap(&tracked()));
    let (views, ..) = only(&config(&path, &json!({"images": [0, 1, 2]}))).unwrap();
    let relative = relative_volume(&views, &carton());
    assert!((relative - 1.0).abs() < 0.15, "{relative}");
}

#[test]
fn images_without_a_place_in_tf_are_worlds_of_their_own() {
    let untracked: Vec<Sent> = (0..3)
        .flat_map(|idx| shown(100 * idx, &view(idx as usize)))
        .collect();
    let all = json!({"images": [0, 1, 2]});
    let (one, names, unused_n, said) = read(&untracked, &all).unwrap();
    assert_eq!(
        (names[0].as_str(), unused_n, said.as_str()),
        ("000000", 2.0, "")
    );
    assert_eq!(one[0].world_from_camera, Pose::identity());
    let (_, names, unused_n, _) = read(&untracked, &json!({"images": [1]})).unwrap();
    assert_eq!((names[0].as_str(), unused_n), ("000001", 0.0));
    // Of a camera that hangs on itself alone nothing says whether it moved.
    let pose = Isometry3::translation(0.1, 0.2, 0.3);
    let mut fixed = untracked.clone();
    fixed.push(sent(
        "/tf_static",
        0,
        &tf(0, ["camera_link", OPTICAL], &pose),
    ));
    let (one, _, unused_n, said) = read(&fixed, &all).unwrap();
    assert_eq!((one.len(), unused_n, said.as_str()), (1, 2.0, ""));
    assert_eq!(*one[0].world_from_camera, pose);
    let mut lacking = untracked.clone();
    lacking.push(sent("/tf", 0, &tf(0, ["map", "base"], &pose)));
    let (one, _, _, said) = read(&lacking, &json!({})).unwrap();
    assert_eq!(one[0].world_from_camera, Pose::identity());
    let expected = "image 000000: tf has no parent of the frame `camera_optical`, so that its world is its own; record `/tf`";
    assert!(said.starts_with(expected), "{said}");
    let mut late = untracked;
    late.push(sent("/tf", 0, &tf(900, ["map", OPTICAL], &pose)));
    let (.., said) = read(&late, &json!({})).unwrap();
    assert!(
        said.contains("does not say where `camera_optical` was"),
        "{said}"
    );
}

#[test]
fn a_recorded_cloud_gives_the_shape_of_the_object() {
    let view = view(0);
    let mut rows = vec![[f64::NAN; 3]; 320 * 240];
    for (pixel, row) in rows.iter_mut().enumerate() {
        let point = view.point_in_camera(pixel).filter(|point| point.z < 2.0);
        *row = point.map_or(*row, Into::into);
    }
    let place = tf(0, ["map", OPTICAL], &view.world_from_camera);
    for cloud in [cloud_message(&rows, 320), cloud_message(&points(&view), 1)] {
        let messages = [sent("/tf_static", 0, &place), sent("/points", 0, &cloud)];
        let (_folder, path) = saved("carton.mcap", &mcap(&messages));
        let (views, ..) = only(&config(&path, &json!({"table": [0, 0, 1, 0]}))).unwrap();
        let relative = relative_volume(&views, &carton());
        assert!((relative - 1.0).abs() < 0.25, "{relative}");
        let at = views[0].world_from_camera.translation.vector;
        assert!((Point3::from(at) - Point3::from(EYES[0])).norm() < 1e-9);
    }
    // Depth images are preferred, and a cloud may be chosen.
    let mut both = shown(0, &view);
    both.push(sent("/points", 0, &cloud_message(&points(&view), 1)));
    let (preferred, ..) = read(&both, &json!({})).unwrap();
    assert_eq!(preferred[0].intrinsics, view.intrinsics);
    let (chosen, ..) = read(&both, &json!({"topic": "/points"})).unwrap();
    assert_ne!(chosen[0].intrinsics, view.intrinsics);
}

#[test]
fn images_are_numbered_in_the_order_of_time() {
    let mut messages = shown(3000, &view(1));
    messages.extend(shown(1000, &view(0)));
    // The camera zooms in between.
    let mut near = view(0);
    near.intrinsics.focal = near.intrinsics.focal.map(|focal| 1.01 * focal);
    let mut info = camera_info(&near);
    info.header = header(3001, OPTICAL);
    messages[0] = sent(CAMERA, 3001, &info);
    let camera = |more: Value| read(&messages, &more).unwrap().0[0].intrinsics;
    assert_eq!(camera(json!({})), view(0).intrinsics);
    assert_eq!(camera(json!({"images": [1]})), near.intrinsics);
    let said = reason(&messages, &json!({"images": [0, 2]}));
    let expected = "`carton.mcap` has no image 2, which `images` has; its images are from 0 to 1";
    assert_eq!(said, expected);
    let many: Vec<u32> = (0..65).collect();
    let said = reason(&messages, &json!({"images": many}));
    assert!(said.contains("has 65 chosen images, at most 64"), "{said}");
}

#[test]
fn compressed_recordings_of_this_project_and_folders_of_rosbag2_are_read() {
    let folder = tempfile::tempdir().unwrap();
    let bag = folder.path().join("carton 1");
    fs::create_dir(&bag).unwrap();
    let file = bag.join("carton_0.mcap");
    let mut recording = Recording::create(&file, &[].into()).unwrap();
    recording.write(CAMERA, 0, &camera_info(&view(0))).unwrap();
    recording.write(DEPTH, 0, &depth(0, &view(0))).unwrap();
    recording.finish().unwrap();
    fs::write(bag.join("metadata.yaml"), "rosbag2_bagfile_information:\n").unwrap();
    let objects = made(&config(&bag, &json!({}))).unwrap();
    let (views, ..) = objects["carton_1"].as_ref().unwrap();
    assert_eq!(as_depth_views(views)[0].intrinsics, view(0).intrinsics);
    let more = json!({"images": [5, 0], "topic": DEPTH});
    let units = RecordedViews::units(&config(&file, &more), &Scope::default()).unwrap();
    assert_eq!(units[0].partition, "carton_0");
    assert_eq!(units[0].files[0].name, "carton_0.mcap");
    assert_eq!(
        (
            units[0].facts["images"].as_str(),
            units[0].facts["topic"].as_str()
        ),
        ("5 0", DEPTH)
    );
    // Cut off in its only chunk.
    let bytes = fs::read(&file).unwrap();
    fs::write(&file, &bytes[..bytes.len() / 2]).unwrap();
    let reason = only(&config(&file, &json!({}))).unwrap_err();
    assert!(
        reason.starts_with("`carton_0.mcap` ends early; copy it again, or save"),
        "{reason}"
    );
    let mut damaged = bytes.clone();
    damaged[bytes.len() / 2] ^= 0x10;
    fs::write(&file, damaged).unwrap();
    let reason = only(&config(&file, &json!({}))).unwrap_err();
    assert!(
        reason.starts_with("`carton_0.mcap` is damaged ("),
        "{reason}"
    );
    let mut other = bytes.clone();
    let zstd = bytes.windows(4).position(|word| word == b"zstd").unwrap();
    other[zstd..zstd + 4].copy_from_slice(b"lz4x");
    fs::write(&file, other).unwrap();
    let reason = only(&config(&file, &json!({}))).unwrap_err();
    assert!(
        reason.contains("is compressed with `lz4x`, which is not read; compress"),
        "{reason}"
    );
}

#[test]
fn other_recordings_are_an_error_that_says_how_to_convert_them() {
    let folder = tempfile::tempdir().unwrap();
    let root = folder.path();
    let check = |path: &Path, expected: &str, hint: &str| {
        let err = made(&config(path, &json!({}))).unwrap_err();
        let (said, hinted) = (err.to_string(), err.hint().unwrap_or_default());
        assert!(said.contains(expected), "{said}");
        assert!(hinted.contains(hint), "{hinted}");
    };
    let bag = |name: &str, files: &[&str]| {
        let bag = root.join(name);
        fs::create_dir(&bag).unwrap();
        for file in files {
            fs::write(bag.join(file), "").unwrap();
        }
        bag
    };
    let ros1 = root.join("demo.bag");
    fs::write(&ros1, "#ROSBAG V2.0\n").unwrap();
    check(&ros1, "is one of ROS 1, and MCAP alone", "demo.bag --dst ");
    let sqlite = bag("sqlite", &["metadata.yaml", "a_0.db3"]);
    check(&sqlite, "is in SQLite format", "with `ros2 bag convert`");
    let convert = format!("--src {} --dst", sqlite.display());
    check(&sqlite.join("a_0.db3"), "is in SQLite format", &convert);
    let packed = bag("packed", &["metadata.yaml", "a_0.mcap.zstd"]);
    check(&packed, "is compressed as a whole", "`zstd -d ");
    let split = bag("split", &["metadata.yaml", "a_1.mcap", "a_0.mcap"]);
    check(&split, "has 2 files, at most 1 is read", "split/a_0.mcap`");
    check(
        &bag("alone", &["a.mcap"]),
        "neither a scene",
        "alone/a.mcap`",
    );
    check(
        &bag("none", &["metadata.yaml"]),
        "neither a scene",
        "or `.mcap`",
    );
    for (bytes, expected) in [
        (
            &b"#ROSBAG V2.0\n"[..],
            "is a recording of ROS 1; convert it",
        ),
        (
            b"SQLite format 3\0",
            "is a recording in SQLite format; convert",
        ),
        (
            &[0x28, 0xb5, 0x2f, 0xfd, 0, 0, 0, 0, 0],
            "is compressed as a whole; unpack",
        ),
        (
            b"version https://git-lfs.github.com/spec/v1\n",
            "Git LFS; fetch",
        ),
        (
            b"nothing of a recording",
            "is not in MCAP format; record with",
        ),
        (b"", "ends early"),
    ] {
        let (_folder, path) = saved("demo.mcap", bytes);
        let reason = only(&config(&path, &json!({}))).unwrap_err();
        assert!(
            reason.starts_with("`demo.mcap` ") && reason.contains(expected),
            "{reason}"
        );
    }
}

/// Changes the message on a topic.
fn changed<M: Message>(messages: &mut [Sent], topic: &str, change: impl Fn(&mut M)) {
    for message in messages.iter_mut().filter(|message| message.topic == topic) {
        let mut content = M::from_cdr(&message.bytes).unwrap();
        change(&mut content);
        message.bytes = content.to_cdr();
    }
}

#[test]
#[expect(clippy::too_many_lines, reason = "a table of cases")]
fn a_recording_that_does_not_fit_together_is_skipped_with_the_reason() {
    let check = |change: &dyn Fn(&mut Vec<Sent>), more: Value, expected: &str| {
        let mut messages = shown(0, &view(0));
        change(&mut messages);
        let reason = reason(&messages, &more);
        assert!(reason.contains(expected), "{expected}: {reason}");
    };
    let none = || json!({});
    let image = |change: fn(&mut Image)| move |it: &mut Vec<Sent>| changed(it, DEPTH, change);
    let info = |change: fn(&mut CameraInfo)| move |it: &mut Vec<Sent>| changed(it, CAMERA, change);
    let tf_with = |transform: fn(&mut TfMessage)| {
        move |it: &mut Vec<Sent>| {
            let mut message = tf(0, ["map", OPTICAL], &Isometry3::identity());
            transform(&mut message);
            it.push(sent("/tf", 0, &message));
        }
    };
    check(
        &Vec::clear,
        none(),
        "`carton.mcap` has no messages; record while",
    );
    check(
        &|it| drop(it.remove(0)),
        none(),
        "has no CameraInfo of the images on `/camera/depth/image_rect_raw`; record `/camera/depth/camera_info` with them",
    );
    check(
        &|it| {
            "/color/camera_info".clone_into(&mut it[0].topic);
            changed(it, "/color/camera_info", |it: &mut CameraInfo| {
                it.header.frame_id.clear();
            });
        },
        none(),
        "(it has `/color/camera_info`)",
    );
    check(
        &info(|it| it.width = 640),
        none(),
        "is of 640 by 240 pixels, the image has 320 by 240",
    );
    check(
        &info(|it| it.header.frame_id.push('2')),
        none(),
        "is of the frame `camera_optical2`",
    );
    check(
        &info(|it| (it.p, it.k) = ([0.0; 12], [0.0; 9])),
        none(),
        "is of no calibrated camera",
    );
    check(
        &info(|it| it.p[2] = 900.0),
        none(),
        "on `/camera/depth/camera_info`: the principal point (900, 119.5)",
    );
    check(
        &|it| {
            changed(it, CAMERA, |it: &mut CameraInfo| it.d[0] = 0.1);
            "/camera/depth/image_raw".clone_into(&mut it[1].topic);
        },
        none(),
        "are distorted: `d` of the CameraInfo",
    );
    check(
        &image(|it| "8UC1".clone_into(&mut it.encoding)),
        none(),
        "`/camera/depth/image_rect_raw` of images of `8UC1`; record a topic",
    );
    check(
        &image(|it| it.step = 10),
        none(),
        "image 000000: on `/camera/depth/image_rect_raw`: `step` is 10",
    );
    check(
        &image(|it| it.data.truncate(1000)),
        none(),
        "`data` has 1000 bytes, expected 153600",
    );
    check(&image(|it| it.data.fill(0)), none(), "no pixel has a depth");
    check(
        &image(|it| it.data.fill(200)),
        none(),
        "`unit_m` of 0.01 would be plausible",
    );
    check(
        &image(|it| *it = image_32(SIZE, &vec![f32::NAN; 320 * 240])),
        none(),
        "no pixel has a depth",
    );
    check(
        &|it| it[1].message_type.clear(),
        none(),
        "of messages without a schema",
    );
    check(
        &|it| {
            for message in it {
                message.bytes.splice(0..4, [0x28, 0xb5, 0x2f, 0xfd]);
            }
        },
        none(),
        "of messages that are compressed one by one; record anew, without `--compression-mode message`",
    );
    check(
        &|it| "ros1".clone_into(&mut it[1].encoding),
        none(),
        "sensor_msgs/msg/Image encoded as `ros1`, not `cdr`",
    );
    check(
        &|it| it[1].bytes[1] = 7,
        none(),
        "that cannot be decoded (encapsulation is not XCDR1)",
    );
    check(
        &|it| it[1].bytes.truncate(200),
        none(),
        "image 000000: on `/camera/depth/image_rect_raw`: its message is no sensor_msgs/msg/Image (message ends at byte 200",
    );
    check(
        &|it| it[0].bytes.truncate(90),
        none(),
        "has no CameraInfo of the images",
    );
    check(
        &|it| *it = vec![sent("/chatter", 0, &Text::default())],
        none(),
        "has neither depth images nor clouds, but `/chatter` of std_msgs/msg/String",
    );
    let twice = |it: &mut Vec<Sent>| {
        let mut second = it[1].clone();
        second.topic.push('2');
        it.push(second);
    };
    check(
        &twice,
        none(),
        "has several topics of depth images: `/camera/depth/image_rect_raw`, `/camera/depth/image_rect_raw2`; choose one, e.g. `topic = \"/camera/depth/image_rect_raw\"`",
    );
    check(
        &|_| (),
        json!({"topic": "/camera/depth/image_rect_rew"}),
        "has no topic `/camera/depth/image_rect_rew`; did you mean `/camera/depth/image_rect_raw`?",
    );
    check(
        &|_| (),
        json!({"topic": "/lidar"}),
        "has no topic `/lidar`; it has `/camera/depth/camera_info` of sensor_msgs/msg/CameraInfo, ",
    );
    check(
        &|_| (),
        json!({"topic": CAMERA}),
        "has no depths on `/camera/depth/camera_info`, but sensor_msgs/msg/CameraInfo; choose `/camera/depth/image_rect_raw`",
    );
    check(
        &tf_with(|it| it.transforms[0].transform.rotation.w = 0.0),
        none(),
        "image 000000: the transform of `camera_optical` in `map` is none: quaternion",
    );
    check(
        &tf_with(|it| "camera_optical".clone_into(&mut it.transforms[0].header.frame_id)),
        none(),
        "the frames of tf are in a circle",
    );
    check(
        &|it| {
            let far: Vec<[f64; 3]> = points(&view(0))
                .iter()
                .map(|it| it.map(|at| at * 1e3))
                .collect();
            *it = vec![sent("/points", 0, &cloud_message(&far, 1))];
        },
        none(),
        "`unit_m` of 0.001 would be plausible",
    );
    check(
        &|it| {
            *it = vec![sent("/points", 0, &cloud_message(&[[1.0; 3]; 4], 1))];
            changed(it, "/points", |it: &mut PointCloud2| it.fields.truncate(2));
        },
        none(),
        "image 000000: on `/points`: the cloud has no field `z`",
    );
}

#[test]
fn no_byte_of_a_recording_makes_it_panic() {
    let numbers: Vec<u16> = (0..24 * 18).map(|idx| 600 + idx % 7).collect();
    let mut small = view(0);
    (small.intrinsics.width, small.intrinsics.height) = (24, 18);
    small.intrinsics.center = [12.0, 9.0];
    let pose = Isometry3::translation(0.0, 0.0, 0.5);
    let messages = [
        sent("/tf_static", 0, &tf(0, ["link", OPTICAL], &pose)),
        sent("/tf", 0, &tf(0, ["map", "link"], &pose)),
        sent(CAMERA, 0, &camera_info(&small)),
        sent(DEPTH, 0, &image_16([24, 18], &numbers)),
    ];
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("small.mcap");
    let mut reasons: Vec<String> = Vec::new();
    for bytes in mutated(&mcap(&messages), 1500) {
        fs::write(&path, bytes).unwrap();
        if let Err(reason) = only(&config(&path, &json!({}))) {
            reasons.push(reason);
        }
    }
    let has = |part: &str| reasons.iter().any(|reason| reason.contains(part));
    for part in [
        "ends early",
        "is damaged",
        "has no CameraInfo",
        "image 000000: ",
        "neither depth",
    ] {
        assert!(has(part), "{part}");
    }
}
