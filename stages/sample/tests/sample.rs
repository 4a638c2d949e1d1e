//! The stage on a network that was hardly trained and a made-up object.

#![expect(
    clippy::disallowed_methods,
    reason = "a test's file may well be half a file"
)]

use std::{
    collections::BTreeMap,
    fs,
    path::{Path, PathBuf},
    sync::Arc,
};

use ::motion::{Motion, Step};
use cgf::{
    Activation, Augmentation, Contact, EncoderRotation, EncoderTimes, Initialization, InputFrame,
    JointOutputs, LatentNoise, LatentPrior, LatentVariance, NetworkConfig, Outputs, Reduction,
    RestingObject, Schedule, Times, TrainingConfig, TrainingDevice, TrainingMotion, TrainingSet,
};
use dataflow::{Artifact, Context, Inputs, Outcome, Output, SourceFile, Stage, Summary};
use geometry::{DistanceField, TriMesh};
use lake::LakeError;
use nalgebra::{Isometry3, Point3, UnitQuaternion, Vector3};
use robot::RobotModel;
use safetensors::{SafeTensors, tensor::TensorView};
use sampling::SamplingError;
use schemas::{
    candidates::{Candidate, Candidates, DrawSource, ObjectSplit, Origin},
    checkpoint, distance_fields,
    draws::{Draw, Draws, Refusal},
    objects::{Object, RestingOrientation},
    ros2::{TfMessage, motion},
    sampling::SampleMeasures,
    training::Split,
    trajectories,
    trajectories::Trajectory,
};
use spatial::{Object as InObject, Pose, RestingPose};
use stage_sample::report::{SamplingMetrics, SamplingReport};
use stage_sample::{
    CheckpointWeights, RestingPoses, Sample, SampleConfig, SampleError, SampleMetrics, SeenShape,
};
use tempfile::TempDir;

/// A palm, and a ball that two joints move: one within a narrow range, one that is hardly limited.
const HAND: &str = r#"<robot name="h">
  <link name="palm"/><link name="finger"/>
  <link name="tip"><collision><geometry><sphere radius="0.01"/></geometry></collision></link>
  <joint name="j" type="revolute"><parent link="palm"/><child link="finger"/><axis xyz="0 1 0"/>
    <origin xyz="0 0 0.1"/><limit lower="0.2" upper="0.25" effort="1" velocity="1"/></joint>
  <joint name="k" type="revolute"><parent link="finger"/><child link="tip"/><axis xyz="0 1 0"/>
    <origin xyz="0 0 0.05"/><limit lower="-9" upper="9" effort="1" velocity="1"/></joint>
</robot>"#;
/// Half of the sides of the object, a box.
const HALF_M: [f64; 3] = [0.03, 0.02, 0.05];

fn rest(up: Vector3<f64>, height_m: f64) -> RestingPose {
    RestingPose {
        up_in_object: nalgebra::Unit::new_normalize(up),
        height_m,
    }
}

fn mesh() -> TriMesh {
    let high = Point3::from(HALF_M);
    TriMesh::cuboid(-high, high)
}

fn object() -> Object {
    let points_m: Vec<[f64; 3]> = (0..100)
        .map(|k| {
            let angle = f64::from(k) * 0.7;
            [
                0.03 * angle.cos(),
                0.02 * angle.sin(),
                f64::from(k) / 1000.0 - 0.05,
            ]
        })
        .collect();
    let rests = [
        (rest(Vector3::z(), 0.05), 3),
        (rest(Vector3::x(), 0.03), 1),
        (rest(-Vector3::z(), 0.05), 0),
    ];
    Object {
        name: "can".to_owned(),
        mass_kg: 0.3,
        center_of_mass_m: [0.0; 3],
        inertia_kg_m2: [1e-4, 1e-4, 1e-4, 0.0, 0.0, 0.0],
        normals: vec![[0.0, 0.0, 1.0]; points_m.len()],
        watertight: true,
        mirror: None,
        vertices_m: mesh()
            .vertices_m
            .iter()
            .map(|&vertex| vertex.into())
            .collect(),
        triangles: mesh().triangles,
        parts_m: vec![points_m[..4].to_vec()],
        points_m,
        rests: rests
            .map(|(rest, seen_n)| RestingOrientation {
                rest,
                seen_n,
                probability: 0.3,
            })
            .to_vec(),
    }
}

