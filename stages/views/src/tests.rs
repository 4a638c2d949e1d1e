//! The stage on scenes and clouds that are rendered, and on odd ones.

use std::{
    collections::BTreeMap,
    fs,
    path::{Path, PathBuf},
};

use completion::{Completion, Observation, complete};
use dataflow::{Artifact, BoxedDiagnostic, Context, Inputs, Outcome, Output, Scope, Stage};
use depth_view::{DepthView, Intrinsics, StereoNoise};
use geometry::TriMesh;
use nalgebra::Point3;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use schemas::{TABLE_FILE, views::Views};
use serde_json::{Value, json};
use spatial::Pose;
use tempfile::TempDir;

use crate::{
    RecordedViews, ViewsConfig, ViewsMetrics,
    fixture::{PlyForm, Png, SceneImage, carton, ply, rendered, write_scene},
    png::GrayImage,
};

/// What becomes of each object: its images, metrics and what is said of them, or why it is skipped.
pub(crate) type Objects = BTreeMap<String, Result<(Views, ViewsMetrics, String), String>>;

pub(crate) const EYES: [[f64; 3]; 3] = [[0.5, 0.1, 0.4], [-0.3, 0.4, 0.45], [0.1, -0.5, 0.35]];

pub(crate) fn config(path: &Path, more: &Value) -> ViewsConfig {
    let mut table = json!({"path": path});
    for (key, value) in more.as_object().unwrap() {
        table[key] = value.clone();
    }
    serde_json::from_value(table).unwrap()
}

pub(crate) fn made(config: &ViewsConfig) -> Result<Objects, BoxedDiagnostic> {
    RecordedViews::prepare(config)?;
    let mut objects = Objects::new();
    for unit in RecordedViews::units(config, &Scope::default())? {
        let labels = unit.labels.unwrap();
        assert_eq!(labels["object"], unit.partition);
        let folder = tempfile::tempdir().unwrap();
        let key = unit.partition.parse().unwrap();
        let cx = Context::detached(&key, 7, folder.path());
        let inputs = Inputs::new(BTreeMap::new(), unit.files).with_facts(unit.facts);
        let made = match RecordedViews::make(config, &inputs, &cx)? {
            Outcome::Made(metrics) => {
                let path = folder.path().join(TABLE_FILE);
                let files = [(TABLE_FILE.to_owned(), path)].into();
                let views = lake::table::read(&Artifact { key, labels, files }).unwrap();
                let said = ["left_out.txt", "notes.txt"].map(|name| {
                    let said = fs::read_to_string(folder.path().join(name));
                    said.unwrap_or_default()
                });
                Ok((views, metrics, said.concat()))
            }
            Outcome::Skipped { reason } => Err(reason),
            other => panic!("{other:?}"),
        };
        objects.insert(unit.partition, made);
    }
    Ok(objects)
}

/// Returns what becomes of the only object.
pub(crate) fn only(config: &ViewsConfig) -> Result<(Views, ViewsMetrics, String), String> {
    let mut objects = made(config).unwrap();
    assert_eq!(objects.len(), 1);
    objects.pop_first().unwrap().1
}

fn scene(images: &[(u32, SceneImage)]) -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    write_scene(folder.path(), images);
    folder
}

pub(crate) fn as_depth_views(views: &Views) -> Vec<DepthView> {
    let view = |view: &schemas::views::View| DepthView {
        intrinsics: Intrinsics {
            width: usize::try_from(view.width).unwrap(),
            height: usize::try_from(view.height).unwrap(),
            focal: view.focal_px,
            center: view.center_px,
        },
        world_from_camera: view.world_from_camera,
        depth_m: view.depths_m().unwrap(),
        mask: view.pixels().unwrap(),
    };
    views.iter().map(view).collect()
}

/// Returns the volume of the shape that is completed from images, relative to a mesh.
pub(crate) fn relative_volume(views: &Views, mesh: &TriMesh) -> f64 {
    let observation = Observation::new(&as_depth_views(views), None).unwrap();
    let shape = complete(&observation, Completion::Symmetry).unwrap();
    shape.mesh.volume_m3() / mesh.volume_m3()
}

