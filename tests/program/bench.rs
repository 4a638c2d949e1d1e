//! An isolated folder for each test: a sample, a lake, and the program on both.

use std::{
    collections::BTreeMap,
    env, fs,
    path::{Path, PathBuf},
    process::{Command, Output},
    sync::OnceLock,
};

use serde_json::Value;
use tempfile::TempDir;

/// Values with which the whole job is small.
pub(crate) const SMALL: [&str; 5] = [
    "train.network.points=64",
    "train.training.epochs=20",
    "sample.per_object=16",
    "screen.robustness.trials=2",
    "screen.pose_errors_per_object=1",
];

/// The recipe of the bundled sample with one recording per object.
pub(crate) fn small_recipe() -> String {
    let recipe = include_str!("../../data/sample/recipe.toml");
    let lines = recipe.lines().map(|line| match line.split_once(" = ") {
        Some(("sequences_per_object", _)) => "sequences_per_object = 1",
        Some(("subjects", _)) => "subjects = 2",
        _ => line,
    });
    lines.collect::<Vec<_>>().join("\n")
}

/// A small sample, made once for all tests of this program.
fn sample() -> &'static Path {
    static SAMPLE: OnceLock<TempDir> = OnceLock::new();
    SAMPLE
        .get_or_init(|| {
            let folder = TempDir::new().unwrap();
            put(&folder.path().join("recipe.toml"), &small_recipe());
            let made = Bench::on(folder.path().to_owned()).run(&["--until", "ingest"]);
            assert!(made.status.success(), "{}", stderr(&made));
            folder
        })
        .path()
}

/// A lake of its own, and a dataset that may be shared.
pub(crate) struct Bench {
    folder: TempDir,
    root: PathBuf,
    /// Values beside [`SMALL`], as `stage.key=value`.
    values: Vec<String>,
}

impl Bench {
    /// Takes the small sample as it is.
    pub(crate) fn new() -> Self {
        Self::on(sample().to_owned())
    }

    /// Takes a copy of the small sample that the test may change.
    pub(crate) fn with_own_sample() -> Self {
        let mut bench = Self::new();
        let copy = bench.folder.path().join("sample");
        copy_folder(&bench.root, &copy);
        bench.root = copy;
        bench
    }

    /// Takes any folder as dataset.
    pub(crate) fn on(root: PathBuf) -> Self {
        Self {
            folder: TempDir::new().unwrap(),
            root,
            values: Vec::new(),
        }
    }

    /// Takes the recordings of a few objects of the small sample.
    pub(crate) fn of_objects(objects: &[&str]) -> Self {
        Self {
            values: vec![format!("ingest.objects={objects:?}")],
            ..Self::new()
        }
    }

    /// Takes what another bench has made so far.
    pub(crate) fn after(other: &Self) -> Self {
        let bench = Self {
            values: other.values.clone(),
            ..Self::on(other.root.clone())
        };
        copy_folder(&other.lake(), &bench.lake());
        bench
    }

    pub(crate) fn root(&self) -> &Path {
        &self.root
    }

    pub(crate) fn lake(&self) -> PathBuf {
        self.folder.path().join("lake")
    }

    /// The command line of `pipeline COMMAND pipelines/cgf.toml` for a small job.
    pub(crate) fn command(&self, command: &str, arguments: &[&str]) -> Command {
        self.command_on("pipelines/cgf.toml", command, arguments)
    }

    /// The same on another file.
    pub(crate) fn command_on(&self, file: &str, command: &str, arguments: &[&str]) -> Command {
        let mut program = Command::new(env!("CARGO_BIN_EXE_pipeline"));
        program
            .current_dir(env!("CARGO_MANIFEST_DIR"))
            .env_remove("PIPELINE_DEPOT")
            .args([command, file, "--lake"])
            .arg(self.lake())
            .arg("--set")
            .arg(format!("ingest.root={}", self.root.display()));
        let values = SMALL
            .into_iter()
            .chain(self.values.iter().map(String::as_str));
        for value in values {
            program.args(["--set", value]);
        }
        program.args(arguments);
        program
    }

    /// Runs a pipeline file of the test's own on the dataset, with the values that it has.
    pub(crate) fn run_own(&self, file: &Path) {
        let ran = Command::new(env!("CARGO_BIN_EXE_pipeline"))
            .current_dir(env!("CARGO_MANIFEST_DIR"))
            .env_remove("PIPELINE_DEPOT")
            .arg("run")
            .arg(file)
            .arg("--lake")
            .arg(self.lake())
            .args(["--set", &format!("ingest.root={}", self.root.display())])
            .output()
            .unwrap();
        assert!(matches!(ran.status.code(), Some(0 | 3)), "{}", stderr(&ran));
    }

    pub(crate) fn run(&self, arguments: &[&str]) -> Output {
        self.command("run", arguments).output().unwrap()
    }

    /// Runs, and expects that everything comes out well.
    pub(crate) fn run_well(&self, arguments: &[&str]) -> Output {
        let ran = self.run(arguments);
        assert_eq!(ran.status.code(), Some(0), "{}", stderr(&ran));
        ran
    }

