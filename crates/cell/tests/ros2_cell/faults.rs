//! The faults of a cell that dispatchers are tested with, injected into this one: each goal moves the
//! joints at most once, as the emulated controllers count it, and nothing false is reported.

use std::{thread, time::Duration};

use cell::{GoalResult, Patience, RecoveryResult};
use schemas::executions::Outcome;

use crate::lab::{Lab, PATIENT, SOON, SOUND, execute, goal, joints, send};

/// An answer that is not there after this time is lost.
const WAIT: Duration = Duration::from_secs(4);
/// Waits no longer than that.
const IMPATIENT: Patience = Patience {
    answer: WAIT,
    result: WAIT,
};
/// Both controllers take part in each motion.
const CONTROLLERS: usize = 2;

/// A pause that separates two motions for the controllers.
fn pause() {
    thread::sleep(Duration::from_millis(800));
}

#[test]
fn a_cell_that_dies_with_a_goal_leaves_it_unknown_and_never_moves_for_it_again() {
    for (fault, moved) in [
        ("die_before_answer", 0),
        ("die_after_answer", 0),
        ("die_in_motion", CONTROLLERS),
    ] {
        let lab = Lab::new();
        let emulated = lab.emulate(SOUND);
        let cell = lab.serve_apart(&[fault]);
        let goal_1 = goal(&lab, 1);
        let sent = send(&lab.connect(), &goal_1, IMPATIENT);
        assert!(matches!(sent, GoalResult::Unknown(_)), "{fault}");
        drop(cell);
        pause();
        let _cell = lab.serve_apart(&[]);
        let client = lab.connect();
        client.capabilities(SOON).unwrap();
        match client.recover(&goal_1.encode().goal_id, &goal_1, &joints(), PATIENT) {
            RecoveryResult::Report(report) => {
                assert_eq!(report.outcome, Outcome::Unknown, "{fault}");
            }
            other => panic!("{fault}: {other:?}"),
        }
        assert_eq!(
            execute(&client, &goal_1).outcome,
            Outcome::Unknown,
            "{fault}"
        );
        assert_eq!(emulated.log().motions_n, moved, "{fault}");
        // Others are carried out.
        assert_eq!(
            execute(&client, &goal(&lab, 2)).outcome,
            Outcome::Failed,
            "{fault}"
        );
        assert_eq!(emulated.log().motions_n, moved + CONTROLLERS, "{fault}");
    }
}

#[test]
fn answers_that_are_lost_late_or_doubled_change_nothing() {
    let lab = Lab::new();
    let emulated = lab.emulate(SOUND);
    let faults = [
        "lose_answer@1",
        "double_answer@3",
        "lose_result@4",
        "late_answer@5",
    ];
    let _cell = lab.serve_apart(&faults);
    let client = lab.connect();
    client.capabilities(SOON).unwrap();
    for attempt in 1..=4_u32 {
        let report = execute(&client, &goal(&lab, attempt));
        // While it is late with an answer, this cell may hear no heartbeat either.
        let is_silence = attempt == 4 && report.message.contains("no heartbeat");
        let expected = if is_silence {
            Outcome::Aborted
        } else {
            Outcome::Failed
        };
        assert_eq!(report.outcome, expected, "{}", report.message);
        pause();
        let motions_n = emulated.log().motions_n;
        assert_eq!(motions_n, attempt as usize * CONTROLLERS);
    }
}

#[test]
fn a_report_that_cannot_be_read_or_is_false_is_not_believed_and_not_repeated() {
    for fault in [
        "garbled_answer",
        "garbled_report",
        "wrong_report",
        "never_answer",
    ] {
        let lab = Lab::new();
        let emulated = lab.emulate(SOUND);
        let _cell = lab.serve_apart(&[fault]);
        let client = lab.connect();
        client.capabilities(SOON).unwrap();
        let goal = goal(&lab, 1);
        let sent = send(&client, &goal, IMPATIENT);
        assert!(matches!(sent, GoalResult::Unknown(_)), "{fault}: {sent:?}");
        // Where a report comes, it comes when the motion has ended: on a busy machine that takes long.
        let patience = if fault == "never_answer" {
            IMPATIENT
        } else {
            PATIENT
        };
        let goal_id = goal.encode().goal_id;
        let recovered = client.recover(&goal_id, &goal, &joints(), patience);
        match (fault, recovered) {
            ("garbled_answer", RecoveryResult::Report(report)) => {
                let ended = [Outcome::Failed, Outcome::Aborted];
                assert!(ended.contains(&report.outcome), "{report:?}");
            }
            ("garbled_report" | "wrong_report", RecoveryResult::Untrusted(report)) => {
                assert_eq!(report.outcome, Outcome::Unknown, "{fault}");
            }
            ("never_answer", RecoveryResult::NoAnswer(_)) => {}
            (_, other) => panic!("{fault}: {other:?}"),
        }
        assert_eq!(emulated.log().motions_n, CONTROLLERS, "{fault}");
    }
}
