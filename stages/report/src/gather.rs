//! Content of a page, read from the artifacts of a run.

use std::collections::BTreeMap;

use dataflow::{Artifact, BoxedDiagnostic, Inputs};
use lake::{ReadInputs, recording, table};
use robot::RobotModel;
use schemas::{
    Table,
    candidates::Candidates,
    demonstrations::Demonstration,
    draws::Refusal,
    executions::{Execution, Executions},
    objects::Object,
    pose_errors::{PoseErrorTrial, PoseErrors},
    rates::SuccessRates,
    robustness::RobustnessTable,
    rollouts::{Rollout, Rollouts},
    smoothness::{CandidateSmoothness, SmoothnessTable},
    success::Successes,
    training::Training,
    trajectories::Trajectory,
};

use crate::{
    EstimatedObject, Facts, Motion, OutcomeGroup, ReportConfig, ReportError,
    estimates::estimated,
    motions::{Recorded, chosen},
    recorded::RecordedMotion,
};

/// Content of a page.
#[derive(Debug, Clone, Default)]
pub struct PageData {
    /// Facts of the pipeline.
    pub facts: Facts,
    /// Number of demonstrations, if they were read.
    pub demonstrations_n: Option<usize>,
    /// Number of trajectories, if they were read.
    pub trajectories_n: Option<usize>,
    /// Names of the objects.
    pub objects: Vec<String>,
    /// Objects whose shape was estimated from views, by name.
    pub estimated: BTreeMap<String, EstimatedObject>,
    /// Losses by epoch.
    pub training: Training,
    /// Refused draws by reason, and number of candidates, if they were read.
    pub draws: Option<Draws>,
    /// Every rollout, by object.
    pub rollouts: BTreeMap<String, Vec<Rollout>>,
    /// Smoothness of every candidate, by object.
    pub smoothness: BTreeMap<String, Vec<CandidateSmoothness>>,
    /// Success by object, generator and origin.
    pub successes: Successes,
    /// Means over objects.
    pub rates: SuccessRates,
    /// Trials under drawn errors: number, and those that held.
    pub robustness: Option<[i64; 2]>,
    /// Control steps of those trials.
    pub robustness_steps_n: i64,
    /// Trials with the object off its estimated pose, by object.
    pub pose_errors: BTreeMap<String, Vec<PoseErrorTrial>>,
    /// Executions by object, if a cell was asked.
    pub executions: BTreeMap<String, Vec<Execution>>,
    /// Motions in the player.
    pub motions: Vec<Motion>,
    /// Number of rollouts with a recording.
    pub recorded_n: usize,
    /// Digest of each input, by its name.
    pub digests: BTreeMap<String, String>,
    /// Seconds that each output took, by `stage.artifact`, where a run's record has them.
    pub seconds: BTreeMap<String, f64>,
}

/// Draws of all motions.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Draws {
    /// Motions that were kept.
    pub candidates_n: i64,
    /// Draws that were not, by the word of their reason.
    pub refused: BTreeMap<&'static str, i64>,
}

impl PageData {
    /// Reads the content of a page; `hand` is the hand's URDF, written plainly, and its model with the shapes of its
    /// meshes: without it, hands of recordings have no meshes.
    ///
    /// # Errors
    ///
    /// Fails if an artifact cannot be read, or a recording cannot be shown.
    pub fn read(
        config: &ReportConfig,
        facts: Facts,
        inputs: &Inputs,
        hand: Option<(&str, &RobotModel)>,
    ) -> Result<Self, BoxedDiagnostic> {
        let counted = |input: &str| {
            let is_wired = facts.run.wired.contains_key(input);
            is_wired.then(|| inputs.artifacts(input).len())
        };
        let mut gathered = Self {
            demonstrations_n: counted(Demonstration::NAME),
            trajectories_n: counted(Trajectory::NAME),
            objects: keys(inputs.artifacts(Object::NAME)),
            estimated: estimated(inputs, &facts)?,
            training: inputs.optional()?.unwrap_or_default(),
            draws: draws(inputs, &facts)?,
            successes: inputs.optional()?.unwrap_or_default(),
            rates: inputs.optional()?.unwrap_or_default(),
            digests: digests(inputs),
            facts,
            ..Self::default()
        };
        for artifact in inputs.artifacts(Rollouts::NAME) {
            let rollouts: Rollouts = table::read(artifact)?;
            gathered.rollouts.insert(artifact.key.to_string(), rollouts);
        }
        for artifact in inputs.artifacts(SmoothnessTable::NAME) {
            let smoothness: SmoothnessTable = table::read(artifact)?;
            gathered
                .smoothness
                .insert(artifact.key.to_string(), smoothness);
        }
        for artifact in inputs.artifacts(PoseErrors::NAME) {
            let trials: PoseErrors = table::read(artifact)?;
            gathered
                .pose_errors
                .insert(artifact.key.to_string(), trials);
        }
        for artifact in inputs.artifacts(Executions::NAME) {
            let executions: Executions = table::read(artifact)?;
            gathered
                .executions
                .insert(artifact.key.to_string(), executions);
        }
        if gathered.facts.run.wired.contains_key(RobustnessTable::NAME) {
            let mut sums = [0, 0];
            for rows in inputs.all::<RobustnessTable>()? {
                for row in rows {
                    sums[0] += row.trials.total_count();
                    sums[1] += row.trials.success_count();
                    gathered.robustness_steps_n += row.control_steps_n;
                }
            }
            gathered.robustness = Some(sums);
        }
        gathered.read_motions(config, inputs.artifacts(Rollouts::NAME), hand)?;
        Ok(gathered)
    }