/// Writes a checkpoint of two motions onto the standing can.
fn write_checkpoint(folder: &Path) {
    let object = object();
    let scene = RestingObject {
        object: "can".to_owned(),
        rest: object.rests[0].rest,
        points_in_object: object
            .points_m
            .iter()
            .map(|&point| Point3::from(point))
            .collect(),
    };
    let track = |name: &str, x: f64| TrainingMotion {
        name: name.to_owned(),
        scene: 0,
        split: Split::Training,
        code: None,
        motion: Motion::new(
            &RobotModel::from_urdf(HAND).unwrap().joint_names(),
            (0..10)
                .map(|k| Step {
                    time_s: f64::from(k),
                    frame_from_palm: Pose::new(Isometry3::translation(
                        x,
                        0.0,
                        0.3 - 0.02 * f64::from(k),
                    )),
                    q_rad: vec![0.1 * f64::from(k), 0.3 - 0.05 * f64::from(k)],
                    rates: (),
                })
                .collect(),
        )
        .unwrap(),
    };
    let set = TrainingSet {
        scenes: vec![scene],
        tracks: vec![track("a", 0.1), track("b", -0.1)],
        distances: BTreeMap::new(),
    };
    let network = NetworkConfig {
        points: 64,
        point_widths: vec![8, 16],
        encoder_steps: 4,
        hand_widths: vec![8],
        encoder_widths: vec![16],
        latent_dim: 3,
        decoder_widths: vec![16, 16],
        local_points: 0,
        local_widths: vec![16],
        activation: Activation::Silu,
        frame: InputFrame::Resting,
        encoder_times: EncoderTimes::Equal,
        encoder_rotation: EncoderRotation::Columns,
        latent_variance: LatentVariance::Free,
        prior: LatentPrior::Normal,
        joints: JointOutputs::Free,
    };
    let training = TrainingConfig {
        device: TrainingDevice::Cpu,
        epochs: 200,
        validation_epochs: 1,
        batch: 2,
        learning_rate: 3e-3,
        max_gradient_norm: None,
        schedule: Schedule::Halving,
        halving_epochs: 500,
        grasp_steps: 2,
        grasp_weight: 1.0,
        random_times: 3,
        times: Times::Continuous,
        latent_noise: LatentNoise::PerMotion,
        initialization: Initialization::Centered,
        augmentation: Augmentation::None,
        outputs: Outputs::Standardized,
        reduction: Reduction::Mean,
        q_weight: 1.0,
        translation_weight: 0.0,
        origins_weight: 10.0,
        rotations_weight: 0.0,
        kl_weight: 1e-3,
        contact_weight: 0.0,
        fixed_statistics_after: 0.5,
        penetration_weight: 0.0,
        local_noise_m: 0.01,
        contact: Contact::TouchCenter,
        tips: vec!["tip".to_owned()],
        tip_radius_m: 0.0,
    };
    let hand = Arc::new(RobotModel::from_urdf(HAND).unwrap());
    let trained = cgf::train(&set, &hand, &network, &training, 7, |_| {}).unwrap();
    trained
        .best
        .save(
            &folder.join(checkpoint::BEST.weights),
            &folder.join(checkpoint::BEST.description),
        )
        .unwrap();
}

/// Writes what the stage reads into `folder`.
fn inputs(folder: &Path) -> Inputs {
    write_checkpoint(folder);
    fs::write(folder.join("hand.urdf"), HAND).unwrap();
    let part = |name: &str, files: &[&str]| {
        let folder = folder.join(name);
        fs::create_dir_all(&folder).unwrap();
        let files = files
            .iter()
            .map(|&file| (file.to_owned(), folder.join(file)));
        (folder.clone(), files.collect::<BTreeMap<_, _>>())
    };
    let artifact = |key: &str, files: BTreeMap<String, PathBuf>| Artifact {
        key: key.parse().unwrap(),
        labels: BTreeMap::new(),
        files,
    };
    let (of_object, object_files) = part("object", &[lake::table::FILE]);
    lake::table::write(&of_object, &object()).unwrap();
    let (of_field, field_files) = part("field", &[distance_fields::FIELD]);
    let field = DistanceField::new(&mesh(), 0.0025, 0.025).unwrap().unwrap();
    fs::write(of_field.join(distance_fields::FIELD), field.to_bytes()).unwrap();
    let shown = [("a", 0.1), ("b", -0.1)].map(|(name, x)| {
        let (folder, files) = part(name, &[lake::table::FILE]);
        lake::table::write(&folder, &trajectory(name, x)).unwrap();
        artifact(name, files)
    });
    let checkpoint = [checkpoint::BEST.weights, checkpoint::BEST.description]
        .map(|file| (file.to_owned(), folder.join(file)));
    Inputs::new(
        BTreeMap::from([
            (
                "checkpoint".to_owned(),
                vec![artifact("cgf", checkpoint.into())],
            ),
            ("objects".to_owned(), vec![artifact("can", object_files)]),
            (
                "distance_fields".to_owned(),
                vec![artifact("can", field_files)],
            ),
            ("trajectories".to_owned(), shown.to_vec()),
        ]),
        vec![SourceFile::named("hand", &folder.join("hand.urdf"))],
    )
}

/// The grasp of a demonstration, beside the object.
fn trajectory(name: &str, x: f64) -> Trajectory {
    let step = Step {
        time_s: 1.0,
        frame_from_palm: Pose::new(Isometry3::translation(x, 0.0, 0.07)),
        q_rad: vec![-0.15, 0.25],
        rates: trajectories::TrajectoryRates::zero(2),
    };
    Trajectory {
        sequence: name.to_owned(),
        object: "can".to_owned(),
        keypoints: Vec::new(),
        tips: Vec::new(),
        rest: object().rests[0].rest,
        // Not in the hand's order.
        motion: Motion::new(&["k", "j"], vec![step]).unwrap(),
        tracking: vec![trajectories::Tracking::default()],
    }
}

fn config() -> SampleConfig {
    SampleConfig {
        hand: "hand.urdf".into(),
        epoch: CheckpointWeights::Best,
        objects: Vec::new(),
        per_object: 40,
        steps: 11,
        duration_s: 2.0,
        demonstrated_share: 0.0,
        demonstrations: Vec::new(),
        draws: 1,
        max_depth_m: 0.004,
        spread: 1.0,
        path: Vec::new(),
        rests: RestingPoses::Seen,
        rest_up: None,
        point_noise: 0.0,
        shape: SeenShape::Own,
        recorded_per_object: 0,
    }
}

/// Draws motions into a folder, which is returned.
fn run(config: &SampleConfig, inputs: &Inputs, seed: u64) -> (TempDir, SampleMetrics) {
    let out = tempfile::tempdir().unwrap();
    let object = &inputs.artifacts("objects")[0].key;
    let cx = Context::detached(object, seed, out.path());
    let Outcome::Made(made) = Sample::read_and_make(config, inputs, &cx).unwrap() else {
        panic!("nothing was made");
    };
    (out, made)
}

