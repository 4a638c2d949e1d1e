//! Tables of a pipeline file: copied with the spans of their values, merged and changed.

use toml_edit::{InlineTable, Item, Value};

/// Copies a table with the spans of its values, so that errors can point at them.
pub(crate) fn copy_table(from: &dyn toml_edit::TableLike, to: &mut InlineTable) {
    for (name, item) in from.iter() {
        let value = match item {
            Item::Value(value) => Some(value.clone()),
            Item::Table(table) => {
                let mut inline = InlineTable::new();
                copy_table(table, &mut inline);
                Some(Value::InlineTable(inline))
            }
            Item::ArrayOfTables(tables) => {
                let values = tables.iter().map(|table| {
                    let mut inline = InlineTable::new();
                    copy_table(table, &mut inline);
                    Value::InlineTable(inline)
                });
                Some(Value::Array(values.collect()))
            }
            Item::None => None,
        };
        if let Some(value) = value {
            match from.get_key_value(name) {
                Some((key, _)) => {
                    to.insert_formatted(key, value);
                }
                None => {
                    to.insert(name, value);
                }
            }
        }
    }
}

/// Overwrites the values of a table with those of another, key by key, with the spans of the keys.
pub(crate) fn merge_values(table: &mut InlineTable, changes: &InlineTable) {
    for (name, value) in changes.clone() {
        match (table.get_mut(&name), value) {
            (Some(Value::InlineTable(inner)), Value::InlineTable(changes)) => {
                merge_values(inner, &changes);
            }
            (_, value) => match changes.key(&name) {
                Some(key) => {
                    table.insert_formatted(key, value);
                }
                None => {
                    table.insert(name.as_str(), value);
                }
            },
        }
    }
}

/// Sets one value, creating the tables on its path.
pub(crate) fn set_value(table: &mut InlineTable, keys: &[String], value: &Value) {
    match keys {
        [] => {}
        [key] => {
            table.insert(key.as_str(), value.clone());
        }
        [key, rest @ ..] => {
            if !matches!(table.get(key), Some(Value::InlineTable(_))) {
                table.insert(key.as_str(), Value::InlineTable(InlineTable::new()));
            }
            if let Some(Value::InlineTable(inner)) = table.get_mut(key) {
                set_value(inner, rest, value);
            }
        }
    }
}

/// The type of a value, in words.
pub(crate) fn found(value: &Value) -> String {
    match value {
        Value::String(text) => format!("the text \"{}\"", text.value()),
        Value::Integer(number) => format!("the number {}", number.value()),
        Value::Float(number) => format!("the number {}", number.to_string().trim()),
        Value::Boolean(value) => format!("`{}`", value.value()),
        Value::Datetime(date) => format!("the date {}", date.value()),
        Value::Array(elements) => match elements.len() {
            0 => "an empty list".to_owned(),
            n => format!("a list of {n}"),
        },
        Value::InlineTable(_) => "a table".to_owned(),
    }
}
