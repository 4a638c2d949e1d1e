//! Makes everything that `ingest` makes of a dataset, in a folder of its own.

use std::{
    collections::BTreeMap,
    fs,
    path::{Path, PathBuf},
};

use dataflow::{
    Artifact, BoxedDiagnostic, Context, Inputs, Labels, MetricValues, Outcome, Output, Partition,
    Scope, Stage, Unit,
};
use object_shapes::ShapeOptions;
use schemas::{
    demonstrations::{Demonstration, Side},
    objects::Object,
};
use stage_ingest::{
    Demonstrations, Format, Ingest, IngestConfig, Landmarks, Objects, ReachRule, Shapes, Split,
    TableRule,
};
use tempfile::TempDir;

/// Options that take every right hand.
pub(crate) fn config(root: &Path) -> IngestConfig {
    IngestConfig {
        root: root.to_owned(),
        format: Format::DexYcb,
        hand: Side::Right,
        mirror: false,
        max_mirror_error_m: 0.005,
        subjects: Vec::new(),
        objects: Vec::new(),
        split: Split::All,
        rate_hz: None,
        landmarks: Landmarks::Either,
        mano_models: None,
        camera_agreement_m: 0.01,
        table: TableRule::Tag,
        min_table_objects_n: 2,
        reach: ReachRule::Robust,
        move_threshold_m: 0.004,
        move_threshold_rad: 0.07,
        jitter_factor: 4.0,
        settle_n: 5,
        max_gap_n: 3,
        min_steps_n: 11,
        max_table_error_m: 0.02,
        shape: ShapeOptions {
            points_n: 500,
            max_convex_parts_n: 16,
            part_tolerance_m: 0.0,
        },
        masses_kg: BTreeMap::new(),
        meshes: BTreeMap::new(),
    }
}

/// The outcome.
pub(crate) struct Bench {
    folder: TempDir,
    pub(crate) config: IngestConfig,
    pub(crate) units: BTreeMap<&'static str, Vec<Unit>>,
    pub(crate) outcomes: BTreeMap<(&'static str, String), Outcome>,
}

impl Bench {
    /// Makes all outputs.
    pub(crate) fn new(config: IngestConfig) -> Self {
        Self::until(config, "objects").unwrap()
    }

    /// Makes the outputs up to `last`.
    pub(crate) fn until(config: IngestConfig, last: &str) -> Result<Self, BoxedDiagnostic> {
        Ingest::prepare(&config)?;
        let mut bench = Self {
            folder: tempfile::tempdir().unwrap(),
            config,
            units: BTreeMap::new(),
            outcomes: BTreeMap::new(),
        };
        bench.make::<Shapes>()?;
        if last != Shapes::ARTIFACT {
            bench.make::<Demonstrations>()?;
        }
        if last == Objects::ARTIFACT {
            bench.make::<Objects>()?;
        }
        Ok(bench)
    }

    fn make<O: Output<Stage = Ingest>>(&mut self) -> Result<(), BoxedDiagnostic> {
        let units = O::units(&self.config, &self.scope())?;
        for unit in &units {
            let mut outcome = self.run::<O>(unit)?;
            if let Outcome::Made(metrics) = outcome {
                outcome = Outcome::Labeled(metrics, unit.labels.clone().unwrap());
            }
            let place = (O::ARTIFACT, unit.partition.clone());
            self.outcomes.insert(place, outcome);
        }
        self.units.insert(O::ARTIFACT, units);
        Ok(())
    }

    /// The partitions made so far.
    fn scope(&self) -> Scope {
        let mut partitions: BTreeMap<String, Vec<Partition>> = BTreeMap::new();
        for ((output, key), outcome) in &self.outcomes {
            if let Outcome::Labeled(_, labels) = outcome {
                let partition = Partition::new(key.parse().unwrap(), labels.clone());
                let of = partitions.entry((*output).to_owned()).or_default();
                of.push(partition);
            }
        }
        Scope::new(partitions)
    }

    fn run<O: Output<Stage = Ingest>>(&self, unit: &Unit) -> Result<Outcome, BoxedDiagnostic> {
        let mut artifacts = BTreeMap::new();
        for (input, keys) in &unit.reads {
            let opened = keys.iter().map(|key| self.artifact(input, key));
            artifacts.insert(input.clone(), opened.collect());
        }
        let folder = self.path(O::ARTIFACT, &unit.partition);
        fs::create_dir_all(&folder).unwrap();
        let inputs = Inputs::new(artifacts, unit.files.clone()).with_facts(unit.facts.clone());
        let cx = Context::detached(&unit.partition.parse().unwrap(), 7, &folder);
        Ok(O::read_and_make(&self.config, &inputs, &cx)?.stored())
    }

    /// Folder of an artifact's files.
    pub(crate) fn path(&self, output: &str, key: &str) -> PathBuf {
        self.folder.path().join(output).join(key)
    }

    pub(crate) fn artifact(&self, output: &str, key: &str) -> Artifact {
        let folder = self.path(output, key);
        let files = fs::read_dir(&folder).unwrap().map(|entry| {
            let entry = entry.unwrap();
            (entry.file_name().into_string().unwrap(), entry.path())
        });
        let labels = self
            .outcomes
            .iter()
            .find(|((of, its), _)| *of == output && its == key);
        Artifact {
            key: key.parse().unwrap(),
            labels: match labels {
                Some((_, Outcome::Labeled(_, labels))) => labels.clone(),
                _ => Labels::new(),
            },
            files: files.collect(),
        }
    }

    /// The metrics and labels of a partition; panics if it was not made.
    pub(crate) fn made(&self, output: &'static str, key: &str) -> (&MetricValues, &Labels) {
        match &self.outcomes[&(output, key.to_owned())] {
            Outcome::Labeled(metrics, labels) => (metrics, labels),
            other => panic!("{output} {key}: {other:?}"),
        }
    }

    pub(crate) fn object(&self, output: &'static str, key: &str) -> Object {
        self.made(output, key);
        lake::table::read(&self.artifact(output, key)).unwrap()
    }

    pub(crate) fn demonstration(&self, key: &str) -> Demonstration {
        let (_, labels) = self.made("demonstrations", key);
        let made: Demonstration = lake::table::read(&self.artifact("demonstrations", key)).unwrap();
        assert_eq!(
            (&labels["object"], &labels["subject"]),
            (&made.object, &made.subject)
        );
        made
    }

    /// The only demonstration.
    pub(crate) fn only(&self) -> Demonstration {
        let [unit] = self.units["demonstrations"].as_slice() else {
            panic!("{} recordings", self.units["demonstrations"].len());
        };
        self.demonstration(&unit.partition)
    }

    /// Why the only recording is not used: the word for it and the reason.
    pub(crate) fn reason(&self) -> (&'static str, String) {
        let [unit] = self.units["demonstrations"].as_slice() else {
            panic!("{} recordings", self.units["demonstrations"].len());
        };
        match &self.outcomes[&("demonstrations", unit.partition.clone())] {
            Outcome::Skipped { reason } => ("skipped", reason.clone()),
            Outcome::Filtered { reason } => ("filtered", reason.clone()),
            Outcome::Made(_) | Outcome::Labeled(..) | Outcome::Provisional(_) => panic!("made"),
        }
    }
}
