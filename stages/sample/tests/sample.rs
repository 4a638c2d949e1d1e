//! The stage on a network that was hardly trained and a made-up object.

use std::{collections::BTreeMap, path::Path, sync::Arc};

use cgf::{
    Activation, Augmentation, Contact, EncoderRotation, EncoderTimes, Frame, Grasp, Initialization,
    LatentNoise, NetworkConfig, Outputs, Reduction, Scene, Schedule, Split, TimedGrasp, Times,
    Track, TrainingConfig, TrainingDevice, TrainingSet,
};
use dataflow::{Artifact, Context, Inputs, Outcome, Stage};
use nalgebra::{Isometry3, Point3, Vector3};
use robot::RobotModel;
use schemas::{
    candidates,
    candidates::Candidates,
    checkpoint, objects,
    objects::{Object, RestingOrientation},
};
use spatial::{Pose, Rest};
use stage_sample::{Epoch, Rests, Sample, SampleConfig, SampleError};

const HAND: &str = r#"<robot name="h">
  <link name="palm"/><link name="tip"/>
  <joint name="j" type="revolute"><parent link="palm"/><child link="tip"/><axis xyz="0 1 0"/>
    <origin xyz="0 0 0.1"/><limit lower="0.2" upper="0.25" effort="1" velocity="1"/></joint>
</robot>"#;

fn rest(up: Vector3<f64>, height_m: f64) -> Rest {
    Rest {
        up_in_object: nalgebra::Unit::new_normalize(up),
        height_m,
    }
}

fn object() -> Object {
    let points_m: Vec<[f64; 3]> = (0..100)
        .map(|k| {
            let angle = f64::from(k) * 0.7;
            [
                0.03 * angle.cos(),
                0.03 * angle.sin(),
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
        vertices_m: points_m[..3].to_vec(),
        triangles: vec![[0, 1, 2]],
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
    let scene = Scene {
        object: "can".to_owned(),
        rest: object.rests[0].rest,
        points_in_object: object
            .points_m
            .iter()
            .map(|&point| Point3::from(point))
            .collect(),
    };
    let track = |name: &str, x: f64| Track {
        name: name.to_owned(),
        scene: 0,
        split: Split::Training,
        steps: (0..10)
            .map(|k| TimedGrasp {
                time_s: f64::from(k),
                grasp: Grasp {
                    table_from_palm: Pose::new(Isometry3::translation(
                        x,
                        0.0,
                        0.3 - 0.02 * f64::from(k),
                    )),
                    q_rad: vec![0.1 * f64::from(k)],
                },
            })
            .collect(),
    };
    let set = TrainingSet {
        scenes: vec![scene],
        tracks: vec![track("a", 0.1), track("b", -0.1)],
    };
    let network = NetworkConfig {
        points: 64,
        point_widths: vec![8, 16],
        encoder_steps: 4,
        hand_widths: vec![8],
        encoder_widths: vec![16],
        latent_dim: 3,
        decoder_widths: vec![16, 16],
        activation: Activation::Silu,
        frame: Frame::Resting,
        encoder_times: EncoderTimes::Equal,
        encoder_rotation: EncoderRotation::Columns,
    };
    let training = TrainingConfig {
        device: TrainingDevice::Cpu,
        epochs: 20,
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

fn inputs(folder: &Path) -> Inputs {
    write_checkpoint(folder);
    lake::table::write(folder, &objects::to_batch(&[object()]).unwrap()).unwrap();
    let artifact = |key: &str, files: &[&str]| Artifact {
        key: key.to_owned(),
        labels: BTreeMap::new(),
        files: files
            .iter()
            .map(|&file| (file.to_owned(), folder.join(file)))
            .collect(),
    };
    Inputs::new(
        BTreeMap::from([
            (
                "checkpoint".to_owned(),
                vec![artifact(
                    "cgf",
                    &[checkpoint::BEST.weights, checkpoint::BEST.description],
                )],
            ),
            (
                "objects".to_owned(),
                vec![artifact("can", &[lake::table::FILE])],
            ),
        ]),
        Vec::new(),
    )
}

fn config() -> SampleConfig {
    SampleConfig {
        epoch: Epoch::Best,
        objects: Vec::new(),
        per_object: 40,
        steps: 11,
        duration_s: 2.0,
        demonstrated_share: 0.0,
        spread: 1.0,
        rests: Rests::Seen,
    }
}

fn sample(config: &SampleConfig, inputs: &Inputs, seed: u64) -> Candidates {
    let out = tempfile::tempdir().unwrap();
    let cx = Context::detached("candidates", "can", seed, out.path());
    assert!(matches!(
        Sample::run(config, inputs, &cx).unwrap(),
        Outcome::Made(_)
    ));
    let artifact = Artifact {
        key: "can".to_owned(),
        labels: BTreeMap::new(),
        files: BTreeMap::from([(
            lake::table::FILE.to_owned(),
            out.path().join(lake::table::FILE),
        )]),
    };
    candidates::from_batch("can", &lake::table::read(&artifact).unwrap()).unwrap()
}

#[test]
fn candidates_end_at_the_grasp_within_limits_in_seen_orientations() {
    let folder = tempfile::tempdir().unwrap();
    let inputs = inputs(folder.path());
    let drawn = sample(&config(), &inputs, 7);
    assert_eq!(drawn.candidates.len(), 40);
    assert_eq!(drawn.joints, ["j"]);
    let mut standing = 0;
    for candidate in &drawn.candidates {
        assert_eq!(candidate.steps.len(), 11);
        assert_eq!(candidate.steps[0].time_s, 0.0);
        assert_eq!(candidate.steps[10].time_s, 2.0);
        assert!(
            candidate
                .steps
                .iter()
                .all(|step| (0.2..=0.25).contains(&step.q_rad[0]))
        );
        let up = candidate.table_from_object.direction(&Vector3::z());
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
        assert!(candidate.table_from_object.direction(&Vector3::z()).z > 0.9);
    }
}

#[test]
fn a_truncated_checkpoint_is_an_error() {
    let folder = tempfile::tempdir().unwrap();
    let inputs = inputs(folder.path());
    let path = folder.path().join(checkpoint::BEST.weights);
    let bytes = std::fs::read(&path).unwrap();
    std::fs::write(&path, &bytes[..bytes.len() / 2]).unwrap();
    let cx = Context::detached("candidates", "can", 7, folder.path());
    let err = Sample::run(&config(), &inputs, &cx).unwrap_err();
    assert!(matches!(err, SampleError::Cgf(_)), "{err}");
}