/// The artifact that a run left in a folder.
fn made_in(folder: &Path) -> Artifact {
    let files = fs::read_dir(folder).unwrap().map(|entry| {
        let entry = entry.unwrap();
        (entry.file_name().into_string().unwrap(), entry.path())
    });
    Artifact {
        key: "can".parse().unwrap(),
        labels: BTreeMap::new(),
        files: files.collect(),
    }
}

fn sample(config: &SampleConfig, inputs: &Inputs, seed: u64) -> Candidates {
    let (out, _) = run(config, inputs, seed);
    lake::table::read(&made_in(out.path())).unwrap()
}

/// Samples, then measures what was sampled.
fn measure(config: &SampleConfig, inputs: &Inputs) -> (Vec<SampleMeasures>, SamplingMetrics) {
    let (out, made) = measured(config, inputs);
    (lake::table::read(&made_in(out.path())).unwrap(), made)
}

/// Samples, then measures into a folder, which is returned.
fn measured(config: &SampleConfig, inputs: &Inputs) -> (TempDir, SamplingMetrics) {
    let (out, _) = run(config, inputs, 7);
    let mut artifacts: BTreeMap<String, Vec<Artifact>> = ["distance_fields", "trajectories"]
        .map(|input| (input.to_owned(), inputs.artifacts(input).to_vec()))
        .into();
    artifacts.insert("candidates".to_owned(), vec![made_in(out.path())]);
    let inputs = Inputs::new(artifacts, inputs.files().to_vec());
    let out = tempfile::tempdir().unwrap();
    let cx = Context::detached(&"can".parse().unwrap(), 7, out.path());
    let Outcome::Made(made) = SamplingReport::read_and_make(config, &inputs, &cx).unwrap() else {
        panic!("nothing was measured");
    };
    (out, made)
}

/// The faults of the options.
fn faults(config: &SampleConfig) -> String {
    let faults = Sample::check(config);
    let said: Vec<String> = faults.iter().map(ToString::to_string).collect();
    said.join("; ")
}

fn refused(config: &SampleConfig, inputs: &Inputs) -> String {
    let out = tempfile::tempdir().unwrap();
    let cx = Context::detached(&"can".parse().unwrap(), 7, out.path());
    let err = Sample::read_and_make(config, inputs, &cx).unwrap_err();
    let source = std::error::Error::source(&err).map(ToString::to_string);
    format!("{err}: {}", source.unwrap_or_default())
}

#[test]
fn candidates_end_at_the_grasp_within_limits_in_seen_orientations() {
    let folder = tempfile::tempdir().unwrap();
    let inputs = inputs(folder.path());
    let drawn = sample(&config(), &inputs, 7);
    assert_eq!(drawn.candidates.len(), 40);
    assert_eq!(*drawn.joints, ["j", "k"]);
    let mut standing = 0;
    for candidate in &drawn.candidates {
        let steps = candidate.motion.steps();
        assert_eq!(steps.len(), 11);
        assert_eq!(steps[0].time_s, 0.0);
        assert_eq!(steps[10].time_s, 2.0);
        assert!(
            steps
                .iter()
                .all(|step| (0.2..=0.25).contains(&step.q_rad[0]))
        );
        let up = candidate.table_from_object * Vector3::z();
        standing += usize::from(up.z > 0.9);
        assert!(up.z > -0.1, "never seen upside down");
    }
    // Three of four were seen standing.
    assert!((22..=38).contains(&standing), "{standing}");
    let names: std::collections::BTreeSet<_> =
        drawn.candidates.iter().map(|c| &c.candidate_id).collect();
    assert_eq!(names.len(), 40);
}

#[test]
fn candidates_follow_from_the_seed() {
    let folder = tempfile::tempdir().unwrap();
    let inputs = inputs(folder.path());
    assert_eq!(sample(&config(), &inputs, 7), sample(&config(), &inputs, 7));
    assert_ne!(sample(&config(), &inputs, 7), sample(&config(), &inputs, 8));
}

#[test]
fn codes_about_demonstrations_without_spread_are_the_demonstrations() {
    let folder = tempfile::tempdir().unwrap();
    let inputs = inputs(folder.path());
    let config = SampleConfig {
        demonstrated_share: 1.0,
        spread: 0.0,
        ..config()
    };
    let drawn = sample(&config, &inputs, 7);
    let codes: std::collections::BTreeSet<String> = drawn
        .candidates
        .iter()
        .map(|candidate| format!("{:?}", candidate.latent))
        .collect();
    assert_eq!(codes.len(), 2);
    for candidate in &drawn.candidates {
        assert!((candidate.table_from_object * Vector3::z()).z > 0.9);
    }
}

#[test]
fn a_truncated_checkpoint_is_an_error() {
    let folder = tempfile::tempdir().unwrap();
    let inputs = inputs(folder.path());
    let path = folder.path().join(checkpoint::BEST.weights);
    let bytes = fs::read(&path).unwrap();
    fs::write(&path, &bytes[..bytes.len() / 2]).unwrap();
    let cx = Context::detached(&"can".parse().unwrap(), 7, folder.path());
    let err = Sample::read_and_make(&config(), &inputs, &cx).unwrap_err();
    assert!(
        matches!(
            err.downcast_ref(),
            Some(SampleError::Sampling(SamplingError::Cgf(_)))
        ),
        "{err}"
    );
}

