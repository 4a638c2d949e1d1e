//! An isolated folder for each test: input files, a pipeline file, a lake, and the program on them.

use std::{
    collections::{BTreeMap, BTreeSet},
    env,
    fs::{self, File, Permissions},
    io::{BufRead, BufReader, Read},
    net::TcpListener,
    os::unix::fs::PermissionsExt,
    path::{Path, PathBuf},
    process::{Child, Command, Output, Stdio},
    sync::{OnceLock, mpsc},
    thread,
    time::{Duration, Instant},
};

use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use tempfile::TempDir;

use crate::folder;

/// Longer than anything here takes; a test that waits this long has failed.
pub(crate) const LONG: Duration = Duration::from_secs(90);

/// Files of a folder, two stages that map them, one that gathers them, one that groups them.
pub(crate) const CHAIN: &str = r#"
[stages.split]
kind = "split"
root = "INPUTS"
table = true

[stages.first]
kind = "map"
inputs.parts = "split.parts"
add = 1
table = true

[stages.second]
kind = "map"
inputs.parts = "first.parts"
add = 1

[stages.gather]
kind = "gather"
inputs.parts = "second.parts"

[stages.group]
kind = "group"
inputs.parts = "first.parts"
"#;

/// A folder with everything that one test uses.
pub(crate) struct Place {
    folder: TempDir,
}

/// One execution of a unit, as the stage itself noted it.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) struct Execution {
    pub(crate) kind: String,
    pub(crate) output: String,
    pub(crate) partition: String,
    /// Tells apart stages of one kind: it is made of the stage's name and the partition.
    pub(crate) seed: String,
}

impl Place {
    /// Makes a place; `INPUTS` in the pipeline stands for the folder of input files.
    pub(crate) fn new(pipeline: &str) -> Self {
        Self::of(pipeline, folder::in_memory())
    }

    /// Makes a place on the disk, for tests of that.
    pub(crate) fn on_disk(pipeline: &str) -> Self {
        Self::of(pipeline, TempDir::new().unwrap())
    }

    fn of(pipeline: &str, folder: TempDir) -> Self {
        let place = Self { folder };
        fs::create_dir(place.inputs()).unwrap();
        let inputs = place.inputs().display().to_string();
        let text = format!("seed = 7\n{}", pipeline.replace("INPUTS", &inputs));
        put(&place.pipeline(), text.as_bytes());
        place
    }

    /// Makes a place with `count` input files `p000`, `p001`, … of a few different bytes each.
    pub(crate) fn with_inputs(pipeline: &str, count: usize) -> Self {
        let place = Self::new(pipeline);
        for number in 0..count {
            place.input(&name(number), format!("a{number}").as_bytes());
        }
        place
    }

    pub(crate) fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    pub(crate) fn inputs(&self) -> PathBuf {
        self.path("inputs")
    }

    pub(crate) fn lake(&self) -> PathBuf {
        self.path("lake")
    }

    pub(crate) fn pipeline(&self) -> PathBuf {
        self.path("own.toml")
    }

    pub(crate) fn log_file(&self) -> PathBuf {
        self.path("log")
    }

    /// Writes the input file of a partition.
    pub(crate) fn input(&self, partition: &str, bytes: &[u8]) {
        put(&self.inputs().join(format!("{partition}.txt")), bytes);
    }

    /// Lets a unit that is held go on, now or when it comes.
    pub(crate) fn let_go(&self, partition: &str) {
        fs::create_dir_all(self.path("gate")).unwrap();
        put(&self.path("gate").join(format!("{partition}.go")), b"");
    }

    /// The command line `own_stages COMMAND own.toml --lake LAKE …` with the stages' log.
    pub(crate) fn command_in(&self, lake: &Path, command: &str, arguments: &[&str]) -> Command {
        let mut program = self.bare(lake, command);
        program.arg(self.pipeline()).args(arguments);
        program
    }

