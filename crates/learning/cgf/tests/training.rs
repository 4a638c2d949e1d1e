//! A grasping function learned from made-up motions of a two-joint hand.

use std::{collections::BTreeMap, sync::Arc};

use cgf::{
    Activation, Augmentation, Cgf, CgfError, Contact, EncoderRotation, EncoderTimes, HandDistance,
    HandMotionState, Initialization, InputFrame, JointOutputs, LatentNoise, LatentPrior,
    LatentVariance, NetworkConfig, Outputs, Random, Reduction, RestingObject, Schedule, Times,
    Trainer, TrainingConfig, TrainingDevice, TrainingMotion, TrainingSet, train,
};
use geometry::{DistanceField, TriMesh};
use motion::{HandState, Motion, Step};
use nalgebra::{Isometry3, Point3, Vector3};
use robot::RobotModel;
use schemas::training::Split;
use spatial::{Pose, RestingPose, Table};

const HAND: &str = r#"<robot name="h">
  <link name="palm"/><link name="a"/><link name="tip">
    <collision><geometry><sphere radius="0.01"/></geometry></collision></link>
  <joint name="ja" type="revolute"><parent link="palm"/><child link="a"/><axis xyz="0 1 0"/>
    <origin xyz="0 0 0.1"/><limit lower="-2" upper="2" effort="1" velocity="1"/></joint>
  <joint name="jb" type="revolute"><parent link="a"/><child link="tip"/><axis xyz="1 0 0"/>
    <origin xyz="0 0 0.05"/><limit lower="-2" upper="2" effort="1" velocity="1"/></joint>
</robot>"#;

fn hand() -> Arc<RobotModel> {
    Arc::new(RobotModel::from_urdf(HAND).unwrap())
}

/// A box of half extents `half` lying at height `half.z`, as points on a grid of its surface.
fn scene(object: &str, half: [f64; 3]) -> RestingObject {
    let mut points_in_object = Vec::new();
    for k in 0..128_u8 {
        let (u, v) = (f64::from(k % 16) / 7.5 - 1.0, f64::from(k / 16) / 3.5 - 1.0);
        let side = if k % 2 == 0 { 1.0 } else { -1.0 };
        let unit = [[side, u, v], [u, side, v], [u, v, side]][usize::from(k) % 3];
        points_in_object.push(Point3::new(
            half[0] * unit[0],
            half[1] * unit[1],
            half[2] * unit[2],
        ));
    }
    RestingObject {
        object: object.to_owned(),
        rest: RestingPose {
            up_in_object: Vector3::z_axis(),
            height_m: half[2],
        },
        points_in_object,
    }
}

fn track(name: &str, scene: usize, toward: Vector3<f64>, angle: f64) -> TrainingMotion {
    let steps = (0..30).map(|k| {
        let t = 1.0 - f64::from(k) / 29.0;
        let position = toward + Vector3::new(-0.2, 0.1, 0.25) * t * (2.0 - t);
        let isometry = Isometry3::new(position, Vector3::new(angle, 1.0 - 0.5 * t, 0.3 * t));
        Step {
            time_s: f64::from(k) / 30.0,
            frame_from_palm: Pose::new(isometry),
            q_rad: vec![0.8 * (1.0 - t) + angle, 0.3 - 0.6 * t * t],
            rates: (),
        }
    });
    TrainingMotion {
        name: name.to_owned(),
        scene,
        split: Split::Training,
        motion: Motion::new(&["a", "b"], steps.collect()).unwrap(),
        code: None,
    }
}

fn set() -> TrainingSet {
    TrainingSet {
        scenes: vec![
            scene("box", [0.05, 0.03, 0.1]),
            scene("brick", [0.1, 0.05, 0.03]),
        ],
        tracks: vec![
            track("a", 0, Vector3::new(0.02, 0.0, 0.15), 0.3),
            track("b", 1, Vector3::new(0.0, 0.05, 0.08), -0.4),
        ],
        distances: BTreeMap::new(),
    }
}