#[test]
fn rates_are_those_of_the_motion_per_second_and_zero_at_a_limit() {
    let folder = tempfile::tempdir().unwrap();
    let inputs = inputs(folder.path());
    let config = SampleConfig {
        per_object: 5,
        steps: 2001,
        spread: 4.0,
        ..config()
    };
    let (mut moving, mut at_limit) = (0, 0);
    for candidate in sample(&config, &inputs, 7).candidates {
        assert!(candidate.limit_excess_rad > 0.01);
        for near in candidate.motion.steps().windows(3).step_by(50) {
            let [before, here, after] = near else {
                unreachable!()
            };
            let between_s = after.time_s - before.time_s;
            let rates = &here.rates;
            let check = |found: f64, expected: f64, scale: f64| {
                assert!(
                    (found - expected).abs() < 2e-3 * scale + 2e-4,
                    "{found} {expected}"
                );
            };
            let palm = |step: &Step<InObject>| *step.frame_from_palm;
            let way = palm(after).translation.vector - palm(before).translation.vector;
            let turn = palm(after).rotation * palm(before).rotation.inverse();
            let (speed, spin) = (way / between_s, turn.scaled_axis() / between_s);
            for (found, expected) in rates.palm_velocity.linear.iter().zip(speed.iter()) {
                check(*found, *expected, speed.norm());
            }
            for (found, expected) in rates.palm_velocity.angular.iter().zip(spin.iter()) {
                check(*found, *expected, spin.norm());
            }
            let [next, last] = [after, before].map(|step| step.rates.palm_velocity.to_array());
            let found = rates.palm_acceleration.to_array();
            for k in 0..6 {
                check(found[k], (next[k] - last[k]) / between_s, 1.0);
            }
            let q = (after.q_rad[1] - before.q_rad[1]) / between_s;
            check(rates.joints.velocity[1], q, q.abs());
            let change = after.rates.joints.velocity[1] - before.rates.joints.velocity[1];
            check(rates.joints.acceleration[1], change / between_s, 1.0);
            moving += usize::from(q.abs() > 0.01);
            if [0.2, 0.25].contains(&here.q_rad[0]) {
                assert_eq!(rates.joints.velocity[0], 0.0);
                assert_eq!(rates.joints.acceleration[0], 0.0);
                at_limit += 1;
            }
        }
    }
    assert!(moving > 50 && at_limit > 50, "{moving} {at_limit}");
}

#[test]
fn any_number_of_steps_is_the_same_motion() {
    let folder = tempfile::tempdir().unwrap();
    let inputs = inputs(folder.path());
    let drawn = |steps: usize| sample(&SampleConfig { steps, ..config() }, &inputs, 7).candidates;
    for (two, many) in drawn(2).iter().zip(drawn(101)) {
        assert_eq!(two.latent, many.latent);
        assert_eq!(
            (two.motion.first(), two.motion.grasp()),
            (many.motion.first(), many.motion.grasp())
        );
    }
}

#[test]
fn a_path_goes_from_one_demonstration_to_the_other() {
    let folder = tempfile::tempdir().unwrap();
    let inputs = inputs(folder.path());
    let path = |from: &str, to: &str| SampleConfig {
        path: vec![from.to_owned(), to.to_owned()],
        per_object: 5,
        recorded_per_object: 3,
        ..config()
    };
    let drawn = sample(&path("a", "b"), &inputs, 7).candidates;
    assert_eq!(drawn.len(), 5);
    let back = sample(&path("b", "a"), &inputs, 8).candidates;
    for (k, candidate) in drawn.iter().enumerate() {
        let share = k as f64 / 4.0;
        let ends = drawn[0].latent.iter().zip(&drawn[4].latent);
        for (found, (from, to)) in candidate.latent.iter().zip(ends) {
            assert!((found - (from + share * (to - from))).abs() < 1e-12);
        }
        // Three of four were seen standing, and both demonstrations are.
        assert!((candidate.table_from_object * Vector3::z()).z > 0.9);
        let grasp = |candidate: &Candidate| candidate.motion.steps()[10].q_rad.clone();
        assert_eq!(candidate.latent.len(), 3);
        let other = &back[4 - k];
        for (a, b) in grasp(candidate).iter().zip(grasp(other)) {
            assert!((a - b).abs() < 1e-5);
        }
    }
    assert_ne!(drawn[0].latent, drawn[4].latent);
    // The ends are the demonstrations' own codes.
    let about = SampleConfig {
        demonstrated_share: 1.0,
        demonstrations: vec!["a".to_owned()],
        spread: 0.0,
        ..config()
    };
    assert_eq!(
        sample(&about, &inputs, 7).candidates[0].latent,
        drawn[0].latent
    );

    let err = refused(&path("a", "c"), &inputs);
    assert!(err.contains("`c`"), "{err}");
    let err = Sample::read_and_make(
        &path("a", "bb"),
        &inputs,
        &Context::detached(&"can".parse().unwrap(), 7, folder.path()),
    )
    .unwrap_err();
    assert_eq!(err.hint().unwrap(), "did you mean `b`?");
}

#[test]
fn a_given_orientation_puts_the_mesh_on_the_table() {
    let folder = tempfile::tempdir().unwrap();
    let inputs = inputs(folder.path());
    let given = |up: [f64; 3]| SampleConfig {
        rests: RestingPoses::Given,
        rest_up: Some(up),
        demonstrated_share: 0.5,
        ..config()
    };
    let drawn = sample(&given([0.0, -0.6, 0.8]), &inputs, 7);
    for candidate in &drawn.candidates {
        let pose = &candidate.table_from_object;
        let up = *pose * Vector3::new(0.0, -0.6, 0.8);
        assert!((up - Vector3::z()).norm() < 1e-9);
        let heights = mesh()
            .vertices_m
            .iter()
            .map(|vertex| (*pose * *vertex).z)
            .collect::<Vec<_>>();
        let lowest = heights.iter().copied().fold(f64::MAX, f64::min);
        assert!(lowest.abs() < 1e-12, "{lowest}");
    }
    for up in [[0.0; 3], [0.0, 0.0, 2.0], [f64::NAN, 0.0, 1.0]] {
        let err = faults(&given(up));
        assert!(
            err.contains("`rest_up`") && err.contains("a unit vector"),
            "{err}"
        );
    }
    let err = faults(&SampleConfig {
        rest_up: None,
        ..given([0.0; 3])
    });
    assert!(err.contains("`rest_up` is missing"), "{err}");
    let without = SampleConfig {
        rests: RestingPoses::Seen,
        ..given([0.0, 0.0, 1.0])
    };
    assert!(faults(&without).contains("left out"));
}

