//! The stage on a can and three motions.

use std::{collections::BTreeMap, f64::consts::TAU, fs, path::Path};

use dataflow::{
    Artifact, BoxedDiagnostic, Context, Inputs, Outcome, Output, Partition, Scope, SourceFile,
    Stage, Summary,
};
use motion::{HandRates, Motion, Step};
use nalgebra::{Quaternion, Translation3, UnitQuaternion, Vector3};
use robot::RobotModel;
use robot_meshes::LoadError;
use schemas::{
    candidates::{Candidate, Candidates, DrawSource},
    objects::{self, RestingOrientation},
    pose_errors::{PoseErrorTrial, PoseErrors},
    rates::SuccessRates,
    robustness::RobustnessTable,
    rollouts::{Rollout, Rollouts, Verdict},
    smoothness::SmoothnessTable,
    success::Successes,
};
use screening::PoseError;
use simulation::{ProtocolName, SceneRandomization};
use spatial::{Pose, RestingPose};
use stage_screen::report::{RatesReport, SuccessReport};
use stage_screen::{
    PoseErrorTrials, RobustnessConfig, RobustnessTrials, Screen, ScreenConfig, ScreenError,
    ScreenMetrics,
};

const HAND: &str = concat!(
    env!("CARGO_MANIFEST_DIR"),
    "/../../data/robots/allegro_right.urdf"
);
const RADIUS_M: f64 = 0.034;
const HEIGHT_M: f64 = 0.102;

fn config() -> ScreenConfig {
    let flexion = [1, 2, 3, 5, 6, 7, 9, 10, 11, 14, 15];
    let config = serde_json::json!({
        "hand": HAND,
        "recorded_per_object": 1,
        "scene": {"drive": {
            "stiffness": 20.0, "damping": 1.0, "torque_limit": 0.7, "armature": 0.001,
        }},
        "protocol": {
            "approach": "open",
            "flexion_joints": flexion.map(|joint| format!("joint_{joint}.0")),
            "hold_s": 0.5,
        },
    });
    serde_json::from_value(config).unwrap()
}

fn upright() -> RestingPose {
    RestingPose {
        up_in_object: Vector3::z_axis(),
        height_m: HEIGHT_M / 2.0,
    }
}

fn can(mass_kg: f64) -> objects::Object {
    let rim = (0..16).map(|idx| TAU * f64::from(idx) / 16.0);
    let points: Vec<[f64; 3]> = rim
        .flat_map(|angle| {
            let (sin, cos) = angle.sin_cos();
            [-0.5, 0.5].map(|end| [RADIUS_M * cos, RADIUS_M * sin, end * HEIGHT_M])
        })
        .collect();
    let across = mass_kg * (3.0 * RADIUS_M.powi(2) + HEIGHT_M.powi(2)) / 12.0;
    let along = mass_kg * RADIUS_M.powi(2) / 2.0;
    objects::Object {
        name: "can".to_owned(),
        mass_kg,
        center_of_mass_m: [0.0; 3],
        inertia_kg_m2: [across, across, along, 0.0, 0.0, 0.0],
        points_m: vec![points[0]],
        normals: vec![[1.0, 0.0, 0.0]],
        watertight: true,
        mirror: None,
        vertices_m: points.clone(),
        triangles: vec![[0, 1, 2]],
        parts_m: vec![points],
        rests: vec![RestingOrientation {
            rest: upright(),
            seen_n: 1,
            probability: 1.0,
        }],
    }
}

/// Joints in an order that is not the hand's.
fn joints() -> Vec<String> {
    (0..16)
        .rev()
        .map(|joint| format!("joint_{joint}.0"))
        .collect()
}

