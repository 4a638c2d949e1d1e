//! Objects excluded from training, to be unseen in sampling.
//!
//! ```
//! use folds::UnseenObjects;
//!
//! let excluded = UnseenObjects { unseen_objects: vec!["cup".into()], unseen_fold: Some("2/3".parse()?) };
//! let demonstrated = ["bowl", "box", "can", "cup", "drill"].into();
//! assert_eq!(excluded.of(&demonstrated), ["box", "cup", "drill"].into());
//! # Ok::<(), String>(())
//! ```

use std::{collections::BTreeSet, fmt, str::FromStr};

use options::options;
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// One of several parts of the objects, e.g. `2/4`: taking the objects in the order of their names, the
/// second, the sixth, the tenth, ….
///
/// Objects with similar names are often alike, so they fall into different folds.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(try_from = "String", into = "String")]
#[schemars(with = "String")]
pub struct Fold {
    /// Number of the fold, from 1.
    number: usize,
    /// Number of folds, at least 2.
    folds_n: usize,
}

impl Fold {
    /// Returns the names that belong to this fold.
    pub fn of<'a>(self, names: &BTreeSet<&'a str>) -> Vec<&'a str> {
        let names = names.iter().skip(self.number - 1).step_by(self.folds_n);
        names.copied().collect()
    }
}

impl FromStr for Fold {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let fold = text.split_once('/').and_then(|(number, folds_n)| {
            let (number, folds_n) = (number.parse().ok()?, folds_n.parse().ok()?);
            (folds_n >= 2 && (1..=folds_n).contains(&number)).then_some(Self { number, folds_n })
        });
        fold.ok_or_else(|| {
            format!("`{text}` is not a fold: write e.g. `2/4` for the second of four, at least two")
        })
    }
}

impl TryFrom<String> for Fold {
    type Error = String;

    fn try_from(text: String) -> Result<Self, String> {
        text.parse()
    }
}

impl fmt::Display for Fold {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}/{}", self.number, self.folds_n)
    }
}

impl From<Fold> for String {
    fn from(fold: Fold) -> Self {
        fold.to_string()
    }
}

/// Objects that nothing is learned from, to be unseen in sampling.
#[options]
#[derive(PartialEq, Eq)]
pub struct UnseenObjects {
    /// Objects excluded from training, by name, to be unseen in sampling
    #[option(default)]
    pub unseen_objects: Vec<String>,
    /// Fold of the objects that is excluded too, e.g. `2/4`: every fourth by name, from the second; with
    /// `--set train.unseen_fold=1/4,2/4,3/4,4/4`, every object is unseen once
    #[option(default)]
    pub unseen_fold: Option<Fold>,
}

impl UnseenObjects {
    /// Returns the excluded ones of the objects that were demonstrated.
    pub fn of<'a>(&self, demonstrated: &BTreeSet<&'a str>) -> BTreeSet<&'a str> {
        let named = |object: &&str| self.unseen_objects.iter().any(|name| name == object);
        let named = demonstrated.iter().copied().filter(named);
        let fold = self.unseen_fold.into_iter();
        named
            .chain(fold.flat_map(|fold| fold.of(demonstrated)))
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_object_is_in_one_fold() {
        let objects: BTreeSet<&str> = ["a", "b", "c", "d", "e"].into();
        let folds = ["1/2", "2/2"].map(|fold| fold.parse::<Fold>().unwrap());
        let of = folds.map(|fold| fold.of(&objects));
        assert_eq!(of, [vec!["a", "c", "e"], vec!["b", "d"]]);
        assert_eq!(folds[1].to_string(), "2/2");
    }

    #[test]
    fn folds_that_are_not_parts_are_refused() {
        for text in ["", "1", "0/4", "5/4", "1/1", "1/0", "-1/4", "1/4/4", "a/b"] {
            let err = text.parse::<Fold>().unwrap_err();
            assert!(err.contains("2/4"), "{err}");
        }
    }
}
