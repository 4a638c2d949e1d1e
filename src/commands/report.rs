//! `pipeline report`

use std::{collections::BTreeMap, path::Path};

use dataflow::{
    Artifact, BoxedDiagnostic, Diagnostic, Inputs, NodeName, RecordOutcome, RunFacts, SkippedItem,
};
use lake::{Lake, Run};
use stage_report::{Facts, INPUTS, PageData, Report, ReportConfig, render};

use crate::{
    arguments::ReportArgs,
    command_line::Program,
    commands::lookup,
    outcome::{CommandError, CommandOutcome},
    report,
};

/// Triangles of an object on a page, as in the stage.
const OBJECT_TRIANGLES: usize = 2000;

/// Makes a page of a run, or of several side by side.
pub(crate) fn report(program: &Program, args: &ReportArgs) -> Result<CommandOutcome, CommandError> {
    let lake = program.open_lake()?;
    let mut runs = Vec::new();
    let names: Vec<Option<&str>> = match args.runs.as_slice() {
        [] => vec![None],
        names => names.iter().map(|name| Some(name.as_str())).collect(),
    };
    let hand = args.hand.as_deref().map(hand).transpose()?;
    for (idx, name) in names.into_iter().enumerate() {
        let run = lookup::run(&lake, name)?;
        let config = ReportConfig {
            hand: args.hand.clone().unwrap_or_default(),
            // Those of the first run are shown.
            motions: if idx == 0 { args.motions } else { 0 },
            object_triangles: OBJECT_TRIANGLES,
        };
        let gathered = gathered(&lake, &run, &config, hand.as_ref())?;
        let name = match name {
            Some(name) if name.parse::<u64>().is_err() => format!("{name} (run {})", run.number),
            _ => format!("run {}", run.number),
        };
        runs.push((name, gathered));
    }
    let files = render(&runs).map_err(CommandError::with_hint(Diagnostic::hint))?;
    for (name, bytes) in &files {
        lake::write_atomic(&args.out.join(name), bytes)?;
    }
    let page = args.out.join("index.html");
    report::data(format!("{}\n", page.display()).as_bytes())?;
    Ok(CommandOutcome::Done)
}

/// A hand's URDF, written plainly, and its model.
pub(crate) type Hand = (String, robot::RobotModel);

/// Reads a hand, of its file or its URDF, with its meshes.
pub(crate) fn hand(path: &Path) -> Result<Hand, CommandError> {
    let urdf = hand_files::urdf_of(path).map_err(CommandError::with_hint(Diagnostic::hint))?;
    let loaded = robot_meshes::load(&urdf).map_err(CommandError::with_hint(Diagnostic::hint))?;
    Ok((robot::plain_urdf(&loaded.urdf), loaded.model))
}

/// Reads what a page shows of a run, with the times that its records have.
fn gathered(
    lake: &Lake,
    run: &Run,
    config: &ReportConfig,
    hand: Option<&Hand>,
) -> Result<PageData, CommandError> {
    let wired = wired(run);
    let mut facts = RunFacts::recorded(&run.record);
    let mut left_out: BTreeMap<String, Vec<SkippedItem>> = BTreeMap::new();
    let mut artifacts: BTreeMap<String, Vec<Artifact>> = BTreeMap::new();
    let mut seconds: BTreeMap<String, f64> = BTreeMap::new();
    for unit in &run.record.units {
        let Some((record, provenance)) = lake.record_and_provenance(&unit.fingerprint)? else {
            continue;
        };
        let node = unit.node.to_string();
        *seconds.entry(node.clone()).or_default() += provenance.took_s;
        let code = record.fingerprint.recipe.code.iter();
        let code = code.map(|(part, digest)| (part.as_str(), digest.as_str()));
        facts.code.insert(node, RunFacts::code_digest(code));
        for (input, _) in wired.iter().filter(|(_, from)| **from == unit.node) {
            match &record.outcome {
                RecordOutcome::Made { files, labels, .. } => {
                    let files = files.iter();
                    let is_read = |name: &str| input == "rollouts" || name == lake::table::FILE;
                    let files = files.filter(|(name, _)| is_read(name.as_str()));
                    artifacts.entry(input.clone()).or_default().push(Artifact {
                        key: unit.partition.clone(),
                        labels: labels.clone(),
                        files: files
                            .map(|(name, file)| Ok((name.to_string(), lake.fetched(file)?)))
                            .collect::<Result<_, CommandError>>()?,
                    });
                }
                RecordOutcome::Skipped { reason } | RecordOutcome::Filtered { reason } => {
                    left_out
                        .entry(input.clone())
                        .or_default()
                        .push(SkippedItem {
                            key: unit.partition.to_string(),
                            is_fault: matches!(record.outcome, RecordOutcome::Skipped { .. }),
                            reason: reason.clone(),
                        });
                }
            }
        }
    }
    facts.wired = wired
        .iter()
        .map(|(input, node)| (input.clone(), node.to_string()))
        .collect();
    let facts = Facts::recorded(facts, &left_out);
    let inputs = Inputs::new(artifacts, Vec::new());
    let hand = hand.map(|(urdf, model)| (urdf.as_str(), model));
    let mut gathered = PageData::read(config, facts, &inputs, hand)
        .map_err(CommandError::with_hint(BoxedDiagnostic::hint))?;
    gathered.seconds = seconds;
    // They are relative to a page in the lake.
    for motion in &mut gathered.motions {
        motion.recording = None;
    }
    Ok(gathered)
}

/// Returns the output for each input of a page: as a report of the run is wired, or else the last output of
/// that name.
fn wired(run: &Run) -> BTreeMap<String, NodeName> {
    let kind = <Report as dataflow::Stage>::KIND;
    let own = run.record.stages.values().find(|stage| stage.kind == kind);
    let mut wired = BTreeMap::new();
    for &input in INPUTS {
        let own = own.and_then(|stage| {
            let found = stage.inputs.iter().find(|(name, _)| name.as_str() == input);
            found.map(|(_, node)| node.clone())
        });
        let mut outputs = run.record.outputs.iter().rev().map(|output| &output.node);
        let last = || outputs.find(|node| node.artifact == *input).cloned();
        if let Some(node) = own.or_else(last) {
            wired.insert(input.to_owned(), node);
        }
    }
    wired
}
