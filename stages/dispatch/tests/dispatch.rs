//! The stage with the simulated cell, and with cells that are not there.

use std::{
    collections::BTreeMap,
    fs,
    path::Path,
    sync::{Mutex, PoisonError},
};

use dataflow::{
    Artifact, BoxedDiagnostic, Context, Inputs, Outcome, Output, SourceFile, Stage, Summary,
};
use motion::{HandRates, Motion, Step};
use nalgebra::{Isometry3, Vector3};
use schemas::{
    Table,
    candidates::{Candidate, Candidates, DrawSource},
    executions::{self, Execution, Executions},
    objects::{Object, RestingOrientation},
    robustness::{Robustness, RobustnessTable, TrialVerdict},
    rollouts::{Rollout, Verdict},
    ros2::{
        JointState, JointTrajectory, JointTrajectoryPoint, TfMessage,
        motion::{GRASP_POSE, JOINT_COMMANDS, JOINT_STATES, JOINT_TRAJECTORY, MARKERS, TF},
    },
};
use spatial::{Pose, RestingPose};
use stage_dispatch::report::DispatchReport;
use stage_dispatch::{Dispatch, DispatchConfig, DispatchError, DispatchMetrics, SendOrder};

const OBJECT: &str = "cube";
const HALF_EDGE_M: f64 = 0.02;

/// Two plates that slide towards each other below a palm that points down.
const GRIPPER: &str = include_str!("../../../crates/cell/tests/gripper.urdf");

fn config() -> DispatchConfig {
    serde_json::from_str(include_str!("dispatch.json")).unwrap()
}

fn joints() -> Vec<String> {
    vec!["slide_left".to_owned(), "slide_right".to_owned()]
}

fn cube() -> Object {
    let side = |corner: u32, bit: u32| {
        if corner >> bit & 1 == 0 {
            -HALF_EDGE_M
        } else {
            HALF_EDGE_M
        }
    };
    let corners: Vec<[f64; 3]> = (0..8)
        .map(|c| [side(c, 0), side(c, 1), side(c, 2)])
        .collect();
    let inertia = 0.1 * (2.0 * HALF_EDGE_M).powi(2) / 6.0;
    Object {
        name: OBJECT.to_owned(),
        mass_kg: 0.1,
        center_of_mass_m: [0.0; 3],
        inertia_kg_m2: [inertia, inertia, inertia, 0.0, 0.0, 0.0],
        points_m: corners.clone(),
        normals: corners.clone(),
        watertight: true,
        mirror: None,
        vertices_m: corners.clone(),
        triangles: vec![[0, 1, 2], [1, 3, 2]],
        parts_m: vec![corners],
        rests: vec![RestingOrientation {
            rest: rest(),
            seen_n: 1,
            probability: 1.0,
        }],
    }
}

fn rest() -> RestingPose {
    RestingPose {
        up_in_object: Vector3::z_axis(),
        height_m: HALF_EDGE_M,
    }
}

/// Comes from above and closes the plates to `closed_m`; they touch the cube at 0.04.
fn candidate(id: &str, closed_m: f64) -> Candidate {
    let step = |time_s: f64, above_m: f64, q: f64| Step {
        time_s,
        frame_from_palm: Pose::new(Isometry3::translation(0.0, 0.0, above_m)),
        q_rad: vec![q, q],
        rates: HandRates::zero(2),
    };
    Candidate {
        candidate_id: id.to_owned(),
        generator: "test".to_owned(),
        source: DrawSource::replayed("a"),
        latent: Vec::new(),
        table_from_object: rest().table_from_object(),
        limit_excess_rad: 0.0,
        depth_m: None,
        residual_m2: None,
        motion: Motion::new(
            &joints(),
            vec![
                step(0.0, 0.15, 0.0),
                step(0.7, 0.02, 0.0),
                step(1.0, 0.02, closed_m),
            ],
        )
        .unwrap(),
    }
}

fn artifact(folder: &Path) -> Artifact {
    Artifact {
        key: OBJECT.parse().unwrap(),
        labels: BTreeMap::new(),
        files: BTreeMap::from([(lake::table::FILE.to_owned(), folder.join(lake::table::FILE))]),
    }
}

/// Writes a table and returns it as the input of its name.
fn given<T: Table>(folder: &Path, table: &T) -> (String, Vec<Artifact>) {
    let folder = folder.join(T::NAME);
    fs::create_dir(&folder).unwrap();
    lake::table::write(&folder, table).unwrap();
    (T::NAME.to_owned(), vec![artifact(&folder)])
}

