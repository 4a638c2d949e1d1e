//! Pipeline files: TOML that wires stages.

mod faults;
mod order;
mod profiles;
mod reader;
mod sharing;
mod stage_options;
mod wiring;

use std::collections::{BTreeMap, BTreeSet};

use crate::{
    advice::BoxedDiagnostic,
    digest::Fields,
    error::{Failure, Problem},
    graph::Node,
    kind::{Kind, StageWithConfig},
    name::{ArtifactName, NodeName, PartitionKey, StageName},
    output::OptionsUsed,
    resources::Resources,
    scope::{RunFacts, Scope},
    source::Location,
    stage::Stage,
    store::{Origin, RunRecord},
    unit::Unit,
};

/// A pipeline file, parsed and checked.
pub struct Pipeline {
    /// The file's stem: names the pipeline in the lake.
    pub name: String,
    /// Seed of everything random.
    pub seed: u64,
    /// The stages in the order of the file.
    pub stages: Vec<StageEntry>,
    /// Their outputs in the order in which they are made.
    pub nodes: Vec<Node>,
    /// The file it was read from, with the profile and the values given beside it.
    pub origin: Origin,
}

/// One stage of a pipeline.
pub struct StageEntry {
    /// Its name: the key under `stages`.
    pub name: StageName,
    /// Its kind.
    pub kind: Kind,
    /// Source of each input.
    pub inputs: BTreeMap<ArtifactName, NodeName>,
    /// Share of items that may be skipped before the stage fails.
    pub max_skipped_fraction: f64,
    /// Resources that a unit needs (cores, memory, GPUs, time).
    pub resources: Resources,
    /// Its options as TOML, merged from all files and values given.
    pub(crate) text: String,
    pub(crate) configured: Box<dyn StageWithConfig>,
    /// Where the file says what [`Stage::FILES`] name.
    pub(crate) places: BTreeMap<String, Location>,
}

impl StageEntry {
    /// Prepares resources outside the lake.
    pub(crate) fn prepare(&self) -> Result<(), Failure> {
        let prepared = self.configured.prepare();
        prepared.map_err(|source| self.failure(None, source))
    }

    /// Lists every file that its options name and that cannot be used, each with its place.
    pub(crate) fn unusable_files(&self) -> Vec<Problem> {
        let faults = self.configured.check_files().into_iter();
        let problems = faults.map(|fault| {
            let place = [fault.place(), fault.key.clone()]
                .iter()
                .find_map(|place| self.places.get(place))
                .cloned();
            Problem::new(format!("stage `{}`: {fault}", self.name))
                .at(place)
                .hint(fault.hint)
        });
        problems.collect()
    }

    /// Lists the units of one of its outputs.
    pub(crate) fn units(&self, output_idx: usize, scope: &Scope) -> Result<Vec<Unit>, Failure> {
        let units = self.configured.units(output_idx, scope);
        units.map_err(|source| self.failure(None, source))
    }

    /// Returns the failure of the stage, at a partition or before all of them.
    pub(crate) fn failure(
        &self,
        partition: Option<&PartitionKey>,
        source: BoxedDiagnostic,
    ) -> Failure {
        let lacking = source
            .0
            .missing_input()
            .and_then(|input| self.inputs.get(input));
        Failure::Stage {
            stage: self.name.clone(),
            partition: partition.cloned(),
            left_out: lacking.cloned().map(Into::into),
            source,
        }
    }

    /// Returns the full configuration of a stage of kind `S`; `None` for another kind.
    pub fn options<S: Stage>(&self) -> Option<&S::Config> {
        let is_one = self.kind.name == S::KIND;
        let options = self.configured.options();
        options.downcast_ref().filter(|_| is_one)
    }

    /// Returns the configuration without the paths of files that its units read.
    pub fn config(&self) -> serde_json::Value {
        self.configured.config()
    }

    /// Returns the given options as fingerprints hold them.
    pub(crate) fn config_of(&self, options: OptionsUsed) -> serde_json::Value {
        let mut config = self.config();
        if let serde_json::Value::Object(known) = &mut config {
            known.retain(|option, _| options.includes(option));
        }
        config
    }
}

impl Pipeline {
    /// Returns the stage of a node.
    pub fn stage(&self, node: &Node) -> &StageEntry {
        &self.stages[node.stage_idx]
    }

    /// Returns the outputs that a node depends on, in the order in which they are made.
    pub(crate) fn upstream_of(&self, node: &NodeName) -> Vec<&Node> {
        let mut wanted = BTreeSet::from([node]);
        for node in self.nodes.iter().rev() {
            if wanted.contains(&node.name) {
                wanted.extend(node.reads.values());
            }
        }
        let nodes = self.nodes.iter();
        nodes
            .filter(|known| wanted.contains(&known.name) && known.name != *node)
            .collect()
    }

