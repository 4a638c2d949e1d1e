//! The keys of a file, as they are written.

use std::{collections::BTreeMap, fmt};

use robot::near_names;
use serde::{
    Deserialize, Deserializer,
    de::{DeserializeOwned, IgnoredAny, SeqAccess, Visitor},
};

use crate::ConfigError;

/// Maximum number of scalars, lists and maps of a file; the library's own have a hundred.
const MAX_NODES: usize = 10_000;
/// Maximum number of lists and maps within each other; the library's own have four.
const MAX_DEPTH: usize = 16;
/// Maximum number of aliases, and of anchors; the library's own have none.
const MAX_ALIASES: usize = 16;

/// A whole file.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct File {
    pub(super) retargeting: Keys,
}

/// The keys of `retargeting`, with the library's defaults.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Keys {
    #[serde(rename = "type")]
    pub(super) kind: String,
    pub(super) urdf_path: String,
    #[serde(default)]
    pub(super) add_dummy_free_joint: bool,
    #[serde(default)]
    pub(super) target_link_human_indices: Option<Indices>,
    #[serde(default)]
    pub(super) wrist_link_name: Option<String>,
    #[serde(default)]
    pub(super) target_link_names: Option<Vec<String>>,
    #[serde(default)]
    pub(super) target_joint_names: Option<Vec<String>>,
    #[serde(default)]
    pub(super) target_origin_link_names: Option<Vec<String>>,
    #[serde(default)]
    pub(super) target_task_link_names: Option<Vec<String>>,
    #[serde(default)]
    pub(super) finger_tip_link_names: Option<Vec<String>>,
    #[serde(default = "one")]
    pub(super) scaling_factor: f64,
    /// In m/rad².
    #[serde(default = "normal_delta")]
    pub(super) normal_delta: f64,
    /// In meters.
    #[serde(default = "huber_delta")]
    pub(super) huber_delta: f64,
    /// In meters.
    #[serde(default = "project_dist")]
    pub(super) project_dist: f64,
    /// In meters.
    #[serde(default = "escape_dist")]
    pub(super) escape_dist: f64,
    #[serde(default = "yes")]
    pub(super) has_joint_limits: bool,
    #[serde(default)]
    pub(super) ignore_mimic_joint: bool,
    #[serde(default = "low_pass_alpha")]
    pub(super) low_pass_alpha: f64,
}

/// All keys, for a hint.
const KEYS: [&str; 18] = [
    "type",
    "urdf_path",
    "add_dummy_free_joint",
    "target_link_human_indices",
    "wrist_link_name",
    "target_link_names",
    "target_joint_names",
    "target_origin_link_names",
    "target_task_link_names",
    "finger_tip_link_names",
    "scaling_factor",
    "normal_delta",
    "huber_delta",
    "project_dist",
    "escape_dist",
    "has_joint_limits",
    "ignore_mimic_joint",
    "low_pass_alpha",
];

fn one() -> f64 {
    1.0
}

fn normal_delta() -> f64 {
    4e-3
}

fn huber_delta() -> f64 {
    2e-2
}

fn project_dist() -> f64 {
    0.03
}

fn escape_dist() -> f64 {
    0.05
}

fn yes() -> bool {
    true
}

fn low_pass_alpha() -> f64 {
    0.1
}

/// Numbers of landmarks: a list, or lists.
#[derive(Debug, Clone)]
pub(super) enum Indices {
    One(Vec<i64>),
    Several(Vec<Vec<i64>>),
}

/// A number or a list of numbers.
enum Item {
    Number(i64),
    List(Vec<i64>),
}

impl<'de> Deserialize<'de> for Item {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Items;

        impl<'de> Visitor<'de> for Items {
            type Value = Item;

            fn expecting(&self, formatter: &mut fmt::Formatter<'_>) -> fmt::Result {
                formatter.write_str("a landmark's number, or a list of them")
            }

            fn visit_i64<E: serde::de::Error>(self, number: i64) -> Result<Item, E> {
                Ok(Item::Number(number))
            }

            fn visit_u64<E: serde::de::Error>(self, number: u64) -> Result<Item, E> {
                i64::try_from(number).map(Item::Number).map_err(E::custom)
            }

            fn visit_seq<A: SeqAccess<'de>>(self, mut list: A) -> Result<Item, A::Error> {
                let mut numbers = Vec::new();
                while let Some(number) = list.next_element()? {
                    numbers.push(number);
                }
                Ok(Item::List(numbers))
            }
        }

        deserializer.deserialize_any(Items)
    }
}

impl<'de> Deserialize<'de> for Indices {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let (mut numbers, mut lists) = (Vec::new(), Vec::new());
        for item in Vec::<Item>::deserialize(deserializer)? {
            match item {
                Item::Number(number) => numbers.push(number),
                Item::List(list) => lists.push(list),
            }
        }
        match (numbers.is_empty(), lists.is_empty()) {
            (_, true) => Ok(Self::One(numbers)),
            (true, false) => Ok(Self::Several(lists)),
            (false, false) => Err(serde::de::Error::custom(
                "numbers and lists of numbers are mixed",
            )),
        }
    }
}

/// Reads a file's keys.
pub(super) fn parse(text: &str) -> Result<File, ConfigError> {
    #[derive(Deserialize)]
    #[expect(
        clippy::zero_sized_map_values,
        reason = "serde reads a mapping into a map"
    )]
    struct Names {
        retargeting: BTreeMap<String, IgnoredAny>,
    }

    let names: Names = read(text)?;
    if let Some(key) = names
        .retargeting
        .into_keys()
        .find(|key| !KEYS.contains(&key.as_str()))
    {
        return Err(ConfigError::UnknownKey {
            near: near_names(&key, KEYS.into_iter()).into_iter().next(),
            key,
        });
    }
    read(text)
}

fn read<T: DeserializeOwned>(text: &str) -> Result<T, ConfigError> {
    let options = serde_saphyr::options! {
        budget: serde_saphyr::budget! {
            max_nodes: MAX_NODES,
            max_events: 4 * MAX_NODES,
            max_recorded_anchor_events: 4 * MAX_NODES,
            max_depth: MAX_DEPTH,
            max_aliases: MAX_ALIASES,
            max_anchors: MAX_ALIASES,
            max_documents: 1,
        },
        with_snippet: false,
    };
    serde_saphyr::from_str_with_options(text, options).map_err(|err| {
        let message = err.to_string();
        ConfigError::Syntax(message.lines().next().unwrap_or_default().to_owned())
    })
}