#[test]
fn a_written_scene_is_read_back_as_it_was() {
    let rendered = EYES.map(|eye| rendered(&carton(), eye).view);
    let images = [0, 1, 2].map(|idx| (7 * idx, SceneImage::of(&rendered[idx as usize])));
    let folder = scene(&images);
    let (views, metrics, left_out) =
        only(&config(folder.path(), &json!({"name": "carton"}))).unwrap();
    assert_eq!(
        (metrics.views_n, metrics.unused_n, left_out.as_str()),
        (3.0, 0.0, "")
    );
    assert!(metrics.measured_share > 0.999);
    for (idx, (read, written)) in as_depth_views(&views).iter().zip(&rendered).enumerate() {
        assert_eq!(views[idx].view, format!("{:06}", 7 * idx));
        assert_eq!(read.intrinsics, written.intrinsics);
        assert_eq!(read.mask, written.mask);
        let off = read.world_from_camera.inv_mul(&written.world_from_camera);
        assert!(off.translation.vector.norm() < 1e-9 && off.rotation.angle() < 1e-7);
        for (read_m, written_m) in read.depth_m.iter().zip(&written.depth_m) {
            assert!((read_m - written_m).abs() <= 5.1e-5 || *written_m > 6.5);
        }
        assert!(views[idx].table.is_empty() && views[idx].world_from_object.is_empty());
    }
    let relative = relative_volume(&views, &carton());
    assert!((relative - 1.0).abs() < 0.1, "{relative}");
}

/// Returns an image's points in the world.
pub(crate) fn cloud(view: &DepthView) -> Vec<Point3<f64>> {
    let points = (0..view.depth_m.len()).filter_map(|pixel| view.point_in_camera(pixel));
    points
        .filter(|point| point.z < 2.0)
        .map(|point| view.world_from_camera * point)
        .collect()
}

pub(crate) fn saved(name: &str, bytes: &[u8]) -> (TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join(name);
    fs::write(&path, bytes).unwrap();
    (folder, path)
}

#[test]
fn a_cloud_gives_the_shape_of_the_object_in_any_frame_and_unit() {
    let mesh = carton();
    let rendered = rendered(&mesh, EYES[0]);
    let view = &rendered.view;
    let camera_from_world = view.world_from_camera.inverse();
    let array = |points: &[Point3<f64>], scale: f64| -> Vec<[f64; 3]> {
        points.iter().map(|point| (point * scale).into()).collect()
    };
    let world = cloud(view);
    let camera: Vec<Point3<f64>> = world
        .iter()
        .map(|point| camera_from_world * *point)
        .collect();
    // A frame as of graphics: y up, z backward.
    let graphics: Vec<Point3<f64>> = camera
        .iter()
        .map(|p| Point3::new(p.x, -p.y, -p.z))
        .collect();
    let mut random = ChaCha8Rng::seed_from_u64(5);
    let mut thinned = camera.clone();
    thinned.retain(|_| random.random_bool(0.5));
    let noisy = StereoNoise::default().measured(&rendered, 3);
    let noisy: Vec<Point3<f64>> = cloud(&noisy)
        .iter()
        .map(|point| camera_from_world * *point)
        .collect();
    for (name, points, more) in [
        ("camera", array(&camera, 1.0), json!({})),
        (
            "millimeters",
            array(&camera, 1000.0),
            json!({"unit_m": 0.001}),
        ),
        ("world", array(&world, 1.0), json!({"camera_m": EYES[0]})),
        ("graphics", array(&graphics, 1.0), json!({})),
        ("thinned", array(&thinned, 1.0), json!({})),
        ("noisy", array(&noisy, 1.0), json!({})),
    ] {
        let (_folder, path) = saved(&format!("{name}.ply"), &ply(&points, PlyForm::Little));
        let (views, ..) = only(&config(&path, &more)).unwrap();
        assert_eq!(views[0].view, format!("{name}.ply"));
        let relative = relative_volume(&views, &mesh);
        assert!((relative - 1.0).abs() < 0.25, "{name}: {relative}");
    }
}

/// Returns an image of the carton, from the first place.
fn image() -> SceneImage {
    SceneImage::of(&rendered(&carton(), EYES[0]).view)
}

