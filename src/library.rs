//! Answers for programs that hold this one as a library: values and errors, nothing printed.

use std::{any::Any, error::Error, fmt, path::Path};

use dataflow::{Artifact, BoxedDiagnostic, Problem, did_you_mean};
use datafusion::arrow::array::RecordBatch;
use serde::Serialize;
use serde_json::Value;
use toml_edit::{InlineTable, ser::ValueSerializer};

use crate::{
    Direction,
    arguments::{Format, LineageArgs, ValueArgs},
    commands, kinds,
    outcome::CommandError,
    report::chain,
};

/// A refused question: what is wrong, and what to do.
#[derive(Debug)]
pub struct Refusal {
    /// What is wrong, and where.
    pub message: String,
    /// What to do, if it is known.
    pub hint: Option<String>,
}

impl fmt::Display for Refusal {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.message)
    }
}

impl Error for Refusal {}

impl From<CommandError> for Refusal {
    fn from(err: CommandError) -> Self {
        match err {
            CommandError::File(err) => {
                let place = err
                    .problems
                    .iter()
                    .find_map(|problem| problem.location.as_ref());
                let place = place.map_or_else(String::new, |place| format!("\n{place}"));
                Self {
                    message: format!("{err}{place}"),
                    hint: err.problems.into_iter().find_map(|problem| problem.hint),
                }
            }
            CommandError::Usage { message, hint } => Self { message, hint },
            CommandError::Failed { error, hint } => Self {
                message: chain(&error),
                hint,
            },
        }
    }
}

impl From<Problem> for Refusal {
    fn from(problem: Problem) -> Self {
        Self {
            message: problem.message,
            hint: problem.hint,
        }
    }
}

/// Reads the options of a stage of a kind, as its table in a pipeline file would have them: `options` is a JSON object.
/// What it leaves out has its default, or is in the file of its `hand`.
///
/// # Errors
///
/// Fails at the first option that a stage would refuse.
pub fn stage_options<C: Any + Clone>(kind: &str, options: &Value) -> Result<C, Refusal> {
    let all = kinds();
    let known = all.iter().find(|known| known.name == kind);
    let kind = known.ok_or_else(|| Refusal {
        message: format!("no kind of stage `{kind}`"),
        hint: Some("`pipeline stages` lists the kinds".to_owned()),
    })?;
    let unusable = |problem: String| Refusal {
        message: format!("the options of `{}` cannot be used: {problem}", kind.name),
        hint: Some(format!(
            "`pipeline stages {}` lists every option",
            kind.name
        )),
    };
    let written = options.serialize(ValueSerializer::new());
    let written = written.map_err(|err| unusable(err.to_string()))?;
    let table: InlineTable = match written {
        toml_edit::Value::InlineTable(table) => table,
        other => return Err(unusable(format!("{} is no table", other.type_name()))),
    };
    Ok(kind.read_options(table)?)
}

/// Returns the options of a stage in a pipeline file, by its name and with those of a profile: all that decide what it
/// makes, as a JSON object, without the files that it reads.
///
/// # Errors
///
/// Fails at every fault of the file, and if it has no such stage.
pub fn options_in(file: &Path, stage: &str, profile: Option<&str>) -> Result<Value, Refusal> {
    let values = ValueArgs {
        profile: profile.map(str::to_owned),
        overrides: Vec::new(),
    };
    let pipeline = commands::read_pipeline(&kinds(), file, &values)?;
    let names = || pipeline.stages.iter().map(|entry| entry.name.as_str());
    let entry = pipeline.find(stage).ok_or_else(|| Refusal {
        message: format!("`{}` has no stage `{stage}`", file.display()),
        hint: did_you_mean(stage, names()).or_else(|| {
            Some(format!(
                "it has: {}",
                names().collect::<Vec<_>>().join(", ")
            ))
        }),
    })?;
    Ok(entry.config())
}

/// Artifacts of a lake.
#[derive(Debug, Clone, Copy)]
pub struct Wanted<'a> {
    /// Their name, e.g. `objects`.
    pub artifact: &'a str,
    /// The stage that made them; it may be left out where only one did.
    pub stage: Option<&'a str>,
    /// The partition of one of them; all if it is left out.
    pub partition: Option<&'a str>,
    /// Name of the run; the newest that has such artifacts if it is left out.
    pub run: Option<&'a str>,
}

