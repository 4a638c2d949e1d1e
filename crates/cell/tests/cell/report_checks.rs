//! Checks of reports: consistent ones are accepted, contradictory ones refused.

use std::sync::{Arc, Mutex, OnceLock};

use cell::{
    Abort, Contradiction, Goal, GoalResult, Keys, ModelMismatch, RecoveryResult, Report, Router,
    ServiceConfig, SimulatedCellConfig, UncheckedReport, execute_offline,
};
use proptest::prelude::*;
use robot::Joint;
use schemas::executions::Outcome;
use serde_json::{Value, json};
use simulation::SceneRandomization;

use crate::{
    arm::{self, ARM},
    impostor::{Key, RogueParty, capabilities, line},
    lab::{self, GRIPPER, LISTEN, PATIENT, SOON, cube, goal, joints_of, robot, terms},
};

/// Numbers of a row of the gripper's report: time, palm, object, two positions, two commands.
const WIDTH: usize = 1 + 7 + 7 + 2 + 2;
const OBJECT_Z: usize = 1 + 7 + 2;
const PALM_Z: usize = 1 + 2;
const Q: usize = 15;
const COMMAND: usize = 17;

/// A report as its line and rows, to be changed.
#[derive(Debug, Clone)]
struct Loose {
    header: Value,
    rows: Vec<Vec<f64>>,
}

impl Loose {
    fn of(report: &Report) -> Self {
        let bytes = report.to_bytes();
        let end = bytes.iter().position(|&byte| byte == b'\n').unwrap();
        let numbers: Vec<f64> = bytes[end + 1..]
            .chunks_exact(8)
            .map(|eight| f64::from_le_bytes(eight.try_into().unwrap()))
            .collect();
        Self {
            header: serde_json::from_slice(&bytes[..end]).unwrap(),
            rows: numbers.chunks_exact(WIDTH).map(<[f64]>::to_vec).collect(),
        }
    }

    fn bytes(&self) -> Vec<u8> {
        let mut header = self.header.clone();
        header["samples_n"] = json!(self.rows.len());
        let mut bytes = line(&header);
        for number in self.rows.iter().flatten() {
            bytes.extend(number.to_le_bytes());
        }
        bytes
    }

    /// Returns the reason for which it is refused, if it is.
    fn refused(&self) -> Option<String> {
        refused(&self.bytes(), &goal(0.04), &robot())
    }
}

fn refused(bytes: &[u8], goal: &Goal, robot: &[Joint]) -> Option<String> {
    match UncheckedReport::from_bytes(bytes) {
        Ok(report) => {
            let checked = report.check(&goal.encode().goal_id, goal, robot);
            checked.err().map(|err| err.to_string())
        }
        Err(err) => Some(err.to_string()),
    }
}

fn config(mismatch: ModelMismatch) -> SimulatedCellConfig {
    SimulatedCellConfig {
        mismatch,
        ..lab::config(ServiceConfig::default())
    }
}

/// Cancels a motion, as a person does, after `until_s` seconds.
fn broken_off_after(until_s: f64, sample: &cell::Sample) -> Option<Abort> {
    (sample.time_s > until_s).then(|| Abort {
        outcome: Outcome::Stopped,
        message: "canceled".to_owned(),
    })
}

/// Returns the report of a cell with this mismatch on a motion that is canceled after `until_s` seconds.
fn reported(goal: &Goal, mismatch: ModelMismatch, until_s: f64) -> Report {
    let mut see = |sample: &cell::Sample| broken_off_after(until_s, sample);
    execute_offline(&config(mismatch), GRIPPER, &cube(), goal, &mut see).unwrap()
}

fn success() -> Loose {
    static SUCCESS: OnceLock<Report> = OnceLock::new();
    let report = SUCCESS.get_or_init(|| reported(&goal(0.04), ModelMismatch::default(), f64::MAX));
    assert_eq!(report.outcome, Outcome::Succeeded);
    Loose::of(report)
}

#[test]
fn consistent_report_is_accepted() {
    let mismatches = [
        ModelMismatch::default(),
        ModelMismatch {
            latency_s: 0.02,
            ..ModelMismatch::default()
        },
        ModelMismatch {
            latency_s: 0.1,
            encoder_noise_rad: 0.001,
            errors: Some(SceneRandomization {
                position_m: 0.004,
                yaw_rad: 0.05,
                ..SceneRandomization::default()
            }),
        },
    ];
    let mut seen = Vec::new();
    for mismatch in mismatches {
        // The second closes on nothing, the third does not come far enough, the fourth pushes the cube.
        for closed_m in [0.04, 0.0, 0.03, 0.045] {
            for until_s in [f64::MAX, 0.05, 0.5, 1.1, 1.6] {
                let goal = goal(closed_m);
                let report = reported(&goal, mismatch, until_s);
                let why = refused(&report.to_bytes(), &goal, &robot());
                assert_eq!(
                    why, None,
                    "{mismatch:?} {closed_m} {until_s}: {}",
                    report.message
                );
                seen.push(report.outcome);
            }
        }
    }
    for outcome in [Outcome::Succeeded, Outcome::Failed, Outcome::Stopped] {
        assert!(seen.contains(&outcome), "{outcome:?}");
    }
}