#[test]
fn an_image_that_does_not_fit_together_is_skipped_with_the_reason() {
    let check = |change: &dyn Fn(&mut SceneImage), more: Value, expected: &str| {
        let mut image = image();
        change(&mut image);
        let folder = scene(&[(4, image)]);
        let reason = only(&config(folder.path(), &more)).unwrap_err();
        assert!(reason.contains(expected), "{expected}: {reason}");
    };
    let none = || json!({});
    let masked = |image: &mut SceneImage, own: &dyn Fn(usize, usize) -> bool| {
        let values = (0..320 * 240).map(|pixel| u16::from(own(pixel % 320, pixel / 320)));
        image.masks[0].values = values.collect();
    };
    check(
        &|it| it.entry["depth_scale"] = json!(0.0001),
        none(),
        "`depth_scale` of 0.1 would be plausible",
    );
    check(
        &|it| it.entry["depth_scale"] = json!(100),
        none(),
        "`depth_scale` of 0.1 would be plausible",
    );
    check(
        &|it| it.entry["depth_scale"] = json!([0.1]),
        none(),
        "image 000004: `depth_scale` is [0.1]",
    );
    check(
        &|it| it.entry["cam_K"] = json!([]),
        none(),
        "image 000004: `cam_K` is []",
    );
    check(
        &|it| it.entry = json!(3),
        none(),
        "`depth_scale` is missing",
    );
    check(
        &|it| it.entry["cam_K"][2] = json!(640),
        none(),
        "(640, 119.5) is outside of the image of 320 by 240",
    );
    check(
        &|it| it.entry["cam_R_w2c"] = json!([1, 0, 0, 0, 1, 0, 0, 0, -1]),
        none(),
        "right-handed",
    );
    check(
        &|it| drop(it.entry.as_object_mut().unwrap().remove("cam_t_w2c")),
        none(),
        "`cam_t_w2c` is missing; give both",
    );
    check(
        &|it| it.depth.bits = 8,
        none(),
        "`depth/000004.png` has numbers of 8 bits, expected depths of 16 bits",
    );
    check(
        &|it| it.depth.values.fill(0),
        none(),
        "no pixel has a depth",
    );
    check(
        &|it| it.depth.values.fill(u16::MAX),
        none(),
        "no pixel has a depth",
    );
    check(
        &|it| masked(it, &|_, _| false),
        none(),
        "the mask is empty; choose other",
    );
    check(
        &|it| masked(it, &|x, _| x < 30),
        none(),
        "reaches the border of the image",
    );
    check(
        &|it| it.masks[0].size = [240, 320],
        none(),
        "the mask has 240 by 320 pixels, the depth image 320 by 240; register",
    );
    let hole = |it: &mut SceneImage| {
        let own = it.masks[0].values.iter().map(|&own| own > 0);
        let depths = it.depth.values.iter_mut().zip(own);
        depths
            .filter(|(_, own)| *own)
            .for_each(|(depth, _)| *depth = 0);
    };
    check(
        &hole,
        none(),
        "0 pixels of the mask have a depth, at least 40",
    );
    let cluttered = |it: &mut SceneImage| {
        let mut random = ChaCha8Rng::seed_from_u64(2);
        it.depth
            .values
            .iter_mut()
            .for_each(|depth| *depth = random.random_range(4000..30_000));
    };
    check(&cluttered, none(), "no table is seen");
    check(
        &|it| {
            cluttered(it);
            it.masks.clear();
        },
        none(),
        "show more of it",
    );
    check(
        &|it| masked(it, &|x, y| x > 200 && x < 260 && y > 180 && y < 220),
        none(),
        "above the table; give the right",
    );
    check(
        &|_| (),
        json!({"table": [0, 0, 1, 0.15]}),
        "m above the table; give the right",
    );
    check(
        &|_| (),
        json!({"table": [0, 0, -1, 0]}),
        "the camera is 0.400 m below the table",
    );
    check(
        &|_| (),
        json!({"table": [0, 0, 1, 400.0]}),
        "399.600 m below",
    );
    let empty = |it: &mut SceneImage| {
        *it = SceneImage::of(&rendered(&carton().scaled(&[1e-3; 3].into()), EYES[0]).view);
        it.masks.clear();
    };
    check(
        &empty,
        none(),
        "no object of at least 40 pixels stands on the table",
    );
    let away = TriMesh::cuboid(Point3::new(-0.3, -0.03, 0.0), Point3::new(0.04, 0.5, 0.12));
    let cut = |it: &mut SceneImage| {
        *it = SceneImage::of(&rendered(&away, EYES[0]).view);
        it.masks.clear();
    };
    check(&cut, none(), "choose an image that shows the whole object");
}