#[test]
fn orientations_of_an_unseen_object_are_those_that_are_stable() {
    let folder = tempfile::tempdir().unwrap();
    let inputs = inputs(folder.path());
    // The orientation that nobody recorded is the only stable one.
    let mut object = object();
    for rest in &mut object.rests {
        rest.probability = if rest.seen_n == 0 { 1.0 } else { 0.0 };
    }
    lake::table::write(&folder.path().join("object"), &object).unwrap();
    let (recorded, stable) = (object.rests[0].rest, object.rests[2].rest);
    let lies_so = |name: &str, rests: RestingPoses, expected: &RestingPose| {
        let artifacts = |input: &&str| {
            let mut artifacts = inputs.artifacts(input).to_vec();
            if *input == "objects" {
                artifacts[0].key = name.parse().unwrap();
            }
            ((*input).to_owned(), artifacts)
        };
        let names = ["checkpoint", "objects", "distance_fields"];
        let inputs = Inputs::new(
            names.iter().map(artifacts).collect(),
            inputs.files().to_vec(),
        );
        let config = SampleConfig { rests, ..config() };
        let drawn = sample(&config, &inputs, 7).candidates;
        drawn.iter().any(|candidate| {
            let up = candidate.table_from_object * expected.up_in_object.into_inner();
            (up - Vector3::z()).norm() < 1e-9
        })
    };
    for (name, rests, is_recorded) in [
        ("can", RestingPoses::Seen, true),
        ("tin", RestingPoses::Seen, false),
        ("tin", RestingPoses::Recorded, true),
    ] {
        assert_eq!(lies_so(name, rests, &recorded), is_recorded, "{name}");
        assert_eq!(lies_so(name, rests, &stable), !is_recorded, "{name}");
    }
}

#[test]
fn options_that_make_no_sense_are_refused() {
    assert_eq!(faults(&config()), "");
    let check = |config: SampleConfig, key: &str| {
        let err = faults(&config);
        assert!(err.starts_with(&format!("`{key}` is")), "{err}");
    };
    let held = SampleConfig {
        per_object: 1_000_000,
        steps: 100,
        ..config()
    };
    assert!(faults(&held).contains("makes 100000000 steps"));
    check(held, "per_object");
    check(
        SampleConfig {
            steps: 1,
            ..config()
        },
        "steps",
    );
    check(
        SampleConfig {
            per_object: 0,
            ..config()
        },
        "per_object",
    );
    check(
        SampleConfig {
            duration_s: f64::NAN,
            ..config()
        },
        "duration_s",
    );
    check(
        SampleConfig {
            spread: -1.0,
            ..config()
        },
        "spread",
    );
    check(
        SampleConfig {
            demonstrated_share: 1.1,
            ..config()
        },
        "demonstrated_share",
    );
    check(
        SampleConfig {
            path: vec!["a".to_owned()],
            ..config()
        },
        "path",
    );
    let path = vec!["a".to_owned(), "b".to_owned()];
    check(
        SampleConfig {
            path,
            per_object: 1,
            ..config()
        },
        "per_object",
    );
}

#[test]
fn motions_are_measured_against_object_table_and_demonstrations() {
    let folder = tempfile::tempdir().unwrap();
    let inputs = inputs(folder.path());
    let about = SampleConfig {
        demonstrated_share: 1.0,
        per_object: 60,
        ..config()
    };
    let (sampled, made) = measure(&about, &inputs);
    assert_eq!(sampled.len(), 60);
    let names = sampled
        .iter()
        .map(|s| s.demonstration.as_ref().unwrap().0.as_str());
    let names: std::collections::BTreeSet<&str> = names.collect();
    assert!(
        names.iter().all(|name| ["a", "b"].contains(name)),
        "{names:?}"
    );
    for motion in &sampled {
        let (_, nearest) = motion.demonstration.as_ref().unwrap();
        assert!(nearest.palm_m > 0.0 && nearest.palm_m < 0.3, "{motion:?}");
        // The tip is a ball of 1 cm within 15 cm of the palm.
        assert!(motion.approach_depth_m < 0.06 && motion.grasp_depth_m < 0.06);
        assert_eq!(
            motion.approach_depth_time_s.is_some(),
            motion.approach_depth_m > 0.0
        );
        assert!(
            motion
                .approach_depth_time_s
                .is_none_or(|time_s| (0.0..2.0).contains(&time_s))
        );
        // It learned to close its first joint far beyond the limits, where it is put back to them.
        assert!(motion.limit_excess_rad > 0.05 && !motion.within_limits());
    }
    let metrics = &made;
    let count =
        |is_one: &dyn Fn(&SampleMeasures) -> bool| sampled.iter().filter(|s| is_one(s)).count();
    assert_eq!(metrics.candidates_n, 60.0);
    assert_eq!(metrics.within_limits_n, 0.0);
    assert_eq!(
        metrics.clear_n,
        count(&|s| s.approach_depth_m <= 0.005) as f64
    );
    let mean_squares = sampled
        .iter()
        .map(|s| s.from_mean.unwrap().palm_m.powi(2))
        .sum::<f64>()
        / 60.0;
    assert!((metrics.grasp_spread_m - mean_squares.sqrt()).abs() < 1e-12);
    assert!(
        metrics.grasp_spread_m > 1e-3 && metrics.collapsed_n == 0.0,
        "{made:?}"
    );
}

