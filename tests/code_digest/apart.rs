//! Reports and generated datasets are apart from results: an edit of `charts`, of a report or of a
//! generator makes no result again.

use std::{
    collections::{BTreeMap, BTreeSet},
    fs, io,
    path::{Path, PathBuf},
};

use dataflow::{
    Advise, Code, Context, Inputs, Kind, Line, Lines, OptionsUsed, Outcome, Output, Outputs,
    Pipeline, Report, RunOptions, Scope, SourceFile, Stage, Unit, UnitState, plan, run,
};
use lake::Lake;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use tempfile::TempDir;

use super::{append, output_of, put};

/// The workspace's stages, each a folder with the crate of its results.
fn stages() -> Vec<String> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("stages");
    let entries = fs::read_dir(root).unwrap().map(|entry| entry.unwrap());
    let folders = entries.filter(|entry| entry.path().join("Cargo.toml").is_file());
    folders
        .map(|entry| entry.file_name().into_string().unwrap())
        .collect()
}

/// The stages that have a crate for their report.
fn reported() -> impl Iterator<Item = String> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("stages");
    let has_report = move |stage: &String| root.join(stage).join("report/Cargo.toml").is_file();
    stages().into_iter().filter(has_report)
}

/// The digests of the code of every stage's results and reports, by the crates' names.
fn codes(root: &Path) -> BTreeMap<String, Vec<code_digest::Part>> {
    let results = stages()
        .into_iter()
        .map(|stage| (format!("stage-{stage}"), format!("stages/{stage}")));
    let reports =
        reported().map(|stage| (format!("report-{stage}"), format!("stages/{stage}/report")));
    results
        .chain(reports)
        .map(|(name, folder)| (name, code_digest::parts(&root.join(folder)).unwrap()))
        .collect()
}

/// Copies manifests and sources of this workspace.
fn copy(from: &Path, to: &Path) {
    fs::create_dir_all(to).unwrap();
    for entry in fs::read_dir(from).unwrap() {
        let entry = entry.unwrap();
        let (path, to) = (entry.path(), to.join(entry.file_name()));
        if path.is_dir() {
            copy(&path, &to);
        } else if path.extension().is_some_and(|kind| {
            ["rs", "toml", "lock", "css", "js"]
                .iter()
                .any(|known| kind == *known)
        }) {
            fs::copy(&path, &to).unwrap();
        }
    }
}

#[test]
fn an_edit_of_charts_reports_or_the_generator_is_in_no_result_of_this_workspace() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let copied = TempDir::new().unwrap();
    for name in ["Cargo.toml", "Cargo.lock"] {
        fs::copy(root.join(name), copied.path().join(name)).unwrap();
    }
    for name in ["crates", "schemas", "stages"] {
        copy(&root.join(name), &copied.path().join(name));
    }
    let mut before = codes(copied.path());
    assert!(before.len() >= 14, "{:?}", before.keys());
    let mut changed_by = |name: &str| -> Vec<String> {
        assert!(copied.path().join(name).is_file(), "{name}");
        append(copied.path(), name, "// Edited.\n");
        let after = codes(copied.path());
        let changed = after.iter().filter(|(name, code)| before[*name] != **code);
        let changed = changed.map(|(name, _)| name.clone()).collect();
        before = after;
        changed
    };
    assert_eq!(
        changed_by("crates/charts/src/style.rs"),
        [
            "report-sample",
            "report-screen",
            "report-train",
            "stage-report"
        ]
    );
    // The page's text, colors and motions are in no other result.
    for of_page in [
        "stages/report/src/page/page.css",
        "stages/report/src/page/player.js",
        "stages/report/src/html.rs",
        "crates/glb/src/motion.rs",
    ] {
        assert_eq!(changed_by(of_page), ["stage-report"], "{of_page}");
    }
    assert_eq!(
        changed_by("crates/demonstrator/src/hand.rs"),
        [] as [&str; 0]
    );
    for stage in reported() {
        let own = format!("report-{stage}");
        assert_eq!(
            changed_by(&format!("stages/{stage}/report/src/report.rs")),
            std::slice::from_ref(&own)
        );
        // What a report shows of a stage follows the stage.
        let both = [own, format!("stage-{stage}")];
        assert_eq!(changed_by(&format!("stages/{stage}/src/lib.rs")), both);
    }
}

#[test]
fn editing_charts_reruns_reports_alone_and_editing_the_generator_nothing() {
    let workspace = buildable();
    let first = built(workspace.path());
    let place = TempDir::new().unwrap();
    for name in ["a.txt", "b.txt"] {
        put(place.path(), &format!("data/{name}"), name);
    }
    let all = ["count.counts", "count.picture"];
    assert_eq!(reruns(place.path(), [1, 1]), all);
    assert_eq!(reruns(place.path(), [1, 1]), [] as [&str; 0]);
    for (name, expected) in [
        ("generator/src/lib.rs", &[][..]),
        ("charts/src/lib.rs", &["count.picture"]),
        ("report/src/lib.rs", &["count.picture"]),
        ("stage/src/lib.rs", &all),
    ] {
        append(workspace.path(), name, "// Edited.\n");
        let now = built(workspace.path());
        let version = |crate_name: &str| {
            if now[crate_name] == first[crate_name] {
                1
            } else {
                2
            }
        };
        assert_eq!(
            reruns(place.path(), ["stage", "report"].map(version)),
            expected,
            "{name}"
        );
        // A lake of its own for the next edit.
        fs::remove_dir_all(place.path().join("lake")).unwrap();
        let code = undo(workspace.path(), name, &first);
        assert_eq!(reruns(place.path(), code), all);
    }
}

