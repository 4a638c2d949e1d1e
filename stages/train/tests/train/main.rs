//! The stage on made-up artifacts of the Allegro hand.

mod accepted;
mod report;

use std::{collections::BTreeMap, path::Path};

use cgf::{
    Activation, Augmentation, Cgf, Contact, EncoderRotation, EncoderTimes, Initialization,
    InputFrame, JointOutputs, LatentNoise, LatentPrior, LatentVariance, NetworkConfig, Outputs,
    Reduction, Schedule, Times, TrainingConfig, TrainingDevice,
};
use dataflow::{Artifact, Context, Inputs, Outcome, Output, Partition, Scope, SourceFile};
use folds::UnseenObjects;
use lake::LakeError;
use motion::{Motion, Step};
use nalgebra::{Isometry3, Vector3};
use schemas::{
    Table, checkpoint,
    demonstrations::TERMS,
    distance_fields,
    objects::{RestingOrientation, Surface},
    training::Split,
    trajectories::{Tracking, Trajectory, TrajectoryRates},
};
use spatial::{Pose, RestingPose};
use stage_train::{Train, TrainConfig, TrainError};

const JOINTS: usize = 16;

fn config() -> TrainConfig {
    TrainConfig {
        hand: Path::new(env!("CARGO_MANIFEST_DIR")).join("../../data/robots/allegro_right.urdf"),
        objects: Vec::new(),
        unseen: UnseenObjects {
            unseen_objects: Vec::new(),
            unseen_fold: None,
        },
        held_out_share: 0.0,
        accepted_per_object: 2,
        network: NetworkConfig {
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
        },
        training: TrainingConfig {
            device: TrainingDevice::Cpu,
            epochs: 3,
            validation_epochs: 1,
            batch: 8,
            learning_rate: 1e-3,
            max_gradient_norm: None,
            schedule: Schedule::Cosine,
            halving_epochs: 500,
            grasp_steps: 5,
            grasp_weight: 3.0,
            random_times: 5,
            times: Times::Continuous,
            latent_noise: LatentNoise::PerMotion,
            initialization: Initialization::Centered,
            augmentation: Augmentation::Vertical,
            outputs: Outputs::Standardized,
            reduction: Reduction::Mean,
            q_weight: 1.0,
            translation_weight: 0.0,
            origins_weight: 100.0,
            rotations_weight: 0.0,
            kl_weight: 1e-3,
            contact_weight: 1.0,
            fixed_statistics_after: 0.5,
            penetration_weight: 0.0,
            local_noise_m: 0.01,
            contact: Contact::TouchSurface,
            tips: vec!["link_3.0_tip".to_owned(), "link_15.0_tip".to_owned()],
            tip_radius_m: 0.012,
        },
    }
}

fn rest(up: Vector3<f64>) -> RestingPose {
    RestingPose {
        up_in_object: nalgebra::Unit::new_normalize(up),
        height_m: 0.05,
    }
}

/// A can that stands or lies.
fn surface(name: &str) -> Surface {
    let point = |k: u32| {
        let angle = f64::from(k) * 0.7;
        let height = f64::from(k) / 1000.0 - 0.05;
        [0.03 * angle.cos(), 0.03 * angle.sin(), height]
    };
    Surface {
        name: name.to_owned(),
        points_m: (0..100).map(point).collect(),
        rests: [Vector3::z(), Vector3::x()]
            .map(|up| RestingOrientation {
                rest: rest(up),
                seen_n: 1,
                probability: 0.5,
            })
            .to_vec(),
    }
}

fn trajectory(sequence: &str, object: &str, up: Vector3<f64>) -> Trajectory {
    let steps = (0..20).map(|k| Step {
        time_s: f64::from(k) / 30.0,
        frame_from_palm: Pose::new(Isometry3::translation(0.0, 0.0, 0.3 - f64::from(k) * 0.01)),
        q_rad: vec![0.3; JOINTS],
        rates: TrajectoryRates::zero(JOINTS),
    });
    // The order of the URDF turned around: positions are found by name.
    let joints: Vec<String> = (0..JOINTS).rev().map(|k| format!("joint_{k}.0")).collect();
    Trajectory {
        sequence: sequence.to_owned(),
        object: object.to_owned(),
        keypoints: Vec::new(),
        tips: Vec::new(),
        rest: rest(up),
        motion: Motion::new(&joints, steps.collect()).unwrap(),
        tracking: vec![Tracking::default(); 20],
    }
}

fn artifact<T: Table>(folder: &Path, key: &str, object: &str, table: &T) -> Artifact {
    let folder = folder.join(key);
    std::fs::create_dir(&folder).unwrap();
    lake::table::write(&folder, table).unwrap();
    Artifact {
        key: key.parse().unwrap(),
        labels: BTreeMap::from([("object".to_owned(), object.to_owned())]),
        files: BTreeMap::from([(T::FILE.to_owned(), folder.join(T::FILE))]),
    }
}

fn inputs(folder: &Path) -> Inputs {
    let objects = ["can", "tin"].map(|name| artifact(folder, name, name, &surface(name)));
    // The second lies a little askew in its recording.
    let up = [Vector3::z(), Vector3::new(1.0, 0.1, 0.0), Vector3::x()];
    let trajectories = [("a", "can"), ("b", "can"), ("c", "tin")];
    let trajectories = trajectories.iter().zip(up).map(|((sequence, object), up)| {
        artifact(folder, sequence, object, &trajectory(sequence, object, up))
    });
    Inputs::new(
        BTreeMap::from([
            ("objects".to_owned(), objects.to_vec()),
            ("trajectories".to_owned(), trajectories.collect()),
        ]),
        vec![SourceFile::named("hand", &config().hand)],
    )
}