/// Reads artifacts of the lake in this folder, in the order of their partitions; they are not collected meanwhile.
///
/// # Errors
///
/// Fails if there is no such artifact, and as `read` does.
pub fn read_artifacts<T>(
    lake: &Path,
    wanted: &Wanted<'_>,
    read: impl FnMut(&Artifact) -> Result<T, BoxedDiagnostic>,
) -> Result<Vec<T>, Refusal> {
    Ok(commands::read_artifacts(lake, wanted, read)?)
}

/// An artifact of a run, and the direction in which its lineage is followed.
#[derive(Debug, Clone, Copy)]
pub struct LineageOf<'a> {
    /// Its name with its stage's, e.g. `screen.rollouts`.
    pub artifact: &'a str,
    /// Its partition; all if it is left out.
    pub partition: Option<&'a str>,
    /// To what it was made of, or to what was made of it.
    pub direction: Direction,
    /// Name of the run; the newest if it is left out.
    pub run: Option<&'a str>,
}

/// Returns the lineage of an artifact, as `pipeline lineage --format json` writes it.
///
/// # Errors
///
/// Fails if there is no such artifact.
pub fn lineage(lake: &Path, of: &LineageOf<'_>) -> Result<Value, Refusal> {
    let args = LineageArgs {
        artifact: of.artifact.to_owned(),
        partition: of.partition.map(str::to_owned),
        down: of.direction == Direction::Down,
        run: of.run.map(str::to_owned),
        format: Format::Json,
    };
    Ok(commands::family(lake, &args)?)
}

/// Answers a question in SQL over the tables of the lake in this folder, as `pipeline query` does: of the newest run
/// that made each table, or of the run of this name.
///
/// # Errors
///
/// Fails if there is no lake, run or table of such a name, if a table is damaged, and at what is no question in SQL.
pub fn query(lake: &Path, sql: &str, run: Option<&str>) -> Result<RecordBatch, Refusal> {
    Ok(commands::rows(lake, sql, run)?)
}

#[cfg(test)]
mod tests {
    use serde_json::json;
    use stage_refine::RefineConfig;

    use super::*;

    const HAND: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/data/hands/allegro_right.toml");

    #[test]
    fn options_are_those_of_a_pipeline_file() {
        let given = json!({ "hand": HAND, "draws": 3, "self_collision_weight": 1.0 });
        let options: RefineConfig = stage_options("refine", &given).unwrap();
        assert_eq!(
            (options.draws, options.refinement.self_collision_weight),
            (3, 1.0)
        );
        assert_eq!(options.hand_table, Path::new(HAND));
        assert!(options.hand.ends_with("data/robots/allegro_right.urdf"));
        let check = |given: Value, what: &str| {
            let err = stage_options::<RefineConfig>("refine", &given).unwrap_err();
            assert!(err.message.contains(what), "{err}");
            assert!(err.hint.is_some());
        };
        check(json!({ "hand": HAND, "drawz": 3 }), "`drawz`");
        check(json!({ "hand": HAND, "draws": 0 }), "`draws` is 0");
        check(json!({ "hand": "nowhere.toml" }), "nowhere.toml");
        check(json!([1]), "no table");
        check(
            json!({ "hand": HAND, "draws": null }),
            "options of `refine`",
        );
    }

    #[test]
    fn options_in_a_file_are_read_again_as_they_are() {
        let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("pipelines/cgf.toml");
        let mut options = options_in(&file, "refine", None).unwrap();
        options["hand"] = HAND.into();
        let read: RefineConfig = stage_options("refine", &options).unwrap();
        assert_eq!(
            (read.draws, read.refinement.self_collision_weight),
            (4, 1.0)
        );
        let lenient = options_in(&file, "refine", Some("table_lift")).unwrap();
        assert_eq!(lenient["self_collision_weight"], 0.0);
        let err = options_in(&file, "refin", None).unwrap_err();
        assert!(err.hint.unwrap().contains("`refine`"), "{}", err.message);
    }
}