    /// Returns the outputs of a stage and those that they depend on, in the order in which they
    /// are made.
    pub(crate) fn upstream_of_stage(&self, stage: &str) -> Vec<&Node> {
        let mut wanted: BTreeSet<&NodeName> = BTreeSet::new();
        for node in self.nodes.iter().rev() {
            if node.name.stage == *stage || wanted.contains(&node.name) {
                wanted.insert(&node.name);
                wanted.extend(node.reads.values());
            }
        }
        let nodes = self.nodes.iter();
        nodes.filter(|node| wanted.contains(&node.name)).collect()
    }

    /// Has each stage of these nodes prepare its resources outside the lake, and checks the files that they
    /// name: of all stages, since a later one fails only when those before it have worked.
    pub(crate) fn prepare(&self, nodes: &[&Node]) -> Result<(), Failure> {
        let is_used = |stage: &&StageEntry| nodes.iter().any(|node| node.name.stage == stage.name);
        let used = || self.stages.iter().filter(is_used);
        for stage in used() {
            stage.prepare()?;
        }
        let problems: Vec<Problem> = used().flat_map(StageEntry::unusable_files).collect();
        Failure::of_files(problems)
    }

    /// Returns the facts of the pipeline that stages may report.
    pub(crate) fn facts(&self) -> RunFacts {
        let options: BTreeMap<String, serde_json::Value> = self
            .stages
            .iter()
            .map(|stage| (stage.name.to_string(), stage.config()))
            .collect();
        let code = self.nodes.iter().map(|node| {
            let digest = RunFacts::code_digest(node.output.code.iter());
            (node.name.to_string(), digest)
        });
        let overrides = self.origin.overrides.iter();
        RunFacts {
            pipeline: self.name.clone(),
            seed: self.seed,
            profile: self.origin.profile.clone(),
            overrides: overrides.map(|given| told(given, &options)).collect(),
            wired: BTreeMap::new(),
            kinds: self
                .stages
                .iter()
                .map(|stage| (stage.name.to_string(), stage.kind.name.to_owned()))
                .collect(),
            code: code.collect(),
            options,
        }
    }

    /// Returns the stage of this name.
    pub fn find(&self, name: &str) -> Option<&StageEntry> {
        self.stages.iter().find(|stage| stage.name == *name)
    }
}

impl RunFacts {
    /// Returns the facts of a recorded run, as far as the record has them: without [`RunFacts::wired`] and
    /// [`RunFacts::code`].
    pub fn recorded(record: &RunRecord) -> Self {
        let stages = || record.stages.iter();
        let options = stages().map(|(name, stage)| (name.to_string(), stage.config.clone()));
        let options: BTreeMap<String, serde_json::Value> = options.collect();
        let overrides = record.origin.overrides.iter();
        Self {
            pipeline: record.pipeline.clone(),
            seed: record.seed,
            profile: record.origin.profile.clone(),
            overrides: overrides.map(|given| told(given, &options)).collect(),
            kinds: stages()
                .map(|(name, stage)| (name.to_string(), stage.kind.clone()))
                .collect(),
            options,
            ..Self::default()
        }
    }

    /// Returns the first digits of the digest of an output's code: of the crates that it links, each with
    /// its own.
    pub fn code_digest<'a>(parts: impl Iterator<Item = (&'a str, &'a str)>) -> String {
        let mut fields = Fields::new("code");
        for (part, digest) in parts {
            fields.text(part);
            fields.text(digest);
        }
        fields.finish().short()
    }
}

/// Returns a value given beside the file; without the value if options do not hold it, as those that name a
/// file or folder.
fn told(given: &str, options: &BTreeMap<String, serde_json::Value>) -> String {
    let Some((path, _)) = given.split_once('=') else {
        return given.to_owned();
    };
    let mut keys = path.split('.');
    let stage = keys.next().unwrap_or_default();
    let Some(config) = options.get(stage) else {
        return given.to_owned();
    };
    let found = keys.try_fold(config, |value, key| value.get(key));
    let is_engine = ["max_skipped_fraction", "kind"]
        .iter()
        .any(|key| path.ends_with(key));
    let is_engine = is_engine
        || [".inputs.", ".resources."]
            .iter()
            .any(|key| path.contains(key));
    if found.is_some() || is_engine {
        given.to_owned()
    } else {
        format!("{path}=…")
    }
}
