//! What an edit makes again, from its digests to the units that run.

use std::{collections::BTreeSet, fs, io, path::Path, path::PathBuf};

use dataflow::{
    BoxedDiagnostic, Code, Context, Diagnostic, Inputs, Kind, Line, Lines, OptionsUsed, Outcome,
    Output, Outputs, Pipeline, Report, RunOptions, Scope, SourceFile, Stage, Unit, UnitState, plan,
    run,
};
use lake::Lake;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use tempfile::TempDir;

use super::{append, changed, digests, put, small};

#[test]
fn an_edit_of_a_comment_or_a_test_reruns_nothing_of_a_chart_reports_and_of_the_core_all() {
    let all = ["count.counts", "count.picture"];
    for (name, more, expected) in [
        ("stage/src/core.rs", "// A comment.\n", &[][..]),
        ("stage/src/core.rs", "#[test]\nfn it() {}\n", &[]),
        ("generator/src/lib.rs", "fn f() {}\n", &[]),
        ("charts/src/lib.rs", "fn f() {}\n", &all[1..]),
        ("stage/src/report.rs", "fn f() {}\n", &all[1..]),
        ("library/src/lib.rs", "fn g() {}\n", &all),
    ] {
        let (workspace, place) = (small::workspace(), TempDir::new().unwrap());
        for name in ["a.txt", "b.txt"] {
            put(place.path(), &format!("data/{name}"), name);
        }
        assert_eq!(reruns(place.path(), [1, 1]), all);
        assert_eq!(reruns(place.path(), [1, 1]), [] as [&str; 0]);
        let program = workspace.path().join("program");
        let before = digests(&program).unwrap();
        append(workspace.path(), name, more);
        let parts = changed(&before, &digests(&program).unwrap());
        let version = |code: &str| 1 + u8::from(parts.iter().any(|part| part.starts_with(code)));
        let codes = ["stage-count ", "report-count "].map(version);
        assert_eq!(reruns(place.path(), codes), expected, "{name} {more}");
    }
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
    let codes = code.map(|version| match version {
        1 => Code { parts: "own=1" },
        _ => Code { parts: "own=2" },
    });
    let kind = match code {
        [1, _] => Kind::generated::<CountReport<1>, _>(codes, generate),
        _ => Kind::generated::<CountReport<2>, _>(codes, generate),
    };
    let path = place.join("pipeline.toml");
    Pipeline::parse(&path, &text, &[kind], None, &[]).unwrap()
}

/// Why the stage cannot go on.
#[derive(Debug, thiserror::Error)]
#[error("cannot use a file")]
struct CountError(#[from] io::Error);

impl Diagnostic for CountError {}

/// Options of `kind = "count"`.
#[derive(Debug, Deserialize, Serialize, JsonSchema)]
struct CountConfig {
    /// Folder of the files.
    #[serde(skip_serializing)]
    root: PathBuf,
}

impl dataflow::Options for CountConfig {}

/// Copies the files of a folder.
struct Count<const STAGE: u8>;

impl<const STAGE: u8> Stage for Count<STAGE> {
    type Config = CountConfig;

    const KIND: &'static str = "count";
    const ABOUT: &'static str = "Copies files";
    const INPUTS: &'static [&'static str] = &[];
    const OUTPUTS: Outputs<Self> = &[&Self];
}

impl<const STAGE: u8> Output for Count<STAGE> {
    type Stage = Self;
    type Metrics = ();
    type Inputs<'a> = &'a Inputs;

    const ARTIFACT: &'static str = "counts";
    const SCHEMA: &'static str = "any/1";
    const PARTITION: &'static str = "file";

    fn units(config: &CountConfig, _scope: &Scope) -> Result<Vec<Unit>, BoxedDiagnostic> {
        let mut units = Vec::new();
        for entry in fs::read_dir(&config.root).map_err(CountError)? {
            let path = entry.map_err(CountError)?.path();
            if let Some(name) = path.file_stem().filter(|_| path.extension().is_some()) {
                let unit = Unit::new(name.to_string_lossy());
                units.push(unit.with_file(SourceFile::named_by_file(&path)));
            }
        }
        Ok(units)
    }

    fn make(
        _: &CountConfig,
        inputs: &Inputs,
        cx: &Context,
    ) -> Result<Outcome<()>, BoxedDiagnostic> {
        // What follows has other bytes, so that whatever reads them is made again too.
        for file in inputs.files() {
            let text = fs::read_to_string(&file.path).map_err(CountError)?;
            let text = format!("{STAGE} {text}");
            put(cx.folder(), "count.txt", &text);
        }
        Ok(Outcome::Made(()))
    }
}

/// Tells what was copied.
enum CountReport<const STAGE: u8> {}

impl<const STAGE: u8> Report for CountReport<STAGE> {
    type Stage = Count<STAGE>;

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
    type Inputs<'a> = &'a Inputs;

    const ARTIFACT: &'static str = "picture";
    const SCHEMA: &'static str = "any/1";
    const PARTITION: &'static str = "file";
    const OPTIONS: OptionsUsed = OptionsUsed::NONE;
    const LINE: Option<Line<()>> = Some(|summary| format!("{} pictures", summary.n_made));

    fn units(_: &CountConfig, scope: &Scope) -> Result<Vec<Unit>, BoxedDiagnostic> {
        let counts = scope.partitions("counts").iter();
        Ok(counts
            .map(|count| Unit::new(&count.key).reading("counts", [&count.key]))
            .collect())
    }

    fn make(_: &CountConfig, _: &Inputs, cx: &Context) -> Result<Outcome<()>, BoxedDiagnostic> {
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