fn network() -> NetworkConfig {
    NetworkConfig {
        points: 96,
        point_widths: vec![16, 32, 48],
        encoder_steps: 8,
        hand_widths: vec![32, 8],
        encoder_widths: vec![32],
        latent_dim: 4,
        decoder_widths: vec![64, 64],
        local_points: 0,
        local_widths: vec![64],
        activation: Activation::Silu,
        frame: InputFrame::Resting,
        encoder_times: EncoderTimes::Equal,
        encoder_rotation: EncoderRotation::Columns,
        latent_variance: LatentVariance::Free,
        prior: LatentPrior::Normal,
        joints: JointOutputs::Free,
    }
}

fn training(epochs: usize) -> TrainingConfig {
    TrainingConfig {
        device: TrainingDevice::Cpu,
        epochs,
        validation_epochs: 1,
        batch: 32,
        learning_rate: 3e-3,
        max_gradient_norm: None,
        schedule: Schedule::Cosine,
        halving_epochs: 500,
        grasp_steps: 5,
        grasp_weight: 3.0,
        random_times: 10,
        times: Times::Continuous,
        latent_noise: LatentNoise::PerMotion,
        initialization: Initialization::Centered,
        augmentation: Augmentation::None,
        outputs: Outputs::Standardized,
        fixed_statistics_after: 0.5,
        reduction: Reduction::Mean,
        q_weight: 1.0,
        translation_weight: 0.0,
        origins_weight: 100.0,
        rotations_weight: 0.0,
        kl_weight: 1e-3,
        contact_weight: 0.0,
        penetration_weight: 0.0,
        local_noise_m: 0.01,
        contact: Contact::TouchSurface,
        tips: vec!["tip".to_owned()],
        tip_radius_m: 0.01,
    }
}

fn trained(epochs: usize) -> Cgf {
    train(&set(), &hand(), &network(), &training(epochs), 7, |_| {})
        .unwrap()
        .last
}

#[test]
fn two_motions_are_learned_by_heart() {
    let cgf = trained(800);
    for demonstration in &cgf.description().demonstrations {
        let error = &demonstration.grasp_error;
        assert!(error.position_m < 0.004, "{error:?}");
        assert!(error.rotation_rad < 0.04, "{error:?}");
        assert!(error.joints_rad < 0.04, "{error:?}");
    }
    let set = set();
    let feature = cgf.feature(&set.scenes[1]).unwrap();
    let mean = cgf.description().demonstrations[1].latent_mean.clone();
    let times = Cgf::times(9);
    for (grasp, t) in cgf.decode(&feature, &[mean], &times).unwrap()[0]
        .iter()
        .zip(times)
    {
        let error = HandDistance::between(grasp, &set.tracks[1].at(t));
        assert!(error.position_m < 0.02, "t = {t}: {error:?}");
    }
    assert_eq!(cgf.description().training_curve.len(), 800);
}

#[test]
fn motions_of_different_codes_differ() {
    let cgf = trained(30);
    let feature = cgf.feature(&set().scenes[0]).unwrap();
    let motions = cgf
        .decode(&feature, &[vec![0.0; 4], vec![1.5; 4]], &[0.0, 0.5])
        .unwrap();
    assert_eq!(motions.len(), 2);
    assert_ne!(motions[0], motions[1]);
    // A code's motion does not depend on what is decoded beside it.
    let alone = cgf.decode(&feature, &[vec![1.5; 4]], &[0.5]).unwrap();
    let error = HandDistance::between(&alone[0][0], &motions[1][1]);
    assert!(
        error.position_m < 1e-5 && error.joints_rad < 1e-5,
        "{error:?}"
    );
}

