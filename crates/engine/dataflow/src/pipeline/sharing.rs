//! The shared values of a pipeline file, and the stages that use them.

use toml_edit::{InlineTable, Key};

use super::{faults::Part, reader::FileReader};
use crate::{
    shared::{self, SHARED},
    source::Location,
    suggestions::did_you_mean,
    tables::{found, merge_values, set_value},
};

impl FileReader<'_> {
    /// Returns the shared values.
    pub(super) fn shared(
        &mut self,
        root: &InlineTable,
        profile: Option<&InlineTable>,
    ) -> InlineTable {
        let mut shared = InlineTable::new();
        let said = [root.get(SHARED), profile.and_then(|it| it.get(SHARED))];
        for said in said.into_iter().flatten() {
            match said.as_inline_table() {
                Some(values) => merge_values(&mut shared, values),
                None => self.problem(
                    format!("`{SHARED}` is not a table of values"),
                    said.span(),
                    Some("write, e.g., `[shared]` and below it `hand = \"hand.urdf\"`".to_owned()),
                ),
            }
        }
        for given in self.overrides {
            if given.path.stage.as_deref() == Some(SHARED) {
                set_value(&mut shared, &given.path.keys, &given.value);
            }
        }
        shared
    }

    /// Merges the shared values that a stage uses into its table; the stage's own values win.
    pub(super) fn take(&mut self, stage: &str, table: &mut InlineTable, shared: &InlineTable) {
        self.taken.clear();
        let Some(value) = table.remove(SHARED) else {
            return;
        };
        let example = "write, e.g., `shared.hand = \"hand\"`".to_owned();
        let Some(wires) = value.as_inline_table() else {
            let place = self.place(stage, &[SHARED.to_owned()], Part::Value, value.span());
            let message = format!("`{SHARED}` of stage `{stage}` is not a table");
            self.problem_at(message, place, Some(example));
            return;
        };
        let mut whole = InlineTable::new();
        for taken in shared::taken(wires) {
            let words = taken.words();
            let path = [&[SHARED.to_owned()], words.as_slice()].concat();
            let place = self.place(stage, &path, Part::Value, taken.name.span());
            let Some(name) = taken.name.as_str() else {
                let message = format!(
                    "`{}` of stage `{stage}` must name a shared value, found {}",
                    path.join("."),
                    found(&taken.name)
                );
                self.problem_at(message, place, Some(example.clone()));
                continue;
            };
            let Some(value) = shared.get(name) else {
                let known: Vec<&str> = shared.iter().map(|(name, _)| name).collect();
                let hint = match did_you_mean(name, known.iter().copied()) {
                    Some(near) => near,
                    None if known.is_empty() => {
                        format!("write `{name} = …` under `[{SHARED}]` in the file")
                    }
                    None => format!("the shared values are: {}", known.join(", ")),
                };
                let message = format!("stage `{stage}` takes an unknown shared value `{name}`");
                self.problem_at(message, place, Some(hint));
                continue;
            };
            self.taken_names.insert(name.to_owned());
            taken.put(&mut whole, value.clone());
            self.taken.push(taken);
        }
        merge_values(&mut whole, table);
        *table = whole;
    }

    /// Refuses shared values that no stage uses.
    pub(super) fn check_taken(&mut self, shared: &InlineTable) {
        for (name, _) in shared {
            if self.taken_names.contains(name) || self.file.taken.contains(name) {
                continue;
            }
            let span = shared.key(name).and_then(Key::span);
            let in_set = || self.in_set(Some(SHARED), &[name.to_owned()], Part::Key);
            let place = span.map(|span| self.location(span)).or_else(in_set);
            let near = did_you_mean(name, self.taken_names.iter().map(String::as_str));
            let take = || format!("write `shared.OPTION = \"{name}\"` in a stage, or remove it");
            let hint = near.unwrap_or_else(take);
            let message = format!("no stage takes the shared value `{name}`");
            self.problem_at(message, place, Some(hint));
        }
    }

    /// The location, among the overrides, of the shared value that the stage uses at these keys.
    pub(super) fn in_shared(&self, path: &[String], part: Part) -> Option<Location> {
        self.taken.iter().find_map(|taken| {
            let below = path.strip_prefix(taken.words().as_slice())?;
            let name = taken.name.as_str()?.to_owned();
            self.in_set(Some(SHARED), &[&[name], below].concat(), part)
        })
    }
}
