//! Faults of a stage's table against the schema of its options: unknown or missing keys, and values
//! of a wrong type.

use std::ops::Range;

use serde_json::Value as Json;
use toml_edit::{InlineTable, Value};

use crate::{kind::Kind, suggestions::nearest, tables::found};

/// Keys of every stage, beside its kind's options.
const COMMON: [&str; 5] = [
    "inputs",
    "kind",
    "max_skipped_fraction",
    "resources",
    "shared",
];

/// One fault of a stage's table.
pub(super) struct Fault {
    /// The keys that lead to it; empty for the table itself.
    pub(super) path: Vec<String>,
    pub(super) part: Part,
    /// Its span in the file, if it has one.
    pub(super) span: Option<Range<usize>>,
    pub(super) message: String,
    pub(super) hint: String,
}

/// Whether a key or its value is wrong.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Part {
    Key,
    Value,
}

/// Returns all faults of a stage's table.
pub(super) fn faults(stage: &str, kind: &Kind, table: &InlineTable) -> Vec<Fault> {
    let root = kind.schema();
    let mut reader = Reader {
        stage,
        kind,
        root: &root,
        whole: table,
        faults: Vec::new(),
    };
    reader.table(&root, table, &[]);
    reader.faults
}

struct Reader<'a> {
    stage: &'a str,
    kind: &'a Kind,
    root: &'a Json,
    /// The stage's table.
    whole: &'a InlineTable,
    faults: Vec<Fault>,
}

