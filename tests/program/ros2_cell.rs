//! The dispatcher's fault tests, with the cell on ROS 2 and an arm and a hand of emulated controllers:
//! router, controllers, cell and dispatcher are four programs.

use std::{
    fs,
    io::{BufRead, BufReader},
    net::TcpListener,
    path::{Path, PathBuf},
    process::{Child, Command, Stdio},
    thread,
    time::{Duration, Instant},
};

use serde_json::Value;

use crate::program::bench::{Bench, put, stderr, stdout};

/// The shipped description of a cell, and what a lab without a robot changes in it.
const SHIPPED: &str = include_str!("../../crates/cell/examples/ros2_cell/xarm6_allegro.toml");
const CHANGES: [(&str, &str); 7] = [
    ("simulated = false", "simulated = true"),
    ("start_tolerance_rad = 0.05", "start_tolerance_rad = 7.0"),
    ("approach_rad_per_s = 0.2", "approach_rad_per_s = 3.0"),
    ("max_age_s = 0.1", "max_age_s = 0.5"),
    (
        "deceleration_rad_per_s2 = 20.0",
        "deceleration_rad_per_s2 = 5000.0",
    ),
    (
        "deceleration_rad_per_s2 = 200.0",
        "deceleration_rad_per_s2 = 5000.0",
    ),
    ("max_off_m = 0.03", "max_off_m = 0.3"),
];
/// Few enough objects, one motion each: every motion takes its time.
const VALUES: [&str; 5] = [
    "dispatch.cell_name=lab",
    r#"sample.objects=["003_cracker_box", "004_sugar_box", "006_mustard_bottle", "010_potted_meat_can"]"#,
    "sample.per_object=32",
    "dispatch.per_object=1",
    "dispatch.start_tolerance_rad=7.0",
];
/// Both controllers take part in each motion.
const CONTROLLERS: usize = 2;

/// A program that runs until it is dropped.
struct Running {
    process: Child,
    said: PathBuf,
}

struct Lab {
    bench: Bench,
    endpoint: String,
    config: PathBuf,
    emulated: Running,
    _router: Running,
    programs_n: usize,
    attempt: u32,
}

impl Running {
    /// Starts a program, whose stderr goes to the file `said`, and waits for its first line.
    fn start(mut program: Command, said: PathBuf) -> Self {
        let file = fs::File::create(&said).unwrap();
        let mut process = program
            .current_dir(env!("CARGO_MANIFEST_DIR"))
            .stdout(Stdio::piped())
            .stderr(file)
            .spawn()
            .unwrap();
        let mut line = String::new();
        let mut out = BufReader::new(process.stdout.take().unwrap());
        out.read_line(&mut line).unwrap();
        let running = Self { process, said };
        assert!(!line.is_empty(), "{}", running.said());
        running
    }

    fn said(&self) -> String {
        fs::read_to_string(&self.said).unwrap()
    }
}

impl Drop for Running {
    fn drop(&mut self) {
        let _gone = self.process.kill();
        let _gone = self.process.wait();
    }
}

/// The built example, which is not part of this test: `cargo test --workspace` builds both.
fn example() -> PathBuf {
    let folder = Path::new(env!("CARGO_BIN_EXE_pipeline")).parent().unwrap();
    let program = folder.join("examples/ros2_cell");
    let hint = "build it first: `cargo build --release -p cell --example ros2_cell`";
    assert!(program.exists(), "no `{}`; {hint}", program.display());
    program
}

impl Lab {
    fn new() -> Self {
        let bench = Bench::new();
        let port = TcpListener::bind("127.0.0.1:0").unwrap().local_addr();
        let endpoint = format!("tcp/{}", port.unwrap());
        let mut screened = bench.command_on("pipelines/arm.toml", "run", &["--until", "screen"]);
        for value in VALUES {
            screened.args(["--set", value]);
        }
        let screened = screened.output().unwrap();
        assert_eq!(screened.status.code(), Some(0), "{}", stderr(&screened));
        let mut text = SHIPPED.replace("tcp/127.0.0.1:7447", &endpoint).replace(
            "data/lake/cells/ros2",
            bench.lake().join("ros2").to_str().unwrap(),
        );
        for (from, to) in CHANGES {
            assert!(text.contains(from), "{from}");
            text = text.replace(from, to);
        }
        let config = bench.lake().join("cell.toml");
        put(&config, &text);
        let mut router = Command::new(env!("CARGO_BIN_EXE_pipeline"));
        router.args(["router", "--listen", &endpoint]);
        let router = Running::start(router, bench.lake().join("router.txt"));
        let mut emulated = Command::new(example());
        emulated.arg("emulate").arg(&config);
        let emulated = Running::start(emulated, bench.lake().join("emulated.txt"));
        Self {
            bench,
            endpoint,
            config,
            emulated,
            _router: router,
            programs_n: 0,
            attempt: 0,
        }
    }

