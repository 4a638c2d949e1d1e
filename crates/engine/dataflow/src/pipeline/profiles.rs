//! The profiles of a pipeline file: the selected one, and the others, which are checked as well.

use std::{collections::BTreeSet, ops::Range};

use toml_edit::{InlineTable, Key, Value};

use super::reader::FileReader;
use crate::{shared::SHARED, source::Source, suggestions::did_you_mean};

impl FileReader<'_> {
    /// Returns the profile of this name.
    pub(super) fn profile<'t>(
        &mut self,
        root: &'t InlineTable,
        name: Option<&str>,
    ) -> Option<&'t InlineTable> {
        let name = name?;
        let profiles = root.get("profiles").and_then(Value::as_inline_table);
        let found = profiles
            .and_then(|profiles| profiles.get(name))
            .and_then(Value::as_inline_table);
        if found.is_none() {
            let known: Vec<&str> = profiles
                .into_iter()
                .flat_map(InlineTable::iter)
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
        let stages = root.get("stages").and_then(Value::as_inline_table);
        for (key, _) in found.into_iter().flat_map(InlineTable::iter) {
            if key != "seed"
                && key != SHARED
                && !stages.is_some_and(|stages| stages.contains_key(key))
            {
                let span = found.and_then(|table| table.key(key)).and_then(Key::span);
                let names = stages.into_iter().flat_map(InlineTable::iter);
                let names = names.map(|(name, _)| name);
                self.problem(
                    format!("profile `{name}` changes an unknown stage `{key}`"),
                    span,
                    did_you_mean(key, names.chain([SHARED])),
                );
            }
        }
        found
    }

    /// Checks the profiles that are not selected.
    pub(super) fn check_others(&mut self, root: &InlineTable, chosen: Option<&str>) {
        let Some(profiles) = root.get("profiles") else {
            return;
        };
        let Some(profiles) = profiles.as_inline_table() else {
            let message = "`profiles` is not a table of profiles".to_owned();
            self.problem(message, profiles.span(), None);
            return;
        };
        for (name, value) in profiles {
            let Some(profile) = value.as_inline_table() else {
                self.problem(
                    format!("profile `{name}` is not a table"),
                    value.span(),
                    None,
                );
                continue;
            };
            if chosen == Some(name) {
                continue;
            }
            // Faults outside the profile are already reported, and command-line values are not
            // meant for it.
            let mut reader = FileReader {
                overrides: &[],
                taken: Vec::new(),
                taken_names: BTreeSet::new(),
                problems: Vec::new(),
                ..*self
            };
            reader.with_profile(root, Some(name));
            let own = self.lines(profile);
            for problem in reader.problems {
                let location = problem.location.as_ref();
                let is_own = location.is_some_and(|location| own.contains(&location.source));
                if is_own && !self.problems.contains(&problem) {
                    self.problems.push(problem);
                }
            }
        }
    }

    /// The lines of a table's keys and values.
    fn lines(&self, table: &InlineTable) -> Vec<Source> {
        let mut spans = Vec::new();
        collect_spans(table, &mut spans);
        let mut lines = Vec::new();
        for span in spans {
            let [first, last] = [span.start, span.end].map(|at| self.location(at..at).source);
            match (first, last) {
                (Source::File { path, line: first }, Source::File { line: last, .. }) => {
                    let path = || path.clone();
                    let all = (first..=last).map(|line| Source::File { path: path(), line });
                    lines.extend(all);
                }
                (first, _) => lines.push(first),
            }
        }
        lines
    }
}

/// Collects the spans of the keys and values of a table and its subtables.
fn collect_spans(table: &InlineTable, spans: &mut Vec<Range<usize>>) {
    for (name, value) in table {
        spans.extend(table.key(name).and_then(Key::span));
        spans.extend(value.span());
        if let Some(inner) = value.as_inline_table() {
            collect_spans(inner, spans);
        }
    }
}