#[test]
fn a_damaged_file_skips_its_image_alone() {
    let images = [0, 1, 2].map(|idx| {
        let view = rendered(&carton(), EYES[idx as usize]).view;
        (idx, SceneImage::of(&view))
    });
    let whole = Png::of(&images[1].1.depth).bytes();
    let mut color = Png::of(&images[1].1.depth);
    color.header[9] = 2;
    let lfs = b"version https://git-lfs.github.com/spec/v1\noid sha256:00\n".to_vec();
    for (file, bytes, expected) in [
        (
            "depth/000001.png",
            whole[..whole.len() / 2].to_vec(),
            "image 000001: `depth/000001.png` ends early; copy it again",
        ),
        (
            "depth/000001.png",
            color.bytes(),
            "`depth/000001.png` has colors, expected gray",
        ),
        (
            "depth/000001.png",
            lfs,
            "pointer of Git LFS; fetch it with `git lfs pull`",
        ),
        (
            "depth/000001.png",
            b"II*\0".to_vec(),
            "has no PNG signature, expected a PNG image; write it as",
        ),
        ("depth/000001.png", Vec::new(), "has no PNG signature"),
        ("mask_visib/000001_000000.png", whole, "ends early"),
    ] {
        let folder = scene(&images);
        let path = folder.path().join(file);
        if file.starts_with("mask") {
            fs::write(&path, &fs::read(&path).unwrap()[..80]).unwrap();
        } else {
            fs::write(&path, bytes).unwrap();
        }
        let (views, metrics, left_out) = only(&config(folder.path(), &json!({}))).unwrap();
        assert_eq!((views.len(), metrics.left_out_n), (2, 1.0));
        assert!(left_out.contains(expected), "{expected}: {left_out}");
    }
    let folder = scene(&images);
    fs::remove_file(folder.path().join("depth/000001.png")).unwrap();
    fs::remove_file(folder.path().join("depth/000002.png")).unwrap();
    fs::create_dir(folder.path().join("depth/000002.png")).unwrap();
    let (views, _, left_out) = only(&config(folder.path(), &json!({}))).unwrap();
    assert_eq!(views.len(), 1);
    assert!(
        left_out.contains("`depth/000001.png` is missing; images are named"),
        "{left_out}"
    );
    assert!(
        left_out.contains("`depth/000002.png` is not a file"),
        "{left_out}"
    );
    let reason = only(&config(folder.path(), &json!({"images": [1, 2]}))).unwrap_err();
    assert!(
        reason.ends_with("`depth/000003.png` (and 1 more)"),
        "{reason}"
    );
}

#[test]
fn images_without_poses_are_worlds_of_their_own() {
    let images = [0, 1, 2].map(|idx| {
        let view = rendered(&carton(), EYES[idx as usize]).view;
        (idx, SceneImage::of(&view).without_pose())
    });
    let folder = scene(&images);
    let (views, metrics, _) = only(&config(folder.path(), &json!({}))).unwrap();
    assert_eq!(
        (views[0].view.as_str(), views.len(), metrics.unused_n),
        ("000000", 1, 2.0)
    );
    assert_eq!(views[0].world_from_camera, Pose::identity());
    let relative = relative_volume(&views, &carton());
    assert!((relative - 1.0).abs() < 0.15, "{relative}");
    let (views, metrics, _) = only(&config(folder.path(), &json!({"images": [2]}))).unwrap();
    assert_eq!((views[0].view.as_str(), metrics.unused_n), ("000002", 0.0));
    // Of some images the pose is known.
    let mut mixed = images;
    mixed[1].1 = SceneImage::of(&rendered(&carton(), EYES[1]).view);
    let (views, metrics, _) = only(&config(scene(&mixed).path(), &json!({}))).unwrap();
    assert_eq!(
        (views[0].view.as_str(), views.len(), metrics.unused_n),
        ("000001", 1, 2.0)
    );
}

