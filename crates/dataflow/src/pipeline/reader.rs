//! Reading a pipeline file and collecting everything that is wrong with it.

use std::{collections::BTreeMap, ops::Range, path::Path};

use toml_edit::{InlineTable, Item, Key, Table, Value};

use super::{
    DEFAULT_MAX_SKIPPED_FRACTION, Pipeline, StageEntry,
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
    /// What is wrong, in the order in which it was found.
    pub(super) problems: Vec<Problem>,
}

impl FileReader<'_> {
    fn problem(&mut self, message: String, span: Option<Range<usize>>, hint: Option<String>) {
        let location = span.map(|span| Location::of(self.path, self.source, span));
        self.problems
            .push(Problem::new(message).at(location).hint(hint));
    }

    /// Reads the whole file; `None` if anything is wrong with it.
    pub(super) fn pipeline(
        &mut self,
        root: &Table,
        profile: Option<&str>,
        overrides: &[Override],
    ) -> Option<Pipeline> {
        const KEYS: [&str; 4] = ["seed", "stages", "profiles", "sweep"];
        for (key, _) in root {
            if !KEYS.contains(&key) {
                let span = root.key(key).and_then(Key::span);
                let hint = nearest(key, KEYS).map(|near| format!("did you mean `{near}`?"));
                self.problem(format!("unknown key `{key}`"), span, hint);
            }
        }
        let profile_name = profile;
        let profile = self.profile(root, profile);
        let seed = self.seed(root, profile, overrides);
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
                self.problem(
                    format!("`--set` names an unknown stage `{stage}`"),
                    None,
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
            if let Some(changes) = profile
                .and_then(|profile| profile.get(name))
                .and_then(Item::as_table_like)
            {
                merge_table(&mut table, changes);
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
                    None,
                );
            }
        }
        found
    }

    fn seed(
        &mut self,
        root: &Table,
        profile: Option<&Table>,
        overrides: &[Override],
    ) -> Option<u64> {
        let at_top = || overrides.iter().rev().filter(|given| given.stage.is_none());
        if let Some(given) = at_top().find(|given| given.keys != ["seed"]) {
            self.problem(
                format!("`--set` names an unknown key `{}`", given.keys.join(".")),
                None,
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
            self.problem(
                "`seed` must be a whole number, 0 or more".to_owned(),
                span,
                Some("write `seed = 7` at the top of the file".to_owned()),
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
        let max_skipped_fraction = self.max_skipped_fraction(&mut table);
        let kind = kind?;
        match kind.configure(table) {
            Ok(configured) => Some(StageEntry {
                name: name.to_owned(),
                kind,
                inputs,
                max_skipped_fraction: max_skipped_fraction?,
                configured,
            }),
            Err(fault) => {
                let (message, hint) = explain(name, &kind, &fault.message);
                self.problem(message, fault.span.or(span), hint);
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
            self.problem(
                format!("stage `{name}` has an unknown kind `{word}`"),
                value.span(),
                Some(hint),
            );
        }
        found
    }

    fn inputs(
        &mut self,
        name: &str,
        table: &mut InlineTable,
        kind: Option<Kind>,
    ) -> BTreeMap<String, NodeName> {
        let mut inputs = BTreeMap::new();
        let Some(value) = table.remove("inputs") else {
            return inputs;
        };
        let Some(wires) = value.as_inline_table() else {
            self.problem(
                format!("`inputs` of stage `{name}` is not a table"),
                value.span(),
                None,
            );
            return inputs;
        };
        for (input, value) in wires {
            if let Some(kind) = kind
                && !kind.inputs.iter().any(|known| known.name == input)
            {
                let known: Vec<&str> = kind.inputs.iter().map(|input| input.name).collect();
                let hint = nearest(input, known.iter().copied()).map_or_else(
                    || format!("`{}` reads: {}", kind.name, known.join(", ")),
                    |near| format!("did you mean `{near}`?"),
                );
                self.problem(
                    format!("stage `{name}` has no input `{input}`"),
                    value.span(),
                    Some(hint),
                );
                continue;
            }
            match value.as_str().and_then(NodeName::parse) {
                Some(node) => {
                    inputs.insert(input.to_owned(), node);
                }
                None => self.problem(
                    format!("input `{input}` of stage `{name}` must name `stage.artifact`"),
                    value.span(),
                    Some(format!("for example `inputs.{input} = \"ingest.{input}\"`")),
                ),
            }
        }
        inputs
    }

    fn max_skipped_fraction(&mut self, table: &mut InlineTable) -> Option<f64> {
        let Some(value) = table.remove("max_skipped_fraction") else {
            return Some(DEFAULT_MAX_SKIPPED_FRACTION);
        };
        let number = value
            .as_float()
            .or_else(|| value.as_integer().map(|whole| whole as f64));
        let fraction = number.filter(|number| (0.0..=1.0).contains(number));
        if fraction.is_none() {
            self.problem(
                "`max_skipped_fraction` must be a number from 0 to 1".to_owned(),
                value.span(),
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
                            .outputs
                            .iter()
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
                let written = tables
                    .get(&stage.name)
                    .and_then(|table| table.get("inputs"))
                    .and_then(|inputs| inputs.get(input.name))
                    .and_then(Item::span)
                    .or_else(|| span.clone());
                if !tables.contains_key(&node.stage) {
                    let hint = nearest(&node.stage, tables.iter().map(|(name, _)| name))
                        .map(|near| format!("did you mean `{near}.{}`?", node.artifact));
                    self.problem(
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
                let outputs: Vec<&str> = maker
                    .kind
                    .outputs
                    .iter()
                    .map(|output| output.artifact)
                    .collect();
                if !outputs.contains(&node.artifact.as_str()) {
                    self.problem(
                        format!("stage `{}` makes no `{}`", node.stage, node.artifact),
                        written,
                        Some(format!("it makes: {}", outputs.join(", "))),
                    );
                } else if node.artifact != input.artifact {
                    self.problem(
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

/// Turns serde's words about a stage's table into the project's, with a hint.
fn explain(stage: &str, kind: &Kind, message: &str) -> (String, Option<String>) {
    let quoted = |prefix: &str| {
        let rest = message.strip_prefix(prefix)?;
        rest.split('`').next()
    };
    let list = format!("`pipeline stages {}` lists every option", kind.name);
    if let Some(key) = quoted("unknown field `") {
        let options = kind.options();
        let names = options
            .iter()
            .map(|option| option.key.rsplit('.').next().unwrap_or(&option.key));
        let common = ["inputs", "kind", "max_skipped_fraction"];
        let hint = nearest(key, names.chain(common)).map_or_else(
            || list.clone(),
            |near| format!("did you mean `{near}`? {list}"),
        );
        return (
            format!("unknown key `{key}` in stage `{stage}`"),
            Some(hint),
        );
    }
    if let Some(key) = quoted("missing field `") {
        return (format!("stage `{stage}` lacks the key `{key}`"), Some(list));
    }
    (format!("stage `{stage}`: {message}"), Some(list))
}