#[test]
fn a_flow_draws_the_codes_of_the_motions_of_the_object_that_it_sees() {
    let set = set();
    let network = NetworkConfig {
        prior: LatentPrior::Flow,
        ..network()
    };
    let training = TrainingConfig {
        kl_weight: 1e-5,
        ..training(800)
    };
    let cgf = train(&set, &hand(), &network, &training, 7, |_| {})
        .unwrap()
        .last;
    let mut random = Random::new(3, 0);
    let mut draw = || (0..4).map(|_| random.normal()).collect();
    let noise: Vec<Vec<f64>> = (0..64).map(|_| draw()).collect();
    for (scene, track) in set.scenes.iter().zip(&set.tracks) {
        let feature = cgf.feature(scene).unwrap();
        let codes = cgf.prior_codes(&feature, noise.clone()).unwrap();
        assert_eq!(codes, cgf.prior_codes(&feature, noise.clone()).unwrap());
        let own = cgf
            .description()
            .demonstrations
            .iter()
            .find(|one| one.name == track.name);
        let mean = &own.unwrap().latent_mean;
        // The root of the mean square distance from the only code that such an object has.
        let off = |codes: &[Vec<f64>]| {
            let squares = codes.iter().flat_map(|code| code.iter().zip(mean));
            (squares.map(|(a, b)| (a - b).powi(2)).sum::<f64>() / 64.0).sqrt()
        };
        assert!(
            off(&codes) < 0.3 * off(&noise),
            "{} {}",
            off(&codes),
            off(&noise)
        );
    }
    let normal = trained(1);
    let feature = normal.feature(&set.scenes[0]).unwrap();
    assert_eq!(normal.prior_codes(&feature, noise.clone()).unwrap(), noise);
}

#[test]
fn a_training_goes_on_from_a_function_and_gives_codes_the_motions_that_are_asked_for() {
    let set = set();
    let (network, training) = (network(), training(150));
    let first = train(&set, &hand(), &network, &training, 7, |_| {});
    let first = first.unwrap().last;
    let code = vec![1.2, -0.7, 0.3, 0.9];
    let wanted = track("wanted", 0, Vector3::new(0.01, 0.03, 0.2), -0.2);
    let off = |cgf: &Cgf| {
        let feature = cgf.feature(&set.scenes[0]).unwrap();
        let motion = cgf
            .decode(&feature, std::slice::from_ref(&code), &[0.0])
            .unwrap();
        HandDistance::between(&motion[0][0], &wanted.at(0.0)).position_m
    };
    let more = TrainingSet {
        tracks: vec![
            set.tracks[0].clone(),
            TrainingMotion {
                code: Some(code.clone()),
                ..wanted.clone()
            },
        ],
        ..set.clone()
    };
    let (hand, longer) = (
        hand(),
        TrainingConfig {
            epochs: 600,
            // The motion of a code is not turned.
            augmentation: Augmentation::Vertical,
            ..training.clone()
        },
    );
    let mut trainer = Trainer::new(&more, &hand, &network, &longer, 8).unwrap();
    trainer.continue_from(&first).unwrap();
    while !trainer.is_done() {
        trainer.train_epoch().unwrap();
    }
    let second = trainer.finish().unwrap().last;
    assert!(
        off(&first) > 0.02 && off(&second) < 0.006,
        "{} {}",
        off(&first),
        off(&second)
    );
    let normalization = |cgf: &Cgf| cgf.description().normalization.clone();
    assert_eq!(normalization(&first), normalization(&second));
    let other = local_network();
    let mut trainer = Trainer::new(&more, &hand, &other, &training, 8).unwrap();
    assert!(matches!(
        trainer.continue_from(&first),
        Err(CgfError::AnotherNetwork)
    ));
}

/// With a second decoder, which sees the object from the palm.
fn local_network() -> NetworkConfig {
    NetworkConfig {
        local_points: 12,
        local_widths: vec![64, 64],
        ..network()
    }
}

/// Decodes a demonstration's mean code.
fn decoded(cgf: &Cgf, set: &TrainingSet, idx: usize, times: &[f64]) -> Vec<HandState<Table>> {
    let track = &set.tracks[idx];
    let feature = cgf.feature(&set.scenes[track.scene]).unwrap();
    let mean = cgf.description().demonstrations[idx].latent_mean.clone();
    cgf.decode(&feature, &[mean], times).unwrap().remove(0)
}