/// Four candidates, of which the screen accepted three.
fn inputs(
    folder: &Path,
    config: &DispatchConfig,
    verdict: Verdict,
    robustness: &RobustnessTable,
) -> Inputs {
    let ids = ["cube-0", "cube-1", "cube-2", "cube-3"];
    let candidates = Candidates {
        object: OBJECT.to_owned(),
        joints: joints().into(),
        candidates: ids
            .iter()
            .map(|id| candidate(id, if *id == "cube-2" { 0.0 } else { 0.04 }))
            .collect(),
    };
    let judged = |candidate: &Candidate| {
        let is_accepted = candidate.candidate_id != "cube-0";
        let verdict = if is_accepted {
            verdict
        } else {
            Verdict::Dropped
        };
        Rollout::unsimulated(candidate, verdict)
    };
    let rollouts: Vec<Rollout> = candidates.candidates.iter().map(judged).collect();
    let artifacts = [
        given(folder, &rollouts),
        given(folder, robustness),
        given(folder, &candidates),
        given(folder, &cube()),
    ];
    Inputs::new(
        artifacts.into(),
        vec![SourceFile::named("hand", &config.hand)],
    )
}

struct Ran {
    made: DispatchMetrics,
    executions: Vec<Execution>,
    folder: tempfile::TempDir,
}

fn run(change: impl Fn(&mut DispatchConfig), verdict: Verdict) -> Result<Ran, BoxedDiagnostic> {
    run_given(change, verdict, &RobustnessTable::new())
}

fn run_given(
    change: impl Fn(&mut DispatchConfig),
    verdict: Verdict,
    robustness: &RobustnessTable,
) -> Result<Ran, BoxedDiagnostic> {
    // All runs of a process have one simulated cell, which executes one goal at a time.
    static AT_THE_CELL: Mutex<()> = Mutex::new(());
    let _alone = AT_THE_CELL.lock().unwrap_or_else(PoisonError::into_inner);
    let work = tempfile::tempdir().unwrap();
    let folder = tempfile::tempdir().unwrap();
    let mut config = config();
    change(&mut config);
    let inputs = inputs(work.path(), &config, verdict, robustness);
    let cx = Context::detached(&OBJECT.parse().unwrap(), 1, folder.path());
    let Outcome::Made(made) = Dispatch::make(&config, &inputs, &cx)? else {
        panic!("expected an artifact");
    };
    let executions: Executions = lake::table::read(&artifact(folder.path())).unwrap();
    Ok(Ran {
        made,
        executions,
        folder,
    })
}

fn line(made: &DispatchMetrics) -> String {
    DispatchReport::line(&Summary::made(std::slice::from_ref(made)))
}

