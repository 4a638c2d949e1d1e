//! Parameter sweeps: several values per key, and the variants that they combine to.

use std::{ops::Range, path::Path, str::FromStr};

use toml_edit::{InlineTable, Key, Value};

use crate::{
    error::{FileError, Problem},
    inheritance::InheritedFile,
    overrides::{KeyPath, Override, OverrideError, parse_value, split},
};

/// Name of the tables in a pipeline file.
const TABLES: &str = "sweep";
/// Example of these tables, for hints.
const HINT: &str = "write, e.g., `[[sweep]]` and below it `\"train.training.epochs\" = [50, 100]`";

/// Several values for one key, or for keys that change together: one `--set` with one value or several,
/// `train.training.kl_weight=1e-4,1e-3`, or one `[[sweep]]` table of a pipeline file.
///
/// On the command line, a value that is TOML as a whole is one value: `[1, 2]`, `"a,b"`. Other text is
/// cut at the commas that are in neither quotes nor brackets.
#[derive(Debug, Clone)]
pub struct Sweep {
    /// Each key with its values, equally many for every key.
    keys: Vec<(KeyPath, Vec<Value>)>,
}

/// One combination: a value for every key.
#[derive(Debug, Clone)]
pub struct Variant {
    /// The values that distinguish it, e.g. `train.training.kl_weight=0.001`; empty if it is the
    /// only one.
    pub label: String,
    /// The values.
    pub overrides: Vec<Override>,
}

impl From<Override> for Sweep {
    fn from(given: Override) -> Self {
        Self {
            keys: vec![(given.path, vec![given.value])],
        }
    }
}

impl FromStr for Sweep {
    type Err = OverrideError;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        let (path, value) = split(text)?;
        let values = if let Some(value) = parse_value(value) {
            vec![value]
        } else {
            let parts = cut_at_commas(value);
            if parts.len() > 1 && parts.iter().any(|part| part.is_empty()) {
                return Err(OverrideError::EmptyValue(text.to_owned()));
            }
            parts
                .into_iter()
                .map(|part| parse_value(part).unwrap_or_else(|| Value::from(part)))
                .collect()
        };
        Ok(Self {
            keys: vec![(path, values)],
        })
    }
}

impl Sweep {
    /// Reads the `[[sweep]]` tables of a pipeline file, or else of the file that it extends, in
    /// their order: none if it has none, or is not TOML.
    ///
    /// Each key of a table is a path as in `--set`, each value a list. The keys of one table change
    /// together; several tables make every combination.
    ///
    /// # Errors
    ///
    /// Fails with every fault in these tables, each with its location and a hint.
    pub fn in_file(path: &Path, source: &str) -> Result<Vec<Self>, FileError> {
        let file = InheritedFile::read(path, source);
        // Faults of the extended files are reported by the file's reader.
        let Some(item) = file.root.get(TABLES) else {
            return Ok(Vec::new());
        };
        // A table has no span of its own.
        let key_span = |table: &InlineTable, key: &str| table.key(key).and_then(Key::span);
        let header = key_span(&file.root, TABLES);
        let place = |span: Option<Range<usize>>| {
            let span = span.or_else(|| header.clone());
            span.map(|span| file.texts.location(span))
        };
        let problem = |message: String, span: Option<Range<usize>>| {
            let location = place(span);
            Problem::new(message).at(location).hint(HINT.to_owned())
        };
        let tables = item.as_array().into_iter().flatten();
        let tables: Vec<_> = tables.map(Value::as_inline_table).collect();
        let tables: Option<Vec<_>> = tables.into_iter().collect();
        let Some(tables) = tables.filter(|_| item.is_array()) else {
            let message = "`sweep` must be an array of tables".to_owned();
            return Err(problem(message, item.span()).into());
        };
        let mut problems = Vec::new();
        let mut sweeps = Vec::new();
        for table in tables {
            let mut keys: Vec<(KeyPath, Vec<Value>)> = Vec::new();
            for (key, item) in table {
                let values: Vec<Value> = item.as_array().into_iter().flatten().cloned().collect();
                let expected = keys.first().map_or(values.len(), |(_, first)| first.len());
                let span = key_span(table, key);
                let Ok((path, _)) = split(&format!("{key}=")) else {
                    problems.push(problem(format!("`{key}` names no value"), span));
                    continue;
                };
                let path = KeyPath {
                    written: place(span.clone()),
                    ..path
                };
                if let Some((inner, span)) = unquoted(key, item) {
                    let message =
                        format!("`{inner}` has dots, which make tables of it: write `\"{inner}\"`");
                    problems.push(problem(message, span));
                } else if values.is_empty() {
                    let message = format!("`{key}` has no list of values to go through");
                    problems.push(problem(message, item.span().or(span)));
                } else if values.len() != expected {
                    let n = values.len();
                    let message = format!(
                        "`{key}` has {n} values, and the key before it in its table {expected}"
                    );
                    problems.push(problem(message, item.span()));
                } else {
                    keys.push((path, values));
                }
            }
            sweeps.push(Self { keys });
        }
        if problems.is_empty() {
            Ok(sweeps)
        } else {
            Err(FileError { problems })
        }
    }