impl Reader<'_> {
    fn list(&self) -> String {
        format!("`pipeline stages {}` lists every option", self.kind.name)
    }

    fn table(&mut self, schema: &Json, table: &InlineTable, path: &[String]) {
        let nothing = serde_json::Map::new();
        let properties = schema.get("properties").and_then(Json::as_object);
        let properties = properties.unwrap_or(&nothing);
        let others = schema.get("additionalProperties");
        let mut meant: Vec<&str> = Vec::new();
        for (key, value) in table {
            let path = [path, &[key.to_owned()]].concat();
            match (properties.get(key), others) {
                (Some(property), _) => self.value(property, value, &path, ""),
                (None, Some(others @ Json::Object(_))) => self.value(others, value, &path, ""),
                (None, Some(Json::Bool(false))) => {
                    let span = table.key(key).and_then(toml_edit::Key::span);
                    let near = nearest(key, properties.keys().map(String::as_str));
                    meant.extend(near);
                    self.unknown(key, near, path, span);
                }
                (None, _) => {}
            }
        }
        let required = schema.get("required").and_then(Json::as_array);
        for key in required.into_iter().flatten().filter_map(Json::as_str) {
            if !table.contains_key(key) && !meant.contains(&key) {
                let path = [path, &[key.to_owned()]].concat().join(".");
                let hint = match self.kind.file_of(&path) {
                    // The missing file is reported by itself.
                    Some(file) if self.whole.get(file).is_none_or(|file| !file.is_str()) => {
                        continue;
                    }
                    Some(file) => format!("write it, or let `{file}` name a file that has it"),
                    None => self.list(),
                };
                self.faults.push(Fault {
                    message: format!("stage `{}` lacks the key `{path}`", self.stage),
                    path: Vec::new(),
                    part: Part::Key,
                    span: None,
                    hint,
                });
            }
        }
    }

    fn unknown(
        &mut self,
        key: &str,
        near: Option<&str>,
        path: Vec<String>,
        span: Option<Range<usize>>,
    ) {
        let options = self.kind.options();
        // The right name in a wrong table, or a common key.
        let same = options
            .iter()
            .find(|option| option.key.rsplit('.').next() == Some(key));
        let elsewhere = || {
            let names = options.iter().map(|option| option.key.as_str());
            nearest(key, names.chain(COMMON))
        };
        let near = near
            .or_else(|| same.map(|option| option.key.as_str()))
            .or_else(elsewhere)
            .filter(|near| *near != key);
        let list = self.list();
        self.faults.push(Fault {
            path,
            part: Part::Key,
            span,
            message: format!("unknown key `{key}` in stage `{}`", self.stage),
            hint: near.map_or_else(
                || list.clone(),
                |near| format!("did you mean `{near}`? {list}"),
            ),
        });
    }

    /// Checks a value; `within` says which part of the option it is.
    fn value(&mut self, schema: &Json, value: &Value, path: &[String], within: &str) {
        let schema = plain(self.root, schema);
        let fits = match (kind_of(schema), value) {
            (Expected::Words(words), Value::String(text)) => words.contains(text.value()),
            (Expected::Tagged(tag, variants), Value::InlineTable(table)) => {
                return self.tagged(tag, &variants, table, path);
            }
            (Expected::Integer | Expected::Number, Value::Integer(number)) => {
                in_range(schema, *number.value() as f64)
            }
            (Expected::Number, Value::Float(number)) => in_range(schema, *number.value()),
            (Expected::Text, Value::String(_))
            | (Expected::Bool, Value::Boolean(_))
            | (Expected::Unknown, _) => true,
            (Expected::Table, Value::InlineTable(table)) => {
                return self.table(schema, table, path);
            }
            (Expected::List, Value::Array(elements)) => {
                let n = u64::try_from(elements.len()).unwrap_or(u64::MAX);
                let limit = |key: &str| schema.get(key).and_then(Json::as_u64);
                let is_long_enough = limit("minItems").is_none_or(|least| least <= n);
                let is_short_enough = limit("maxItems").is_none_or(|most| n <= most);
                if is_long_enough && is_short_enough {
                    for (idx, element) in elements.iter().enumerate() {
                        if let Some(schema) = element_of(schema, idx) {
                            let within = format!("element {} of {within}", idx + 1);
                            self.value(schema, element, path, &within);
                        }
                    }
                    return;
                }
                false
            }
            _ => false,
        };
        if !fits {
            let near = match (kind_of(schema), value) {
                (Expected::Words(words), Value::String(text)) => {
                    nearest(text.value(), words.iter().map(String::as_str))
                        .map(|near| format!("did you mean `\"{near}\"`? "))
                }
                _ => None,
            };
            self.faults.push(Fault {
                path: path.to_vec(),
                part: Part::Value,
                span: value.span(),
                message: format!(
                    "{within}`{}` in stage `{}` must be {}, found {}",
                    path.join("."),
                    self.stage,
                    expected(self.root, schema),
                    found(value)
                ),
                hint: format!("{}{}", near.unwrap_or_default(), self.list()),
            });
        }
    }

    /// Checks an internally tagged table.
    fn tagged(&mut self, tag: &str, variants: &[&Json], table: &InlineTable, path: &[String]) {
        let word_of = |variant: &Json| {
            let word = variant.pointer(&format!("/properties/{tag}/const"))?;
            word.as_str().map(str::to_owned)
        };
        let given = table.get(tag).and_then(Value::as_str);
        let chosen = variants
            .iter()
            .find(|variant| given.is_some() && word_of(variant).as_deref() == given);
        match (chosen, table.get(tag)) {
            (Some(variant), _) => self.table(variant, table, path),
            // No variant matches: the key is missing.
            (None, None) => {
                let schema = serde_json::json!({ "required": [tag] });
                self.table(&schema, table, path);
            }
            (None, Some(value)) => {
                let words: Vec<String> = variants.iter().filter_map(|it| word_of(it)).collect();
                let schema = serde_json::json!({ "enum": words });
                let path = [path, &[tag.to_owned()]].concat();
                self.value(&schema, value, &path, "");
            }
        }
    }
}

/// The expected type of a value.
enum Expected<'s> {
    /// One of these texts.
    Words(Vec<String>),
    /// A table whose variant is named by this key.
    Tagged(&'s str, Vec<&'s Json>),
    Integer,
    Number,
    Text,
    Bool,
    List,
    Table,
    /// The schema does not say.
    Unknown,
}

/// Follows references and strips `null` from optional values.
fn plain<'s>(root: &'s Json, schema: &'s Json) -> &'s Json {
    let schema = crate::kind::resolve(root, schema);
    let variants = schema.get("anyOf").and_then(Json::as_array);
    let is_null = |variant: &&Json| variant.get("type") != Some(&Json::from("null"));
    let mut variants = variants.into_iter().flatten().filter(is_null);
    match (variants.next(), variants.next()) {
        (Some(only), None) => plain(root, only),
        _ => schema,
    }
}