#[test]
fn accepted_motions_are_executed_by_the_simulated_cell_and_recorded() {
    let ran = run(|_| {}, Verdict::Held).unwrap();
    let rows: Vec<(&str, executions::Outcome)> = ran
        .executions
        .iter()
        .map(|e| (e.candidate_id.as_str(), e.outcome))
        .collect();
    // `cube-0` was not accepted, `cube-3` is beyond `per_object`.
    assert_eq!(
        rows,
        [
            ("cube-1", executions::Outcome::Succeeded),
            ("cube-2", executions::Outcome::Failed)
        ]
    );
    assert!(ran.executions[0].lift_m > 0.08);
    assert!(
        ran.executions[0].simulated && ran.executions[0].gap.contains("mass times 1.100 to 1.100")
    );
    // Another test of this process may have had the cell execute the same goals before.
    let line = line(&ran.made);
    let expected = "2 motions → 1 succeed at the simulated cell, 1 failed";
    assert!(line.starts_with(expected), "{line}");

    let recording = lake::recording::read(&ran.folder.path().join("cube-1.mcap")).unwrap();
    assert_eq!(recording.about["outcome"], "succeeded");
    let shown = robot::plain_urdf(GRIPPER);
    assert_eq!(recording.attachments["robot.urdf"], shown.as_bytes());
    let states: Vec<JointState> = recording
        .topic(JOINT_STATES)
        .map(|m| m.decode().unwrap().unwrap())
        .collect();
    assert_eq!(states[0].name, joints());
    let commanded: Vec<JointState> = recording
        .topic(JOINT_COMMANDS)
        .map(|m| m.decode().unwrap().unwrap())
        .collect();
    assert_eq!(commanded.len(), states.len());
    for (command, state) in commanded.iter().zip(&states) {
        assert_eq!(
            (&command.header, &command.name),
            (&state.header, &state.name)
        );
        assert_eq!(command.position.len(), state.position.len());
    }
    let last = |states: &[JointState]| states.last().unwrap().position.clone();
    let [told, measured] = [last(&commanded), last(&states)];
    let commands: JointTrajectory = recording
        .topic(JOINT_TRAJECTORY)
        .next()
        .unwrap()
        .decode()
        .unwrap()
        .unwrap();
    // The last point is held, and the cube keeps the fingers from it.
    assert_eq!(told, commands.points.last().unwrap().positions);
    let short = told.iter().zip(&measured).map(|(told, q)| (told - q).abs());
    assert!(short.fold(0.0, f64::max) > 1e-3, "{told:?}, {measured:?}");
    // What the hand was told, at its 333 Hz to the end of the squeeze.
    let end = &commands.points.last().unwrap().time_from_start;
    let rate_hz =
        (commands.points.len() - 1) as f64 / (f64::from(end.sec) + f64::from(end.nanosec) * 1e-9);
    assert!((330.0..=333.001).contains(&rate_hz), "{rate_hz}");
    let rates = |point: &JointTrajectoryPoint| [point.velocities.len(), point.accelerations.len()];
    assert!(commands.points.iter().all(|point| rates(point) == [2, 2]));
    let poses: TfMessage = recording
        .topic(TF)
        .last()
        .unwrap()
        .decode()
        .unwrap()
        .unwrap();
    let object = poses
        .transforms
        .iter()
        .find(|t| t.child_frame_id == "object")
        .unwrap();
    assert!(
        object.transform.translation.z > 0.1,
        "the object ends up in the air"
    );
    assert_eq!(recording.topic(MARKERS).count(), 1);
    assert_eq!(recording.topic(GRASP_POSE).count(), 1);
}

#[test]
fn most_robust_motions_are_sent_first_or_as_they_were_accepted() {
    let tried = [("cube-1", 4), ("cube-2", 15), ("cube-3", 9)].map(|(id, held_n)| {
        let trials = [(Verdict::Held, held_n), (Verdict::Dropped, 16 - held_n)];
        let trials = trials.map(|(verdict, n)| (TrialVerdict(verdict), n));
        Robustness {
            candidate_id: id.to_owned(),
            trials: trials.into_iter().collect(),
            control_steps_n: 1600,
        }
    });
    let sent = |order: SendOrder| -> Vec<String> {
        let ran = run_given(|c| c.order = order, Verdict::Held, &tried.to_vec()).unwrap();
        let sent = ran.executions.iter();
        sent.map(|row| row.candidate_id.clone()).collect()
    };
    assert_eq!(sent(SendOrder::Robust), ["cube-2", "cube-3"]);
    assert_eq!(sent(SendOrder::Accepted), ["cube-1", "cube-2"]);
}

#[test]
fn motions_that_the_robot_cannot_make_are_rows_and_no_cell_is_asked() {
    let ran = run(
        |c| {
            c.cell = "tcp/127.0.0.1:9".to_owned();
            c.limits.palm_speed_m_per_s = 0.05;
            c.limits.max_slowdown = 2.0;
        },
        Verdict::Held,
    )
    .unwrap();
    assert_eq!(ran.executions.len(), 3);
    for row in &ran.executions {
        assert_eq!(row.outcome, executions::Outcome::Rejected);
        assert!(row.message.contains("max_slowdown"), "{}", row.message);
        assert!(row.goal_id.is_empty() && !row.accepted && !row.simulated);
    }
    assert_eq!(
        line(&ran.made),
        "3 motions → 0 succeed at the robot cell, 3 infeasible"
    );
}

#[test]
fn motion_is_slowed_down_to_its_limits() {
    let duration_s = |speed: f64| {
        let ran = run(|c| c.limits.palm_speed_m_per_s = speed, Verdict::Held).unwrap();
        assert_eq!(ran.executions[0].outcome, executions::Outcome::Succeeded);
        ran.executions[0].duration_s
    };
    let (fast, slow) = (duration_s(1.0), duration_s(0.2));
    // The palm comes down by 0.13 m and goes up by 0.1 m, which takes 0.15 m over its speed.
    let (reach, lift) = (0.13 / 0.2 - 0.6 * 0.7, 0.1 * 1.5 / 0.2 - 0.4);
    assert!(slow > fast + reach + lift, "{slow} {fast}");
    assert!(slow < fast + reach + lift + 0.3, "{slow} {fast}");
}