    /// The command line of a command that takes no pipeline file, e.g. `verify`.
    pub(crate) fn bare(&self, lake: &Path, command: &str) -> Command {
        let mut program = Command::new(program());
        program
            .current_dir(self.folder.path())
            .env("OWN_STAGES_LOG", self.log_file())
            .env_remove("PIPELINE_DEPOT")
            .args([command, "--lake"])
            .arg(lake);
        program
    }

    pub(crate) fn command(&self, command: &str, arguments: &[&str]) -> Command {
        self.command_in(&self.lake(), command, arguments)
    }

    /// `run` whose units wait until the test lets them go.
    pub(crate) fn held(&self, arguments: &[&str]) -> Command {
        fs::create_dir_all(self.path("gate")).unwrap();
        let mut command = self.command("run", arguments);
        command.env("OWN_STAGES_GATE", self.path("gate"));
        command
    }

    /// Runs, and expects that everything comes out well.
    pub(crate) fn run_well(&self, arguments: &[&str]) -> Output {
        well(self.command("run", arguments))
    }

    /// Returns the stages' log entries since the last call.
    pub(crate) fn take_log(&self) -> Vec<Execution> {
        let executions = self.log();
        if self.log_file().exists() {
            fs::remove_file(self.log_file()).unwrap();
        }
        executions
    }

    /// Returns the stages' log entries.
    pub(crate) fn log(&self) -> Vec<Execution> {
        let text = fs::read_to_string(self.log_file()).unwrap_or_default();
        text.lines().map(execution).collect()
    }

    /// Returns the number of units that each kind of stage made since the last call.
    pub(crate) fn take_counts(&self) -> BTreeMap<String, usize> {
        let mut counts = BTreeMap::new();
        for execution in self.take_log() {
            *counts.entry(execution.kind).or_default() += 1;
        }
        counts
    }

    /// Stage and partition of every unit by the seed in the log; `stages` in the order of the graph.
    pub(crate) fn names_by_seed(&self, stages: &[&str]) -> BTreeMap<String, (String, String)> {
        let lake = TempDir::new_in(self.folder.path()).unwrap();
        self.take_log();
        let mut names = BTreeMap::new();
        for stage in stages {
            well(self.command_in(lake.path(), "run", &["--until", stage]));
            for execution in self.take_log() {
                let name = ((*stage).to_owned(), execution.partition);
                names.insert(execution.seed, name);
            }
        }
        names
    }

    pub(crate) fn published(&self) -> BTreeMap<String, String> {
        published(&self.lake())
    }

    /// Returns the artifacts that the pipeline publishes in a lake without faults.
    pub(crate) fn undisturbed(&self, arguments: &[&str]) -> BTreeMap<String, String> {
        let lake = TempDir::new_in(self.folder.path()).unwrap();
        let mut command = self.command_in(lake.path(), "run", arguments);
        command.env_remove("OWN_STAGES_LOG");
        well(command);
        published(lake.path())
    }
}

/// A port of this machine that nothing uses now.
pub(crate) fn free_port() -> u16 {
    let free = TcpListener::bind("127.0.0.1:0").unwrap();
    free.local_addr().unwrap().port()
}

/// The name of an input by its number.
pub(crate) fn name(number: usize) -> String {
    format!("p{number:03}")
}

fn execution(line: &str) -> Execution {
    let words: Vec<&str> = line.split(' ').collect();
    let [kind, output, partition, _process, seed] = words[..] else {
        panic!("`{line}` is not a line of the stages' log");
    };
    Execution {
        kind: kind.to_owned(),
        output: output.to_owned(),
        partition: partition.to_owned(),
        seed: seed.to_owned(),
    }
}

/// The built example, which is not part of this test: `cargo test` builds both, `cargo test --test
/// suite` only this.
pub(crate) fn program() -> &'static Path {
    static PROGRAM: OnceLock<PathBuf> = OnceLock::new();
    PROGRAM.get_or_init(up_to_date_program)
}

