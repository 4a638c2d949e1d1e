//! Dependencies of the results, after some edits.

use std::{
    collections::{BTreeMap, BTreeSet},
    fs,
    path::PathBuf,
};

use serde_json::{Value, json};

use crate::engine::{
    place::{Place, put},
    program_maps::{MAP_PROGRAM, program_table},
};

/// Seed, input files, versions of the code, and stages.
pub(super) struct World {
    pub(super) seed: u64,
    /// Folder of the input files.
    pub(super) root: PathBuf,
    /// The input files by partition. The first one is never bad, nor does it go away: a stage with
    /// nothing to do fails.
    pub(super) files: BTreeMap<String, Vec<u8>>,
    /// Input files that are to be written again although nothing about them has changed.
    pub(super) touched: BTreeSet<String>,
    /// Kinds of which the code is in its second version.
    pub(super) second: BTreeSet<String>,
    pub(super) stages: Vec<StageSpec>,
    /// Path of the program's code.
    pub(super) code: PathBuf,
    written: BTreeMap<String, Vec<u8>>,
}

/// One stage of the pipeline file.
#[derive(Debug, Clone)]
pub(super) struct StageSpec {
    pub(super) name: String,
    pub(super) kind: &'static str,
    /// The stage whose `parts` it reads.
    pub(super) reads: Option<String>,
    /// Every value of its table that counts.
    pub(super) config: BTreeMap<&'static str, Value>,
}

/// The input file that stays good.
pub(super) const ANCHOR: &str = "a";

impl StageSpec {
    pub(super) fn new(name: &str, kind: &'static str, reads: Option<&str>) -> Self {
        let config = match kind {
            "split" => vec![
                ("add", json!(0)),
                ("modulo", json!(0)),
                ("table", json!(false)),
                ("skip", json!([])),
                ("leave_out", json!([])),
            ],
            "map" => vec![
                ("add", json!(1)),
                ("modulo", json!(0)),
                ("table", json!(false)),
            ],
            "program" => vec![("options.add", json!(1)), ("options.modulo", json!(0))],
            _ => vec![("min_bytes", json!(0))],
        };
        Self {
            name: name.to_owned(),
            kind,
            reads: reads.map(str::to_owned),
            config: config.into_iter().collect(),
        }
    }

    pub(super) fn makes_parts(&self) -> bool {
        matches!(self.kind, "split" | "map" | "program")
    }

    pub(super) fn value(&self, key: &str) -> u8 {
        let of_program = || self.config.get(&*format!("options.{key}"));
        let value = self.config.get(key).or_else(of_program);
        let value = value.and_then(Value::as_u64);
        u8::try_from(value.unwrap_or(0)).unwrap()
    }

    pub(super) fn lists(&self, key: &str, partition: &str) -> bool {
        let list = self.config.get(key).and_then(Value::as_array);
        list.is_some_and(|list| list.iter().any(|listed| listed == partition))
    }
}

impl World {
    pub(super) fn new(place: &Place) -> Self {
        Self {
            seed: 7,
            root: place.inputs(),
            code: place.path("map.sh"),
            files: [("a", "apple"), ("b", "banana"), ("c", "avocado")]
                .map(|(name, text)| (name.to_owned(), text.as_bytes().to_vec()))
                .into(),
            touched: BTreeSet::new(),
            second: BTreeSet::new(),
            stages: vec![
                StageSpec::new("split_1", "split", None),
                StageSpec::new("map_1", "map", Some("split_1")),
                StageSpec::new("program_1", "program", Some("map_1")),
                StageSpec::new("gather_1", "gather", Some("map_1")),
                StageSpec::new("group_1", "group", Some("map_1")),
            ],
            written: BTreeMap::new(),
        }
    }

    pub(super) fn version(&self, kind: &str) -> u8 {
        1 + u8::from(self.second.contains(kind))
    }

    pub(super) fn stage(&self, name: &str) -> &StageSpec {
        let mut stages = self.stages.iter();
        stages.find(|stage| stage.name == name).unwrap()
    }

    /// The stage that a stage reads.
    pub(super) fn reads(&self, stage: &str) -> Option<&str> {
        self.stage(stage).reads.as_deref()
    }

    pub(super) fn is_map(&self, stage: &str) -> bool {
        matches!(self.stage(stage).kind, "map" | "program")
    }

    /// A stage and everything above it.
    pub(super) fn with_ancestors(&self, stage: &str) -> BTreeSet<String> {
        let mut names = BTreeSet::from([stage.to_owned()]);
        let mut last = stage;
        while let Some(upstream) = self.reads(last) {
            names.insert(upstream.to_owned());
            last = upstream;
        }
        names
    }

    pub(super) fn pipeline_file(&self) -> String {
        let mut text = format!("seed = {}\n", self.seed);
        for stage in &self.stages {
            let (name, kind) = (&stage.name, stage.kind);
            text.push_str(&format!("\n[stages.{name}]\nkind = \"{kind}\"\n"));
            text.push_str("max_skipped_fraction = 1.0\n");
            match &stage.reads {
                Some(upstream) => {
                    text.push_str(&format!("inputs.parts = \"{upstream}.parts\"\n"));
                }
                None => text.push_str(&format!("root = \"{}\"\n", self.root.display())),
            }
            if kind == "program" {
                text.push_str(&program_table(&self.code));
            }
            for (key, value) in &stage.config {
                text.push_str(&format!("{key} = {value}\n"));
            }
        }
        text
    }

    /// The program's code, in its version.
    pub(super) fn code_text(&self) -> Vec<u8> {
        let more = self.version("program") - 1;
        MAP_PROGRAM
            .replace("more=0", &format!("more={more}"))
            .into_bytes()
    }

    /// Brings the folder of input files to this state.
    pub(super) fn write(&mut self, place: &Place) {
        if !self.root.exists() {
            fs::create_dir_all(&self.root).unwrap();
            self.written.clear();
        }
        let path = |name: &str| self.root.join(format!("{name}.txt"));
        for (name, bytes) in &self.files {
            if self.written.get(name) != Some(bytes) || self.touched.contains(name) {
                put(&path(name), bytes);
            }
        }
        for name in self.written.keys() {
            if !self.files.contains_key(name) {
                fs::remove_file(path(name)).unwrap();
            }
        }
        self.written = self.files.clone();
        self.touched.clear();
        put(&self.code, &self.code_text());
        put(&place.pipeline(), self.pipeline_file().as_bytes());
    }
}
