//! The memory of what was ever sent to a cell: apart from options and runs, and older than this program.

use std::{fs, path::Path, sync::Arc};

use cell::{
    CellRobot, CellServer, EncodedGoal, Goal, Machine, MachineDescription, MonitoredMotion,
    PalmLimits, Rejection, Report, Sample, ServerConfig, ServiceConfig,
};
use robot::RobotModel;

use crate::program::{
    bench::{stderr, stdout},
    cell_lab::Lab,
};

const HAND: &str = include_str!("../../data/robots/allegro_right.urdf");

/// A real robot to which no goal may come.
struct Untouched(CellRobot);

impl Machine for Untouched {
    fn description(&self) -> MachineDescription {
        MachineDescription {
            simulated: false,
            robot: self.0.digest().to_owned(),
            joints: self.0.joint_names(),
            controllers: self.0.controllers(0.003),
            palm: Some(PalmLimits {
                speed_m_per_s: 3.0,
                acceleration_m_per_s2: 60.0,
                turn_rad_per_s: 12.0,
                turn_acceleration_rad_per_s2: 250.0,
                workspace_m: [[-2.0; 3], [2.0; 3]],
            }),
            table_from_base: None,
            gap: String::new(),
            silence: None,
        }
    }

    fn check(&self, goal: &Goal) -> Result<(), Rejection> {
        panic!("goal `{}` came", goal.candidate_id);
    }

    fn measure(&self) -> Option<Sample> {
        None
    }

    fn execute(
        &self,
        goal: &Goal,
        _encoded: &EncodedGoal,
        _motion: &mut MonitoredMotion<'_>,
    ) -> Report {
        panic!("goal `{}` moves it", goal.candidate_id);
    }
}

#[test]
fn a_dry_run_is_asked_again() {
    let lab = Lab::of_few_objects();
    let robot = CellRobot::new(HAND, RobotModel::from_urdf(HAND).unwrap(), None).unwrap();
    let config = ServerConfig {
        name: "simulated".to_owned(),
        listen: lab.endpoint.clone(),
        service: ServiceConfig::default(),
    };
    let real = CellServer::start(config, Arc::new(Untouched(robot))).unwrap();
    for _ in 0..2 {
        let ran = lab.dispatch().output().unwrap();
        let said = stderr(&ran);
        assert_eq!(ran.status.code(), Some(0), "{said}");
        assert!(
            said.contains("ready; nothing moved without `--execute`"),
            "{said}"
        );
    }
    let cell = format!("dispatch.cell={}", lab.endpoint);
    let planned = lab
        .bench
        .command(
            "plan",
            &["--set", &cell, "--set", "dispatch.answer_timeout_s=5.0"],
        )
        .output()
        .unwrap();
    let planned = stdout(&planned);
    assert!(
        planned.contains("the last result was for its own run alone"),
        "{planned}"
    );
    real.stop();
    // The same command, at a cell that is simulated.
    let cell = lab.cell(&["--fast"]);
    let ran = lab.dispatch().output().unwrap();
    let said = stderr(&ran);
    assert_eq!(ran.status.code(), Some(0), "{said}");
    assert!(said.contains("succeed at the simulated cell"), "{said}");
    drop(cell);
    assert!(lab.taken() > 0);
}

#[test]
fn an_option_that_changes_no_motion_sends_nothing_again() {
    let mut lab = Lab::of_few_objects();
    // Of the second goal nobody knows the end: the cell went down in it and came back without it.
    let cell = lab.cell(&["--fast", "--fault", "die_in_motion@2"]);
    assert_eq!(lab.dispatch().output().unwrap().status.code(), Some(1));
    lab.end(cell);
    let taken = lab.taken();
    let lost = lab.bench.lake().join("lost");
    fs::rename(lab.journal(), &lost).unwrap();
    // With the key of its journal, so that it passes for the same.
    fs::create_dir_all(lab.journal()).unwrap();
    fs::copy(lost.join("key"), lab.journal().join("key")).unwrap();
    let cell = lab.cell(&["--fast"]);
    for more in [
        ["--set", "dispatch.result_timeout_s=33.0"],
        ["--fresh", "dispatch"],
        ["--set", "dispatch.after_unknown=continue"],
    ] {
        let ran = lab.dispatch().args(more).output().unwrap();
        let said = stderr(&ran);
        assert_eq!(ran.status.code(), Some(1), "{more:?}: {said}");
        assert!(
            said.contains("is unknown; the robot may have moved"),
            "{said}"
        );
        assert_eq!(lab.taken(), 0, "{more:?}: {said}");
        let kept = lab.bench.ask(&["gc", "--keep", "1"]);
        assert!(kept.status.success(), "{}", stderr(&kept));
    }
    // A person has looked.
    let ran = lab
        .dispatch()
        .args(["--set", "dispatch.attempt=2"])
        .output()
        .unwrap();
    assert_eq!(ran.status.code(), Some(0), "{}", stderr(&ran));
    assert!(lab.taken() >= taken);
    lab.end(cell);
}

/// Makes the lake one of version 4, which had no ledger.
fn forget_ledger(lake: &Path) {
    fs::remove_dir_all(lake.join("effects")).unwrap();
}

#[test]
fn goals_that_version_4_recorded_are_never_sent_again() {
    let mut lab = Lab::of_few_objects();
    let cell = lab.cell(&["--fast"]);
    let ran = lab.dispatch().output().unwrap();
    assert_eq!(ran.status.code(), Some(0), "{}", stderr(&ran));
    let taken = lab.taken();
    forget_ledger(&lab.bench.lake());
    // The cell knows them.
    let again = ["--fresh", "dispatch"];
    let ran = lab.dispatch().args(again).output().unwrap();
    let said = stderr(&ran);
    assert_eq!(ran.status.code(), Some(0), "{said}");
    assert!(said.contains(&format!("{taken} done before")), "{said}");
    assert_eq!(lab.taken(), taken);
    lab.end(cell);
    // Another cell does not: what they came to is in the lake.
    forget_ledger(&lab.bench.lake());
    fs::rename(lab.journal(), lab.bench.lake().join("lost")).unwrap();
    let cell = lab.cell(&["--fast"]);
    let ran = lab.dispatch().args(again).output().unwrap();
    let said = stderr(&ran);
    assert_eq!(ran.status.code(), Some(1), "{said}");
    assert!(
        said.contains("version 4 of the protocol recorded it as `"),
        "{said}"
    );
    assert_eq!(lab.taken(), 0);
    lab.end(cell);
    // Nor one that version 4 sent without hearing of its end: it left a note beside the unit.
    let other = Lab::of_few_objects();
    let id = lab.over[0].split_whitespace().nth(1).unwrap();
    let note = other.bench.lake().join("resume").join("0".repeat(64));
    fs::create_dir_all(&note).unwrap();
    fs::write(note.join(format!("{id}.sent")), "00ff").unwrap();
    let cell = other.cell(&["--fast"]);
    let ran = other.dispatch().output().unwrap();
    let said = stderr(&ran);
    assert_eq!(ran.status.code(), Some(1), "{said}");
    assert!(
        said.contains("it was sent to the cell with journal `00ff`"),
        "{said}"
    );
    drop(cell);
    assert!(!other.journal().join(format!("{id}.goal")).exists());
}