#[test]
fn images_of_different_worlds_are_not_put_together() {
    let view = |idx: usize| rendered(&carton(), EYES[idx]).view;
    let check = |second: SceneImage, expected: &str| {
        let folder = scene(&[(0, SceneImage::of(&view(0))), (1, second)]);
        let reason = only(&config(folder.path(), &json!({}))).unwrap_err();
        assert!(reason.contains(expected), "{expected}: {reason}");
    };
    // Camera to world, in place of world to camera.
    let mut inverse = view(1);
    inverse.world_from_camera = inverse.world_from_camera.inverse().reinterpret();
    check(
        SceneImage {
            entry: SceneImage::of(&inverse).entry,
            ..SceneImage::of(&view(1))
        },
        "the table in image 000001 is ",
    );
    let mut shifted = view(1);
    shifted.world_from_camera = shifted
        .world_from_camera
        .translated(&[0.4, 0.0, 0.0].into());
    check(SceneImage::of(&shifted), "the object in image 000001 is 0.");
    // The offset in meters, in place of millimeters.
    let mut meters = SceneImage::of(&view(1));
    for axis in 0..3 {
        meters.entry["cam_t_w2c"][axis] =
            json!(meters.entry["cam_t_w2c"][axis].as_f64().unwrap() / 1000.0);
    }
    check(meters, "take the world to the camera, in mm");
}

#[test]
fn objects_are_named_by_their_entries_or_masks() {
    let image = image();
    let mut two = image.clone();
    two.masks.push(GrayImage {
        values: vec![0; 320 * 240],
        ..two.masks[0].clone()
    });
    let folder = scene(&[(0, two.clone()), (1, two.clone())]);
    let objects = |more: Value| made(&config(folder.path(), &more));
    let names = |objects: &Objects| objects.keys().cloned().collect::<Vec<_>>();
    // By the numbers of the masks; the second is hidden.
    let found = objects(json!({"name": "carton"})).unwrap();
    assert_eq!(names(&found), ["carton_000000", "carton_000001"]);
    assert_eq!(found["carton_000000"].as_ref().unwrap().0.len(), 2);
    let hidden = found["carton_000001"].as_ref().unwrap_err();
    assert!(
        hidden.contains("the mask is empty") && hidden.ends_with("(and 1 more)"),
        "{hidden}"
    );
    // Of the image that alone shows the second, the camera's pose is not known.
    let mixed = scene(&[(0, two.clone().without_pose()), (1, image.clone())]);
    let found = made(&config(mixed.path(), &json!({"name": "carton"}))).unwrap();
    let (views, metrics, _) = found["carton_000000"].as_ref().unwrap();
    assert_eq!((views[0].view.as_str(), metrics.unused_n), ("000001", 1.0));
    assert!(
        found["carton_000001"]
            .as_ref()
            .unwrap_err()
            .contains("image 000000")
    );
    let listed = |entries: Value| {
        fs::write(folder.path().join("scene_gt.json"), entries.to_string()).unwrap();
    };
    listed(json!({"0": [{"obj_id": 5}, {"obj_id": 2}], "1": [{"obj_id": 5}, {"obj_id": 2}]}));
    assert_eq!(
        names(&objects(json!({})).unwrap()),
        ["obj_000002", "obj_000005"]
    );
    // Nothing says which of two alike is which in another image.
    listed(json!({"0": [{"obj_id": 5}, {"obj_id": 5}], "1": [{"obj_id": 5}]}));
    let found = objects(json!({})).unwrap();
    assert_eq!(names(&found), ["obj_000005-1", "obj_000005-2"]);
    let (views, metrics, _) = found["obj_000005-1"].as_ref().unwrap();
    assert_eq!((views.len(), metrics.unused_n), (1, 1.0));
    // Without the mask of an entry.
    listed(json!({"0": [{"obj_id": 5}, {"obj_id": 2}, {"obj_id": 3}]}));
    let found = objects(json!({})).unwrap();
    let missing = found["obj_000003"].as_ref().unwrap_err();
    assert!(
        missing.contains("`mask_visib/000000_000002.png` is missing"),
        "{missing}"
    );
    for wrong in [
        json!({"0": [{"obj_id": -1}]}),
        json!({"0": {"obj_id": 1}}),
        json!({"0": [{}]}),
    ] {
        listed(wrong);
        let err = objects(json!({})).unwrap_err().to_string();
        assert!(
            err.contains("no list of objects with `obj_id` for image 0"),
            "{err}"
        );
    }
    listed(json!({"5": []}));
    let err = objects(json!({})).unwrap_err();
    assert!(err.to_string().contains("no object in 2 images"), "{err}");
    assert!(err.hint().unwrap().contains("`scene_gt.json`"));
    // Without masks it is the largest thing on the table, of which the lowest 8 mm are left out.
    let unmasked = SceneImage {
        masks: Vec::new(),
        ..image.clone()
    };
    let folder = scene(&[(0, unmasked)]);
    let (views, ..) = only(&config(folder.path(), &json!({"name": "carton"}))).unwrap();
    let own = |mask: &[bool]| mask.iter().filter(|own| **own).count();
    let share = own(&views[0].pixels().unwrap()) * 100
        / own(&image.masks[0]
            .values
            .iter()
            .map(|&own| own > 0)
            .collect::<Vec<_>>());
    assert!((85..=100).contains(&share), "{share}");
    fs::write(
        folder.path().join("scene_gt.json"),
        r#"{"0": [{"obj_id": 7}]}"#,
    )
    .unwrap();
    assert_eq!(
        names(&made(&config(folder.path(), &json!({}))).unwrap()),
        ["obj_000007"]
    );
}