fn scope() -> Scope {
    let labeled = |key: &str, labels: &[(&str, &str)]| {
        let labels = labels.iter().map(|&(name, is)| (name.into(), is.into()));
        Partition::new(key.parse().unwrap(), labels.collect())
    };
    let partition = |key: &str, object: &str| labeled(key, &[("object", object)]);
    Scope::new(BTreeMap::from([
        (
            "objects".to_owned(),
            vec![partition("can", "can"), partition("tin", "tin")],
        ),
        (
            "trajectories".to_owned(),
            vec![
                partition("a", "can"),
                partition("b", "can"),
                labeled("c", &[("object", "tin"), (TERMS, "Ours, CC0")]),
            ],
        ),
    ]))
}

#[test]
fn a_checkpoint_is_made_of_all_trajectories() {
    let (lake, out) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    let cx = Context::detached(&"cgf".parse().unwrap(), 7, out.path());
    let units = Train::units(&config(), &scope()).unwrap();
    let inputs = inputs(lake.path()).with_facts(units[0].facts.clone());
    let Outcome::Made(made) = Train::make(&config(), &inputs, &cx).unwrap() else {
        panic!("nothing was made");
    };
    assert_eq!(made.trajectories[Split::Training], Some(3.0));
    let file = |name: &str| out.path().join(name);
    let files = checkpoint::LAST;
    let cgf = Cgf::load(&file(files.weights), &file(files.description)).unwrap();
    assert_eq!(cgf.description().joints[0], "joint_0.0");
    let demonstrations = &cgf.description().demonstrations;
    assert_eq!(demonstrations[0].rest_up, [0.0, 0.0, 1.0]);
    assert_eq!(demonstrations[1].rest_up, [1.0, 0.0, 0.0]);
    // One motion's dataset states its terms, the others' do not.
    let expected = ["Ours, CC0", "source and terms not stated"];
    assert_eq!(cgf.description().data, expected);
}

#[test]
fn one_unit_reads_the_chosen_objects() {
    let mut config = config();
    let units = Train::units(&config, &scope()).unwrap();
    assert_eq!(units.len(), 1);
    assert_eq!(units[0].reads["trajectories"], ["a", "b", "c"]);
    config.unseen.unseen_objects = vec!["can".to_owned()];
    let units = Train::units(&config, &scope()).unwrap();
    // What is kept back is read as well, to measure with.
    assert_eq!(units[0].reads["trajectories"], ["a", "b", "c"]);
    config.objects = vec!["tin".to_owned()];
    config.unseen.unseen_objects = Vec::new();
    let units = Train::units(&config, &scope()).unwrap();
    assert_eq!(units[0].reads["trajectories"], ["c"]);
    assert_eq!(units[0].reads["objects"], ["tin"]);
    // Distances are read where the hand is kept out of the objects.
    assert!(units[0].reads["distance_fields"].is_empty());
    config.training.penetration_weight = 1.0;
    let units = Train::units(&config, &scope()).unwrap();
    assert_eq!(units[0].reads["distance_fields"], ["tin"]);
}

#[test]
fn a_damaged_distance_field_is_named() {
    let (lake, out) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    let path = lake.path().join(distance_fields::FIELD);
    std::fs::write(&path, b"sdfield1 and no more").unwrap();
    let mut field = artifact(lake.path(), "field", "tin", &surface("tin"));
    field.key = "tin".parse().unwrap();
    let inputs = Inputs::new(
        BTreeMap::from([("distance_fields".to_owned(), vec![field.clone()])]),
        vec![SourceFile::named("hand", &config().hand)],
    );
    let cx = Context::detached(&"cgf".parse().unwrap(), 7, out.path());
    let err = Train::make(&config(), &inputs, &cx).unwrap_err();
    assert!(err.downcast_ref::<LakeError>().is_some(), "{err}");
    field.files.insert(distance_fields::FIELD.to_owned(), path);
    let inputs = Inputs::new(
        BTreeMap::from([("distance_fields".to_owned(), vec![field])]),
        vec![SourceFile::named("hand", &config().hand)],
    );
    let err = Train::make(&config(), &inputs, &cx).unwrap_err();
    assert!(
        err.to_string().contains("artifact `tin` is damaged") && err.hint().is_some(),
        "{err}"
    );
}

#[test]
fn choices_that_leave_nothing_are_refused_with_a_hint() {
    let mut config = config();
    config.unseen.unseen_objects = vec!["can".to_owned(), "tin".to_owned()];
    let err = Train::units(&config, &scope()).unwrap_err();
    assert!(
        matches!(
            err.downcast_ref(),
            Some(TrainError::NoTrajectories { found: 3 })
        ) && err.hint().is_some()
    );
    config.unseen.unseen_objects = vec!["cup".to_owned()];
    let err = Train::units(&config, &scope()).unwrap_err();
    assert!(err.hint().unwrap().contains("can, tin"), "{err}");
    config.unseen.unseen_objects = vec!["can".to_owned()];
    config.unseen.unseen_fold = Some("3/3".parse().unwrap());
    let err = Train::units(&config, &scope()).unwrap_err();
    assert!(
        matches!(
            err.downcast_ref(),
            Some(TrainError::EmptyFold { objects_n: 2, .. })
        ) && err.hint().is_some()
    );
}