fn up_to_date_program() -> PathBuf {
    let folder = Path::new(env!("CARGO_BIN_EXE_pipeline")).parent().unwrap();
    let program = folder.join("examples/own_stages");
    let hint = "build it first: `cargo build --release --workspace --example own_stages`";
    let built = fs::metadata(&program).and_then(|metadata| metadata.modified());
    let built = built.unwrap_or_else(|err| panic!("no `{}` ({err}); {hint}", program.display()));
    // Beside it cargo lists the sources of which it was made.
    let sources = fs::read_to_string(program.with_extension("d")).unwrap();
    for source in sources.split_whitespace().skip(1) {
        let changed = fs::metadata(source).and_then(|metadata| metadata.modified());
        assert!(
            changed.is_ok_and(|changed| changed <= built),
            "`{}` is older than `{source}`; {hint}",
            program.display()
        );
    }
    program
}

/// Runs a command, and expects that everything comes out well.
pub(crate) fn well(mut command: Command) -> Output {
    let output = command.output().unwrap();
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    output
}

/// A running program and its stderr, line by line.
pub(crate) struct Running {
    pub(crate) child: Child,
    lines: mpsc::Receiver<String>,
    said: Vec<String>,
}

impl Running {
    pub(crate) fn start(mut command: Command) -> Self {
        command.stdout(Stdio::null()).stderr(Stdio::piped());
        let mut child = command.spawn().unwrap();
        let stderr = BufReader::new(child.stderr.take().unwrap());
        let (sender, lines) = mpsc::channel();
        thread::spawn(move || {
            for line in stderr.lines().map_while(Result::ok) {
                let _gone = sender.send(line);
            }
        });
        Self {
            child,
            lines,
            said: Vec::new(),
        }
    }

    /// Waits until a unit of this partition is being made.
    pub(crate) fn wait_for(&mut self, place: &Place, partition: &str) {
        self.wait_for_log(place, partition, |made| made.partition == partition);
    }

    /// Waits until the stages have noted something that is `wanted`.
    pub(crate) fn wait_for_log(
        &mut self,
        place: &Place,
        about: &str,
        wanted: impl Fn(&Execution) -> bool,
    ) {
        let until = Instant::now() + LONG;
        while !place.log().iter().any(&wanted) {
            let ended = self.child.try_wait().unwrap();
            assert!(
                ended.is_none() && Instant::now() < until,
                "`{about}` was not made ({ended:?}): {}",
                self.lines.try_iter().collect::<Vec<_>>().join("\n")
            );
            thread::park_timeout(Duration::from_millis(2));
        }
    }

    /// Waits until it says a line that is `wanted`.
    pub(crate) fn wait_for_line(&mut self, about: &str, mut wanted: impl FnMut(&str) -> bool) {
        let until = Instant::now() + LONG;
        while let Ok(line) = self.lines.recv_timeout(until - Instant::now()) {
            self.said.push(line.clone());
            if wanted(&line) {
                return;
            }
        }
        panic!("did not say {about}, but:\n{}", self.said.join("\n"));
    }

    /// Waits for its end; returns its exit code and everything it said.
    pub(crate) fn finish(mut self) -> (Option<i32>, String) {
        let status = self.child.wait().unwrap();
        self.said.extend(self.lines.iter());
        (status.code(), self.said.join("\n"))
    }
}

impl Drop for Running {
    fn drop(&mut self) {
        // A test that failed leaves nothing behind; others have waited for the end.
        let _ended = self.child.kill();
        let _status = self.child.wait();
    }
}

/// Tables of the history of runs, which differs from lake to lake.
const HISTORY: [&str; 5] = ["runs", "settings", "units", "artifacts", "metrics"];