#[test]
fn charts_show_samples_beside_demonstrations() {
    let folder = tempfile::tempdir().unwrap();
    let with = inputs(folder.path());
    let check = |inputs: &Inputs, per_object: usize, expected: &[(&str, bool)]| {
        let config = SampleConfig {
            per_object,
            ..config()
        };
        let (out, _) = measured(&config, inputs);
        let mut files = made_in(out.path()).files;
        files.remove(lake::table::FILE).unwrap();
        let found = files.iter().map(|(name, path)| {
            let svg = fs::read_to_string(path).unwrap();
            assert!(svg.starts_with("<svg ") && svg.ends_with("</svg>\n"));
            (name.as_str(), svg.contains(">demonstrations</text>"))
        });
        assert_eq!(found.collect::<Vec<_>>(), expected);
    };
    let plausible = [("depth.svg", false), ("limits.svg", false)];
    let [depth, limits] = plausible;
    check(
        &with,
        40,
        &[
            depth,
            ("grasps.svg", true),
            ("joints.svg", true),
            limits,
            ("palm.svg", true),
        ],
    );
    let without = BTreeMap::from([
        (
            "checkpoint".to_owned(),
            with.artifacts("checkpoint").to_vec(),
        ),
        ("objects".to_owned(), with.artifacts("objects").to_vec()),
        (
            "distance_fields".to_owned(),
            with.artifacts("distance_fields").to_vec(),
        ),
    ]);
    let without = Inputs::new(without, with.files().to_vec());
    // One motion and nothing beside it: there is no spread to be drawn.
    check(&without, 1, &plausible);
}

/// Posterior collapse: a decoder that makes no use of the latent code.
#[test]
fn a_decoder_that_ignores_the_code_is_flagged_as_collapsed() {
    let folder = tempfile::tempdir().unwrap();
    let inputs = inputs(folder.path());
    let path = folder.path().join(checkpoint::BEST.weights);
    let bytes = fs::read(&path).unwrap();
    let read = SafeTensors::deserialize(&bytes).unwrap();
    let (views, zeros) = (read.tensors(), vec![0_u8; 16 * 3 * 4]);
    let tensors = views.iter().map(|(name, view)| {
        let is_of_code = name == "decoder.0.latent";
        let data = if is_of_code { &zeros[..] } else { view.data() };
        let view = TensorView::new(view.dtype(), view.shape().to_vec(), data).unwrap();
        (name.as_str(), view)
    });
    fs::write(&path, safetensors::serialize(tensors, None).unwrap()).unwrap();
    let wide = SampleConfig {
        spread: 5.0,
        ..config()
    };
    let (_, made) = measure(&wide, &inputs);
    for spread in [
        made.grasp_spread_m,
        made.grasp_spread_rad,
        made.grasp_q_spread_rad,
        made.motion_spread_m,
    ] {
        assert!(spread < 1e-6, "{made:?}");
    }
    assert_eq!(made.collapsed_n, 1.0);
    let said = SamplingReport::LINE.unwrap()(&Summary::made(&[made]));
    assert!(
        said.contains("COLLAPSED for 1 objects") && said.contains("spread 0 mm"),
        "{said}"
    );
}

#[test]
fn motions_too_deep_in_the_object_are_drawn_again() {
    let folder = tempfile::tempdir().unwrap();
    let inputs = inputs(folder.path());
    let make = |draws: usize| {
        let config = SampleConfig {
            spread: 100.0,
            draws,
            ..config()
        };
        let (out, made) = run(&config, &inputs, 7);
        let drawn: Candidates = lake::table::read(&made_in(out.path())).unwrap();
        let candidates = drawn.candidates;
        let (sampled, _) = measure(&config, &inputs);
        let deepest = |s: &SampleMeasures| {
            let in_object = s.approach_depth_m.max(s.grasp_depth_m);
            in_object.max(s.table_depth_m)
        };
        let depths: Vec<f64> = sampled.iter().map(deepest).collect();
        let rows: Draws = lake::table::read(&made_in(out.path())).unwrap();
        assert_eq!(rows.len() as f64, made.draws);
        (candidates, depths, rows)
    };
    let (once, deep, drawn) = make(1);
    assert_eq!(drawn, once.iter().map(Draw::kept).collect::<Draws>());
    assert_eq!(once.len(), 40);
    let (chosen, depths, drawn) = make(20);
    let too_deep = |depths: &[f64]| depths.iter().filter(|&&depth| depth > 0.004).count();
    let (before, after) = (too_deep(&deep), too_deep(&depths));
    assert!(before > 4 && after < before / 2, "{before}, then {after}");
    assert!((41..=800).contains(&drawn.len()), "{}", drawn.len());
    for (number, depth) in deep.iter().enumerate() {
        // What was out of it is as it was; what was not is not deeper now.
        assert_eq!(
            chosen[number].motion == once[number].motion,
            *depth <= 0.004 || depths[number] == *depth
        );
        assert!(depths[number] <= depth.max(0.004));
        // What was measured when it was drawn is what the report measures.
        assert_eq!(chosen[number].depth_m, Some(depths[number]));
        assert_eq!(once[number].depth_m, None);
    }
    let (again, _, drawn_again) = make(20);
    assert_eq!((again, drawn_again), (chosen.clone(), drawn.clone()));

    // Every draw is a row: that which is kept and those that were refused for it.
    let names = drawn.iter().map(|draw| draw.candidate_id.as_str());
    assert!(names.is_sorted());
    for candidate in &chosen {
        let of_motion = |draw: &&Draw| draw.candidate_id == candidate.candidate_id;
        let rows: Vec<&Draw> = drawn.iter().filter(of_motion).collect();
        let numbers = rows.iter().map(|draw| draw.source.draw_n);
        assert!(numbers.eq(1..=rows.len() as u32));
        let (kept, refused): (Vec<&Draw>, Vec<&Draw>) =
            rows.iter().partition(|draw| draw.refused.is_none());
        assert_eq!(kept, [&Draw::kept(candidate)]);
        for draw in refused {
            assert!(draw.depth_m > Some(0.004) && draw.depth_m >= candidate.depth_m);
            // Far out, the hand is deeper in the table than in the small object.
            assert_eq!(draw.refused, Some(Refusal::Table));
        }
        // The last draw is kept, unless all are too deep and another is the least deep.
        let is_last = candidate.source.draw_n as usize == rows.len();
        assert!(is_last || (candidate.depth_m > Some(0.004) && rows.len() == 20));
    }
}