#[test]
fn a_second_decoder_learns_motions_by_heart_in_the_palms_frame() {
    let set = set();
    let training = TrainingConfig {
        local_noise_m: 0.0,
        ..training(1600)
    };
    let cgf = train(&set, &hand(), &local_network(), &training, 7, |_| {});
    let cgf = cgf.unwrap().last;
    let times = Cgf::times(9);
    for (idx, track) in set.tracks.iter().enumerate() {
        for (grasp, &t) in decoded(&cgf, &set, idx, &times).iter().zip(&times) {
            let error = HandDistance::between(grasp, &track.at(t));
            assert!(error.position_m < 0.02, "t = {t}: {error:?}");
            assert!(error.rotation_rad < 0.1, "t = {t}: {error:?}");
        }
    }
}

/// On the tape the second decoder's palm is composed by products of tensors, and otherwise by poses.
#[test]
fn a_second_decoder_is_the_same_on_the_tape() {
    let mut set = set();
    set.tracks[1].split = Split::HeldOut;
    set.tracks
        .push(track("c", 0, Vector3::new(0.03, 0.01, 0.12), 0.1));
    let training = training(5);
    let cgf = train(&set, &hand(), &local_network(), &training, 7, |_| {});
    let cgf = cgf.unwrap().last;
    let epoch = cgf.description().training_curve.last().unwrap();
    let losses = epoch.held_out.unwrap();
    let sum = losses.q + 100.0 * losses.origins + 1e-3 * losses.kl + losses.coarse;
    assert!(losses.coarse > 0.0 && (losses.total - sum).abs() < 1e-5 * sum);
    let expected = f64::from(losses.translation);
    let track = &set.tracks[1];
    let mut times = track.times().split_off(25);
    times.extend(Cgf::times(10));
    let weights = |at: usize| if at < 5 { 3.0 } else { 1.0 };
    let (mut squares, mut total) = (0.0, 0.0);
    for (at, grasp) in decoded(&cgf, &set, 1, &times).iter().enumerate() {
        let wanted = track.at(times[at]).frame_from_palm.translation.vector;
        let off = grasp.frame_from_palm.translation.vector - wanted;
        let unit = cgf.description().normalization.scale[0];
        squares += weights(at) * (off / unit).norm_squared() / 3.0;
        total += weights(at);
    }
    let found = squares / total;
    assert!(
        (found - expected).abs() < 1e-4 * expected,
        "{found} {expected}"
    );
}

#[test]
fn a_second_decoder_sees_what_is_near_the_palm_and_has_exact_derivatives() {
    const H: f64 = 1e-3;
    let set = set();
    let cgf = train(&set, &hand(), &local_network(), &training(30), 7, |_| {});
    let cgf = cgf.unwrap().last;
    let code = vec![vec![0.4; 4]];
    let mut scene = set.scenes[0].clone();
    let grasp = |scene: &RestingObject| {
        let feature = cgf.feature(scene).unwrap();
        cgf.decode(&feature, &code, &[0.0]).unwrap()[0][0].clone()
    };
    let before = grasp(&scene);
    // The first decoder sees the first 96 of 128 points, and this is another.
    let near = scene.rest.table_from_object().inverse() * before.frame_from_palm;
    scene.points_in_object[100] = Point3::from(near.translation.vector);
    assert_ne!(before, grasp(&scene));
    let feature = cgf.feature(&scene).unwrap();
    let at = |t: f64| cgf.decode_with_rates(&feature, &code, &[t]).unwrap()[0][0].clone();
    let (here, back, ahead) = (at(0.4), at(0.4 - H), at(0.4 + H));
    let place = |state: &HandMotionState| state.grasp.frame_from_palm.translation.vector;
    let slope = (place(&ahead) - place(&back)) / (2.0 * H);
    let off = (slope - here.velocity.palm.linear).norm();
    assert!(off < 0.01 * slope.norm() + 1e-4, "{off} of {slope}");
    let turn = ahead.grasp.frame_from_palm.rotation * back.grasp.frame_from_palm.rotation.inverse();
    let spin = turn.scaled_axis() / (2.0 * H);
    let off = (spin - here.velocity.palm.angular).norm();
    assert!(off < 0.01 * spin.norm() + 1e-3, "{off} of {spin}");
}

