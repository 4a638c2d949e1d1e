//! Reading a pipeline file and collecting all its faults.

use std::{
    collections::{BTreeMap, BTreeSet},
    ops::Range,
    path::Path,
};

use options::OptionFault;
use serde::{Deserialize, de::IntoDeserializer};
use toml_edit::{InlineTable, Key, Value};

use super::{
    Pipeline, StageEntry,
    faults::{Part, faults},
    order::order,
};
use crate::{
    error::{FileError, Problem},
    file_fault::place_of,
    inheritance::{EXTENDS, InheritedFile, WITHOUT},
    kind::Kind,
    name::{ArtifactName, NodeName, PipelineName, StageName},
    overrides::Override,
    resources::Resources,
    shared::{SHARED, SharedUse},
    source::Location,
    stage::Wiring,
    store::Origin,
    suggestions::did_you_mean,
    tables::{found, merge_values, set_value},
};

/// Example of `resources`, for hints.
const RESOURCES_HINT: &str = "write, e.g., `resources = { cores = 4, memory_gb = 16, gpus = 1, time_min = 30, partition = \"gpu\" }`";

/// Default share of items that a stage may skip: one in five.
const DEFAULT_MAX_SKIPPED_FRACTION: f64 = 0.2;

impl Pipeline {
    /// Parses and checks a pipeline file, and reads the files that it extends; `profile` names a table under
    /// `profiles`, and `overrides` come last.
    ///
    /// # Errors
    ///
    /// Fails with every fault in the files, each with its location and a hint.
    pub fn parse(
        path: &Path,
        source: &str,
        kinds: &[Kind],
        profile: Option<&str>,
        overrides: &[Override],
    ) -> Result<Self, FileError> {
        let file = InheritedFile::read(path, source);
        if !file.problems.is_empty() {
            return Err(FileError {
                problems: file.problems,
            });
        }
        let mut reader = FileReader {
            path,
            file: &file,
            kinds,
            overrides,
            taken: Vec::new(),
            taken_names: BTreeSet::new(),
            problems: Vec::new(),
        };
        let pipeline = reader.pipeline(profile);
        match pipeline {
            Some(pipeline) if reader.problems.is_empty() => Ok(pipeline),
            _ => Err(FileError {
                problems: reader.problems,
            }),
        }
    }
}

pub(super) struct FileReader<'a> {
    pub(super) path: &'a Path,
    /// The file, merged with the files that it extends.
    pub(super) file: &'a InheritedFile,
    pub(super) kinds: &'a [Kind],
    /// Values that override those of the file.
    pub(super) overrides: &'a [Override],
    /// The options of the stage being read that take shared values.
    pub(super) taken: Vec<SharedUse>,
    /// Names of all shared values taken so far.
    pub(super) taken_names: BTreeSet<String>,
    /// The faults, in the order in which they were found.
    pub(super) problems: Vec<Problem>,
}

