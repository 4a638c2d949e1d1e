//! A robot cell, optionally a router, and a dispatcher, each a separate program.

use std::{
    collections::BTreeMap,
    fs,
    io::{BufRead, BufReader, Read},
    net::TcpListener,
    path::{Path, PathBuf},
    process::{Child, ChildStderr, Command, Stdio},
    sync::OnceLock,
    thread,
    time::{Duration, Instant},
};

use serde_json::Value;

use crate::program::{
    bench::{Bench, stderr, stdout},
    credential_folder::CredentialFolder,
};

/// Objects whose recordings are taken where a few are enough.
const OBJECTS: [&str; 3] = [
    "004_sugar_box",
    "005_tomato_soup_can",
    "010_potted_meat_can",
];
/// Way in which all programs authenticate.
const WAY: &str = "certificates";

/// A lake with everything made but the executions.
pub(crate) struct Lab {
    pub(crate) bench: Bench,
    /// Address of the cell or its router, the same after a restart.
    pub(crate) endpoint: String,
    /// Whether the cell connects to a router there.
    behind: Behind,
    /// Credentials of all programs, where they need them.
    credentials: Option<CredentialFolder>,
    /// Reports of cells on finished goals.
    pub(crate) over: Vec<String>,
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum Behind {
    Nothing,
    Router,
}

/// The process of a cell or a router.
pub(crate) struct Served {
    process: Child,
    said: Option<BufReader<ChildStderr>>,
}

/// A lake in which everything up to `screen` is made, once for all tests of this program; they take copies.
pub(crate) fn screened() -> &'static Bench {
    static SCREENED: OnceLock<Bench> = OnceLock::new();
    SCREENED.get_or_init(|| until_screened(Bench::new()))
}

/// A lake in which everything is made; tests only look at it.
pub(crate) fn executed() -> &'static Bench {
    static EXECUTED: OnceLock<Bench> = OnceLock::new();
    EXECUTED.get_or_init(|| {
        let bench = Bench::after(screened());
        bench.run_well(&[]);
        bench
    })
}

fn until_screened(bench: Bench) -> Bench {
    bench.run_well(&["--until", "screen"]);
    bench
}

impl Lab {
    /// A lab whose cell listens itself.
    pub(crate) fn new() -> Self {
        Self::of(Behind::Nothing)
    }

    /// A lab whose cell connects to a router; [`Lab::router`] starts it.
    pub(crate) fn behind_a_router() -> Self {
        Self::of(Behind::Router)
    }

    /// As [`Lab::behind_a_router`], over TLS, where every program shows a certificate.
    pub(crate) fn on_a_network() -> Self {
        let mut lab = Self::of(Behind::Router);
        lab.endpoint = lab.endpoint.replace("tcp/127.0.0.1", "tls/localhost");
        let shipped = Path::new(env!("CARGO_MANIFEST_DIR")).join("data/access");
        lab.credentials = Some(CredentialFolder::new(&shipped));
        lab
    }

    /// A lab with the motions of a few objects.
    pub(crate) fn of_few_objects() -> Self {
        static SCREENED: OnceLock<Bench> = OnceLock::new();
        let screened = SCREENED.get_or_init(|| until_screened(Bench::of_objects(&OBJECTS)));
        Self::with(Bench::after(screened), Behind::Nothing)
    }

    fn of(behind: Behind) -> Self {
        Self::with(Bench::after(screened()), behind)
    }

    fn with(bench: Bench, behind: Behind) -> Self {
        let port = TcpListener::bind("127.0.0.1:0")
            .unwrap()
            .local_addr()
            .unwrap();
        Self {
            bench,
            endpoint: format!("tcp/{port}"),
            behind,
            credentials: None,
            over: Vec::new(),
        }
    }

    pub(crate) fn journal(&self) -> PathBuf {
        self.bench.lake().join("cells/simulated")
    }