/// Takes an edit back; returns the versions of the code, which are the first ones again.
fn undo(workspace: &Path, name: &str, first: &BTreeMap<String, String>) -> [u8; 2] {
    let text = fs::read_to_string(workspace.join(name)).unwrap();
    put(workspace, name, &text.replace("// Edited.\n", ""));
    assert_eq!(built(workspace), *first);
    [1, 1]
}

#[test]
fn a_generated_dataset_is_there_before_units_are_listed() {
    let place = TempDir::new().unwrap();
    put(place.path(), "data/recipe", "");
    let all = ["count.counts", "count.picture"];
    assert_eq!(reruns(place.path(), [1, 1]), all);
    let lake = Lake::open(&place.path().join("lake"));
    let options = RunOptions::default();
    let planned = plan(&pipeline(place.path(), [1, 1]), &lake, &options).unwrap();
    let units = planned.nodes[0].units.as_ref().unwrap();
    assert_eq!(units[0].partition.as_str(), "generated");
}

/// A workspace that builds: a stage, its report with charts, and a generator of what the stage reads.
/// Its program prints the code of the results and that of the reports.
fn buildable() -> TempDir {
    let folder = TempDir::new().unwrap();
    let code_digest = Path::new(env!("CARGO_MANIFEST_DIR")).join("crates/code_digest");
    let build = format!(
        "[build-dependencies]\ncode_digest = {{ path = {:?} }}\n",
        code_digest.display()
    );
    let package = |name: &str, dependencies: &[&str]| {
        let mut text =
            format!("[package]\nname = \"{name}\"\nedition = \"2024\"\n[dependencies]\n");
        for name in dependencies {
            text += &format!("{name} = {{ path = \"../{name}\" }}\n");
        }
        text
    };
    let code = "pub const CODE: &str = env!(\"PIPELINE_CODE\");\n";
    let emit = "fn main() {\n    code_digest::emit();\n}\n";
    let print = "fn main() {\n    println!(\"stage {}\", stage::CODE);\n    \
                 println!(\"report {}\", report::CODE);\n}\n";
    let members = "charts\", \"generator\", \"program\", \"report\", \"stage";
    let program = package("program", &["generator", "report", "stage"]);
    let (stage, report) = (
        package("stage", &[]) + &build,
        package("report", &["charts", "stage"]) + &build,
    );
    let workspace = format!("[workspace]\nmembers = [\"{members}\"]\nresolver = \"3\"\n");
    for (name, text) in [
        ("Cargo.toml", workspace.as_str()),
        ("charts/Cargo.toml", &package("charts", &[])),
        ("charts/src/lib.rs", ""),
        ("generator/Cargo.toml", &package("generator", &["stage"])),
        ("generator/src/lib.rs", ""),
        ("stage/Cargo.toml", &stage),
        ("stage/build.rs", emit),
        ("stage/src/lib.rs", code),
        ("report/Cargo.toml", &report),
        ("report/build.rs", emit),
        ("report/src/lib.rs", code),
        ("program/Cargo.toml", &program),
        ("program/src/main.rs", print),
    ] {
        put(folder.path(), name, text);
    }
    folder
}

/// Builds the workspace and returns the code of the results and that of the reports.
fn built(workspace: &Path) -> BTreeMap<String, String> {
    let said = output_of(workspace, "program");
    let lines = said.lines().map(|line| line.split_once(' ').unwrap());
    lines
        .map(|(name, code)| (name.to_owned(), code.to_owned()))
        .collect()
}

/// Runs the pipeline on the files of `data` with these versions of the code of stage and report;
/// returns the outputs that were made, after checking that the plan has said so.
fn reruns(place: &Path, code: [u8; 2]) -> Vec<String> {
    let pipeline = pipeline(place, code);
    let lake = Lake::open(&place.join("lake"));
    let options = RunOptions::default();
    let planned = plan(&pipeline, &lake, &options).unwrap();
    let is_cached = |state: &UnitState| *state == UnitState::Cached;
    let nodes = planned.nodes.iter();
    let left = nodes.filter(|node| match &node.units {
        Some(units) => !units.iter().all(|unit| is_cached(&unit.state)),
        None => true,
    });
    let left: BTreeSet<String> = left.map(|node| node.node.to_string()).collect();
    let ran = run(&pipeline, &lake, &options, None, &|_| {}).unwrap();
    let nodes = ran.nodes.iter();
    let made = nodes.filter(|node| node.units.iter().any(|unit| unit.made_now));
    let made: Vec<String> = made.map(|node| node.record.node.to_string()).collect();
    assert_eq!(left, made.iter().cloned().collect());
    made
}

