//! The stage: one unit, of everything that is wired to it.

use dataflow::{
    BoxedDiagnostic, Context, Inputs, Line, OptionsUsed, Outcome, Output, Outputs, Scope,
    SourceFile, Stage, Sum, Unit, counted,
};
use lake::{ReadInputs, WriteArtifact};
use schemas::{
    Table, candidates::Candidates, completions::CompletedObject, demonstrations::Demonstration,
    draws::Draws, executions::Executions, objects::Object, pose_errors::PoseErrors,
    rates::SuccessRates, robustness::RobustnessTable, rollouts::Rollouts,
    smoothness::SmoothnessTable, success::Successes, training::Training, trajectories::Trajectory,
    views::Views,
};

use crate::{Facts, PageData, ReportConfig, render::render, sections::result};

/// Everything that a report may read.
pub const INPUTS: &[&str] = &[
    Demonstration::NAME,
    Object::NAME,
    Trajectory::NAME,
    Training::NAME,
    Candidates::NAME,
    Rollouts::NAME,
    SmoothnessTable::NAME,
    RobustnessTable::NAME,
    PoseErrors::NAME,
    Successes::NAME,
    SuccessRates::NAME,
    Executions::NAME,
    Views::NAME,
    CompletedObject::NAME,
];

/// The panels in which other programs show the recordings: a layout of Foxglove, a blueprint of Rerun.
const PANELS: [(&str, &[u8]); 2] = [
    ("foxglove.json", include_bytes!("page/foxglove.json")),
    ("rollout.rbl", include_bytes!("page/rollout.rbl")),
];

/// Key of the one partition.
const ALL: &str = "all";

/// Makes one page of what a run learned.
pub struct Report;

dataflow::metrics! {
    /// Metrics of a page.
    pub struct PageMetrics {
        /// Number of motions on it.
        motions_n: Sum,
        /// Number of objects.
        objects_n: Sum,
        /// Size of the page, in bytes.
        page_bytes: Sum,
        /// Number of executions that succeeded.
        successes_n: Sum,
        /// Number of executions that count.
        trials_n: Sum,
        /// Number of those at a simulated cell.
        simulated_n: Sum,
    }
}

impl Stage for Report {
    type Config = ReportConfig;

    const KIND: &'static str = "report";
    const ABOUT: &'static str = "Makes one page of a run's results, with motions to look at";
    const INPUTS: &'static [&'static str] = &[];
    const OPTIONAL_INPUTS: &'static [&'static str] = INPUTS;
    const OUTPUTS: Outputs<Self> = &[&Self];
}

impl Output for Report {
    type Stage = Self;
    type Metrics = PageMetrics;
    type Inputs<'a> = &'a Inputs;

    const ARTIFACT: &'static str = "page";
    const SCHEMA: &'static str = "page/1";
    const PARTITION: &'static str = "report";
    const OPTIONS: OptionsUsed = OptionsUsed::All;
    const LINE: Option<Line<PageMetrics>> = Some(|summary| {
        let all = &summary.metrics;
        format!(
            "{}, {} to look at, {:.1} MB",
            counted(all.objects_n, "object"),
            counted(all.motions_n, "motion"),
            all.page_bytes / 1e6
        )
    });

    fn units(config: &ReportConfig, scope: &Scope) -> Result<Vec<Unit>, BoxedDiagnostic> {
        let facts = Facts::of(scope, INPUTS);
        let mut unit = unit(config, &facts)?;
        for &input in INPUTS {
            let keys = scope
                .partitions(input)
                .iter()
                .map(|partition| &partition.key);
            unit = reading(unit, input, keys);
        }
        Ok(vec![unit])
    }