#[test]
fn a_path_with_neither_layout_is_an_error_that_names_what_is_near() {
    let folder = tempfile::tempdir().unwrap();
    let root = folder.path();
    fs::create_dir_all(root.join("test/000001")).unwrap();
    write_scene(&root.join("test/000001"), &[(0, image())]);
    fs::write(root.join("notes.txt"), "none").unwrap();
    fs::create_dir_all(root.join("other/clouds")).unwrap();
    fs::write(root.join("other/clouds/mug.ply"), "ply").unwrap();
    fs::create_dir_all(root.join("empty")).unwrap();
    let check = |path: &str, expected: &str, hint: &str| {
        let err = made(&config(&root.join(path), &json!({}))).unwrap_err();
        let (said, hinted) = (err.to_string(), err.hint().unwrap_or_default());
        assert!(said.contains(expected), "{path}: {said}");
        assert!(hinted.contains(hint), "{path}: {hinted}");
    };
    check("tset", "no scene and no cloud", "did you mean");
    check("", "neither a scene", "test/000001`");
    check("test", "neither a scene", "test/000001`");
    check("test/000001/depth", "neither a scene", "test/000001`");
    check(
        "test/000001/scene_camera.json",
        "neither a scene",
        "test/000001`",
    );
    check("other", "neither a scene", "other/clouds/mug.ply`");
    check(
        "notes.txt",
        "neither a scene",
        "a `.ply`, `.npy` or `.mcap`",
    );
    check(
        "empty",
        "neither a scene",
        "`scene_camera.json` and `depth`",
    );
    let list = root.join("test/000001/scene_camera.json");
    for (text, expected) in [
        ("{\"0\": {\"depth_scale\": NaN}}", "line 1 column 23"),
        ("[]", "has no object"),
        ("{\"0\": {", "EOF while parsing"),
        ("version https://git-lfs.github.com/spec/v1\n", "Git LFS"),
    ] {
        fs::write(&list, text).unwrap();
        check("test/000001", expected, "it");
    }
    fs::remove_file(&list).unwrap();
    fs::create_dir(&list).unwrap();
    check(
        "test/000001",
        "`scene_camera.json` is not a file",
        "put the right file",
    );
}

#[test]
fn images_are_chosen_by_number() {
    let image = image();
    let images: Vec<(u32, SceneImage)> = (0..66).map(|k| (k * 10, image.clone())).collect();
    let folder = scene(&images);
    let check = |more: Value, expected: &str, hint: &str| {
        let err = made(&config(folder.path(), &more)).unwrap_err();
        assert!(err.to_string().contains(expected), "{err}");
        assert_eq!(err.hint().unwrap(), hint);
    };
    let hint = "choose some, e.g. `images = [0, 90, 180, 270, 360, 450, 540, 630]`";
    check(json!({}), "66 images are chosen, at most 64", hint);
    check(
        json!({"images": [10, 11]}),
        "`images` has 11",
        "its images are from 0 to 650",
    );
    let (views, ..) = only(&config(folder.path(), &json!({"images": [630, 0, 630]}))).unwrap();
    let names: Vec<&str> = views.iter().map(|view| view.view.as_str()).collect();
    assert_eq!(names, ["000000", "000630"]);
}