#[test]
fn checkpoint_is_read_as_it_was_written() {
    let folder = tempfile::tempdir().unwrap();
    let (weights, description) = (folder.path().join("w"), folder.path().join("d"));
    let cgf = trained(3);
    cgf.save(&weights, &description).unwrap();
    let read = Cgf::load(&weights, &description).unwrap();
    assert_eq!(read.weights(), cgf.weights());
    assert_eq!(read.description().network, cgf.description().network);
    assert_eq!(read.description().joints, cgf.description().joints);
    assert_eq!(
        read.description().training_curve,
        cgf.description().training_curve
    );
    let feature = read.feature(&set().scenes[0]).unwrap();
    let motion = |cgf: &Cgf| cgf.decode(&feature, &[vec![0.5; 4]], &[0.0]).unwrap()[0][0].clone();
    let error = HandDistance::between(&motion(&read), &motion(&cgf));
    assert!(
        error.position_m < 1e-12 && error.joints_rad < 1e-12,
        "{error:?}"
    );
    let bytes = std::fs::read(&weights).unwrap();
    std::fs::write(&weights, &bytes[..bytes.len() - 100]).unwrap();
    assert!(matches!(
        Cgf::load(&weights, &description),
        Err(CgfError::Weights(_))
    ));
}

#[test]
fn checkpoint_of_another_hand_or_network_is_refused() {
    let folder = tempfile::tempdir().unwrap();
    let (weights, description) = (folder.path().join("w"), folder.path().join("d"));
    let cgf = trained(1);
    cgf.save(&weights, &description).unwrap();
    let other = ["ja".to_owned(), "jc".to_owned()];
    assert!(matches!(
        cgf.check_hand(&other),
        Err(CgfError::AnotherHand { .. })
    ));
    let text = std::fs::read_to_string(&description).unwrap();
    let mut of_no_rest: serde_json::Value = serde_json::from_str(&text).unwrap();
    of_no_rest["demonstrations"][1]["rest_up"] = serde_json::json!([0.0, 0.0, 2.0]);
    std::fs::write(&description, of_no_rest.to_string()).unwrap();
    assert!(matches!(
        Cgf::load(&weights, &description),
        Err(CgfError::RestingPose { .. })
    ));
    std::fs::write(
        &description,
        text.replace("\"latent_dim\": 4", "\"latent_dim\": 5"),
    )
    .unwrap();
    assert!(matches!(
        Cgf::load(&weights, &description),
        Err(CgfError::Tensor { .. })
    ));
}

#[test]
fn unusable_sets_are_refused() {
    let check = |change: fn(&mut TrainingSet), expected: &str| {
        let mut set = set();
        change(&mut set);
        let err = train(&set, &hand(), &network(), &training(1), 7, |_| {}).unwrap_err();
        assert!(err.to_string().contains(expected), "{err}");
    };
    check(|set| set.tracks.clear(), "0 trajectories");
    check(|set| set.tracks.truncate(1), "1 trajectories");
    check(
        |set| {
            let motion = &mut set.tracks[1].motion;
            let first = vec![motion.first().clone()];
            *motion = Motion::of_joints(motion.joints().clone(), first).unwrap();
        },
        "`b` has 1 steps",
    );
    check(
        |set| {
            let motion = &mut set.tracks[0].motion;
            let joints: Vec<String> = (0..16).map(|joint| format!("joint {joint}")).collect();
            let mut steps = motion.steps().to_vec();
            for step in &mut steps {
                step.q_rad = vec![0.0; 16];
            }
            *motion = Motion::new(&joints, steps).unwrap();
        },
        "16 joint positions",
    );
    check(
        |set| set.scenes[0].points_in_object.truncate(10),
        "`box` has 10 surface points",
    );
}

