//! A tree in `HO-Cap`'s layout, made here, gives the same reach as one in `DexYCB`'s; a bad one ends like a bad one
//! there. The dataset's own files were never met.

use std::{
    fs,
    io::Cursor,
    path::{Path, PathBuf},
};

use dataflow::Stage;
use nalgebra::{Isometry3, Vector3};
use npyz::WriterBuilder;
use schemas::demonstrations::Side;
use stage_ingest::{Format, Ingest, IngestConfig, IngestError, TableRule};

use crate::{
    bench::{Bench, config},
    rig::{self, FIRST, IMAGES, LAST, OBJECT, Rig, brick, rows},
};

const CAMERAS: [&str; 3] = ["037522251142", "043422252387", "046122250168"];
/// A box that stands upright and is moved once the first object is away.
const OTHER: &str = "003_cracker_box";

/// Everything about the recording that a test may want different.
struct HoCapRig {
    /// `mano_sides`.
    sides: &'static str,
    /// Whose landmarks are those of the hand that grasps: 0 the right hand's, 1 the left's.
    slot: usize,
    /// Whether the other hand rests half a meter away.
    two_hands: bool,
    /// Lines of the calibration that are left out.
    without: &'static str,
    /// Images that no camera has a label of.
    missing: std::ops::Range<usize>,
    /// Images in which one landmark is marked as not there.
    marked: std::ops::Range<usize>,
    /// By how much lengths are too large.
    unit: f64,
    /// Whether quaternions begin with w.
    w_first: bool,
}

impl Default for HoCapRig {
    fn default() -> Self {
        Self {
            sides: "[right]",
            slot: 0,
            two_hands: false,
            without: "no line",
            missing: 0..0,
            marked: 0..0,
            unit: 1.0,
            w_first: false,
        }
    }
}

impl HoCapRig {
    fn sequence(root: &Path) -> PathBuf {
        // The subject is named as the rig names it, so that the answer is the same.
        root.join("20200709-subject-01/20231025_165502")
    }

    fn master_from_camera(camera: usize) -> Isometry3<f64> {
        let around = camera as f64;
        Isometry3::new(
            Vector3::new(0.3 * around, 0.1, 0.2 * around),
            Vector3::new(0.1 * around, 0.5 * around, 0.0),
        )
    }

    /// The tag, whose frame is the world.
    fn master_from_tag() -> Isometry3<f64> {
        Rig::world_from_tag()
    }

    fn write(&self, root: &Path) {
        let sequence = Self::sequence(root);
        let calibration = root.join("calibration/extrinsics");
        fs::create_dir_all(&sequence).unwrap();
        fs::create_dir_all(&calibration).unwrap();
        for (name, edges) in [(OBJECT.0, [0.1, 0.08, 0.03]), (OTHER, [0.06, 0.16, 0.2])] {
            let model = root.join("models").join(name);
            fs::create_dir_all(&model).unwrap();
            fs::write(model.join("cleaned_mesh_10000.obj"), brick(edges)).unwrap();
        }
        let mut lines = format!("rs_master: '{}'\nextrinsics:\n", CAMERAS[0]);
        for (camera, serial) in CAMERAS.iter().enumerate() {
            lines += &format!(
                "  '{serial}': {}\n",
                rows(&Self::master_from_camera(camera))
            );
        }
        for tag in ["tag_0", "tag_1"] {
            lines += &format!("  {tag}: {}\n", rows(&Self::master_from_tag()));
        }
        let lines = lines.lines().filter(|line| !line.contains(self.without));
        let lines = lines.collect::<Vec<_>>().join("\n");
        fs::write(calibration.join("extrinsics_20231014.yaml"), lines).unwrap();
        let serials = CAMERAS.map(|serial| format!("  - '{serial}'\n")).concat();
        let meta = format!(
            "num_frames: {IMAGES}\nobject_ids: [{OTHER}, {}]\nmano_sides: {}\nsubject_id: subject_1\n\
             task_id: 1\nrealsense:\n  width: 640\n  height: 480\n  serials:\n{serials}\
             extrinsics: extrinsics_20231014.yaml\n",
            OBJECT.0, self.sides
        );
        fs::write(sequence.join("meta.yaml"), meta).unwrap();
        let tag_from_others = |image: usize| {
            let lift = 0.01 * image.saturating_sub(LAST + 6) as f64;
            Isometry3::new(Vector3::new(0.2, 0.1, 0.1 + lift), Vector3::z() * 0.4)
        };
        let mut poses = Vec::new();
        for object in 0..2 {
            for image in 0..IMAGES {
                let pose = [tag_from_others(image), Rig::tag_from_object(image)][object];
                let (q, t) = (pose.rotation, pose.translation.vector * self.unit);
                let turn = if self.w_first {
                    [q.w, q.i, q.j, q.k]
                } else {
                    [q.i, q.j, q.k, q.w]
                };
                poses.extend(turn.into_iter().chain([t.x, t.y, t.z]).map(|v| v as f32));
            }
        }
        npy(
            &sequence.join("poses_o.npy"),
            &[2, IMAGES as u64, 7],
            &poses,
        );
        for (camera, serial) in CAMERAS.iter().enumerate() {
            let folder = sequence.join(serial);
            fs::create_dir_all(&folder).unwrap();
            let camera_from_tag =
                Self::master_from_camera(camera).inverse() * Self::master_from_tag();
            for image in (0..IMAGES).filter(|image| !self.missing.contains(image)) {
                let resting = Rig::tag_from_object(LAST.min(image));
                let mut hands = vec![-1.0_f32; 2 * 21 * 3];
                for k in 0..21 {
                    let point = resting * Rig::keypoint(image, k);
                    let mut put = |slot: usize, point: nalgebra::Point3<f64>| {
                        let point = camera_from_tag * point * self.unit;
                        let at = 63 * slot + 3 * k;
                        hands[at..at + 3]
                            .copy_from_slice(&<[f64; 3]>::from(point).map(|v| v as f32));
                    };
                    if image >= FIRST && !(self.marked.contains(&image) && k == 8) {
                        put(self.slot, point);
                    }
                    if self.two_hands {
                        put(1 - self.slot, point + Vector3::new(0.5, 0.0, 0.0));
                    }
                }
                let in_world = [tag_from_others(image), Rig::tag_from_object(image)];
                let obj_poses = in_world.iter().flat_map(|tag_from_object| {
                    let mut pose = camera_from_tag * tag_from_object;
                    pose.translation.vector *= self.unit;
                    let matrix = pose.to_homogeneous();
                    (0..16).map(move |n| matrix[(n / 4, n % 4)] as f32)
                });
                rig::npz(
                    &folder.join(format!("label_{image:06}.npz")),
                    &[
                        ("hand_joints_3d", &[2, 21, 3], &hands),
                        ("obj_poses", &[2, 4, 4], &obj_poses.collect::<Vec<_>>()),
                    ],
                );
            }
        }
    }
}