fn candidate(id: &str, flexion: [f64; 3], thumb: [f64; 4]) -> Candidate {
    let position = |name: &str| {
        let number: usize = name[6..name.len() - 2].parse().unwrap();
        match (number / 4, number % 4) {
            (3, joint) => thumb[joint],
            (_, 0) => 0.0,
            (_, joint) => flexion[joint - 1],
        }
    };
    let q_rad: Vec<f64> = joints().iter().map(|name| position(name)).collect();
    let turn = UnitQuaternion::from_quaternion(Quaternion::new(0.5, 0.5, 0.5, 0.5));
    let steps = (0..=8).map(|step| {
        let left = 1.0 - f64::from(step) / 8.0;
        let place = Translation3::new(-0.015, -0.055 - 0.15 * left, 0.02);
        Step {
            time_s: 0.1 * f64::from(step),
            frame_from_palm: Pose::from_parts(place, turn),
            rates: HandRates::zero(q_rad.len()),
            q_rad: q_rad.clone(),
        }
    });
    Candidate {
        candidate_id: id.to_owned(),
        generator: "test".to_owned(),
        source: DrawSource::replayed("a"),
        latent: Vec::new(),
        table_from_object: upright().table_from_object(),
        limit_excess_rad: 0.0,
        depth_m: None,
        residual_m2: None,
        motion: Motion::new(&joints(), steps.collect()).unwrap(),
    }
}

fn three() -> Candidates {
    Candidates {
        object: "can".to_owned(),
        joints: joints().into(),
        candidates: vec![
            candidate("can-0000", [2.5, 0.9, 0.7], [1.3, 0.5, 0.5, 0.7]),
            candidate("can-0001", [0.8, 0.9, 0.7], [1.3, 0.5, 0.5, 0.7]),
            candidate("can-0002", [0.5, 0.6, 0.4], [1.3, 0.3, 0.2, 0.3]),
        ],
    }
}