#[test]
fn arm_report_is_accepted_in_the_goal_s_joint_order() {
    let asked = arm::carried();
    let robot = joints_of(ARM);
    for mismatch in [
        ModelMismatch::default(),
        ModelMismatch {
            latency_s: 0.05,
            encoder_noise_rad: 0.01,
            ..ModelMismatch::default()
        },
    ] {
        for until_s in [f64::MAX, 0.2] {
            let config = SimulatedCellConfig {
                mismatch,
                ..arm::config()
            };
            let mut see = |sample: &cell::Sample| broken_off_after(until_s, sample);
            let report = execute_offline(&config, arm::HAND, &cube(), &asked, &mut see).unwrap();
            let why = refused(&report.to_bytes(), &asked, &robot);
            assert_eq!(why, None, "{mismatch:?} {until_s}: {}", report.message);
            assert_eq!(report.joints, asked.joint_names());
            assert_eq!(report.joints[0], "joint1");
        }
    }
}

/// Changes of a report on a success, each with the expected refusal.
type Change = (&'static str, fn(&mut Loose), &'static str);

const CHANGES: &[Change] = &[
    ("no samples", |r| r.rows.clear(), "without samples"),
    ("no joints", |r| r.header["joints"] = json!([]), "rows of"),
    (
        "neither",
        |r| {
            r.rows.clear();
            r.header["joints"] = json!([]);
        },
        "without samples",
    ),
    ("one sample", |r| r.rows.truncate(1), "end after 0 s"),
    (
        "the first sample in all rows",
        |r| r.rows = vec![r.rows[0].clone(); r.rows.len()],
        "sample 1 is at 0 s",
    ),
    (
        "frozen from the start, but for the times",
        |r| {
            let first = r.rows[0].clone();
            for row in &mut r.rows {
                row[1..].copy_from_slice(&first[1..]);
            }
        },
        "from where the goal has it",
    ),
    (
        "measured joints frozen",
        |r| {
            let first = r.rows[0].clone();
            for row in &mut r.rows {
                row[Q..COMMAND].copy_from_slice(&first[Q..COMMAND]);
            }
        },
        "has moved by 0.0000",
    ),
    (
        "commands frozen",
        |r| {
            let first = r.rows[0].clone();
            for row in &mut r.rows {
                row[COMMAND..].copy_from_slice(&first[COMMAND..]);
            }
        },
        "the goal commands",
    ),
    (
        "object frozen",
        |r| {
            let first = r.rows[0].clone();
            for row in &mut r.rows {
                row[8..Q].copy_from_slice(&first[8..Q]);
            }
        },
        "that of the samples, 0.0000 m",
    ),
    (
        "object frozen, and so it is said",
        |r| {
            let first = r.rows[0].clone();
            for row in &mut r.rows {
                row[8..Q].copy_from_slice(&first[8..Q]);
            }
            r.header["lift_m"] = json!(0.0);
        },
        "the object rose 0.0000 m",
    ),
    (
        "object dropped before the end",
        |r| {
            let n = r.rows.len();
            let low = r.rows[0][OBJECT_Z];
            for row in &mut r.rows[n - 20..n - 5] {
                row[OBJECT_Z] = low;
            }
        },
        "below the required 0.05 m",
    ),
    (
        "palm stays down",
        |r| {
            let low = r.rows[60][PALM_Z];
            for row in &mut r.rows[60..] {
                row[PALM_Z] = low;
            }
        },
        "from where the goal has it",
    ),
    (
        "lift of -5 m",
        |r| r.header["lift_m"] = json!(-5.0),
        "reported rise -5 m",
    ),
    (
        "lift of 1e308 m",
        |r| r.header["lift_m"] = json!(1e308),
        "m differs from that of the samples",
    ),
    (
        "no lift",
        |r| r.header["lift_m"] = Value::Null,
        "invalid type",
    ),
    (
        "lift of 6 m",
        |r| r.header["lift_m"] = json!(6.0),
        "reported rise 6 m",
    ),
    (
        "lift of 0",
        |r| r.header["lift_m"] = json!(0),
        "reported rise 0 m",
    ),
    (
        "times that go back",
        |r| r.rows.swap(50, 51),
        "sample 51 is at",
    ),
    ("all back", |r| r.rows.reverse(), "sample 0 is at"),
    (
        "one time twice",
        |r| r.rows[50][0] = r.rows[49][0],
        "sample 50 is at",
    ),
    (
        "negative times",
        |r| {
            for row in &mut r.rows {
                row[0] -= 0.05;
            }
        },
        "sample 0 is at -0.05 s",
    ),
    (
        "a late start",
        |r| drop(r.rows.drain(..20)),
        "sample 0 is at",
    ),
    (
        "times in milliseconds",
        |r| {
            for row in &mut r.rows {
                row[0] *= 1000.0;
            }
        },
        "sample 1 is at 10 s",
    ),
    (
        "a time of 1e308",
        |r| r.rows.last_mut().unwrap()[0] = 1e308,
        "is at 1",
    ),
    (
        "a gap",
        |r| drop(r.rows.drain(40..55)),
        "sample 40 is at 0.55",
    ),
    (
        "cut before the hold",
        |r| r.rows.truncate(140),
        "end after 1.39",
    ),
    (
        "joints in another order",
        |r| r.header["joints"] = json!(["slide_right", "slide_left"]),
        "its joints are `slide_right`, `slide_left`",
    ),
    (
        "a joint by another name",
        |r| r.header["joints"][1] = json!("thumb"),
        "`thumb`",
    ),
    (
        "a joint twice",
        |r| r.header["joints"][1] = json!("slide_left"),
        "its joints are",
    ),
    (
        "one joint more",
        |r| r.header["joints"] = json!(["slide_left", "slide_right", "thumb"]),
        "rows of",
    ),
    (
        "one joint more, and numbers",
        |r| {
            r.header["joints"] = json!(["slide_left", "slide_right", "thumb"]);
            for row in &mut r.rows {
                row.insert(COMMAND, 0.0);
                row.push(0.0);
            }
        },
        "its joints are",
    ),
    (
        "one joint less",
        |r| {
            r.header["joints"] = json!(["slide_left"]);
            for row in &mut r.rows {
                row.truncate(COMMAND + 1);
                row.remove(Q);
            }
        },
        "its joints are",
    ),
    (
        "rows of another length",
        |r| {
            r.rows[3].pop();
        },
        "rows of",
    ),
    (
        "a position of 1e308",
        |r| r.rows[9][Q] = 1e308,
        "outside 0 to 0.06",
    ),
    ("not a number", |r| r.rows[9][Q] = f64::NAN, "not finite"),
    ("infinite", |r| r.rows[9][0] = f64::INFINITY, "not finite"),
    (
        "beyond the stop",
        |r| r.rows[90][Q] = 0.09,
        "outside 0 to 0.06",
    ),
    (
        "a command of its own",
        |r| r.rows[90][COMMAND] = 0.02,
        "the goal commands",
    ),
    (
        "commands of a goal that closes otherwise",
        |r| {
            for row in &mut r.rows {
                row[COMMAND] *= 0.7;
            }
        },
        "the goal commands",
    ),
    ("a quaternion of length 2", |r| r.rows[3][7] = 2.0, "row 3"),
    (
        "a quaternion of zeros",
        |r| r.rows[3][4..8].fill(0.0),
        "row 3",
    ),
    (
        "a palm elsewhere",
        |r| r.rows[60][1] += 0.2,
        "from where the goal has it",
    ),
    (
        "an object beyond the room",
        |r| r.rows[60][8] = -1e9,
        "implausible object position, 1000000000 m",
    ),
    (
        "an object that lay elsewhere",
        |r| {
            for row in &mut r.rows {
                row[8] += 1.0;
            }
        },
        "is 1.0000 m from where",
    ),
    (
        "about another goal",
        |r| r.header["goal_id"] = json!("00ff"),
        "about goal `00ff`",
    ),
    (
        "rejected",
        |r| r.header["outcome"] = json!("rejected"),
        "is not an outcome of a goal",
    ),
    (
        "no outcome",
        |r| r.header["outcome"] = json!("great"),
        "is not an outcome",
    ),
];