    /// Reads the recordings of the chosen rollouts.
    fn read_motions(
        &mut self,
        config: &ReportConfig,
        artifacts: &[Artifact],
        hand: Option<(&str, &RobotModel)>,
    ) -> Result<(), BoxedDiagnostic> {
        let mut recorded: Vec<(&Artifact, &str, Recorded<'_>)> = Vec::new();
        for artifact in artifacts {
            let rollouts = self.rollouts.get(artifact.key.as_str());
            let rollouts = rollouts.map_or(&[][..], Vec::as_slice);
            for file in artifact.files.keys() {
                let Some(id) = file.strip_suffix(".mcap") else {
                    continue;
                };
                let mut rollouts = rollouts.iter();
                let rollout = rollouts.find(|rollout| rollout.candidate_id == id);
                let rollout = rollout.ok_or_else(|| ReportError::Stray { name: file.clone() })?;
                let object = artifact.key.as_str();
                recorded.push((artifact, file, Recorded { object, rollout }));
            }
        }
        self.recorded_n = recorded.len();
        let all: Vec<Recorded<'_>> = recorded.iter().map(|(.., one)| *one).collect();
        let mut motions = Vec::new();
        for idx in chosen(&all, config.motions) {
            let Some((artifact, file, Recorded { object, rollout })) = recorded.get(idx) else {
                continue;
            };
            let Some(path) = artifact.file(file) else {
                continue;
            };
            let contents = recording::read(path)?;
            let mut motion = RecordedMotion::read(file, &contents, hand)?;
            let id = rollout.candidate_id.as_str();
            let outcome = OutcomeGroup::of(rollout);
            motion.about = BTreeMap::from(
                [
                    ("candidate_id", id),
                    ("object", object),
                    ("verdict", rollout.verdict.as_str()),
                ]
                .map(|(key, value)| (key.to_owned(), value.to_owned())),
            );
            motions.push(Motion {
                id: id.to_owned(),
                object: (*object).to_owned(),
                generator: rollout.generator.clone(),
                origin: rollout.source.origin.as_str().to_owned(),
                verdict: rollout.verdict.as_str().to_owned(),
                outcome,
                duration_s: motion.moments.last().map_or(0.0, |last| last.time_s),
                recording: self.link(object, file),
                glb: motion.to_glb(id, config.object_triangles)?,
            });
        }
        self.motions = motions;
        Ok(())
    }

    /// Returns the path of a published recording relative to the page: both are below the lake.
    fn link(&self, object: &str, file: &str) -> Option<String> {
        let (stage, artifact) = self.facts.run.wired.get(Rollouts::NAME)?.split_once('.')?;
        let pipeline = &self.facts.run.pipeline;
        Some(format!(
            "../../../../../files/{pipeline}/{stage}/{artifact}/{object}/{file}"
        ))
    }
}

fn keys(artifacts: &[Artifact]) -> Vec<String> {
    artifacts.iter().map(|one| one.key.to_string()).collect()
}

/// Counts the draws of all candidates; `None` if they are not wired.
fn draws(inputs: &Inputs, facts: &Facts) -> Result<Option<Draws>, BoxedDiagnostic> {
    if !facts.run.wired.contains_key(Candidates::NAME) {
        return Ok(None);
    }
    let mut draws = Draws::default();
    for artifact in inputs.artifacts(Candidates::NAME) {
        for draw in table::read_draws(artifact)? {
            let reason = match draw.refused {
                None => {
                    draws.candidates_n += 1;
                    continue;
                }
                Some(Refusal::Object) => "too deep in the object",
                Some(Refusal::Table) => "too deep in the table",
                Some(Refusal::Residual) => "another sample of the motion had a smaller residual",
                Some(Refusal::Change) => "another sample of the motion was changed less",
                Some(Refusal::Motion) => "no motion of the hand",
            };
            *draws.refused.entry(reason).or_default() += 1;
        }
    }
    Ok(Some(draws))
}

/// The digest of each input: of its partitions' names and files, which the lake names by their bytes.
fn digests(inputs: &Inputs) -> BTreeMap<String, String> {
    let mut digests = BTreeMap::new();
    for &input in crate::report::INPUTS {
        let artifacts = inputs.artifacts(input);
        if artifacts.is_empty() {
            continue;
        }
        let mut text = String::new();
        for artifact in artifacts {
            for (name, path) in &artifact.files {
                let blob = path.file_stem().map(|stem| stem.to_string_lossy());
                let blob = blob.unwrap_or_default();
                text.push_str(&format!("{} {name} {blob}\n", artifact.key));
            }
        }
        digests.insert(
            input.to_owned(),
            dataflow::Digest::of_bytes(text.as_bytes()).to_hex(),
        );
    }
    digests
}