fn artifact(folder: &Path) -> Artifact {
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

/// Writes the inputs into `folder` and runs the stage; its files lie in `folder/out`.
fn run(
    config: &ScreenConfig,
    object: &objects::Object,
    candidates: &Candidates,
    folder: &Path,
) -> Result<Outcome<ScreenMetrics>, BoxedDiagnostic> {
    let [made, motions, out] = ["objects", "candidates", "out"].map(|name| folder.join(name));
    for folder in [&made, &motions, &out] {
        fs::create_dir(folder).unwrap();
    }
    lake::table::write(&made, object).unwrap();
    lake::table::write(&motions, candidates).unwrap();
    let inputs = Inputs::new(
        BTreeMap::from([
            ("objects".to_owned(), vec![artifact(&made)]),
            ("candidates".to_owned(), vec![artifact(&motions)]),
        ]),
        vec![SourceFile::named("hand", Path::new(HAND))],
    );
    Screen::make(
        config,
        &inputs,
        &Context::detached(&"can".parse().unwrap(), 7, &out),
    )
}

fn made<M: std::fmt::Debug>(outcome: Outcome<M>) -> M {
    match outcome {
        Outcome::Made(made) => made,
        other => panic!("{other:?}"),
    }
}

fn rows(folder: &Path) -> Vec<Rollout> {
    lake::table::read(&artifact(&folder.join("out"))).unwrap()
}

#[test]
fn judges_candidates_in_their_order_and_records_one_accepted_and_one_failed() {
    let folder = tempfile::tempdir().unwrap();
    let made = made(run(&config(), &can(0.35), &three(), folder.path()).unwrap());
    let rows = rows(folder.path());
    let verdicts: Vec<_> = rows
        .iter()
        .map(|row| (row.candidate_id.as_str(), row.verdict))
        .collect();
    assert_eq!(
        verdicts,
        [
            ("can-0000", Verdict::Limit),
            ("can-0001", Verdict::Held),
            ("can-0002", Verdict::NotGrasped),
        ]
    );
    assert_eq!(made.candidates_n, 3.0);
    assert_eq!(made.accepted_n, 1.0);
    let steps: f64 = rows
        .iter()
        .map(|row| f64::from(row.measures.control_steps_n))
        .sum();
    assert_eq!(made.control_steps_n, steps);
    let recording = lake::recording::read(&folder.path().join("out/can-0001.mcap")).unwrap();
    let moments = recording.topic("/joint_states").count();
    // The rollout was ended once the can had settled; what is recorded is carried out to the end:
    // 0.8 s reach, 0.3 s squeeze, 0.3 s pause, 0.4 s lift, 0.5 s hold, at 50 Hz, and the start.
    assert_eq!(moments, 116);
    assert!(
        (90..=115).contains(&rows[1].measures.control_steps_n),
        "{}",
        rows[1].measures.control_steps_n
    );
    for row in &rows {
        assert_eq!(
            row.measures.control_steps_n + row.measures.skipped_steps_n.unwrap(),
            115
        );
    }
    // A motion that is refused on geometry alone has no recording.
    let failed = lake::recording::read(&folder.path().join("out/can-0002.mcap")).unwrap();
    assert_eq!(failed.about["reason"], "not_grasped");
    // It is recorded until its end is certain without shortcuts.
    let steps_n = failed.topic("/joint_states").count();
    assert!(
        (rows[2].measures.control_steps_n as usize + 1..116).contains(&steps_n),
        "{steps_n}"
    );
    assert_eq!(fs::read_dir(folder.path().join("out")).unwrap().count(), 4);
}

/// Writes the rollouts of a can's candidates, and what `make` makes of them.
fn tried<T: schemas::Table>(
    config: &ScreenConfig,
    make: impl FnOnce(&Inputs, &Context),
) -> (T, Rollouts) {
    let folder = tempfile::tempdir().unwrap();
    made(run(config, &can(0.35), &three(), folder.path()).unwrap());
    let out = folder.path().join("tried");
    fs::create_dir(&out).unwrap();
    let read = [
        ("rollouts", "out"),
        ("candidates", "candidates"),
        ("objects", "objects"),
    ]
    .map(|(input, made)| (input.to_owned(), vec![artifact(&folder.path().join(made))]));
    let hand = SourceFile::named("hand", Path::new(HAND));
    let inputs = Inputs::new(BTreeMap::from(read), vec![hand]);
    make(
        &inputs,
        &Context::detached(&"can".parse().unwrap(), 7, &out),
    );
    let tried = lake::table::read(&artifact(&out)).unwrap();
    (tried, rows(folder.path()))
}

/// The can's rollouts, and the trials of those that hold under these errors.
fn robustness(trials: usize, errors: SceneRandomization) -> (RobustnessTable, Rollouts) {
    let mut config = config();
    config.robustness = RobustnessConfig {
        trials,
        errors,
        ..config.robustness
    };
    tried(&config, |inputs, cx| {
        made(RobustnessTrials::make(&config, inputs, cx).unwrap());
    })
}

/// So many of the can's motions with the can off its estimated pose.
fn pose_errors(pose_errors_per_object: usize) -> PoseErrors {
    let config = ScreenConfig {
        pose_errors_per_object,
        // Replaced by the errors of known sizes.
        pose_noise: 1.0,
        ..config()
    };
    tried(&config, |inputs, cx| {
        made(PoseErrorTrials::make(&config, inputs, cx).unwrap());
    })
    .0
}

#[test]
fn motions_are_tried_with_the_object_off_its_pose_accepted_or_not() {
    let trials = pose_errors(8);
    // Three motions with errors of seven sizes.
    assert_eq!(trials.len(), 21);
    let sizes = |trial: &PoseErrorTrial| (trial.position_m, trial.yaw_rad);
    for (position_m, yaw_rad) in [(0.0, 0.0), (0.01, 0.0), (0.005, 5.0_f64.to_radians())] {
        // As the screen judges with that error.
        let screened = ScreenConfig {
            pose_error: PoseError {
                position_m,
                yaw_rad,
            },
            ..config()
        };
        let folder = tempfile::tempdir().unwrap();
        made(run(&screened, &can(0.35), &three(), folder.path()).unwrap());
        let expected: Vec<_> = rows(folder.path())
            .into_iter()
            .map(|row| {
                let steps_n = i64::from(row.measures.control_steps_n);
                (row.candidate_id, row.verdict, steps_n)
            })
            .collect();
        let of_size = trials
            .iter()
            .filter(|trial| sizes(trial) == (position_m, yaw_rad));
        let found: Vec<_> = of_size
            .map(|trial| {
                let PoseErrorTrial {
                    verdict,
                    control_steps_n,
                    ..
                } = *trial;
                (trial.candidate_id.clone(), verdict, control_steps_n)
            })
            .collect();
        assert_eq!(found, expected, "{position_m} {yaw_rad}");
    }
    let of_first: Vec<_> = trials.into_iter().step_by(3).collect();
    assert_eq!(pose_errors(1), of_first);
    assert!(pose_errors(0).is_empty());
}

#[test]
fn accepted_motions_are_tried_under_the_drawn_errors_alone() {
    let none = SceneRandomization::NONE;
    // Without errors, every trial is the rollout again.
    let (tried, rollouts) = robustness(3, none);
    assert_eq!(tried.len(), 1);
    let row = &tried[0];
    assert_eq!(row.candidate_id, "can-0001");
    assert_eq!(
        (row.trials.total_count(), row.trials.success_count()),
        (3, 3)
    );
    assert_eq!(
        row.control_steps_n,
        3 * i64::from(rollouts[1].measures.control_steps_n)
    );

    // On ice, a heavy can is not lifted.
    let friction_scale = [0.02, 0.05];
    let errors = SceneRandomization {
        friction_scale,
        ..none
    };
    assert_eq!(robustness(3, errors).0[0].trials.success_count(), 0);

    // Where it is a little elsewhere, it is held in some trials; more of them do not change the first.
    let position_m = 0.02;
    let errors = SceneRandomization { position_m, ..none };
    let verdicts = |trials: usize| robustness(trials, errors).0.remove(0).trials;
    let (few, many) = (verdicts(6), verdicts(12));
    assert_eq!(few, verdicts(6));
    assert!((1..=11).contains(&many.success_count()), "{many:?}");
    for (verdict, n) in few.iter() {
        assert!(n <= many.count(verdict), "{few:?} {many:?}");
    }
    assert!(robustness(0, none).0.is_empty());
}

#[test]
fn says_of_all_objects_how_often_their_candidates_hold() {
    let folder = tempfile::tempdir().unwrap();
    made(run(&config(), &can(0.35), &three(), folder.path()).unwrap());
    let success = folder.path().join("success");
    fs::create_dir(&success).unwrap();
    let read = [("rollouts", "out"), ("candidates", "candidates")]
        .map(|(input, made)| (input.to_owned(), vec![artifact(&folder.path().join(made))]));
    let inputs = Inputs::new(BTreeMap::from(read), Vec::new());
    let cx = Context::detached(&"all".parse().unwrap(), 7, &success);
    let made = made(SuccessReport::make(&config(), &inputs, &cx).unwrap());
    let said: Successes = lake::table::read(&artifact(&success)).unwrap();
    assert_eq!(said.len(), 1);
    let row = &said[0];
    assert_eq!(
        (row.object.as_str(), row.generator.as_str()),
        ("can", "test")
    );
    assert_eq!(
        (row.verdicts.total_count(), row.verdicts.success_count()),
        (3, 1)
    );
    let counted = [Verdict::Limit, Verdict::NotGrasped].map(|verdict| row.verdicts.count(verdict));
    assert_eq!(counted, [1, 1]);
    let rollouts = rows(folder.path());
    let control_steps_n: i64 = rollouts
        .iter()
        .map(|r| i64::from(r.measures.control_steps_n))
        .sum();
    assert_eq!(row.control_steps_n, control_steps_n);
    // One grasp has no spread.
    assert_eq!((row.spread_n, row.spread_palm_m), (0, None));
    let svg = fs::read_to_string(success.join("rates.svg")).unwrap();
    for text in [
        ">can</text>",
        ">Candidates that succeed, by object (test, demonstration)</text>",
    ] {
        assert!(svg.contains(text), "{svg}");
    }
    let said = SuccessReport::LINE.unwrap()(&Summary::made(&[made]));
    assert_eq!(said, "33.3 % of candidates succeed, 33.3 % of samples");

    let rates = folder.path().join("rates");
    fs::create_dir(&rates).unwrap();
    let read = BTreeMap::from([("success".to_owned(), vec![artifact(&success)])]);
    let cx = Context::detached(&"all".parse().unwrap(), 7, &rates);
    let outcome = RatesReport::make(&config(), &Inputs::new(read, Vec::new()), &cx).unwrap();
    let Outcome::Made(made) = outcome else {
        panic!("nothing was made");
    };
    let table: SuccessRates = lake::table::read(&artifact(&rates)).unwrap();
    let origins: Vec<&str> = table.iter().map(|rate| rate.origin.as_str()).collect();
    assert_eq!(origins, ["all", "demonstration"]);
    // One object is one trial of 1/3: next to nothing is known.
    let [_, low, high] = table[0].by_candidate().unwrap();
    assert!(low < 0.05 && high > 0.85, "{low} {high}");
    let said = RatesReport::LINE.unwrap()(&Summary::made(&[made]));
    assert!(
        said.starts_with("1 object: mean 33.3 % (95 % CI "),
        "{said}"
    );
    let svg = fs::read_to_string(rates.join("objects_mean.svg")).unwrap();
    assert!(svg.contains(">test, demonstration</text>"), "{svg}");
}

#[test]
fn writes_the_same_bytes_on_any_number_of_threads() {
    let bytes = |threads: usize| {
        let folder = tempfile::tempdir().unwrap();
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .unwrap();
        pool.install(|| run(&config(), &can(0.35), &three(), folder.path()).unwrap());
        [
            "part.parquet",
            "smoothness.parquet",
            "can-0001.mcap",
            "can-0002.mcap",
        ]
        .map(|file| fs::read(folder.path().join("out").join(file)).unwrap())
    };
    assert!(bytes(1) == bytes(3));
}

#[test]
fn a_candidate_alone_gets_the_same_row() {
    let folder = tempfile::tempdir().unwrap();
    made(run(&config(), &can(0.35), &three(), folder.path()).unwrap());
    let together = rows(folder.path());
    for (idx, row) in together.iter().enumerate() {
        let mut alone = three();
        alone.candidates = vec![alone.candidates.swap_remove(idx)];
        let folder = tempfile::tempdir().unwrap();
        made(run(&config(), &can(0.35), &alone, folder.path()).unwrap());
        assert_eq!(rows(folder.path()), std::slice::from_ref(row));
    }
}

#[test]
fn candidates_for_another_hand_are_an_error_with_a_hint() {
    let check = |spoil: &dyn Fn(&mut Candidates), expected: &str| {
        let mut candidates = three();
        candidates.candidates.truncate(1);
        spoil(&mut candidates);
        let folder = tempfile::tempdir().unwrap();
        let error = run(&config(), &can(0.35), &candidates, folder.path()).unwrap_err();
        let source = std::error::Error::source(&error).unwrap().to_string();
        assert!(source.contains(expected), "{error}: {source}");
        assert!(error.hint().is_some());
    };
    let of_joints = |candidates: &mut Candidates, joints: &[String]| {
        candidates.joints = joints.into();
        for candidate in &mut candidates.candidates {
            let mut steps = candidate.motion.steps().to_vec();
            for step in &mut steps {
                step.q_rad.truncate(joints.len());
                step.rates = HandRates::zero(joints.len());
            }
            candidate.motion = Motion::new(joints, steps).unwrap();
        }
    };
    let mut renamed = joints();
    renamed[3] = "wrist".to_owned();
    check(&|candidates| of_joints(candidates, &renamed), "`wrist`");
    let fewer = &joints()[..15];
    check(&|candidates| of_joints(candidates, fewer), "`joint_0.0`");
}

/// The steps of the protocol, not those of the options: 0.4 s each to grasp, squeeze and lift, and one more. A joint
/// beyond its limit is no failure there, a grasp that opens inside the object is one.
#[test]
fn a_published_protocol_replaces_the_options() {
    let mut config = config();
    config.protocol.name = ProtocolName::DexgraspbenchTabletop;
    let folder = tempfile::tempdir().unwrap();
    made(run(&config, &can(0.35), &three(), folder.path()).unwrap());
    let rows = rows(folder.path());
    let verdicts: Vec<Verdict> = rows.iter().map(|row| row.verdict).collect();
    assert_eq!(
        verdicts,
        [Verdict::EarlyContact, Verdict::Held, Verdict::Dropped]
    );
    for row in &rows {
        assert_eq!(
            row.measures.control_steps_n + row.measures.skipped_steps_n.unwrap(),
            61,
            "{row:?}"
        );
    }
}

#[test]
fn an_object_without_mass_is_skipped_with_its_reason() {
    let folder = tempfile::tempdir().unwrap();
    let outcome = run(&config(), &can(0.0), &three(), folder.path()).unwrap();
    assert!(matches!(outcome, Outcome::Skipped { reason } if reason.contains("mass of 0 kg")));
}

#[test]
fn a_protocol_that_does_not_fit_the_hand_fails_the_stage() {
    let mut config = config();
    config.protocol.flexion_joints[0] = "joint_99.0".to_owned();
    let folder = tempfile::tempdir().unwrap();
    let error = run(&config, &can(0.35), &three(), folder.path()).unwrap_err();
    assert!(matches!(
        error.downcast_ref(),
        Some(ScreenError::Simulation { .. })
    ));
    assert!(error.hint().unwrap().contains("joint_1.0"));
}

#[test]
fn each_unit_reads_its_object_and_the_hand() {
    let partition = |key: &str| Partition::new(key.parse().unwrap(), BTreeMap::new());
    let scope = Scope::new(BTreeMap::from([
        (
            "candidates".to_owned(),
            vec![partition("can"), partition("cup")],
        ),
        (
            "objects".to_owned(),
            vec![partition("box"), partition("can")],
        ),
    ]));
    let units = Screen::units(&config(), &scope).unwrap();
    assert_eq!(units.len(), 2);
    assert_eq!(units[0].reads["candidates"], ["can"]);
    assert_eq!(units[0].reads["objects"], ["can"]);
    assert!(units[1].reads["objects"].is_empty());
    assert_eq!(units[0].files[0].name, "hand");
    let nothing = Screen::units(&config(), &Scope::default()).unwrap_err();
    assert_eq!(nothing.missing_input(), Some("candidates"));
}

#[test]
fn the_hand_is_found_to_be_missing_before_anything_runs() {
    let mut config = config();
    config.hand = "no/such/hand.urdf".into();
    let err = Screen::prepare(&config).unwrap_err();
    assert!(err.downcast_ref::<LoadError>().is_some(), "{err}");
    config.hand = HAND.into();
    assert!(Screen::prepare(&config).is_ok());
    let xml = fs::read_to_string(HAND).unwrap();
    assert_eq!(RobotModel::from_urdf(&xml).unwrap().dof(), 16);
}

#[test]
fn options_that_do_not_go_with_the_hand_are_refused_before_anything_runs() {
    let folder = tempfile::tempdir().unwrap();
    let urdf = folder.path().join("hand.urdf");
    let described = fs::read_to_string(HAND).unwrap();
    let refused = |config: &ScreenConfig| {
        let err = Screen::prepare(config).unwrap_err();
        assert!(
            matches!(err.downcast_ref(), Some(ScreenError::Options { .. })),
            "{err:?}"
        );
        let cause = std::error::Error::source(&err).unwrap().to_string();
        (cause, err.hint().unwrap_or_default())
    };
    let with = |described: &str| {
        lake::write_atomic(&urdf, described.as_bytes()).unwrap();
        ScreenConfig {
            hand: urdf.clone(),
            ..config()
        }
    };
    let mut unknown = config();
    unknown
        .protocol
        .flexion_joints
        .push("joint_99.0".to_owned());
    let (said, hint) = refused(&unknown);
    assert!(
        said.contains("`flexion_joints` names `joint_99.0`"),
        "{said}"
    );
    assert!(hint.contains("joint_0.0, joint_1.0"), "{hint}");

    let mut still = config();
    still.scene.time_step_s = 0.0;
    assert!(refused(&still).0.contains("`time_step_s` is 0"));

    // A link without inertia, and a palm without, which needs none.
    let without = |link: &str| {
        let link = described.find(&format!("<link name=\"{link}\">")).unwrap();
        let start = link + described[link..].find("<inertial>").unwrap();
        let end = start + described[start..].find("</inertial>").unwrap() + "</inertial>".len();
        [&described[..start], &described[end..]].concat()
    };
    let (said, hint) = refused(&with(&without("link_2.0")));
    assert!(said.contains("without inertia: `link_2.0`"), "{said}");
    assert!(hint.contains("`<inertial>`"), "{hint}");
    Screen::prepare(&with(&without("base_link"))).unwrap();

    let untouchable = described.replace("<collision>", "<visual>");
    let (said, _) = refused(&with(&untouchable.replace("</collision>", "</visual>")));
    assert!(said.contains("no collision shapes"), "{said}");
}

#[test]
fn the_meshes_of_a_hand_are_read_beside_its_urdf() {
    let folder = tempfile::tempdir().unwrap();
    let put = |name: &str, text: &str| {
        let path = folder.path().join(name);
        lake::write_atomic(&path, text.as_bytes()).unwrap();
        path
    };
    put("tip.obj", "");
    let described = fs::read_to_string(HAND).unwrap();
    let ball = "<sphere radius=\"0.012\"/>";
    assert!(described.contains(ball));
    let of_mesh = described.replace(ball, "<mesh filename=\"tip.obj\"/>");
    let config = ScreenConfig {
        hand: put("hand.urdf", &of_mesh),
        ..config()
    };
    let scope = Scope::new(BTreeMap::from([(
        "candidates".to_owned(),
        vec![Partition::new("can".parse().unwrap(), BTreeMap::new())],
    )]));
    let units = Screen::units(&config, &scope).unwrap();
    let names: Vec<&str> = units[0]
        .files
        .iter()
        .map(|file| file.name.as_str())
        .collect();
    assert_eq!(names, ["hand", "tip.obj"]);
    // Whatever is wrong with it is known before anything runs.
    let err = Screen::prepare(&config).unwrap_err();
    assert!(err.downcast_ref::<LoadError>().is_some(), "{err}");
    fs::remove_file(folder.path().join("tip.obj")).unwrap();
    let err = Screen::prepare(&config).unwrap_err();
    assert!(err.to_string().contains("which is not there"), "{err}");
    assert!(Screen::units(&config, &scope).is_err());
}

#[test]
fn smoothness_of_a_straight_reach_is_that_of_a_line_for_the_palm() {
    let folder = tempfile::tempdir().unwrap();
    let mut candidates = three();
    // One finger joint moves with the palm, evenly.
    for candidate in &mut candidates.candidates {
        let mut steps = candidate.motion.steps().to_vec();
        for (idx, step) in steps.iter_mut().enumerate() {
            step.q_rad[15] = 0.01 * idx as f64;
        }
        candidate.motion = Motion::new(&joints(), steps).unwrap();
    }
    made(run(&config(), &can(0.35), &candidates, folder.path()).unwrap());
    let rows: SmoothnessTable = lake::table::read(&artifact(&folder.path().join("out"))).unwrap();
    for row in rows {
        let found = row.drawn;
        for line in [
            found.paper.joints,
            found.robust.joints,
            found.released.joints,
        ] {
            assert!((line.position - 1.0).abs() < 1e-9, "{line:?}");
            assert!(line.velocity < 1e-9 && line.acceleration < 1e-6, "{line:?}");
        }
        // Links go along with the palm, but for those that the finger bends away.
        let links = found.robust.cartesian;
        assert!((1.0..1.01).contains(&links.position), "{links:?}");
        assert!(found.paper.cartesian.position >= 1.0 - 1e-9);
    }
}

#[test]
fn pose_noise_lowers_success_and_is_reproducible() {
    let judged = |pose_noise: f64| {
        let folder = tempfile::tempdir().unwrap();
        let mut config = config();
        config.pose_noise = pose_noise;
        let mut candidates = three();
        let good = candidates.candidates[1].clone();
        candidates.candidates = (0..12)
            .map(|number| Candidate {
                candidate_id: format!("can-{number:04}"),
                ..good.clone()
            })
            .collect();
        // Its extent is that of its points.
        let mut can = can(0.35);
        can.points_m.clone_from(&can.vertices_m);
        can.normals = vec![[1.0, 0.0, 0.0]; can.points_m.len()];
        made(run(&config, &can, &candidates, folder.path()).unwrap());
        rows(folder.path())
    };
    let held = |rows: &[Rollout]| rows.iter().filter(|r| r.verdict == Verdict::Held).count();
    let exact = judged(0.0);
    assert_eq!(held(&exact), 12);
    let little = judged(0.001);
    assert!(held(&little) >= 10, "{}", held(&little));
    // The twelve are mistaken each in its own way.
    assert!(
        little
            .windows(2)
            .any(|pair| pair[0].measures.slip_m.unwrap() != pair[1].measures.slip_m.unwrap())
    );
    let much = judged(1.0);
    assert!(held(&much) <= 3, "{}", held(&much));
    assert_eq!(judged(1.0), much);
}

#[test]
fn a_share_that_is_no_share_is_refused() {
    for pose_noise in [-0.1, f64::NAN, f64::INFINITY] {
        let mut config = config();
        config.pose_noise = pose_noise;
        let faults = Screen::check(&config);
        assert_eq!(faults.len(), 1);
        assert_eq!(faults[0].key, "pose_noise");
    }
}