#[test]
fn contradictory_report_is_refused() {
    assert_eq!(success().refused(), None);
    for (what, change, said) in CHANGES {
        let mut report = success();
        change(&mut report);
        let why = report.refused();
        let why = why.unwrap_or_else(|| panic!("{what}: it is accepted"));
        assert!(why.contains(said), "{what}: {why}");
    }
}

#[test]
fn finger_that_the_object_blocks_from_the_start_is_no_contradiction() {
    let mut report = success();
    let first = report.rows[0].clone();
    for row in &mut report.rows {
        for (q, first) in row[Q..COMMAND].iter_mut().zip(&first[Q..COMMAND]) {
            *q = first + 0.05 * (*q - first);
        }
    }
    report.header["outcome"] = json!("failed");
    assert_eq!(report.refused(), None);
}

#[test]
fn unsuccessful_outcome_is_not_counted_as_success() {
    for (closed_m, until_s) in [(0.0, f64::MAX), (0.04, 0.5), (0.04, 1.1)] {
        let goal = goal(closed_m);
        let report = reported(&goal, ModelMismatch::default(), until_s);
        assert_ne!(report.outcome, Outcome::Succeeded);
        let mut loose = Loose::of(&report);
        loose.header["outcome"] = json!("succeeded");
        let why = refused(&loose.bytes(), &goal, &robot());
        assert!(why.is_some(), "{closed_m} {until_s}");
    }
}