fn npy(path: &Path, shape: &[u64], numbers: &[f32]) {
    let mut bytes = Cursor::new(Vec::new());
    let writer = npyz::WriteOptions::new()
        .default_dtype()
        .shape(shape)
        .writer(&mut bytes);
    let mut writer = writer.begin_nd().unwrap();
    writer.extend(numbers.iter().copied()).unwrap();
    writer.finish().unwrap();
    fs::write(path, bytes.into_inner()).unwrap();
}

fn hocap(root: &Path) -> IngestConfig {
    IngestConfig {
        format: Format::HoCap,
        ..config(root)
    }
}

fn make_with(rig: &HoCapRig, change: impl FnOnce(&mut IngestConfig)) -> Bench {
    let root = tempfile::tempdir().unwrap();
    rig.write(root.path());
    let mut config = hocap(root.path());
    change(&mut config);
    Bench::new(config)
}

fn reason(rig: &HoCapRig) -> (&'static str, String) {
    make_with(rig, |_| {}).reason()
}

/// Damages a dataset.
type Damage<'a> = &'a dyn Fn(&Path);

#[test]
fn the_object_that_moves_first_is_the_one_that_is_reached_for() {
    let bench = make_with(&HoCapRig::default(), |_| {});
    crate::assert_known_answer(&bench.only());
    let key = &bench.units["demonstrations"][0].partition;
    assert_eq!(key, "20200709-subject-01-20231025_165502");
    let (metrics, _) = bench.made("demonstrations", key);
    assert_eq!(metrics["cameras_n"], 3.0);
    assert!(metrics["camera_spread_m"] < 1e-6);
    assert!(metrics["pose_difference_m"] < 1e-6);
    // Metadata, poses, calibration and mesh, and a label for each image of each camera.
    assert_eq!(bench.units["demonstrations"][0].files.len(), 3 * IMAGES + 4);
}

#[test]
fn of_two_hands_the_configured_one_is_read_if_it_is_nearer() {
    let both = |slot| HoCapRig {
        sides: "[left, right]",
        slot,
        two_hands: true,
        ..HoCapRig::default()
    };
    crate::assert_known_answer(&make_with(&both(0), |_| {}).only());
    let left = make_with(&both(1), |config| config.hand = Side::Left).only();
    crate::assert_known_answer(&left);
    let (word, reason) = reason(&both(1));
    assert_eq!(word, "skipped");
    assert!(
        reason.contains("leaves with the hand that is not the right one"),
        "{reason}"
    );
}