    fn cell(&mut self, faults: &[&str]) -> Running {
        let mut program = Command::new(example());
        program.arg("serve").arg(&self.config);
        for fault in faults {
            program.args(["--fault", fault]);
        }
        self.programs_n += 1;
        let said = self
            .bench
            .lake()
            .join(format!("cell{}.txt", self.programs_n));
        Running::start(program, said)
    }

    /// `pipeline run` of the last stage alone, at this cell: this attempt.
    fn dispatch(&self) -> Command {
        let mut run = self
            .bench
            .command_on("pipelines/arm.toml", "run", &["--only", "dispatch"]);
        for value in VALUES {
            run.args(["--set", value]);
        }
        for value in [
            format!("dispatch.cell={}", self.endpoint),
            format!("dispatch.attempt={}", self.attempt),
            "dispatch.answer_timeout_s=5.0".to_owned(),
        ] {
            run.args(["--set", &value]);
        }
        run
    }

    /// Returns the number of goals that the cell has taken, of all attempts.
    fn taken(&self) -> usize {
        let files = fs::read_dir(self.bench.lake().join("ros2"))
            .unwrap()
            .flatten();
        let endings = files.map(|file| file.path().extension().map(ToOwned::to_owned));
        endings.flatten().filter(|ending| ending == "goal").count()
    }

    /// Runs to the end, and makes sure that each goal moved the robot at most once, and that the reports of them are
    /// true: no object ever rose.
    fn dispatch_to_the_end(&self, unknown_n: u64) {
        let ran = self.dispatch().output().unwrap();
        assert_eq!(ran.status.code(), Some(0), "{}", stderr(&ran));
        let sql =
            "select outcome, count(*) as n from executions where goal_id <> '' group by outcome";
        let asked = self.bench.ask(&["query", "--format", "json", sql]);
        let (mut all, mut unknown) = (0, 0);
        for line in stdout(&asked).lines() {
            let row: Value = serde_json::from_str(line).unwrap();
            let (outcome, n) = (row["outcome"].as_str().unwrap(), row["n"].as_u64().unwrap());
            assert!(
                ["failed", "aborted", "unknown"].contains(&outcome),
                "{line}"
            );
            all += n;
            unknown += if outcome == "unknown" { n } else { 0 };
        }
        assert!(all >= 2, "only {all} goals were sent");
        assert_eq!(unknown, unknown_n, "{}", stdout(&asked));
        // The controllers count motions by themselves.
        let said = self.emulated.said();
        let mut streams = said
            .lines()
            .filter_map(|line| line.rsplit_once("message stream "));
        let streams_n: usize = streams.next_back().map_or(0, |(_, n)| n.parse().unwrap());
        assert!(
            streams_n > 0 && streams_n <= CONTROLLERS * self.taken(),
            "{said}"
        );
        assert!(!said.contains("refused"), "{said}");
    }
}

#[test]
fn a_cell_on_ros_2_moves_each_goal_once_and_reports_nothing_false() {
    let mut lab = Lab::new();
    for fault in [
        "die_before_answer@2",
        "die_after_answer@2",
        "die_in_motion@2",
    ] {
        lab.attempt += 1;
        let cell = lab.cell(&[fault]);
        let ran = lab.dispatch().output().unwrap();
        let said = stderr(&ran);
        assert_eq!(ran.status.code(), Some(1), "{fault}: {said}");
        assert!(
            said.contains("is unknown; the robot may have moved"),
            "{said}"
        );
        drop(cell);
        let _cell = lab.cell(&[]);
        lab.dispatch_to_the_end(1);
    }
    lab.attempt += 1;
    let cell = lab.cell(&["lose_answer@1", "double_answer@3", "lose_result@4"]);
    lab.dispatch_to_the_end(0);
    drop(cell);
    for (fault, unknown_n) in [("garbled_answer@2", 0), ("wrong_report@2", 1)] {
        lab.attempt += 1;
        let _cell = lab.cell(&[fault]);
        let before = lab.taken();
        let ran = lab.dispatch().output().unwrap();
        assert_eq!(ran.status.code(), Some(1), "{fault}: {}", stderr(&ran));
        assert_eq!(lab.taken(), before + 2, "{fault}: nothing more is sent");
        lab.dispatch_to_the_end(unknown_n);
    }
}

#[test]
fn a_dispatcher_killed_at_ten_moments_has_a_cell_on_ros_2_move_nothing_twice() {
    let mut lab = Lab::new();
    lab.attempt = 1;
    let _cell = lab.cell(&[]);
    for number in 0..10 {
        let pause = Duration::from_millis(100 + number * 389 % 3000);
        let mut run = lab.dispatch().stderr(Stdio::null()).spawn().unwrap();
        let started = Instant::now();
        while started.elapsed() < pause && run.try_wait().unwrap().is_none() {
            thread::sleep(Duration::from_millis(1));
        }
        let _gone = run.kill();
        run.wait().unwrap();
    }
    // The robot stopped when it heard no heartbeat any more, and that is what the reports say.
    lab.dispatch_to_the_end(0);
}