    fn make(
        config: &ReportConfig,
        inputs: &Inputs,
        cx: &Context,
    ) -> Result<Outcome<PageMetrics>, BoxedDiagnostic> {
        let loaded = robot_meshes::load(&inputs.source("hand")?.path)?;
        let urdf = robot::plain_urdf(&loaded.urdf);
        let facts = Facts::from_facts(inputs.facts())?;
        cx.progress(0.1, "reading");
        let gathered = PageData::read(config, facts, inputs, Some((&urdf, &loaded.model)))?;
        cx.progress(0.8, "writing");
        let name = gathered.facts.run.pipeline.clone();
        let runs = [(name, gathered)];
        let files = render(&runs)?;
        for (name, bytes) in &files {
            cx.write_file(name, bytes)?;
        }
        for (name, bytes) in PANELS {
            cx.write_file(name, bytes)?;
        }
        let [(_, gathered)] = &runs;
        let page_bytes = files.get("index.html").map_or(0, Vec::len);
        Ok(Outcome::Made(metrics(gathered, page_bytes)))
    }
}

/// Returns the unit of a page without its artifacts.
///
/// # Errors
///
/// Fails if the hand cannot be read, or facts not be written.
pub fn unit(config: &ReportConfig, facts: &Facts) -> Result<Unit, BoxedDiagnostic> {
    let unit = Unit::new(ALL).with_file_of_form(
        SourceFile::named("hand", &config.hand),
        robot_meshes::URDF_FORM,
    );
    let facts = facts.to_facts()?.into_iter();
    let unit = facts.fold(unit, |unit, (name, value)| unit.with_fact(&name, value));
    let meshes = robot_meshes::sources(&config.hand)?;
    Ok(meshes.into_iter().fold(unit, Unit::with_file))
}

/// Adds the partitions of an input: of rollouts the recordings too, of others the tables.
fn reading<'a, K: ToString + 'a>(
    unit: Unit,
    input: &'static str,
    keys: impl Iterator<Item = &'a K>,
) -> Unit {
    let unit = unit.reading(input, keys.map(ToString::to_string));
    if input == Rollouts::NAME {
        unit
    } else {
        unit.only_files(input, [lake::table::FILE, Draws::FILE])
    }
}

fn metrics(gathered: &PageData, page_bytes: usize) -> PageMetrics {
    let trials = result::trials(gathered);
    PageMetrics {
        motions_n: gathered.motions.len() as f64,
        objects_n: gathered.objects.len().max(gathered.rollouts.len()) as f64,
        page_bytes: page_bytes as f64,
        successes_n: trials.successes_n as f64,
        trials_n: trials.trials_n as f64,
        simulated_n: trials.simulated_n as f64,
    }
}

#[cfg(test)]
mod tests {
    use schemas::ros2::motion::{CONTACT_FORCES, CONTACTS, JOINT_STATES, MARKERS, TABLE};

    use super::*;

    #[test]
    fn panels_name_the_topics_and_the_frame_of_recordings() {
        let [(_, layout), (_, blueprint)] = PANELS;
        let layout: serde_json::Value = serde_json::from_slice(layout).unwrap();
        let configs = layout["configById"].as_object().unwrap();
        let shown = &configs["3D!motion"];
        assert_eq!(shown["followTf"], TABLE);
        for topic in [MARKERS, CONTACTS] {
            assert_eq!(shown["topics"][topic]["visible"], true, "{topic}");
        }
        for (panel, topic) in [
            ("Plot!positions", JOINT_STATES),
            ("Plot!forces", CONTACT_FORCES),
        ] {
            let path = configs[panel]["paths"][0]["value"].as_str().unwrap();
            assert!(path.starts_with(&format!("{topic}.")), "{path}");
        }
        // Every panel that is placed has a configuration, and the other way around.
        let placed = layout["layout"].to_string();
        for name in configs.keys() {
            assert!(placed.contains(name.as_str()), "{name}");
        }
        let blueprint = String::from_utf8_lossy(blueprint);
        assert!(blueprint.starts_with("RRF2"));
    }

    #[test]
    fn options_out_of_bounds_are_faults() {
        let config = |motions: usize, object_triangles: usize| ReportConfig {
            hand: "hand.urdf".into(),
            motions,
            object_triangles,
        };
        assert!(Report::check(&config(0, 100)).is_empty());
        assert_eq!(Report::check(&config(2001, 99)).len(), 2);
    }
}