#[test]
fn device_that_the_program_was_built_without_is_refused() {
    for (device, is_built) in [
        (TrainingDevice::Cuda, cfg!(feature = "cuda")),
        (TrainingDevice::Metal, cfg!(feature = "metal")),
    ] {
        if is_built {
            continue;
        }
        let mut config = training(1);
        config.device = device;
        let refused = train(&set(), &hand(), &network(), &config, 7, |_| {});
        assert!(matches!(refused, Err(CgfError::NotBuiltFor { .. })));
    }
}

/// A set that says where the surfaces of its two boxes are, in which both motions end with the finger
/// tip.
fn solid_set() -> TrainingSet {
    let mut set = set();
    set.tracks = vec![
        track("a", 0, Vector3::new(-0.08, 0.0, 0.03), 0.0),
        track("b", 1, Vector3::new(-0.08, 0.0, -0.04), 0.0),
    ];
    for (object, half) in [("box", [0.05, 0.03, 0.1]), ("brick", [0.1, 0.05, 0.03])] {
        let high = Point3::from(half);
        let field = DistanceField::new(&TriMesh::cuboid(-high, high), 0.0025, 0.025);
        let field = Arc::new(field.unwrap().unwrap());
        set.distances.insert(object.to_owned(), field);
    }
    set
}

#[test]
fn a_hand_is_kept_out_of_object_and_table() {
    let set = solid_set();
    let penetration = |weight: f64| {
        let mut config = training(200);
        config.penetration_weight = weight;
        let trained = train(&set, &hand(), &network(), &config, 7, |_| {}).unwrap();
        let curve = &trained.last.description().training_curve;
        f64::from(curve[199].training.penetration)
    };
    let (free, kept_out) = (penetration(1e-9), penetration(1e5));
    assert!(free > 1e-6, "{free}");
    assert!(kept_out < 0.2 * free, "{kept_out} of {free}");
}

#[test]
fn an_object_without_a_distance_field_is_refused_where_one_is_needed() {
    let mut set = solid_set();
    set.distances.remove("brick");
    let mut config = training(1);
    let train = |config: &TrainingConfig| train(&set, &hand(), &network(), config, 7, |_| {});
    assert!(train(&config).is_ok());
    config.penetration_weight = 1.0;
    let err = train(&config).unwrap_err();
    let is_named = matches!(&err, CgfError::NoDistances { object } if object == "brick");
    assert!(is_named, "{err}");
}

#[test]
fn joints_stay_within_their_limits_for_any_code() {
    let farthest = |joints: JointOutputs| {
        let mut network = network();
        network.joints = joints;
        let trained = train(&set(), &hand(), &network, &training(30), 7, |_| {}).unwrap();
        let feature = trained.last.feature(&set().scenes[0]).unwrap();
        let codes = [-1.0, 1.0].map(|sign| vec![60.0 * sign; 4]);
        let motions = trained.last.decode(&feature, &codes, &Cgf::times(9));
        let motions = motions.unwrap();
        let q = motions.iter().flatten().flat_map(|grasp| &grasp.q_rad);
        q.fold(0.0_f64, |m, q| m.max(q.abs()))
    };
    assert!(farthest(JointOutputs::WithinLimits) <= 2.0);
    assert!(farthest(JointOutputs::Free) > 2.0);
}

#[test]
fn divergence_is_reported() {
    let mut config = training(200);
    config.learning_rate = 1e12;
    let err = train(&set(), &hand(), &network(), &config, 7, |_| {}).unwrap_err();
    assert!(matches!(err, CgfError::Diverged { .. }), "{err}");
}