#[test]
fn the_still_objects_say_where_the_table_is_if_asked() {
    let bench = make_with(&HoCapRig::default(), |config| {
        config.table = TableRule::Objects;
    });
    crate::assert_known_but_rest(&bench.only());
    assert_eq!(bench.units["shapes"].len(), 2);
}

#[test]
fn bad_recordings_end_with_a_reason() {
    let skipped = |rig: HoCapRig, expected: &str| {
        let (word, reason) = reason(&rig);
        assert_eq!(word, "skipped", "{reason}");
        assert!(reason.contains(expected), "{expected}: {reason}");
    };
    let usual = HoCapRig::default;
    // Images that are missing, and landmarks that are marked, in the middle of the reach.
    skipped(
        HoCapRig {
            missing: 12..20,
            ..usual()
        },
        "no hand in 8 images from image 12 on",
    );
    skipped(
        HoCapRig {
            marked: 12..20,
            ..usual()
        },
        "no hand in 8 images from image 12 on",
    );
    // Landmarks of the hand that is not there.
    skipped(HoCapRig { slot: 1, ..usual() }, "hand");
    // Millimeters.
    skipped(
        HoCapRig {
            unit: 1000.0,
            ..usual()
        },
        "`obj_poses` of the labels is",
    );
    // Quaternions that begin with w.
    let rig = HoCapRig {
        w_first: true,
        ..usual()
    };
    skipped(rig, "`obj_poses` of the labels is");
    // No table: neither tag is in the calibration.
    skipped(
        HoCapRig {
            without: "tag_",
            ..usual()
        },
        "no pose of `tag_1`",
    );
    skipped(
        HoCapRig {
            without: CAMERAS[1],
            ..usual()
        },
        "no pose of `043422252387`",
    );
    // A left hand is left out by the options, and nothing else is there.
    let root = tempfile::tempdir().unwrap();
    let left = HoCapRig {
        sides: "[left]",
        slot: 1,
        ..usual()
    };
    left.write(root.path());
    let err = Ingest::prepare(&hocap(root.path())).unwrap_err();
    assert!(
        matches!(
            err.downcast_ref(),
            Some(IngestError::NoneChosen { found: 1, .. })
        ),
        "{err}"
    );
}

#[test]
fn gaps_are_bridged_up_to_the_limit() {
    for rig in [
        HoCapRig {
            missing: 12..15,
            ..HoCapRig::default()
        },
        HoCapRig {
            marked: 12..15,
            ..HoCapRig::default()
        },
    ] {
        let demonstration = make_with(&rig, |_| {}).only();
        crate::assert_known_answer(&demonstration);
        let bridged = demonstration.steps.iter().filter(|step| step.bridged);
        assert_eq!(bridged.count(), 3);
    }
}

#[test]
fn damaged_files_and_names_that_lead_elsewhere_are_reasons() {
    let damaged = |damage: &dyn Fn(&Path)| {
        let root = tempfile::tempdir().unwrap();
        HoCapRig::default().write(root.path());
        damage(root.path());
        match Bench::until(hocap(root.path()), "objects") {
            Ok(bench) => bench.reason().1,
            Err(err) => format!("{err}: {}", std::error::Error::source(&err).unwrap()),
        }
    };
    let meta = |from: &'static str, to: &'static str| {
        move |root: &Path| {
            let path = HoCapRig::sequence(root).join("meta.yaml");
            let text = fs::read_to_string(&path).unwrap();
            assert!(text.contains(from));
            fs::write(&path, text.replace(from, to)).unwrap();
        }
    };
    let cases: [(Damage<'_>, &str); 6] = [
        (
            &meta("object_ids: [", "object_ids: [../x, "),
            "a name has letters",
        ),
        (
            &meta("num_frames: 40", "num_frames: 41"),
            "expected [2, 41, 7]",
        ),
        (
            &meta("num_frames: 40", "num_frames: 4000000"),
            "more than 10800",
        ),
        (&meta("[right]", "[both]"), "`mano_sides` is [\"both\"]"),
        (
            &meta("extrinsics_20231014.yaml", "../../secret"),
            "calibration/extrinsics/",
        ),
        (
            &|root| {
                let path = HoCapRig::sequence(root).join("poses_o.npy");
                let bytes = fs::read(&path).unwrap();
                fs::write(&path, &bytes[..bytes.len() / 2]).unwrap();
            },
            "its length does not fit its shape",
        ),
    ];
    for (damage, expected) in cases {
        let found = damaged(damage);
        assert!(found.contains(expected), "{expected}: {found}");
    }
}

#[test]
fn a_folder_of_another_layout_is_refused_with_the_way_out() {
    let root = tempfile::tempdir().unwrap();
    let err = Ingest::prepare(&hocap(root.path())).unwrap_err();
    assert!(
        err.to_string().starts_with("no HO-Cap sequences under"),
        "{err}"
    );
    assert!(err.hint().unwrap().contains("subject_1"));
}