    /// Starts the router and waits until it serves.
    pub(crate) fn router(&self) -> Served {
        let mut program = Command::new(env!("CARGO_BIN_EXE_pipeline"));
        program.args(["router", "--listen", &self.endpoint]);
        self.introduce(&mut program, "router");
        self.start(program)
    }

    /// Starts the cell and waits until it serves.
    pub(crate) fn cell(&self, arguments: &[&str]) -> Served {
        self.cell_of(Command::new(env!("CARGO_BIN_EXE_pipeline")), arguments)
    }

    /// As [`Lab::cell`], by a program that runs what it is given.
    pub(crate) fn cell_of(&self, program: Command, arguments: &[&str]) -> Served {
        self.serve(program, &self.bench.lake(), arguments)
    }

    /// As [`Lab::cell`], with a lake of its own.
    pub(crate) fn cell_in(&self, lake: &Path, arguments: &[&str]) -> Served {
        let program = Command::new(env!("CARGO_BIN_EXE_pipeline"));
        self.serve(program, lake, arguments)
    }

    /// Starts a cell with a journal of its own in the lake, which is refused, and returns its output.
    pub(crate) fn refused_cell(&self, journal: &str) -> String {
        let mut program = Command::new(env!("CARGO_BIN_EXE_pipeline"));
        program
            .current_dir(env!("CARGO_MANIFEST_DIR"))
            .args(["cell", "--fast", "--connect", &self.endpoint, "--lake"])
            .arg(self.bench.lake())
            .arg("--journal")
            .arg(self.bench.lake().join(journal));
        self.introduce(&mut program, "cell");
        let refused = program.output().unwrap();
        assert_eq!(refused.status.code(), Some(1), "{}", stderr(&refused));
        stderr(&refused)
    }

    fn serve(&self, mut program: Command, lake: &Path, arguments: &[&str]) -> Served {
        let way = match self.behind {
            Behind::Nothing => "--listen",
            Behind::Router => "--connect",
        };
        program
            .args(["cell", "--lake"])
            .arg(lake)
            .args([way, &self.endpoint])
            .args(arguments);
        self.introduce(&mut program, "cell");
        self.start(program)
    }

    /// Gives a program its credentials, where it needs them.
    fn introduce(&self, program: &mut Command, who: &str) {
        if let Some(credentials) = &self.credentials {
            program.arg("--access").arg(credentials.file(WAY, who));
        }
    }

    /// As [`Lab::dispatch`], as an authenticated user.
    pub(crate) fn dispatch_as(&self, who: &str) -> Command {
        let mut command = self.dispatch();
        if let Some(credentials) = &self.credentials {
            let file = credentials.file(WAY, who);
            command
                .arg("--set")
                .arg(format!("dispatch.access={}", file.display()));
        }
        command
    }

    fn start(&self, mut program: Command) -> Served {
        let mut process = program
            .current_dir(env!("CARGO_MANIFEST_DIR"))
            .stdout(Stdio::piped())
            .stderr(Stdio::piped())
            .spawn()
            .unwrap();
        let mut line = String::new();
        BufReader::new(process.stdout.take().unwrap())
            .read_line(&mut line)
            .unwrap();
        let served = Served::of(process);
        if line.trim() == self.endpoint {
            return served;
        }
        panic!("{}", served.end());
    }

    /// `pipeline run` of the last stage alone, at this cell.
    pub(crate) fn dispatch(&self) -> Command {
        let cell = format!("dispatch.cell={}", self.endpoint);
        self.bench.command(
            "run",
            &[
                "--only",
                "dispatch",
                "--set",
                &cell,
                "--set",
                "dispatch.answer_timeout_s=5.0",
            ],
        )
    }

    /// Runs the last stage, and expects that the cell has executed every accepted goal once, and
    /// that all of them are reported.
    pub(crate) fn dispatch_to_the_end(&mut self, cell: Served) {
        let ran = self.dispatch().output().unwrap();
        assert_eq!(ran.status.code(), Some(0), "{}", stderr(&ran));
        let taken = self.taken();
        self.end(cell);
        let outcomes = self.outcomes();
        assert!(!outcomes.contains_key("unknown"), "{outcomes:?}");
        assert_eq!(all_of(&outcomes), taken as u64, "{outcomes:?}");
        assert_eq!(self.over.len(), taken);
    }