/// A set with a motion that is held out and one with an unseen object.
fn split_set() -> TrainingSet {
    let mut set = set();
    set.scenes.push(scene("tin", [0.04, 0.04, 0.06]));
    for (name, scene, split) in [("c", 0, Split::HeldOut), ("d", 2, Split::Unseen)] {
        let mut track = track(name, scene, Vector3::new(0.01, 0.02, 0.12), 0.1);
        track.split = split;
        set.tracks.push(track);
    }
    set
}

#[test]
fn a_training_that_was_stopped_ends_as_one_that_was_not() {
    let (set, hand, network) = (split_set(), hand(), network());
    // Statistics are fixed half-way, and rotations are drawn.
    let mut config = training(8);
    config.augmentation = Augmentation::Vertical;
    let start = || Trainer::new(&set, &hand, &network, &config, 7).unwrap();
    let bytes = |trainer: Trainer| {
        let trained = trainer.finish().unwrap();
        let folder = tempfile::tempdir().unwrap();
        let paths = ["w", "d"].map(|name| folder.path().join(name));
        [&trained.best, &trained.last].map(|cgf| {
            cgf.save(&paths[0], &paths[1]).unwrap();
            paths.each_ref().map(|path| std::fs::read(path).unwrap())
        })
    };
    let mut undisturbed = start();
    while !undisturbed.is_done() {
        undisturbed.train_epoch().unwrap();
    }
    let curve = undisturbed.curve().to_vec();
    let expected = bytes(undisturbed);
    for stops in [vec![0], vec![1], vec![3, 5], vec![4], vec![7], vec![8]] {
        let mut trainer = start();
        for &stop in &stops {
            while trainer.curve().len() < stop {
                trainer.train_epoch().unwrap();
            }
            let state = trainer.state().unwrap();
            trainer = start();
            trainer.restore(&state).unwrap();
        }
        while !trainer.is_done() {
            trainer.train_epoch().unwrap();
        }
        assert_eq!(trainer.curve(), curve);
        assert!(bytes(trainer) == expected, "stopped after {stops:?}");
    }
}

#[test]
fn a_state_that_is_damaged_or_of_another_training_changes_nothing() {
    let (set, hand, network, config) = (set(), hand(), network(), training(2));
    let mut trainer = Trainer::new(&set, &hand, &network, &config, 7).unwrap();
    trainer.train_epoch().unwrap();
    let state = trainer.state().unwrap();
    let mut other = network.clone();
    other.latent_dim = 5;
    let mut fresh = Trainer::new(&set, &hand, &other, &config, 7).unwrap();
    let before = fresh.state().unwrap();
    for length in [0, 7, 100, state.len() / 2, state.len() - 1, state.len()] {
        fresh.restore(&state[..length]).unwrap_err();
        assert!(fresh.state().unwrap() == before, "{length} bytes");
    }
}

#[test]
fn held_out_trajectories_are_measured_and_not_trained_on() {
    let trained = |set: &TrainingSet| {
        train(set, &hand(), &network(), &training(5), 7, |_| {})
            .unwrap()
            .last
    };
    let (with, without) = (trained(&split_set()), trained(&set()));
    assert_eq!(with.weights(), without.weights());
    let splits = |cgf: &Cgf| -> Vec<Split> {
        let demonstrations = cgf.description().demonstrations.iter();
        demonstrations.map(|shown| shown.split).collect()
    };
    let (training, held_out, unseen) = (Split::Training, Split::HeldOut, Split::Unseen);
    assert_eq!(splits(&with), [training, training, held_out, unseen]);
    let epoch = with.description().training_curve[4];
    assert!(epoch.held_out.is_some() && epoch.unseen.is_some());
    assert_eq!(without.description().training_curve[4].held_out, None);
}