impl FileReader<'_> {
    pub(super) fn location(&self, span: Range<usize>) -> Location {
        self.file.texts.location(span)
    }

    pub(super) fn problem(
        &mut self,
        message: String,
        span: Option<Range<usize>>,
        hint: Option<String>,
    ) {
        let location = span.map(|span| self.location(span));
        self.problem_at(message, location, hint);
    }

    pub(super) fn problem_at(
        &mut self,
        message: String,
        location: Option<Location>,
        hint: Option<String>,
    ) {
        self.problems
            .push(Problem::new(message).at(location).hint(hint));
    }

    /// The location of a stage's key or value: in the file, or else in the override.
    pub(super) fn place(
        &self,
        stage: &str,
        path: &[String],
        part: Part,
        span: Option<Range<usize>>,
    ) -> Option<Location> {
        match span {
            Some(span) => Some(self.location(span)),
            None => self
                .in_set(Some(stage), path, part)
                .or_else(|| self.in_shared(path, part)),
        }
    }

    /// The location of these keys in the last override of them, of a table around them or of a key
    /// below them.
    pub(super) fn in_set(
        &self,
        stage: Option<&str>,
        path: &[String],
        part: Part,
    ) -> Option<Location> {
        let mut given = self.overrides.iter().rev();
        let given = given.find(|given| {
            let is_related =
                path.starts_with(&given.path.keys) || given.path.keys.starts_with(path);
            given.path.stage.as_deref() == stage && is_related && !path.is_empty()
        })?;
        let (argument, value) = given.argument();
        let part = match path.split_last() {
            Some((key, above)) if part == Part::Key && path.len() <= given.path.keys.len() => {
                let above = stage.into_iter().chain(above.iter().map(String::as_str));
                let start: usize = above.map(|key| key.len() + 1).sum();
                start..start + key.len()
            }
            _ => value..argument.len(),
        };
        Some(given.place(part))
    }

    /// Reads the whole file; `None` if it has any fault, even in a profile that is not selected.
    pub(super) fn pipeline(&mut self, profile: Option<&str>) -> Option<Pipeline> {
        let file = self.file;
        let root = &file.root;
        let pipeline = self.with_profile(root, profile);
        self.check_others(root, profile);
        pipeline.filter(|_| self.problems.is_empty())
    }

    /// Reads the file with one profile; `None` if it has any fault.
    pub(super) fn with_profile(
        &mut self,
        root: &InlineTable,
        profile: Option<&str>,
    ) -> Option<Pipeline> {
        self.check_keys(root);
        let overrides = self.overrides;
        let profile_name = profile;
        let profile = self.profile(root, profile);
        let seed = self.seed(root, profile);
        let shared = self.shared(root, profile);
        let Some(tables) = root.get("stages").and_then(Value::as_inline_table) else {
            self.problem("the file has no `[stages.…]` tables".to_owned(), None, None);
            return None;
        };
        self.check_overrides(tables);
        let mut stages = Vec::new();
        for (name, value) in tables {
            let span = tables.key(name).and_then(Key::span);
            let Some(mut table) = value.as_inline_table().cloned() else {
                self.problem(format!("stage `{name}` is not a table"), span, None);
                continue;
            };
            if let Some(changes) = profile.and_then(|profile| profile.get(name)) {
                match changes.as_inline_table() {
                    Some(changes) => merge_values(&mut table, changes),
                    None => self.problem(
                        format!("what a profile changes in stage `{name}` is not a table"),
                        changes.span(),
                        None,
                    ),
                }
            }
            for given in overrides
                .iter()
                .filter(|given| given.path.stage.as_deref() == Some(name))
            {
                set_value(&mut table, &given.path.keys, &given.value);
            }
            stages.extend(self.stage(name, span, table, &shared));
        }
        self.check_taken(&shared);
        self.check_wiring(&stages, tables);
        if !self.problems.is_empty() {
            return None;
        }
        let stem = self.path.file_stem();
        let name = stem.map_or_else(String::new, |stem| stem.to_string_lossy().into_owned());
        if let Err(err) = name.parse::<PipelineName>() {
            let hint = "the pipeline is named after its file: rename the file";
            self.problem(err.to_string(), None, Some(hint.to_owned()));
            return None;
        }
        let place = |stage: &StageEntry, input: &ArtifactName| {
            self.wire(tables, &stage.name, input.as_str())
        };
        match order(&stages, place) {
            Ok(nodes) => Some(Pipeline {
                name,
                seed: seed?,
                stages,
                nodes,
                origin: Origin {
                    file: self.path.to_owned(),
                    profile: profile_name.map(str::to_owned),
                    overrides: overrides.iter().map(ToString::to_string).collect(),
                },
            }),
            Err(circles) => {
                self.problems.extend(circles);
                None
            }
        }
    }

    /// Refuses unknown keys of the file.
    fn check_keys(&mut self, root: &InlineTable) {
        const KEYS: [&str; 7] = [
            "seed", "stages", "profiles", "sweep", SHARED, EXTENDS, WITHOUT,
        ];
        for (key, _) in root {
            if !KEYS.contains(&key) {
                let span = root.key(key).and_then(Key::span);
                let hint = did_you_mean(key, KEYS);
                self.problem(format!("unknown key `{key}`"), span, hint);
            }
        }
    }

    /// Refuses overrides of unknown stages.
    fn check_overrides(&mut self, tables: &InlineTable) {
        let names: Vec<&str> = tables.iter().map(|(name, _)| name).collect();
        for given in self.overrides {
            let stage = given.path.stage.as_deref();
            let Some(stage) = stage.filter(|stage| *stage != SHARED && !names.contains(stage))
            else {
                continue;
            };
            let near = did_you_mean(stage, names.iter().copied().chain([SHARED]));
            let hint = near.unwrap_or_else(|| format!("its stages are: {}", names.join(", ")));
            let location = given.place(0..stage.len());
            self.problem_at(
                format!("{} names an unknown stage `{stage}`", given.giver()),
                Some(location),
                Some(hint),
            );
        }
    }

    fn seed(&mut self, root: &InlineTable, profile: Option<&InlineTable>) -> Option<u64> {
        let overrides = self.overrides;
        let at_top = || {
            overrides
                .iter()
                .rev()
                .filter(|given| given.path.stage.is_none())
        };
        if let Some(given) = at_top().find(|given| given.path.keys != ["seed"]) {
            self.problem_at(
                format!(
                    "{} names an unknown key `{}`",
                    given.giver(),
                    given.path.keys.join(".")
                ),
                self.in_set(None, &given.path.keys, Part::Key),
                Some("write `stage.key=value`, or `seed=NUMBER`".to_owned()),
            );
            return None;
        }
        let item = profile
            .and_then(|profile| profile.get("seed"))
            .or_else(|| root.get("seed"));
        let value = at_top().next().map(|given| &given.value).or(item);
        let span = value.and_then(Value::span);
        let seed = value
            .and_then(Value::as_integer)
            .and_then(|seed| u64::try_from(seed).ok());
        if seed.is_none() {
            let given = self.in_set(None, &["seed".to_owned()], Part::Value);
            let hint = match given {
                Some(_) => "write `--set seed=7`",
                None => "write `seed = 7` at the top of the file",
            };
            let in_file = || span.map(|span| self.location(span));
            self.problem_at(
                "`seed` must be a whole number, 0 or more".to_owned(),
                given.or_else(in_file),
                Some(hint.to_owned()),
            );
        }
        seed
    }

    fn stage(
        &mut self,
        name: &str,
        span: Option<Range<usize>>,
        mut table: InlineTable,
        shared: &InlineTable,
    ) -> Option<StageEntry> {
        let stage_name: StageName = match name.parse() {
            Ok(name) => name,
            Err(err) => {
                self.problem(err.to_string(), span, None);
                return None;
            }
        };
        let n_problems = self.problems.len();
        self.take(name, &mut table, shared);
        let is_whole = self.problems.len() == n_problems;
        let kind = self.kind(name, span.as_ref(), &mut table);
        let inputs = self.inputs(name, &mut table, kind.as_ref());
        let max_skipped_fraction = self.max_skipped_fraction(name, &mut table);
        let resources = self.resources(name, &mut table);
        // The missing inputs have been reported.
        let mut kind = kind.filter(|_| is_whole)?;
        let before = table.clone();
        if let Err(fault) = kind.complete(&mut table) {
            self.option_fault(name, span.as_ref(), &kind, &before, &fault);
            return None;
        }
        match kind.configure(table.clone()) {
            Ok(configured) => {
                let mut faults = configured.check();
                if let Some(inputs) = &inputs {
                    let wires = inputs.iter();
                    let wires = wires.map(|(input, wire)| (input.to_string(), wire.clone()));
                    faults.extend(configured.check_wired(&wires.collect()));
                    if kind.wiring == Wiring::Free {
                        kind.inputs = inputs.keys().map(ToString::to_string).collect();
                    }
                }
                kind.outputs = configured.outputs();
                for fault in faults {
                    self.option_fault(name, span.as_ref(), &kind, &table, &fault);
                }
                let places = self.places(name, &before, configured.files());
                Some(StageEntry {
                    name: stage_name,
                    places,
                    kind,
                    inputs: inputs?,
                    max_skipped_fraction: max_skipped_fraction?,
                    resources: resources?,
                    text: table.to_string(),
                    configured,
                })
            }
            Err(fault) => {
                let faults = faults(name, &kind, &table);
                if faults.is_empty() {
                    // Not covered by the schema: the option's own message.
                    let message = format!("stage `{name}`: {}", fault.message);
                    let list = format!("`pipeline stages {}` lists every option", kind.name);
                    self.problem(message, fault.span.or_else(|| span.clone()), Some(list));
                }
                for fault in faults {
                    let place = self.place(name, &fault.path, fault.part, fault.span);
                    let header = || self.location(span.clone().unwrap_or(0..0));
                    let place = place.unwrap_or_else(header);
                    self.problem_at(fault.message, Some(place), Some(fault.hint));
                }
                None
            }
        }
    }

    /// Reports a fault of a stage's option.
    fn option_fault(
        &mut self,
        stage: &str,
        span: Option<&Range<usize>>,
        kind: &Kind,
        table: &InlineTable,
        fault: &OptionFault,
    ) {
        let path: Vec<String> = fault.key.split('.').map(str::to_owned).collect();
        let place = self.place(stage, &path, Part::Value, span_of(table, &fault.key));
        let header = || self.location(span.cloned().unwrap_or(0..0));
        let place = place.unwrap_or_else(header);
        let list = format!("`pipeline stages {}` lists every option", kind.name);
        let message = format!("stage `{stage}`: {fault}");
        self.problem_at(message, Some(place), Some(list));
    }

    /// Returns where these options of a stage stand: the values of tables and lists, each, and the whole.
    fn places(
        &self,
        stage: &str,
        table: &InlineTable,
        options: &[&str],
    ) -> BTreeMap<String, Location> {
        let mut places = BTreeMap::new();
        for &option in options {
            let Some(value) = table.get(option) else {
                continue;
            };
            let mut note = |key: &str, element: Option<usize>, value: &Value| {
                let path: Vec<String> = key.split('.').map(str::to_owned).collect();
                let place = self.place(stage, &path, Part::Value, value.span());
                places.extend(place.map(|place| (place_of(key, element), place)));
            };
            note(option, None, value);
            match value {
                Value::InlineTable(below) => {
                    for (key, value) in below {
                        note(&format!("{option}.{key}"), None, value);
                    }
                }
                Value::Array(elements) => {
                    for (idx, value) in elements.iter().enumerate() {
                        note(option, Some(idx), value);
                    }
                }
                _ => {}
            }
        }
        places
    }

    fn kind(
        &mut self,
        name: &str,
        span: Option<&Range<usize>>,
        table: &mut InlineTable,
    ) -> Option<Kind> {
        let Some(value) = table.remove("kind") else {
            let known: Vec<&str> = self.kinds.iter().map(|kind| kind.name).collect();
            self.problem(
                format!("stage `{name}` has no `kind`"),
                span.cloned(),
                Some(format!("the kinds are: {}", known.join(", "))),
            );
            return None;
        };
        let word = value.as_str().unwrap_or_default().to_owned();
        let found = self.kinds.iter().find(|kind| kind.name == word).cloned();
        if found.is_none() {
            let near = did_you_mean(&word, self.kinds.iter().map(|kind| kind.name));
            let near = near.map_or_else(String::new, |near| format!("{near} "));
            let hint = format!("{near}`pipeline stages` lists every kind");
            let place = self.place(name, &["kind".to_owned()], Part::Value, value.span());
            self.problem_at(
                format!("stage `{name}` has an unknown kind `{word}`"),
                place,
                Some(hint),
            );
        }
        found
    }

    /// Reads the wires of the inputs; `None` if they have a fault.
    fn inputs(
        &mut self,
        name: &str,
        table: &mut InlineTable,
        kind: Option<&Kind>,
    ) -> Option<BTreeMap<ArtifactName, NodeName>> {
        let mut inputs = BTreeMap::new();
        let Some(value) = table.remove("inputs") else {
            return Some(inputs);
        };
        let n_problems = self.problems.len();
        let Some(wires) = value.as_inline_table() else {
            let place = self.place(name, &["inputs".to_owned()], Part::Value, value.span());
            self.problem_at(
                format!("`inputs` of stage `{name}` is not a table"),
                place,
                Some("write, e.g., `inputs.demonstrations = \"ingest.demonstrations\"`".to_owned()),
            );
            return None;
        };
        for (input, value) in wires {
            let path = ["inputs".to_owned(), input.to_owned()];
            let known = kind.map(Kind::all_inputs);
            if let Some((kind, known)) = kind.zip(known)
                && kind.wiring == Wiring::Declared
                && !known.contains(&input)
            {
                let all = || format!("`{}` reads: {}", kind.name, known.join(", "));
                let near = did_you_mean(input, known.iter().copied());
                let hint = near.unwrap_or_else(all);
                let place = self.place(name, &path, Part::Key, value.span());
                self.problem_at(
                    format!("stage `{name}` has no input `{input}`"),
                    place,
                    Some(hint),
                );
                continue;
            }
            let key = input;
            match (input.parse(), value.as_str().and_then(NodeName::parse)) {
                (Ok(input), Some(node)) => {
                    let is_optional = kind.is_some_and(|kind| kind.optional_inputs.contains(&key));
                    if !(is_optional && self.file.left_out.contains(node.stage.as_str())) {
                        inputs.insert(input, node);
                    }
                }
                _ => self.problem_at(
                    format!("input `{input}` of stage `{name}` must name `stage.artifact`"),
                    self.place(name, &path, Part::Value, value.span()),
                    Some(format!("for example `inputs.{input} = \"ingest.{input}\"`")),
                ),
            }
        }
        (self.problems.len() == n_problems).then_some(inputs)
    }

    fn resources(&mut self, stage: &str, table: &mut InlineTable) -> Option<Resources> {
        const KEY: &str = "resources";
        let Some(value) = table.remove(KEY) else {
            return Some(Resources::default());
        };
        let span = value.span();
        match Resources::deserialize(value.into_deserializer()) {
            Ok(resources) => Some(resources),
            Err(err) => {
                let message = err.message().trim();
                self.problem_at(
                    format!("`{KEY}` of stage `{stage}`: {message}"),
                    self.place(stage, &[KEY.to_owned()], Part::Value, err.span().or(span)),
                    Some(RESOURCES_HINT.to_owned()),
                );
                None
            }
        }
    }

    fn max_skipped_fraction(&mut self, stage: &str, table: &mut InlineTable) -> Option<f64> {
        const KEY: &str = "max_skipped_fraction";
        let Some(value) = table.remove(KEY) else {
            return Some(DEFAULT_MAX_SKIPPED_FRACTION);
        };
        let number = value
            .as_float()
            .or_else(|| value.as_integer().map(|whole| whole as f64));
        let fraction = number.filter(|number| (0.0..=1.0).contains(number));
        if fraction.is_none() {
            let found = found(&value);
            self.problem_at(
                format!("`{KEY}` in stage `{stage}` must be a number from 0 to 1, found {found}"),
                self.place(stage, &[KEY.to_owned()], Part::Value, value.span()),
                None,
            );
        }
        fraction
    }
}

/// The span of a dotted key's value, or of the nearest table around it.
fn span_of(table: &InlineTable, key: &str) -> Option<Range<usize>> {
    let (mut table, mut found) = (table, None);
    for word in key.split('.') {
        let Some(value) = table.get(word) else {
            break;
        };
        found = value.span().or(found);
        let Some(inner) = value.as_inline_table() else {
            break;
        };
        table = inner;
    }
    found
}