#[test]
fn a_unit_names_the_files_that_it_reads() {
    let folder = scene(&[(3, image())]);
    let units = RecordedViews::units(&config(folder.path(), &json!({})), &Scope::default());
    let units = units.unwrap();
    let names: Vec<&str> = units[0]
        .files
        .iter()
        .map(|file| file.name.as_str())
        .collect();
    assert_eq!(
        names,
        [
            "scene_camera.json",
            "depth/000003.png",
            "mask_visib/000003_000000.png"
        ]
    );
    let (_folder, path) = saved("mug.npy", b"");
    let units = RecordedViews::units(&config(&path, &json!({})), &Scope::default()).unwrap();
    assert_eq!(
        (units[0].partition.as_str(), units[0].files[0].name.as_str()),
        ("mug", "mug.npy")
    );
}

#[test]
fn a_cloud_that_shows_no_object_on_a_table_is_skipped_with_the_reason() {
    let view = rendered(&carton(), EYES[0]).view;
    let world: Vec<[f64; 3]> = cloud(&view).into_iter().map(Into::into).collect();
    let object: Vec<[f64; 3]> = world
        .iter()
        .copied()
        .filter(|point| point[2] > 0.01)
        .collect();
    let table: Vec<[f64; 3]> = world
        .iter()
        .copied()
        .filter(|point| point[2] < 1e-6)
        .collect();
    let mut damaged = world.clone();
    damaged[1000][1] = f64::NAN;
    let at = |more: Value| {
        let mut all = json!({"camera_m": EYES[0]});
        all.as_object_mut()
            .unwrap()
            .extend(more.as_object().unwrap().clone());
        all
    };
    let known = || json!({"table": [0, 0, 1, 0]});
    let millimeters: Vec<[f64; 3]> = world.iter().map(|point| point.map(|it| it * 1e3)).collect();
    for (points, more, expected) in [
        (&object, at(json!({})), Some("or `table` if it is another")),
        (&object, at(known()), None),
        (
            &table,
            at(json!({})),
            Some("no object of at least 40 pixels"),
        ),
        (&world, at(known()), None),
        (&world, json!({}), Some("set `camera_m` to")),
        (
            &world,
            at(json!({"table": [0, 0, 1, 0.5]})),
            Some("the camera is 0.100 m below"),
        ),
        (&world, at(json!({"unit_m": 0.001})), Some("within 0.0")),
        (
            &millimeters,
            json!({}),
            Some("`unit_m` of 0.001 would be plausible"),
        ),
        (
            &damaged,
            at(json!({})),
            Some("point 1000 has numbers that are finite, and"),
        ),
        (
            &object[..150].to_vec(),
            at(json!({})),
            Some("150 points, at least 200"),
        ),
    ] {
        let (_folder, path) = saved("carton.ply", &ply(points, PlyForm::Text));
        match (only(&config(&path, &more)), expected) {
            (Ok((views, ..)), None) => assert_eq!(
                views[0].table.len(),
                usize::from(more.get("table").is_some())
            ),
            (Err(reason), Some(expected)) => {
                assert!(reason.contains(expected), "{expected}: {reason}");
            }
            (Ok(_), Some(expected)) => panic!("{expected}: read"),
            (Err(reason), None) => panic!("{reason}"),
        }
    }
    for (name, bytes, expected) in [
        (
            "cloud.ply",
            b"".to_vec(),
            "`cloud.ply` has no PLY signature",
        ),
        (
            "cloud.NPY",
            b"ply".to_vec(),
            "`cloud.NPY` has no NPY signature",
        ),
        (
            "cloud.ply",
            ply(&world, PlyForm::Big)[..9000].to_vec(),
            "`cloud.ply` ends early; copy it again",
        ),
    ] {
        let (_folder, path) = saved(name, &bytes);
        let reason = only(&config(&path, &json!({}))).unwrap_err();
        assert!(reason.contains(expected), "{expected}: {reason}");
    }
}