#[test]
fn contradictory_outcome_is_never_recorded() {
    let router = Router::start(LISTEN, None).unwrap();
    let keys = Keys::new("simulated").unwrap();
    let key = Key::new(1);
    let mut cell = RogueParty::at(router.endpoint());
    let signer = Arc::clone(&key);
    cell.says(keys.capabilities(), &key, move || {
        line(&capabilities(&signer))
    });
    cell.says(keys.goal(), &key, || {
        line(&json!({ "answer": "accepted", "known": false }))
    });
    let said = Arc::new(Mutex::new(Vec::new()));
    let now = Arc::clone(&said);
    cell.says(keys.result("*"), &key, move || now.lock().unwrap().clone());
    let client = cell::CellClient::connect(router.endpoint(), "simulated", SOON).unwrap();
    for (what, change, part) in CHANGES {
        let mut report = success();
        change(&mut report);
        *said.lock().unwrap() = report.bytes();
        let executed = client
            .execute(&goal(0.04), &terms(&client), &robot(), PATIENT, &())
            .unwrap();
        assert!(
            matches!(&executed, GoalResult::Unknown(why) if why.contains(part)),
            "{what}: {executed:?}"
        );
        // Queried again, the motion's outcome is unknown.
        let RecoveryResult::Untrusted(report) =
            client.recover(&goal(0.04).encode().goal_id, &goal(0.04), &robot(), PATIENT)
        else {
            panic!("{what}: it has a report");
        };
        assert_eq!(report.outcome, Outcome::Unknown, "{what}");
        assert!(report.message.contains(part) && report.samples.is_empty());
    }
    *said.lock().unwrap() = success().bytes();
    let executed = client
        .execute(&goal(0.04), &terms(&client), &robot(), PATIENT, &())
        .unwrap();
    assert!(
        matches!(&executed, GoalResult::Report(report) if report.outcome == Outcome::Succeeded),
        "{executed:?}"
    );
}

#[test]
fn contradiction_names_its_numbers() {
    let far = Contradiction::Lift {
        reported_m: -5.0,
        sampled_m: 0.1,
    };
    assert_eq!(
        far.to_string(),
        "reported rise -5 m differs from that of the samples, 0.1000 m"
    );
}

/// Corruptions of a report on a success that make it contradictory.
fn spoiling() -> impl Strategy<Value = (String, Loose)> {
    let whole = success();
    let n = whole.rows.len();
    let column = 0..WIDTH;
    (0..11_usize, 0..n, column, 0.0..1.0_f64).prop_map(move |(way, row, column, share)| {
        let mut report = whole.clone();
        let rows = &mut report.rows;
        match way {
            // Rows are missing, at the end or for longer than a gap.
            0 => rows.truncate(row.min(n - 15)),
            1 => {
                let from = row.min(n - 15);
                drop(rows.drain(from..from + 12));
            }
            // The times do not increase.
            2 => rows[row.max(1)][0] = rows[row.max(1) - 1][0] - share,
            3 => rows.swap(row.min(n - 2), n - 1),
            // Everything stops before the fingers have closed.
            4 => {
                let from = row.min(30);
                let still = rows[from].clone();
                for row in &mut rows[from..] {
                    row[1..].copy_from_slice(&still[1..]);
                }
            }
            // A number is implausibly large.
            5 => rows[row][column] = 1e3 + share * 1e300,
            6 => rows[row][column] = -1e3 - share * 1e300,
            7 => rows[row][column] = f64::NAN,
            8 => report.header["lift_m"] = json!(rows[n - 1][OBJECT_Z] + 0.1 + share * 1e3),
            9 => report.header["lift_m"] = json!(0.06 - 0.02 - share * 1e3),
            _ => {
                let by = 0.01 + share;
                for row in rows.iter_mut() {
                    row[COMMAND + column % 2] += by;
                }
            }
        }
        (
            format!("way {way} at row {row}, column {column}, {share}"),
            report,
        )
    })
}

proptest! {
    #[test]
    fn altered_report_is_refused((how, report) in spoiling()) {
        prop_assert!(report.refused().is_some(), "{how}");
    }
}