    /// Returns every combination of the values, at least one; the last key varies fastest. If two
    /// name the same key, the later one wins.
    pub fn variants(given: &[Self]) -> Vec<Variant> {
        let mut variants = vec![Variant {
            label: String::new(),
            overrides: Vec::new(),
        }];
        for (idx, sweep) in given.iter().enumerate() {
            let later = given.get(idx + 1..).unwrap_or_default();
            let is_later = |path: &KeyPath| {
                let mut keys = later.iter().flat_map(|later| &later.keys);
                keys.any(|(known, _)| known == path)
            };
            let keys = sweep.keys.iter().filter(|(path, _)| !is_later(path));
            let keys: Vec<&(KeyPath, Vec<Value>)> = keys.collect();
            let Some(n) = keys.first().map(|(_, values)| values.len()) else {
                continue;
            };
            variants = variants
                .iter()
                .flat_map(|variant| (0..n).map(|number| extend(variant, &keys, number)))
                .collect();
        }
        variants
    }
}

/// Returns the whole path of keys that are written without quotes, and the span of the last.
fn unquoted(key: &str, item: &Value) -> Option<(String, Option<Range<usize>>)> {
    let table = item.as_inline_table().filter(|_| item.span().is_none())?;
    let (below, value) = table.iter().next()?;
    let path = format!("{key}.{below}");
    let span = || (path.clone(), table.key(below).and_then(Key::span));
    Some(unquoted(&path, value).unwrap_or_else(span))
}

/// Adds the values of this number to a variant.
fn extend(variant: &Variant, keys: &[&(KeyPath, Vec<Value>)], number: usize) -> Variant {
    let mut extended = variant.clone();
    for (path, values) in keys {
        let Some(value) = values.get(number) else {
            continue;
        };
        extended.overrides.push(Override {
            path: path.clone(),
            value: value.clone(),
        });
        if values.len() > 1 {
            if !extended.label.is_empty() {
                extended.label.push_str(", ");
            }
            extended.label += &format!("{path}={}", shown(value));
        }
    }
    extended
}

/// A value as labels show it.
fn shown(value: &Value) -> String {
    match value {
        Value::String(text) => text.value().clone(),
        Value::Float(number) => number.value().to_string(),
        Value::Integer(number) => number.value().to_string(),
        other => other.to_string().trim().to_owned(),
    }
}

