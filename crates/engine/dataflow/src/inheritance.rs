//! A pipeline file merged with the files that it extends.

use std::{
    collections::BTreeSet,
    fs,
    path::{Path, PathBuf},
};

use toml_edit::{Document, InlineTable, Key, Value};

use crate::{
    error::Problem,
    shared,
    source_map::Texts,
    suggestions::{did_you_mean, missing},
    tables::{copy_table, found, merge_values},
};

/// The key that names the extended file.
pub(crate) const EXTENDS: &str = "extends";
/// The key that lists the stages of the extended file to remove.
pub(crate) const WITHOUT: &str = "without";

/// A pipeline file whose missing values come from the files that it extends.
#[derive(Debug, Default)]
pub(crate) struct InheritedFile {
    /// All values, each with its span among [`Self::texts`].
    pub(crate) root: InlineTable,
    /// The texts that the spans point into.
    pub(crate) texts: Texts,
    /// Shared values of removed stages: they need no other user.
    pub(crate) taken: BTreeSet<String>,
    /// Names of removed stages that no file adds again.
    pub(crate) left_out: BTreeSet<String>,
    /// Faults in the extended files; if there are any, the values must not be used.
    pub(crate) problems: Vec<Problem>,
}

impl InheritedFile {
    /// Reads a file's text and the files that it extends.
    pub(crate) fn read(path: &Path, text: &str) -> Self {
        let mut extended = Self::default();
        if let Some(root) = extended.load(path, text, &[]) {
            let stages = root.get("stages").and_then(Value::as_inline_table);
            extended
                .left_out
                .retain(|name| !stages.is_some_and(|stages| stages.contains_key(name)));
            extended.root = root;
        }
        extended
    }

    /// Reads a text; `above` are the files that extend it.
    fn load(&mut self, path: &Path, text: &str, above: &[PathBuf]) -> Option<InlineTable> {
        let padded = self.texts.add(path, text);
        let document = match Document::parse(padded) {
            Ok(document) => document,
            Err(err) => {
                let location = err.span().map(|span| self.texts.location(span));
                let problem = Problem::new(err.message().to_owned()).at(location);
                self.problems.push(problem);
                return None;
            }
        };
        let mut root = InlineTable::new();
        copy_table(document.as_table(), &mut root);
        let without = root.remove_entry(WITHOUT);
        let Some(extends) = root.remove(EXTENDS) else {
            if let Some((key, _)) = without {
                let message = format!(
                    "`{WITHOUT}` leaves stages of an extended file out, and none is extended"
                );
                self.problem(
                    message,
                    &key,
                    "write, e.g., `extends = \"cgf.toml\"` above it",
                );
            }
            return Some(root);
        };
        let (target, text) = self.target(path, &extends, above)?;
        let above = [above, &[path.to_owned()]].concat();
        let mut base = self.load(&target, &text, &above)?;
        if let Some((_, without)) = without {
            self.leave_out(&mut base, &without);
        }
        merge_values(&mut base, &root);
        Some(base)
    }

    /// Returns the extended file and its text.
    fn target(
        &mut self,
        path: &Path,
        extends: &Value,
        above: &[PathBuf],
    ) -> Option<(PathBuf, String)> {
        let location = extends.span().map(|span| self.texts.location(span));
        let mut refuse = |message: String, hint: String| {
            let problem = Problem::new(message).at(location.clone()).hint(hint);
            self.problems.push(problem);
            None
        };
        let Some(name) = extends.as_str() else {
            let message = format!(
                "`{EXTENDS}` must be the name of a pipeline file, found {}",
                found(extends)
            );
            return refuse(message, "write, e.g., `extends = \"cgf.toml\"`".to_owned());
        };
        let folder = path.parent().unwrap_or(Path::new(""));
        let target = folder.join(name);
        let is_same = |other: &Path| match (fs::canonicalize(other), fs::canonicalize(&target)) {
            (Ok(other), Ok(target)) => other == target,
            _ => other == target,
        };
        if is_same(path) || above.iter().any(|above| is_same(above)) {
            let message = format!("`{name}` extends itself, or a file that extends it");
            return refuse(message, "remove one `extends` of the circle".to_owned());
        }
        match fs::read_to_string(&target) {
            Ok(text) => Some((target, text)),
            Err(err) => {
                let message = format!(
                    "cannot read the extended file `{}`: {err}",
                    target.display()
                );
                let beside = format!(
                    "the path is taken relative to the folder of `{}`",
                    path.display()
                );
                let hint = match err.kind() {
                    std::io::ErrorKind::NotFound => missing(&target),
                    _ => beside,
                };
                refuse(message, hint)
            }
        }
    }

    /// Removes stages, and their values in profiles.
    fn leave_out(&mut self, base: &mut InlineTable, without: &Value) {
        let list = "write, e.g., `without = [\"dispatch\"]`";
        let Some(names) = without.as_array() else {
            let message = format!(
                "`{WITHOUT}` must be a list of names of stages, found {}",
                found(without)
            );
            let location = without.span().map(|span| self.texts.location(span));
            let problem = Problem::new(message).at(location).hint(list.to_owned());
            self.problems.push(problem);
            return;
        };
        for name in names {
            let stages = base.get_mut("stages").and_then(Value::as_inline_table_mut);
            let known: Vec<String> = stages
                .iter()
                .flat_map(|stages| stages.iter().map(|(name, _)| name.to_owned()))
                .collect();
            let gone = name
                .as_str()
                .and_then(|name| stages.and_then(|stages| stages.remove(name)));
            let (Some(word), Some(stage)) = (name.as_str(), gone) else {
                let word = name
                    .as_str()
                    .map_or_else(|| found(name), |word| format!("`{word}`"));
                let near = did_you_mean(word.trim_matches('`'), known.iter().map(String::as_str));
                let hint = near.unwrap_or_else(|| format!("its stages are: {}", known.join(", ")));
                let location = name.span().map(|span| self.texts.location(span));
                let message = format!("the extended file has no stage {word} to leave out");
                self.problems
                    .push(Problem::new(message).at(location).hint(hint));
                continue;
            };
            self.taken.extend(shared::names(&stage));
            self.left_out.insert(word.to_owned());
            let profiles = base
                .get_mut("profiles")
                .and_then(Value::as_inline_table_mut);
            for (_, profile) in profiles.into_iter().flat_map(InlineTable::iter_mut) {
                if let Some(profile) = profile.as_inline_table_mut() {
                    profile.remove(word);
                }
            }
        }
    }

    fn problem(&mut self, message: String, key: &Key, hint: &str) {
        let location = key.span().map(|span| self.texts.location(span));
        let problem = Problem::new(message).at(location).hint(hint.to_owned());
        self.problems.push(problem);
    }
}
