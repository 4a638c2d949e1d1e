//! Several values for one key, and the variants that they make together.

use std::str::FromStr;

use toml_edit::Value;

use super::{KeyPath, Override, OverrideError, parse_value, split};

/// One `--set` with one value or several: `train.training.kl_weight=1e-4,1e-3`.
///
/// A value that is TOML as a whole is one value: `[1, 2]`, `"a,b"`. Other text is cut at the commas
/// that are in neither quotes nor brackets.
#[derive(Debug, Clone)]
pub struct Sweep {
    path: KeyPath,
    values: Vec<Value>,
}

/// One value for every key that was given.
#[derive(Debug, Clone)]
pub struct Variant {
    /// What sets it apart, e.g. `train.training.kl_weight=0.001`; empty if it is the only one.
    pub label: String,
    /// The values.
    pub overrides: Vec<Override>,
}

impl From<Override> for Sweep {
    fn from(given: Override) -> Self {
        Self {
            path: KeyPath {
                stage: given.stage,
                keys: given.keys,
            },
            values: vec![given.value],
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
        Ok(Self { path, values })
    }
}

impl Sweep {
    /// Returns every combination of the values, at least one; the last key varies fastest. Of two
    /// that name the same key, the later counts.
    pub fn variants(given: &[Self]) -> Vec<Variant> {
        let mut variants = vec![Variant {
            label: String::new(),
            overrides: Vec::new(),
        }];
        for (idx, sweep) in given.iter().enumerate() {
            let later = given.get(idx + 1..).unwrap_or_default();
            if later.iter().any(|later| later.path == sweep.path) {
                continue;
            }
            variants = variants
                .iter()
                .flat_map(|variant| {
                    sweep
                        .values
                        .iter()
                        .map(|value| sweep.extend(variant, value))
                })
                .collect();
        }
        variants
    }

    fn extend(&self, variant: &Variant, value: &Value) -> Variant {
        let mut extended = variant.clone();
        extended.overrides.push(self.path.with(value.clone()));
        if self.values.len() > 1 {
            if !extended.label.is_empty() {
                extended.label.push_str(", ");
            }
            let words = self.path.stage.iter().chain(&self.path.keys);
            let words: Vec<&str> = words.map(String::as_str).collect();
            extended
                .label
                .push_str(&format!("{}={}", words.join("."), shown(value)));
        }
        extended
    }
}

/// A value as a label names it.
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
    fn what_is_toml_as_a_whole_is_one_value() {
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
    fn the_later_of_two_for_one_key_counts() {
        check(&["a.b=1,2", "a.b=3"], &[""]);
        let given = ["a.b=1,2", "a.b=3"].map(|text| text.parse().unwrap());
        let variants = Sweep::variants(&given);
        assert_eq!(variants[0].overrides.len(), 1);
        assert_eq!(variants[0].overrides[0].value.as_integer(), Some(3));
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