    /// Returns the number of units of each output that the newest run made, outputs without any
    /// left out.
    pub(crate) fn made_by_newest_run(&self) -> BTreeMap<String, usize> {
        let runs = self.runs();
        let outputs = runs.last().unwrap()["outputs"].as_array().unwrap();
        let counts = outputs.iter().map(|output| {
            let n_made = output["n_made_now"].as_u64().unwrap();
            let name = output["output"].as_str().unwrap().to_owned();
            (name, usize::try_from(n_made).unwrap())
        });
        counts.filter(|&(_, n_made)| n_made > 0).collect()
    }

    /// Returns the runs that `pipeline runs` lists.
    pub(crate) fn runs(&self) -> Vec<Value> {
        let output = self.ask(&["runs", "--format", "json"]);
        assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
        serde_json::from_slice(&output.stdout).unwrap()
    }

    /// A command on the lake that names no pipeline file.
    pub(crate) fn ask(&self, arguments: &[&str]) -> Output {
        Command::new(env!("CARGO_BIN_EXE_pipeline"))
            .env_remove("COLUMNS")
            .env_remove("PIPELINE_DEPOT")
            .args(arguments)
            .arg("--lake")
            .arg(self.lake())
            .output()
            .unwrap()
    }

    /// Digests of the published artifacts of the lake, by path.
    pub(crate) fn published(&self) -> BTreeMap<String, String> {
        let mut digests = BTreeMap::new();
        for folder in ["tables", "files", "reports"] {
            digest_folder(&self.lake().join(folder), folder, &mut digests);
        }
        // The history of runs is not an artifact.
        digests.retain(|path, _| !path.contains("/run="));
        digests
    }

    /// The folder of the first recording of a right hand.
    pub(crate) fn a_recording(&self) -> PathBuf {
        let subject = first(&self.root, |name| name.contains("subject"));
        first(&subject, |name| {
            let meta = fs::read_to_string(subject.join(name).join("meta.yml")).unwrap();
            meta.contains("right")
        })
    }
}

/// The first entry of a folder by name.
pub(crate) fn first(folder: &Path, wanted: impl Fn(&str) -> bool) -> PathBuf {
    let mut names: Vec<String> = fs::read_dir(folder)
        .unwrap()
        .map(|entry| entry.unwrap().file_name().into_string().unwrap())
        .collect();
    names.sort();
    folder.join(names.into_iter().find(|name| wanted(name)).unwrap())
}

/// The label files of a recording in order.
pub(crate) fn labels(recording: &Path) -> Vec<PathBuf> {
    let camera = first(recording, |name| name.bytes().all(|b| b.is_ascii_digit()));
    let mut paths: Vec<PathBuf> = fs::read_dir(camera)
        .unwrap()
        .map(|entry| entry.unwrap().path())
        .filter(|path| path.extension().is_some_and(|ending| ending == "npz"))
        .collect();
    paths.sort();
    paths
}

/// Lists the shipped pipeline files, those of studies too, in order.
pub(crate) fn pipeline_files() -> Vec<PathBuf> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut files: Vec<PathBuf> = ["pipelines", "pipelines/studies"]
        .iter()
        .flat_map(|folder| fs::read_dir(root.join(folder)).unwrap())
        .map(|entry| entry.unwrap().path())
        .filter(|path| path.extension().is_some_and(|ending| ending == "toml"))
        .collect();
    files.sort();
    files
}

pub(crate) fn stderr(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

pub(crate) fn stdout(output: &Output) -> String {
    String::from_utf8_lossy(&output.stdout).into_owned()
}

/// Writes a test's own file.
#[expect(
    clippy::disallowed_methods,
    reason = "a test's file may well be half a file"
)]
pub(crate) fn put(path: &Path, text: &str) {
    fs::write(path, text).unwrap();
}

/// Returns the text of a file with which a test compares what it found; `PIPELINE_WRITE_GOLDEN=1` writes that first.
pub(crate) fn golden(path: &Path, found: &str) -> String {
    if env::var_os("PIPELINE_WRITE_GOLDEN").is_some() {
        put(path, found);
    }
    fs::read_to_string(path).unwrap_or_default()
}

pub(crate) fn copy_folder(from: &Path, to: &Path) {
    fs::create_dir_all(to).unwrap();
    for entry in fs::read_dir(from).unwrap() {
        let path = entry.unwrap().path();
        let copy = to.join(path.file_name().unwrap());
        if path.is_dir() {
            copy_folder(&path, &copy);
        } else {
            fs::copy(&path, &copy).unwrap();
        }
    }
}

fn digest_folder(folder: &Path, name: &str, digests: &mut BTreeMap<String, String>) {
    let Ok(entries) = fs::read_dir(folder) else {
        return;
    };
    for entry in entries {
        let path = entry.unwrap().path();
        let name = format!("{name}/{}", path.file_name().unwrap().to_string_lossy());
        if path.is_dir() {
            digest_folder(&path, &name, digests);
        } else {
            let digest = dataflow::Digest::of_bytes(&fs::read(&path).unwrap());
            digests.insert(name, digest.to_string());
        }
    }
}