#[test]
fn object_frame_network_is_independent_of_the_rest_pose() {
    let mut network = network();
    network.frame = InputFrame::Object;
    let mut set = set();
    set.scenes[1] = set.scenes[0].clone();
    set.scenes[1].rest = RestingPose {
        up_in_object: Vector3::x_axis(),
        height_m: 0.05,
    };
    let trained = train(&set, &hand(), &network, &training(600), 7, |_| {}).unwrap();
    let cgf = trained.last;
    // The same motion about the object is above another table.
    for (scene, demonstration) in cgf.description().demonstrations.iter().enumerate() {
        let feature = cgf.feature(&set.scenes[scene]).unwrap();
        let codes = [demonstration.latent_mean.clone()];
        let decoded = &cgf.decode(&feature, &codes, &[0.0]).unwrap()[0][0];
        let error = HandDistance::between(decoded, &set.tracks[scene].at(0.0));
        assert!(
            error.position_m < 0.01 && error.rotation_rad < 0.1,
            "{error:?}"
        );
    }
}

#[test]
fn the_paper_and_its_code_can_be_trained_as_they_are() {
    let mut network = network();
    network.frame = InputFrame::Object;
    network.activation = Activation::Relu;
    let mut config = training(60);
    config.outputs = Outputs::Physical;
    config.initialization = Initialization::Torch;
    let check = |network: &NetworkConfig, config: &TrainingConfig| {
        let trained = train(&split_set(), &hand(), network, config, 7, |_| {}).unwrap();
        let curve = &trained.last.description().training_curve;
        let (first, last) = (curve[0].training.total, curve[59].training.total);
        assert!(last < 0.5 * first, "{first} {last}");
        curve[59].training
    };
    config.reduction = Reduction::Sum;
    config.origins_weight = 10.0;
    config.contact_weight = 50.0;
    config.contact = Contact::TouchCenter;
    assert_eq!(check(&network, &config).rotations, 0.0);
    config.reduction = Reduction::Mean;
    config.times = Times::Recorded;
    config.latent_noise = LatentNoise::PerTime;
    config.augmentation = Augmentation::Released;
    config.translation_weight = 10.0;
    config.rotations_weight = 0.5;
    config.contact_weight = 0.0;
    config.contact = Contact::Demonstrated;
    network.encoder_times = EncoderTimes::Recorded;
    network.encoder_rotation = EncoderRotation::AxisAngle;
    let losses = check(&network, &config);
    assert!(losses.rotations > 0.0 && losses.contact > 0.0);
}

/// Runs itself with 1 and 2 threads and compares the bytes of the checkpoints: candle and rayon read
/// the number of threads once per process.
#[test]
fn bytes_do_not_depend_on_the_number_of_threads() {
    const OUT: &str = "CGF_TEST_OUT";
    if let Ok(out) = std::env::var(OUT) {
        // Wide enough that matrix products are shared between threads.
        let mut network = network();
        network.points = 128;
        network.point_widths = vec![64, 128, 256];
        network.decoder_widths = vec![256, 256];
        network.joints = JointOutputs::WithinLimits;
        network.latent_variance = LatentVariance::BelowPrior;
        let mut config = training(4);
        config.random_times = 120;
        config.augmentation = Augmentation::Vertical;
        config.penetration_weight = 1e3;
        let trained = train(&solid_set(), &hand(), &network, &config, 7, |_| {}).unwrap();
        let out = std::path::Path::new(&out);
        trained.last.save(&out.join("w"), &out.join("d")).unwrap();
        return;
    }
    let folders = ["1", "2"].map(|threads| {
        let folder = tempfile::tempdir().unwrap();
        let status = std::process::Command::new(std::env::current_exe().unwrap())
            .args(["--exact", "bytes_do_not_depend_on_the_number_of_threads"])
            .env(OUT, folder.path())
            .env("RAYON_NUM_THREADS", threads)
            .output()
            .unwrap();
        assert!(status.status.success());
        folder
    });
    for file in ["w", "d"] {
        let [one, two] = [0, 1].map(|k| std::fs::read(folders[k].path().join(file)).unwrap());
        assert!(one == two, "{file} differs");
    }
}
