//! Values shared by several stages: each is written once, under `[shared]`, and referred to in a
//! stage's table as `shared.OPTION = "NAME"`.

use toml_edit::{InlineTable, Key, Value};

/// The table of the shared values, and of a stage's references to them.
pub(crate) const SHARED: &str = "shared";

/// One option of a stage that uses a shared value.
pub(crate) struct SharedUse {
    /// The keys that lead to the option.
    pub(crate) path: Vec<Key>,
    /// The name of the shared value, as the stage gives it.
    pub(crate) name: Value,
}

impl SharedUse {
    /// Returns the keys that lead to the option.
    pub(crate) fn words(&self) -> Vec<String> {
        self.path.iter().map(|key| key.get().to_owned()).collect()
    }

    /// Sets the option's value, with the spans of its keys.
    pub(crate) fn put(&self, table: &mut InlineTable, value: Value) {
        put(table, &self.path, value);
    }
}

/// Lists the options below a stage's `shared`.
pub(crate) fn taken(wires: &InlineTable) -> Vec<SharedUse> {
    let mut all = Vec::new();
    collect(wires, &[], &mut all);
    all
}

/// Returns the names of the shared values that a stage uses.
pub(crate) fn names(stage: &Value) -> Vec<String> {
    let table = stage.as_inline_table();
    let wires = table.and_then(|table| table.get(SHARED)?.as_inline_table());
    let all = wires.map(taken).unwrap_or_default();
    let names = all.iter().filter_map(|taken| taken.name.as_str());
    names.map(str::to_owned).collect()
}

fn collect(wires: &InlineTable, path: &[Key], all: &mut Vec<SharedUse>) {
    for (name, value) in wires {
        let key = wires.key(name).cloned().unwrap_or_else(|| Key::new(name));
        let path = [path, &[key]].concat();
        match value {
            Value::InlineTable(inner) => collect(inner, &path, all),
            value => all.push(SharedUse {
                path,
                name: value.clone(),
            }),
        }
    }
}

fn put(table: &mut InlineTable, path: &[Key], value: Value) {
    match path {
        [] => {}
        [key] => {
            table.insert_formatted(key, value);
        }
        [key, rest @ ..] => {
            if !matches!(table.get(key.get()), Some(Value::InlineTable(_))) {
                table.insert_formatted(key, Value::InlineTable(InlineTable::new()));
            }
            if let Some(Value::InlineTable(inner)) = table.get_mut(key.get()) {
                put(inner, rest, value);
            }
        }
    }
}