/// Digests of every published artifact of a lake, by path.
pub(crate) fn published(lake: &Path) -> BTreeMap<String, String> {
    let mut digests = BTreeMap::new();
    for path in files_below(lake) {
        let name = path.strip_prefix(lake).unwrap();
        let is_history = HISTORY
            .iter()
            .any(|table| name.starts_with(Path::new("tables").join(table)));
        let is_shown = ["tables", "files", "reports"]
            .iter()
            .any(|folder| name.starts_with(folder));
        if is_shown && !is_history {
            let digest = digest_file(&path);
            digests.insert(name.display().to_string(), digest);
        }
    }
    assert!(!digests.is_empty(), "`{}` shows nothing", lake.display());
    digests
}

/// Asserts that the published files are as expected; names those that differ.
pub(crate) fn assert_same(
    shown: &BTreeMap<String, String>,
    expected: &BTreeMap<String, String>,
    context: &str,
) {
    let names: BTreeSet<&String> = shown.keys().chain(expected.keys()).collect();
    let differ: Vec<_> = names
        .into_iter()
        .filter(|name| shown.get(*name) != expected.get(*name))
        .map(|name| (name, shown.get(name), expected.get(name)))
        .collect();
    assert!(differ.is_empty(), "{context}\nshown, expected: {differ:#?}");
}

fn digest_file(path: &Path) -> String {
    let mut hasher = blake3::Hasher::new();
    hasher.update_reader(fs::File::open(path).unwrap()).unwrap();
    hasher.finalize().to_hex().to_string()
}

/// Every file below a folder, ordered; a folder or file that goes away meanwhile is left out.
pub(crate) fn files_below(folder: &Path) -> Vec<PathBuf> {
    let mut files = Vec::new();
    let mut open = vec![folder.to_owned()];
    while let Some(folder) = open.pop() {
        for entry in fs::read_dir(folder).into_iter().flatten().flatten() {
            match entry.file_type() {
                Ok(kind) if kind.is_dir() => open.push(entry.path()),
                Ok(_) => files.push(entry.path()),
                Err(_) => {}
            }
        }
    }
    files.sort();
    files
}

/// A generator of chances for one test; `PIPELINE_SEED` draws others.
pub(crate) fn chances(test: &str) -> ChaCha8Rng {
    let seed: u64 = number("PIPELINE_SEED", 1);
    println!("PIPELINE_SEED={seed} draws these chances again");
    let mut name = [0; 32];
    for (place, byte) in name.iter_mut().zip(test.bytes().chain(seed.to_le_bytes())) {
        *place = byte;
    }
    name[24..].copy_from_slice(&seed.to_le_bytes());
    ChaCha8Rng::from_seed(name)
}

/// A number from an environment variable.
pub(crate) fn number<N: std::str::FromStr>(variable: &str, default: N) -> N {
    let given = env::var(variable).ok();
    given.and_then(|text| text.parse().ok()).unwrap_or(default)
}

/// Writes a test's own file.
pub(crate) fn put(path: &Path, bytes: &[u8]) {
    fs::write(path, bytes).unwrap();
}

/// Writes a file in place, its time and permissions kept.
pub(crate) fn write_unnoticed(path: &Path, bytes: &[u8]) {
    let before = fs::metadata(path).unwrap();
    fs::set_permissions(path, Permissions::from_mode(0o644)).unwrap();
    put(path, bytes);
    let file = File::options().write(true).open(path).unwrap();
    file.set_modified(before.modified().unwrap()).unwrap();
    fs::set_permissions(path, before.permissions()).unwrap();
}

pub(crate) fn read(path: &Path) -> Vec<u8> {
    let mut bytes = Vec::new();
    let mut file = fs::File::open(path).unwrap();
    file.read_to_end(&mut bytes).unwrap();
    bytes
}

pub(crate) fn stderr(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

pub(crate) fn stdout(output: &Output) -> String {
    String::from_utf8_lossy(&output.stdout).into_owned()
}