#[test]
fn every_draw_says_where_its_code_comes_from() {
    let folder = tempfile::tempdir().unwrap();
    let inputs = inputs(folder.path());
    let sources = |inputs: &Inputs, config: &SampleConfig| -> Vec<DrawSource> {
        let (out, _) = run(config, inputs, 7);
        let drawn: Draws = lake::table::read(&made_in(out.path())).unwrap();
        drawn.into_iter().map(|draw| draw.source).collect()
    };
    let half = SampleConfig {
        demonstrated_share: 0.5,
        spread: 100.0,
        draws: 20,
        ..config()
    };
    let drawn = sources(&inputs, &half);
    let of = |origin: Origin| drawn.iter().filter(move |source| source.origin == origin);
    let (prior, posterior) = (of(Origin::Prior).count(), of(Origin::Posterior).count());
    assert_eq!(prior + posterior, drawn.len());
    assert!(prior > drawn.len() / 3 && posterior > drawn.len() / 3);
    assert!(of(Origin::Prior).all(|source| source.demonstration.is_empty()));
    let named: std::collections::BTreeSet<&str> = of(Origin::Posterior)
        .map(|source| source.demonstration.as_str())
        .collect();
    assert_eq!(named.into_iter().collect::<Vec<_>>(), ["a", "b"]);
    let split = |source: &DrawSource| source.object_split;
    assert!(
        drawn
            .iter()
            .all(|one| split(one) == Some(ObjectSplit::Seen))
    );

    let path = SampleConfig {
        path: vec!["b".to_owned(), "a".to_owned()],
        ..config()
    };
    let expected = DrawSource {
        draw_n: 1,
        origin: Origin::Path,
        demonstration: "b".to_owned(),
        object_split: Some(ObjectSplit::Seen),
    };
    assert!(
        sources(&inputs, &path)
            .iter()
            .all(|source| *source == expected)
    );

    // The function learned from demonstrations of the can alone.
    let cup = Object {
        name: "cup".to_owned(),
        ..object()
    };
    lake::table::write(&folder.path().join("object"), &cup).unwrap();
    let artifacts = ["checkpoint", "objects", "distance_fields"].map(|input| {
        let renamed = inputs
            .artifacts(input)
            .iter()
            .cloned()
            .map(|given| Artifact {
                key: given.key.as_str().replace("can", "cup").parse().unwrap(),
                ..given
            });
        (input.to_owned(), renamed.collect())
    });
    let inputs = Inputs::new(artifacts.into(), inputs.files().to_vec());
    let unseen = sources(&inputs, &half);
    assert!(
        unseen
            .iter()
            .all(|one| split(one) == Some(ObjectSplit::Unseen))
    );
    assert!(unseen.iter().all(|source| source.origin == Origin::Prior));
}

#[test]
fn a_recording_shows_motions_side_by_side() {
    let folder = tempfile::tempdir().unwrap();
    let inputs = inputs(folder.path());
    let config = SampleConfig {
        path: vec!["a".to_owned(), "b".to_owned()],
        per_object: 5,
        recorded_per_object: 3,
        ..config()
    };
    let (out, _) = run(&config, &inputs, 7);
    let drawn: Candidates = lake::table::read(&made_in(out.path())).unwrap();
    let drawn = drawn.candidates;
    let contents = lake::recording::read(&out.path().join("motions.mcap")).unwrap();
    assert_eq!(
        contents.about["candidate_ids"],
        "can-00000,can-00002,can-00004"
    );
    let tf = |topic: &str| -> Vec<TfMessage> {
        let messages = contents.topic(topic);
        messages
            .map(|message| message.decode().unwrap().unwrap())
            .collect()
    };
    // From the table to each hand, by the names of the frames.
    let fixed = tf(motion::TF_STATIC);
    let steps = tf(motion::TF);
    assert_eq!((fixed.len(), steps.len()), (1, 11));
    let pose = |message: &TfMessage, parent: &str, child: &str| {
        let mut found = message.transforms.iter();
        let found = found.find(|t| t.child_frame_id == child).unwrap();
        assert_eq!(found.header.frame_id, parent);
        let (t, r) = (&found.transform.translation, &found.transform.rotation);
        let rotation = spatial::quaternion_xyzw([r.x, r.y, r.z, r.w]).unwrap();
        Isometry3::from_parts(nalgebra::Translation3::new(t.x, t.y, t.z), rotation)
    };
    let mut sides = Vec::new();
    for (number, candidate) in [0, 2, 4].into_iter().enumerate() {
        let base = format!("motion_{number}");
        let table_from_base = pose(&fixed[0], "table", &base);
        sides.push(table_from_base.translation.y);
        assert_eq!(table_from_base.rotation, UnitQuaternion::identity());
        let base_from_object = pose(&fixed[0], &base, &format!("{base}/object"));
        for (message, step) in steps.iter().zip(drawn[candidate].motion.steps()) {
            let base_from_palm = pose(message, &base, &format!("{base}/palm"));
            let object_from_palm = base_from_object.inverse() * base_from_palm;
            let off = object_from_palm.inverse() * *step.frame_from_palm;
            assert!(off.translation.vector.norm() < 1e-9 && off.rotation.angle() < 1e-6);
        }
        let states = format!("/{base}/joint_states");
        assert_eq!(contents.topic(&states).count(), 11);
    }
    assert!((sides[1] - sides[0] - 0.4).abs() < 1e-12 && (sides[2] + sides[0]).abs() < 1e-12);
}