    /// Waits until a cell says that its router is there again, and keeps its output until then.
    pub(crate) fn wait_until_back(&mut self, cell: &mut Served) {
        let mut said = String::new();
        while !said.contains("is there again") {
            let n_bytes = cell.said.as_mut().unwrap().read_line(&mut said).unwrap();
            assert!(n_bytes > 0, "{said}");
        }
        self.hear(&said);
    }

    /// Ends a cell and keeps its output.
    pub(crate) fn end(&mut self, cell: Served) {
        self.hear(&cell.end());
    }

    /// Keeps a cell's reports of finished goals.
    pub(crate) fn hear(&mut self, said: &str) {
        let over = said.lines().filter(|line| line.starts_with("goal"));
        self.over.extend(over.map(str::to_owned));
    }

    /// Makes sure that no goal was over twice, and returns the number of motions by outcome.
    pub(crate) fn outcomes(&self) -> BTreeMap<String, u64> {
        let mut ids: Vec<&str> = self
            .over
            .iter()
            .filter_map(|line| {
                line.split([' ', ':'])
                    .filter(|word| !word.is_empty())
                    .nth(1)
            })
            .collect();
        ids.sort_unstable();
        let n = ids.len();
        ids.dedup();
        assert_eq!(ids.len(), n, "{:#?}", self.over);
        let sql = "select outcome, count(*) as n from executions group by outcome";
        let asked = self.bench.ask(&["query", "--format", "json", sql]);
        stdout(&asked)
            .lines()
            .map(|line| {
                let row: Value = serde_json::from_str(line).unwrap();
                let outcome = row["outcome"].as_str().unwrap().to_owned();
                (outcome, row["n"].as_u64().unwrap())
            })
            .collect()
    }

    /// Waits until the cell has taken so many goals.
    pub(crate) fn wait_until_taken(&self, n: usize) {
        let deadline = Instant::now() + Duration::from_mins(1);
        while self.taken() < n {
            assert!(Instant::now() < deadline, "no goal {n} within a minute");
            thread::sleep(Duration::from_millis(5));
        }
    }

    /// Returns the number of goals that the cell has taken.
    pub(crate) fn taken(&self) -> usize {
        let files = fs::read_dir(self.journal()).unwrap().flatten();
        files
            .filter(|file| {
                file.path()
                    .extension()
                    .is_some_and(|ending| ending == "goal")
            })
            .count()
    }
}

impl Served {
    /// Takes a process whose standard error is piped.
    pub(crate) fn of(mut process: Child) -> Self {
        let said = process.stderr.take().map(BufReader::new);
        Self { process, said }
    }

    /// Sends the process a signal, e.g. `-STOP`.
    pub(crate) fn signal(&self, name: &str) {
        let id = self.process.id().to_string();
        let sent = Command::new("kill").args([name, &id]).status().unwrap();
        assert!(sent.success());
    }

    fn kill(&mut self) {
        let _gone = self.process.kill();
        let _gone = self.process.wait();
    }

    /// Ends the process at once, as a crash does.
    pub(crate) fn crash(self) {
        drop(self);
    }

    /// Ends the process and returns its output.
    pub(crate) fn end(mut self) -> String {
        // Its report on the last goal may be under way.
        thread::sleep(Duration::from_millis(200));
        self.kill();
        let mut said = String::new();
        if let Some(mut reader) = self.said.take() {
            reader.read_to_string(&mut said).unwrap();
        }
        said
    }
}

impl Drop for Served {
    fn drop(&mut self) {
        self.kill();
    }
}

/// Motions of the small job that are sent when nothing goes wrong.
pub(crate) fn all_of(outcomes: &BTreeMap<String, u64>) -> u64 {
    outcomes.values().sum()
}
