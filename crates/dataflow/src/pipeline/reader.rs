//! Reading a pipeline file and collecting everything that is wrong with it.

use std::{
    collections::{BTreeMap, BTreeSet},
    ops::Range,
    path::Path,
};

use toml_edit::{InlineTable, Item, Key, Table, TableLike, Value};

use super::{
    DEFAULT_MAX_SKIPPED_FRACTION, Pipeline, StageEntry,
    faults::{Part, faults, found},
    tables::{copy_table, merge_table, set_value},
};
use crate::{
    error::Problem,
    graph::{self, NodeName},
    kind::Kind,
    near::nearest,
    overrides::Override,
    source::Location,
    store::Origin,
};

pub(super) struct FileReader<'a> {
    pub(super) path: &'a Path,
    pub(super) source: &'a str,
    pub(super) kinds: &'a [Kind],
    /// Values that replace those of the file.
    pub(super) overrides: &'a [Override],
    /// What is wrong, in the order in which it was found.
    pub(super) problems: Vec<Problem>,
}

impl FileReader<'_> {
    fn problem(&mut self, message: String, span: Option<Range<usize>>, hint: Option<String>) {
        let location = span.map(|span| Location::of(self.path, self.source, span));
        self.problem_at(message, location, hint);
    }

    fn problem_at(&mut self, message: String, location: Option<Location>, hint: Option<String>) {
        self.problems
            .push(Problem::new(message).at(location).hint(hint));
    }

    /// Where something of a stage stands: in the file, or else in the value given beside it.
    fn place(
        &self,
        stage: &str,
        path: &[String],
        part: Part,
        span: Option<Range<usize>>,
    ) -> Option<Location> {
        match span {
            Some(span) => Some(Location::of(self.path, self.source, span)),
            None => self.in_set(Some(stage), path, part),
        }
    }

    /// Where the last value given for these keys, or for what is around or below them, says it.
    fn in_set(&self, stage: Option<&str>, path: &[String], part: Part) -> Option<Location> {
        let mut given = self.overrides.iter().rev();
        let given = given.find(|given| {
            let is_related = path.starts_with(&given.keys) || given.keys.starts_with(path);
            given.stage.as_deref() == stage && is_related && !path.is_empty()
        })?;
        let (argument, value) = given.argument();
        let part = match path.split_last() {
            Some((key, above)) if part == Part::Key && path.len() <= given.keys.len() => {
                let above = stage.into_iter().chain(above.iter().map(String::as_str));
                let start: usize = above.map(|key| key.len() + 1).sum();
                start..start + key.len()
            }
            _ => value..argument.len(),
        };
        Some(Location::in_set(&argument, part))
    }

    /// Reads the whole file; `None` if anything is wrong with it, in profiles that nobody asks for too.
    pub(super) fn pipeline(&mut self, root: &Table, profile: Option<&str>) -> Option<Pipeline> {
        let pipeline = self.with_profile(root, profile);
        self.check_others(root, profile);
        pipeline.filter(|_| self.problems.is_empty())
    }

    /// Checks the profiles that are not chosen.
    fn check_others(&mut self, root: &Table, chosen: Option<&str>) {
        let Some(profiles) = root.get("profiles") else {
            return;
        };
        let Some(profiles) = profiles.as_table() else {
            let message = "`profiles` is no table of profiles".to_owned();
            self.problem(message, profiles.span(), None);
            return;
        };
        for (name, item) in profiles {
            let Some(profile) = item.as_table() else {
                self.problem(
                    format!("profile `{name}` is not a table"),
                    item.span(),
                    None,
                );
                continue;
            };
            if chosen == Some(name) {
                continue;
            }
            // What is wrong without the profile has been said, and values given on the command line
            // are not meant for it.
            let mut reader = FileReader {
                overrides: &[],
                problems: Vec::new(),
                ..*self
            };
            reader.with_profile(root, Some(name));
            let own = self.lines(profile);
            for problem in reader.problems {
                let line = problem.location.as_ref().and_then(Location::line);
                if line.is_some_and(|line| own.contains(&line)) && !self.problems.contains(&problem)
                {
                    self.problems.push(problem);
                }
            }
        }
    }

    /// The lines, from 1, on which the keys and values of a table stand.
    fn lines(&self, table: &Table) -> BTreeSet<usize> {
        let mut spans = Vec::new();
        collect_spans(table, &mut spans);
        let line = |at: usize| self.source[..at].matches('\n').count() + 1;
        spans
            .into_iter()
            .flat_map(|span| line(span.start)..=line(span.end))
            .collect()
    }

    /// Reads the file with one profile; `None` if anything is wrong with it.
    fn with_profile(&mut self, root: &Table, profile: Option<&str>) -> Option<Pipeline> {
        const KEYS: [&str; 4] = ["seed", "stages", "profiles", "sweep"];
        let overrides = self.overrides;
        for (key, _) in root {
            if !KEYS.contains(&key) {
                let span = root.key(key).and_then(Key::span);
                let hint = nearest(key, KEYS).map(|near| format!("did you mean `{near}`?"));
                self.problem(format!("unknown key `{key}`"), span, hint);
            }
        }
        let profile_name = profile;
        let profile = self.profile(root, profile);
        let seed = self.seed(root, profile);
        let Some(tables) = root.get("stages").and_then(Item::as_table) else {
            self.problem("the file has no `[stages.…]` tables".to_owned(), None, None);
            return None;
        };
        let names: Vec<&str> = tables.iter().map(|(name, _)| name).collect();
        for given in overrides {
            if let Some(stage) = given.stage.as_deref()
                && !names.contains(&stage)
            {
                let hint = nearest(stage, names.iter().copied()).map_or_else(
                    || format!("its stages are: {}", names.join(", ")),
                    |near| format!("did you mean `{near}`?"),
                );
                let (argument, _) = given.argument();
                let location = Location::in_set(&argument, 0..stage.len());
                self.problem_at(
                    format!("`--set` names an unknown stage `{stage}`"),
                    Some(location),
                    Some(hint),
                );
            }
        }
        let mut stages = Vec::new();
        for (name, item) in tables {
            let span = tables.key(name).and_then(Key::span);
            let table = item.as_table_like().map(|table| {
                let mut inline = InlineTable::new();
                copy_table(table, &mut inline);
                inline
            });
            let Some(mut table) = table else {
                self.problem(format!("stage `{name}` is not a table"), span, None);
                continue;
            };
            if let Some(changes) = profile.and_then(|profile| profile.get(name)) {
                match changes.as_table_like() {
                    Some(changes) => merge_table(&mut table, changes),
                    None => self.problem(
                        format!("what a profile changes in stage `{name}` is not a table"),
                        changes.span(),
                        None,
                    ),
                }
            }
            for given in overrides
                .iter()
                .filter(|given| given.stage.as_deref() == Some(name))
            {
                set_value(&mut table, &given.keys, &given.value);
            }
            stages.extend(self.stage(name, span, table));
        }
        self.check_wiring(&stages, tables);
        if !self.problems.is_empty() {
            return None;
        }
        match graph::order(&stages) {
            Ok(nodes) => Some(Pipeline {
                name: self
                    .path
                    .file_stem()
                    .map_or_else(String::new, |stem| stem.to_string_lossy().into_owned()),
                seed: seed?,
                stages,
                nodes,
                origin: Origin {
                    file: self.path.to_owned(),
                    profile: profile_name.map(str::to_owned),
                    overrides: overrides.iter().map(ToString::to_string).collect(),
                },
            }),
            Err(problem) => {
                self.problems.push(problem);
                None
            }
        }
    }

    fn profile<'t>(&mut self, root: &'t Table, name: Option<&str>) -> Option<&'t Table> {
        let name = name?;
        let profiles = root.get("profiles").and_then(Item::as_table);
        let found = profiles
            .and_then(|profiles| profiles.get(name))
            .and_then(Item::as_table);
        if found.is_none() {
            let known: Vec<&str> = profiles
                .into_iter()
                .flat_map(Table::iter)
                .map(|(name, _)| name)
                .collect();
            let hint = if known.is_empty() {
                "the file has no `[profiles.…]` tables".to_owned()
            } else {
                format!("its profiles are: {}", known.join(", "))
            };
            self.problem(
                format!("no profile `{name}` in the pipeline file"),
                None,
                Some(hint),
            );
        }
        let stages = root.get("stages").and_then(Item::as_table);
        for (key, _) in found.into_iter().flat_map(Table::iter) {
            if key != "seed" && !stages.is_some_and(|stages| stages.contains_key(key)) {
                let span = found.and_then(|table| table.key(key)).and_then(Key::span);
                self.problem(
                    format!("profile `{name}` changes an unknown stage `{key}`"),
                    span,
                    nearest(
                        key,
                        stages
                            .into_iter()
                            .flat_map(Table::iter)
                            .map(|(name, _)| name),
                    )
                    .map(|near| format!("did you mean `{near}`?")),
                );
            }
        }
        found
    }

    fn seed(&mut self, root: &Table, profile: Option<&Table>) -> Option<u64> {
        let overrides = self.overrides;
        let at_top = || overrides.iter().rev().filter(|given| given.stage.is_none());
        if let Some(given) = at_top().find(|given| given.keys != ["seed"]) {
            self.problem_at(
                format!("`--set` names an unknown key `{}`", given.keys.join(".")),
                self.in_set(None, &given.keys, Part::Key),
                Some("write `stage.key=value`, or `seed=NUMBER`".to_owned()),
            );
            return None;
        }
        let item = profile
            .and_then(|profile| profile.get("seed"))
            .or_else(|| root.get("seed"));
        let value = at_top()
            .next()
            .map(|given| &given.value)
            .or_else(|| item.and_then(Item::as_value));
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
            let in_file = || span.map(|span| Location::of(self.path, self.source, span));
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
    ) -> Option<StageEntry> {
        let is_name = |text: &str| {
            !text.is_empty()
                && text
                    .bytes()
                    .all(|b| b.is_ascii_alphanumeric() || b == b'_' || b == b'-')
        };
        if !is_name(name) {
            self.problem(
                format!("`{name}` is no name for a stage: use letters, digits, `_` and `-`"),
                span,
                None,
            );
            return None;
        }
        let kind = self.kind(name, span.as_ref(), &mut table);
        let inputs = self.inputs(name, &mut table, kind);
        let max_skipped_fraction = self.max_skipped_fraction(name, &mut table);
        let kind = kind?;
        match kind.configure(table.clone()) {
            Ok(configured) => {
                for fault in configured.check() {
                    let path: Vec<String> = fault.key.split('.').map(str::to_owned).collect();
                    let place = self.place(name, &path, Part::Value, span_of(&table, &fault.key));
                    let header =
                        || Location::of(self.path, self.source, span.clone().unwrap_or(0..0));
                    let place = place.unwrap_or_else(header);
                    let list = format!("`pipeline stages {}` lists every option", kind.name);
                    let message = format!("stage `{name}`: {fault}");
                    self.problem_at(message, Some(place), Some(list));
                }
                Some(StageEntry {
                    name: name.to_owned(),
                    kind,
                    inputs: inputs?,
                    max_skipped_fraction: max_skipped_fraction?,
                    configured,
                })
            }
            Err(fault) => {
                let faults = faults(name, &kind, &table);
                if faults.is_empty() {
                    // What the schema does not say: the option's own words.
                    let message = format!("stage `{name}`: {}", fault.message);
                    let list = format!("`pipeline stages {}` lists every option", kind.name);
                    self.problem(message, fault.span.or_else(|| span.clone()), Some(list));
                }
                for fault in faults {
                    let place = self.place(name, &fault.path, fault.part, fault.span);
                    let header =
                        || Location::of(self.path, self.source, span.clone().unwrap_or(0..0));
                    let place = place.unwrap_or_else(header);
                    self.problem_at(fault.message, Some(place), Some(fault.hint));
                }
                None
            }
        }
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
        let found = self.kinds.iter().find(|kind| kind.name == word).copied();
        if found.is_none() {
            let near = nearest(&word, self.kinds.iter().map(|kind| kind.name));
            let hint = near.map_or_else(
                || "`pipeline stages` lists every kind".to_owned(),
                |near| format!("did you mean `{near}`? `pipeline stages` lists every kind"),
            );
            let place = self.place(name, &["kind".to_owned()], Part::Value, value.span());
            self.problem_at(
                format!("stage `{name}` has an unknown kind `{word}`"),
                place,
                Some(hint),
            );
        }
        found
    }

    /// Reads where the inputs come from; `None` if anything is wrong with that.
    fn inputs(
        &mut self,
        name: &str,
        table: &mut InlineTable,
        kind: Option<Kind>,
    ) -> Option<BTreeMap<String, NodeName>> {
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
            if let Some(kind) = kind
                && !kind.inputs.iter().any(|known| known.name == input)
            {
                let known: Vec<&str> = kind.inputs.iter().map(|input| input.name).collect();
                let hint = nearest(input, known.iter().copied()).map_or_else(
                    || format!("`{}` reads: {}", kind.name, known.join(", ")),
                    |near| format!("did you mean `{near}`?"),
                );
                let place = self.place(name, &path, Part::Key, value.span());
                self.problem_at(
                    format!("stage `{name}` has no input `{input}`"),
                    place,
                    Some(hint),
                );
                continue;
            }
            match value.as_str().and_then(NodeName::parse) {
                Some(node) => {
                    inputs.insert(input.to_owned(), node);
                }
                None => self.problem_at(
                    format!("input `{input}` of stage `{name}` must name `stage.artifact`"),
                    self.place(name, &path, Part::Value, value.span()),
                    Some(format!("for example `inputs.{input} = \"ingest.{input}\"`")),
                ),
            }
        }
        (self.problems.len() == n_problems).then_some(inputs)
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

    /// Checks that every input is wired to an output that exists and holds the right artifact.
    fn check_wiring(&mut self, stages: &[StageEntry], tables: &Table) {
        for stage in stages {
            let span = tables.key(&stage.name).and_then(Key::span);
            for input in stage.kind.inputs {
                let Some(node) = stage.inputs.get(input.name) else {
                    let offer = stages.iter().find(|other| {
                        other
                            .kind
                            .outputs()
                            .any(|output| output.artifact == input.artifact)
                    });
                    let hint = offer.map(|other| {
                        format!(
                            "write `inputs.{} = \"{}.{}\"`",
                            input.name, other.name, input.artifact
                        )
                    });
                    self.problem(
                        format!(
                            "stage `{}` has nothing wired to its input `{}`",
                            stage.name, input.name
                        ),
                        span.clone(),
                        hint,
                    );
                    continue;
                };
                let in_file = tables
                    .get(&stage.name)
                    .and_then(|table| table.get("inputs"))
                    .and_then(|inputs| inputs.get(input.name))
                    .and_then(Item::span)
                    .or_else(|| span.clone());
                let path = ["inputs".to_owned(), input.name.to_owned()];
                let given = self.in_set(Some(&stage.name), &path, Part::Value);
                let written = given
                    .or_else(|| in_file.map(|span| Location::of(self.path, self.source, span)));
                if !tables.contains_key(&node.stage) {
                    let hint = nearest(&node.stage, tables.iter().map(|(name, _)| name))
                        .map(|near| format!("did you mean `{near}.{}`?", node.artifact));
                    self.problem_at(
                        format!(
                            "stage `{}` reads from an unknown stage `{}`",
                            stage.name, node.stage
                        ),
                        written,
                        hint,
                    );
                    continue;
                }
                // A stage whose own table is at fault has been reported already.
                let Some(maker) = stages.iter().find(|other| other.name == node.stage) else {
                    continue;
                };
                let outputs: Vec<&str> =
                    maker.kind.outputs().map(|output| output.artifact).collect();
                if !outputs.contains(&node.artifact.as_str()) {
                    self.problem_at(
                        format!("stage `{}` makes no `{}`", node.stage, node.artifact),
                        written,
                        Some(format!("it makes: {}", outputs.join(", "))),
                    );
                } else if node.artifact != input.artifact {
                    self.problem_at(
                        format!(
                            "input `{}` of stage `{}` wants `{}`, and is wired to `{}`",
                            input.name, stage.name, input.artifact, node.artifact
                        ),
                        written,
                        None,
                    );
                }
            }
        }
    }
}

/// Collects where the keys and values of a table stand, and of the tables in it.
fn collect_spans(table: &dyn TableLike, spans: &mut Vec<Range<usize>>) {
    for (name, item) in table.iter() {
        spans.extend(table.key(name).and_then(Key::span));
        match item {
            Item::Value(value) => spans.extend(value.span()),
            Item::Table(table) => collect_spans(table, spans),
            Item::ArrayOfTables(tables) => {
                for table in tables {
                    collect_spans(table, spans);
                }
            }
            Item::None => {}
        }
    }
}

/// Where the value of a dotted key stands, or that of the nearest table around it.
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