#[test]
fn another_hand_and_a_damaged_field_are_errors() {
    let folder = tempfile::tempdir().unwrap();
    let inputs = inputs(folder.path());
    let other = folder.path().join("hand.urdf");
    fs::write(&other, HAND.replace("\"k\"", "\"other\"")).unwrap();
    let recorded = SampleConfig {
        recorded_per_object: 1,
        ..config()
    };
    let err = refused(&recorded, &inputs);
    assert!(
        err.contains("grasping function") && err.contains("`k`"),
        "{err}"
    );

    fs::write(&other, HAND).unwrap();
    let (out, _) = run(&config(), &inputs, 7);
    let field = inputs.artifacts("distance_fields")[0]
        .file(distance_fields::FIELD)
        .unwrap();
    fs::write(field, b"sdfield1").unwrap();
    let mut artifacts: BTreeMap<String, Vec<Artifact>> = ["distance_fields", "trajectories"]
        .map(|input| (input.to_owned(), inputs.artifacts(input).to_vec()))
        .into();
    artifacts.insert("candidates".to_owned(), vec![made_in(out.path())]);
    let damaged = Inputs::new(artifacts, inputs.files().to_vec());
    let cx = Context::detached(&"can".parse().unwrap(), 7, out.path());
    let err = SamplingReport::read_and_make(&config(), &damaged, &cx).unwrap_err();
    assert!(
        matches!(err.downcast_ref(), Some(LakeError::BadFile { .. })),
        "{err}"
    );
}

#[test]
fn noisy_points_change_the_motions_by_the_seed_and_leave_the_draws() {
    let folder = tempfile::tempdir().unwrap();
    let inputs = inputs(folder.path());
    let with = |point_noise: f64| SampleConfig {
        point_noise,
        ..config()
    };
    let exact = sample(&with(0.0), &inputs, 7);
    let noisy = sample(&with(0.1), &inputs, 7);
    assert_eq!(noisy, sample(&with(0.1), &inputs, 7));
    let latents = |drawn: &Candidates| -> Vec<Vec<f64>> {
        let all = drawn.candidates.iter();
        all.map(|candidate| candidate.latent.clone()).collect()
    };
    assert_eq!(latents(&exact), latents(&noisy));
    assert_ne!(exact, noisy);
    // Every motion sees noise of its own: equal codes give other motions.
    let motions = |point_noise: f64| {
        let same = ["a".to_owned(), "a".to_owned()];
        let config = SampleConfig {
            path: same.to_vec(),
            ..with(point_noise)
        };
        let drawn = sample(&config, &inputs, 7).candidates;
        [drawn[0].motion.clone(), drawn[1].motion.clone()]
    };
    let [one, other] = motions(0.0);
    assert_eq!(one, other);
    let [one, other] = motions(0.1);
    assert_ne!(one, other);
    for noise in [-1.0, f64::NAN] {
        let said = faults(&with(noise));
        assert!(said.contains("point_noise"), "{said}");
    }
}

#[test]
fn the_shape_of_another_object_changes_the_motions_and_leaves_the_draws() {
    let folder = tempfile::tempdir().unwrap();
    let inputs = inputs(folder.path());
    let config = |shape: SeenShape| SampleConfig { shape, ..config() };
    let alone = refused(&config(SeenShape::Other), &inputs);
    assert!(
        alone.contains("there is no other object than `can`"),
        "{alone}"
    );
    let mut tin = object();
    tin.name = "tin".to_owned();
    for point in &mut tin.points_m {
        *point = point.map(|coord| 2.0 * coord);
    }
    let of_tin = folder.path().join("tin");
    fs::create_dir(&of_tin).unwrap();
    lake::table::write(&of_tin, &tin).unwrap();
    let tin = Artifact {
        key: "tin".parse().unwrap(),
        ..made_in(&of_tin)
    };
    let both = ["checkpoint", "objects"].map(|input| {
        let extra = (input == "objects").then(|| tin.clone());
        let known = inputs.artifacts(input).iter().cloned();
        (input.to_owned(), known.chain(extra).collect())
    });
    let both = Inputs::new(both.into(), inputs.files().to_vec());
    let own = sample(&config(SeenShape::Own), &both, 7).candidates;
    let other = sample(&config(SeenShape::Other), &both, 7).candidates;
    assert_eq!(own, sample(&config(SeenShape::Own), &inputs, 7).candidates);
    assert_eq!(own.len(), other.len());
    for (own, other) in own.iter().zip(&other) {
        assert_eq!(own.latent, other.latent);
        assert_eq!(own.table_from_object, other.table_from_object);
        assert_eq!(own.source, other.source);
        assert_ne!(own.motion, other.motion);
    }
}