fn kind_of(schema: &Json) -> Expected<'_> {
    let words = |list: &Json| -> Option<Vec<String>> {
        let texts = list.as_array()?.iter();
        texts.map(|text| text.as_str().map(str::to_owned)).collect()
    };
    if let Some(words) = schema.get("enum").and_then(words) {
        return Expected::Words(words);
    }
    if let Some(variants) = schema.get("oneOf").and_then(Json::as_array) {
        return one_of(variants);
    }
    let types = schema.get("type");
    let types = match types {
        Some(Json::Array(types)) => types.iter().filter_map(Json::as_str).collect(),
        Some(Json::String(name)) => vec![name.as_str()],
        _ => Vec::new(),
    };
    match types.iter().find(|name| **name != "null") {
        Some(&"integer") => Expected::Integer,
        Some(&"number") => Expected::Number,
        Some(&"string") => Expected::Text,
        Some(&"boolean") => Expected::Bool,
        Some(&"array") => Expected::List,
        Some(&"object") => Expected::Table,
        _ => Expected::Unknown,
    }
}

fn one_of(variants: &[Json]) -> Expected<'_> {
    let mut words = Vec::new();
    for variant in variants {
        match (variant.get("const"), kind_of(variant)) {
            (Some(Json::String(word)), _) => words.push(word.clone()),
            (None, Expected::Words(several)) => words.extend(several),
            _ => {}
        }
    }
    if words.len() >= variants.len() {
        return Expected::Words(words);
    }
    let tag = variants.first().and_then(|first| {
        let mut properties = first.get("properties")?.as_object()?.iter();
        let (tag, _) = properties.find(|(_, property)| property.get("const").is_some())?;
        Some(tag.as_str())
    });
    match tag {
        Some(tag) => Expected::Tagged(tag, variants.iter().collect()),
        None => Expected::Unknown,
    }
}

fn element_of(schema: &Json, idx: usize) -> Option<&Json> {
    let own = schema.get("prefixItems").and_then(|items| items.get(idx));
    own.or_else(|| schema.get("items"))
}

fn in_range(schema: &Json, number: f64) -> bool {
    let limit = |key: &str| schema.get(key).and_then(Json::as_f64);
    limit("minimum").is_none_or(|least| least <= number)
        && limit("maximum").is_none_or(|most| number <= most)
}

/// The expected type of a value, in words.
fn expected(root: &Json, schema: &Json) -> String {
    let schema = plain(root, schema);
    match kind_of(schema) {
        Expected::Words(words) => {
            let words: Vec<String> = words.iter().map(|word| format!("\"{word}\"")).collect();
            match words.split_last() {
                Some((last, others)) if !others.is_empty() => {
                    format!("{} or {last}", others.join(", "))
                }
                _ => words.concat(),
            }
        }
        Expected::Integer => format!("a whole number{}", range(schema)),
        Expected::Number => format!("a number{}", range(schema)),
        Expected::Text => "text".to_owned(),
        Expected::Bool => "`true` or `false`".to_owned(),
        Expected::Table | Expected::Tagged(..) => "a table".to_owned(),
        Expected::List => {
            let limit = |key: &str| schema.get(key).and_then(Json::as_u64);
            let n = match (limit("minItems"), limit("maxItems")) {
                (Some(least), Some(most)) if least == most => format!("{least} "),
                _ => String::new(),
            };
            let elements = element_of(schema, 0).map_or("values", |items| plural(root, items));
            format!("a list of {n}{elements}")
        }
        Expected::Unknown => "something else".to_owned(),
    }
}

/// The expected type of list elements, in words.
fn plural(root: &Json, schema: &Json) -> &'static str {
    match kind_of(plain(root, schema)) {
        Expected::Integer => "whole numbers",
        Expected::Number => "numbers",
        Expected::Words(_) | Expected::Text => "texts",
        Expected::Bool => "`true` and `false`",
        Expected::List => "lists",
        Expected::Table | Expected::Tagged(..) => "tables",
        Expected::Unknown => "values",
    }
}

/// The range of a number, after a space.
fn range(schema: &Json) -> String {
    options::range_in(schema).map_or_else(String::new, |range| format!(" {range}"))
}