#[test]
fn a_cell_with_other_controllers_is_sent_nothing() {
    // The simulated cell calls its joints what the URDF does.
    let err = run(
        |c| {
            let name = ("slide_left".to_owned(), "ah_joint00".to_owned());
            c.joint_names = BTreeMap::from([name]);
        },
        Verdict::Held,
    );
    let err = err.map(|_| ()).unwrap_err();
    assert!(
        matches!(err.downcast_ref(), Some(DispatchError::Controllers { .. })),
        "{err}"
    );
    let text = err.to_string();
    for part in ["`hand` has no joint `ah_joint00`", "nothing was sent"] {
        assert!(text.contains(part), "{text}");
    }
    assert!(err.hint().unwrap().contains("joint_names"));
}

#[test]
fn equal_inputs_give_equal_files() {
    let files = || {
        let ran = run(|_| {}, Verdict::Held).unwrap();
        let read = |name| fs::read(ran.folder.path().join(name)).unwrap();
        [
            read("part.parquet"),
            read("cube-1.mcap"),
            read("cube-2.mcap"),
        ]
    };
    assert!(files() == files());
}

#[test]
fn without_an_accepted_motion_the_table_is_empty_and_no_cell_is_asked() {
    let ran = run(|c| c.cell = "tcp/127.0.0.1:9".to_owned(), Verdict::Slipped).unwrap();
    assert!(ran.executions.is_empty());
    assert_eq!(line(&ran.made), "no accepted motion to execute");
}

#[test]
fn silent_cell_is_an_error_with_endpoint_and_hint() {
    let err = run(
        |c| {
            c.cell = "tcp/127.0.0.1:9".to_owned();
            c.answer_timeout_s = 0.3;
        },
        Verdict::Held,
    )
    .map(|_| ())
    .unwrap_err();
    let text = err.to_string();
    assert!(
        text.contains("tcp/127.0.0.1:9") && text.contains("nothing was sent"),
        "{text}"
    );
    assert!(
        err.hint()
            .unwrap()
            .contains("--set dispatch.cell=simulated")
    );
}

#[test]
fn invalid_options_are_named() {
    assert_eq!(Dispatch::check(&config()), []);
    let err = |change: fn(&mut DispatchConfig)| {
        let mut config = config();
        change(&mut config);
        let faults = Dispatch::check(&config);
        assert_eq!(faults.len(), 1);
        faults[0].to_string()
    };
    assert!(err(|c| c.cell = "10.0.0.7".to_owned()).contains("`cell`"));
    assert!(err(|c| c.answer_timeout_s = 0.0).contains("`answer_timeout_s`"));
    assert!(err(|c| c.cell_name = "a/b".to_owned()).contains("`a/b`"));
}

#[test]
fn unreachable_cell_is_refused_before_any_stage_runs() {
    let refused = |cell: &str, access: Option<&str>| {
        let mut config = config();
        config.cell = cell.to_owned();
        config.access = access.map(Into::into);
        let faults = Dispatch::check(&config);
        let [fault] = faults.as_slice() else {
            panic!("{cell}: {faults:?}");
        };
        format!("`{}` {}", fault.key, fault.problem)
    };
    for host in ["localhost", "no-such-host.invalid"] {
        let said = refused(&format!("tls/{host}:7447"), None);
        assert!(said.starts_with("`cell` `tls/"), "{said}");
        assert!(said.contains("needs an access file"), "{said}");
        assert!(said.contains("`--set dispatch.access=FILE`"), "{said}");
    }
    let mut unreadable = config();
    unreadable.cell = "tls/localhost:7447".to_owned();
    unreadable.access = Some("/nowhere.json5".into());
    // Options are checked without reading files.
    assert!(Dispatch::check(&unreadable).is_empty());
    let said = Dispatch::prepare(&unreadable).unwrap_err().to_string();
    assert!(said.contains("/nowhere.json5"), "{said}");
    let said = refused("tcp/10.0.0.7:7447", None);
    assert!(said.starts_with("`cell` `tcp/"), "{said}");
    assert!(said.contains("not protected"), "{said}");
    let said = refused("tcp/127.0.0.1", None);
    assert!(said.contains("is not an endpoint"), "{said}");
    // Whether somebody is there is another matter.
    let mut config = config();
    config.cell = "tcp/127.0.0.1:9".to_owned();
    assert!(Dispatch::check(&config).is_empty());
}