/// Cuts text at the commas outside quotes and brackets.
fn cut_at_commas(text: &str) -> Vec<&str> {
    let mut parts = Vec::new();
    let mut start = 0;
    let mut depth = 0_usize;
    let mut quote: Option<char> = None;
    let mut escaped = false;
    for (at, c) in text.char_indices() {
        match (quote, c) {
            _ if escaped => escaped = false,
            (Some('"'), '\\') => escaped = true,
            (Some(open), c) if c == open => quote = None,
            (None, '"' | '\'') => quote = Some(c),
            (None, '[' | '{') => depth += 1,
            (None, ']' | '}') => depth = depth.saturating_sub(1),
            (None, ',') if depth == 0 => {
                parts.extend(text.get(start..at));
                start = at + 1;
            }
            _ => {}
        }
    }
    parts.extend(text.get(start..));
    parts.into_iter().map(str::trim).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn check(given: &[&str], labels: &[&str]) {
        let sweeps: Vec<Sweep> = given.iter().map(|text| text.parse().unwrap()).collect();
        let found: Vec<String> = Sweep::variants(&sweeps)
            .into_iter()
            .map(|variant| variant.label)
            .collect();
        assert_eq!(found, labels, "{given:?}");
    }

    #[test]
    fn a_list_makes_one_variant_per_value() {
        check(&[], &[""]);
        check(&["train.kl_weight=1e-3"], &[""]);
        check(
            &["train.kl_weight=1e-4,1e-3, 1e-2"],
            &[
                "train.kl_weight=0.0001",
                "train.kl_weight=0.001",
                "train.kl_weight=0.01",
            ],
        );
        check(&["seed=1,2"], &["seed=1", "seed=2"]);
        check(&["a.on=true,false"], &["a.on=true", "a.on=false"]);
    }

    #[test]
    fn several_lists_make_their_product() {
        check(
            &["a.x=1,2", "b.z=9", "a.y=red,blue"],
            &[
                "a.x=1, a.y=red",
                "a.x=1, a.y=blue",
                "a.x=2, a.y=red",
                "a.x=2, a.y=blue",
            ],
        );
    }

    #[test]
    fn override_that_is_valid_toml_is_one_value() {
        check(&["train.network.point_widths=[64, 128]"], &[""]);
        check(&["ingest.root=\"/data/a,b\""], &[""]);
        check(&["a.b={ x = 1, y = 2 }"], &[""]);
    }

    #[test]
    fn commas_in_quotes_and_brackets_do_not_cut() {
        check(&["a.b=[1, 2],[3]"], &["a.b=[1, 2]", "a.b=[3]"]);
        check(&["a.root=\"/x,1\",/y"], &["a.root=/x,1", "a.root=/y"]);
        check(&["a.b='p,q','r'"], &["a.b=p,q", "a.b=r"]);
        check(&[r#"a.b="\",",c"#], &["a.b=\",", "a.b=c"]);
    }

    #[test]
    fn last_override_of_a_key_wins() {
        check(&["a.b=1,2", "a.b=3"], &[""]);
        let given = ["a.b=1,2", "a.b=3"].map(|text| text.parse().unwrap());
        let variants = Sweep::variants(&given);
        assert_eq!(variants[0].overrides.len(), 1);
        assert_eq!(variants[0].overrides[0].value.as_integer(), Some(3));
    }

    #[test]
    fn tables_of_a_file_go_through_their_lists_and_keys_of_one_table_together() {
        let source = r#"
            [[sweep]]
            "a.x" = [0.0, 0.5]
            "b.y" = ["red", "blue"]
            [[sweep]]
            "a.z.w" = [1, 2]
        "#;
        let read = || Sweep::in_file(Path::new("x.toml"), source).unwrap();
        let labels = |given: Vec<Sweep>| -> Vec<String> {
            let variants = Sweep::variants(&given).into_iter();
            variants.map(|variant| variant.label).collect()
        };
        assert_eq!(
            labels(read()),
            [
                "a.x=0, b.y=red, a.z.w=1",
                "a.x=0, b.y=red, a.z.w=2",
                "a.x=0.5, b.y=blue, a.z.w=1",
                "a.x=0.5, b.y=blue, a.z.w=2",
            ]
        );
        // A later sweep takes a key out of its table.
        let set = |text: &str| text.parse::<Sweep>().unwrap();
        let given = [read(), vec![set("a.x=7"), set("a.z.w=3")]].concat();
        assert_eq!(labels(given), ["b.y=red", "b.y=blue"]);
        assert!(
            Sweep::in_file(Path::new("x.toml"), "seed = 1")
                .unwrap()
                .is_empty()
        );
    }

    #[test]
    fn faulty_tables_are_refused_where_they_are_faulty() {
        let check = |source: &str, line: usize, expected: &str| {
            let err = Sweep::in_file(Path::new("x.toml"), source).unwrap_err();
            let problem = &err.problems[0];
            assert_eq!(problem.message, expected);
            let shown = problem.location.as_ref().unwrap().to_string();
            assert!(shown.contains(&format!("--> x.toml:{line}:")), "{shown}");
            assert!(problem.hint.is_some());
        };
        check("sweep = 3", 1, "`sweep` must be an array of tables");
        let no_list = "`a.x` has no list of values to go through";
        check("[[sweep]]\n\"a.x\" = 3", 2, no_list);
        check("[[sweep]]\n\"a.x\" = []", 2, no_list);
        check("[[sweep]]\n\"a..x\" = [1]", 2, "`a..x` names no value");
        check(
            "[[sweep]]\n\"a.x\" = [1, 2]\n\"a.y\" = [1]",
            3,
            "`a.y` has 1 values, and the key before it in its table 2",
        );
    }

    #[test]
    fn refuses_an_empty_value_in_a_list() {
        for text in ["a.b=1,,2", "a.b=1,", "a.b=,1"] {
            assert_eq!(
                text.parse::<Sweep>().unwrap_err(),
                OverrideError::EmptyValue(text.to_owned())
            );
        }
        assert!("a.b".parse::<Sweep>().is_err());
    }
}