fn pipeline(place: &Path, code: [u8; 2]) -> Pipeline {
    let root = place.join("data").display().to_string();
    let text = format!("seed = 7\n[stages.count]\nkind = \"count\"\nroot = {root:?}\n");
    let kind = match code {
        [1, 1] => Kind::generated::<CountReport<1, 1>, _>(generate),
        [1, _] => Kind::generated::<CountReport<1, 2>, _>(generate),
        [_, 1] => Kind::generated::<CountReport<2, 1>, _>(generate),
        [_, _] => Kind::generated::<CountReport<2, 2>, _>(generate),
    };
    let path = place.join("pipeline.toml");
    Pipeline::parse(&path, &text, &[kind], None, &[]).unwrap()
}

/// Why the stage cannot go on.
#[derive(Debug, thiserror::Error)]
#[error("cannot use a file")]
struct CountError(#[from] io::Error);

impl Advise for CountError {
    fn hint(&self) -> Option<String> {
        None
    }
}

/// Options of `kind = "count"`.
#[derive(Debug, Deserialize, Serialize, JsonSchema)]
struct CountConfig {
    /// Folder of the files.
    #[serde(skip_serializing)]
    root: PathBuf,
}

const fn code(version: u8) -> Code {
    let parts = if version == 1 { "own=1" } else { "own=2" };
    Code { parts }
}

/// Copies the files of a folder.
struct Count<const STAGE: u8>;

impl<const STAGE: u8> Stage for Count<STAGE> {
    type Config = CountConfig;
    type Error = CountError;

    const KIND: &'static str = "count";
    const ABOUT: &'static str = "Copies files";
    const CODE: Code = code(STAGE);
    const INPUTS: &'static [&'static str] = &[];
    const OUTPUTS: Outputs<Self> = &[&Self];
}

impl<const STAGE: u8> Output for Count<STAGE> {
    type Stage = Self;
    type Metrics = ();
    type Error = CountError;

    const ARTIFACT: &'static str = "counts";
    const SCHEMA: &'static str = "any/1";
    const PARTITION: &'static str = "file";

    fn units(config: &CountConfig, _scope: &Scope) -> Result<Vec<Unit>, CountError> {
        let mut units = Vec::new();
        for entry in fs::read_dir(&config.root)? {
            let path = entry?.path();
            if let Some(name) = path.file_stem().filter(|_| path.extension().is_some()) {
                let unit = Unit::new(name.to_string_lossy());
                units.push(unit.with_file(SourceFile::named_by_file(&path)));
            }
        }
        Ok(units)
    }

    fn make(_: &CountConfig, inputs: &Inputs, cx: &Context) -> Result<Outcome<()>, CountError> {
        // What follows has other bytes, so that whatever reads them is made again too.
        for file in inputs.files() {
            let text = format!("{STAGE} {}", fs::read_to_string(&file.path)?);
            put(cx.folder(), "count.txt", &text);
        }
        Ok(Outcome::Made(()))
    }
}

/// Tells what was copied.
enum CountReport<const STAGE: u8, const REPORT: u8> {}

impl<const STAGE: u8, const REPORT: u8> Report for CountReport<STAGE, REPORT> {
    type Stage = Count<STAGE>;

    const CODE: Code = code(REPORT);
    const OUTPUTS: Outputs<Count<STAGE>> = &[&Picture::<STAGE>];

    fn lines(lines: &mut Lines<Count<STAGE>>) {
        lines.add::<Count<STAGE>>(|summary| format!("{} counts", summary.n_made));
    }
}

/// Draws what was copied.
struct Picture<const STAGE: u8>;

impl<const STAGE: u8> Output for Picture<STAGE> {
    type Stage = Count<STAGE>;
    type Metrics = ();
    type Error = CountError;

    const ARTIFACT: &'static str = "picture";
    const SCHEMA: &'static str = "any/1";
    const PARTITION: &'static str = "file";
    const OPTIONS: OptionsUsed = OptionsUsed::NONE;
    const LINE: Option<Line<()>> = Some(|summary| format!("{} pictures", summary.n_made));

    fn units(_: &CountConfig, scope: &Scope) -> Result<Vec<Unit>, CountError> {
        let counts = scope.partitions("counts").iter();
        Ok(counts
            .map(|count| Unit::new(&count.key).reading("counts", [&count.key]))
            .collect())
    }

    fn make(_: &CountConfig, _: &Inputs, cx: &Context) -> Result<Outcome<()>, CountError> {
        put(cx.folder(), "picture.svg", "<svg/>");
        Ok(Outcome::Made(()))
    }
}

/// Writes a file where a folder has a recipe.
#[expect(clippy::unnecessary_wraps, reason = "as a generator must be")]
fn generate(config: &CountConfig) -> Result<(), CountError> {
    if config.root.join("recipe").is_file() {
        put(&config.root, "generated.txt", "made up");
    }
    Ok(())
}
