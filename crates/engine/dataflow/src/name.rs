//! Names of stages, artifacts, partitions, outputs and units.

use std::{borrow::Borrow, fmt, str::FromStr};

use serde::{Deserialize, Serialize};

use crate::shared::SHARED;

/// Text that does not name what it should.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("`{text}` is not a name for {what}: {rule}")]
pub struct InvalidName {
    /// The text.
    pub text: String,
    /// Kind of thing that it should name, e.g. `a stage`.
    pub what: &'static str,
    /// The rule that it breaks.
    pub rule: &'static str,
}

/// Declares names: texts that are checked once, when they are parsed. `$broken` returns the rule that
/// a text breaks.
macro_rules! names {
    ($($(#[$meta:meta])* $name:ident, $what:literal, $broken:expr;)*) => {$(
        $(#[$meta])*
        #[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
        #[serde(try_from = "String")]
        pub struct $name(String);

        impl $name {
            /// Returns the text.
            pub fn as_str(&self) -> &str {
                &self.0
            }
        }

        impl TryFrom<String> for $name {
            type Error = InvalidName;

            fn try_from(text: String) -> Result<Self, InvalidName> {
                let broken: fn(&str) -> Option<&'static str> = $broken;
                match broken(&text) {
                    None => Ok(Self(text)),
                    Some(rule) => Err(InvalidName { text, what: $what, rule }),
                }
            }
        }

        impl FromStr for $name {
            type Err = InvalidName;

            fn from_str(text: &str) -> Result<Self, InvalidName> {
                text.to_owned().try_into()
            }
        }

        impl From<&$name> for String {
            fn from(name: &$name) -> Self {
                name.0.clone()
            }
        }

        impl fmt::Display for $name {
            fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.pad(&self.0)
            }
        }

        impl Borrow<str> for $name {
            fn borrow(&self) -> &str {
                &self.0
            }
        }

        impl PartialEq<str> for $name {
            fn eq(&self, text: &str) -> bool {
                self.0 == text
            }
        }
    )*};
}

names! {
    /// The name of a stage: its key under `stages` in the pipeline file.
    ///
    /// ```
    /// use dataflow::StageName;
    ///
    /// assert!("screen_2".parse::<StageName>().is_ok());
    /// assert!("screen.rollouts".parse::<StageName>().is_err());
    /// ```
    StageName, "a stage", |text| match text {
        SHARED => Some("it is that of shared values"),
        _ => broken_word(text),
    };

    /// The name of an artifact, which is also that of its table.
    ///
    /// ```
    /// use dataflow::ArtifactName;
    ///
    /// assert!("rollouts".parse::<ArtifactName>().is_ok());
    /// assert!("".parse::<ArtifactName>().is_err());
    /// ```
    ArtifactName, "an artifact", broken_word;

    /// The key of a partition of an artifact, e.g. the name of an object. It also names folders.
    ///
    /// ```
    /// use dataflow::PartitionKey;
    ///
    /// assert!("025_mug".parse::<PartitionKey>().is_ok());
    /// assert!("object=025_mug".parse::<PartitionKey>().is_err());
    /// ```
    PartitionKey, "a partition", |text| {
        let is_key = !text.is_empty()
            && !text.starts_with('.')
            && !text.contains(['/', '\\', '\0', '=']);
        (!is_key)
            .then_some("keys are not empty, do not begin with a dot and have no `/`, `\\` or `=`")
            .or_else(|| too_long(text))
    };

    /// The name of a file of an artifact: one component of a path, never a path.
    ///
    /// ```
    /// use dataflow::FileName;
    ///
    /// assert!("part.parquet".parse::<FileName>().is_ok());
    /// assert!("../part.parquet".parse::<FileName>().is_err());
    /// ```
    FileName, "a file of an artifact", broken_component;

    /// The name of a pipeline: the stem of its file, which also names folders.
    ///
    /// ```
    /// use dataflow::PipelineName;
    ///
    /// assert!("cgf".parse::<PipelineName>().is_ok());
    /// assert!("..".parse::<PipelineName>().is_err());
    /// ```
    PipelineName, "a pipeline", broken_component;

    /// The kind of item that one partition holds: the column of its key in tables.
    ///
    /// ```
    /// use dataflow::ColumnName;
    ///
    /// assert!("object".parse::<ColumnName>().is_ok());
    /// assert!("a/b".parse::<ColumnName>().is_err());
    /// ```
    ColumnName, "a column", |text| broken_word(text)
        .or_else(|| (text.len() > LONGEST_COLUMN).then_some("names of columns have at most 50 bytes"));
}

/// Longest name of a column, in bytes: with a key and `=` it is the name of a folder, of at most 255.
const LONGEST_COLUMN: usize = 50;

/// Longest other name, in bytes: folders and locks are named after it, with a prefix or a suffix.
const LONGEST: usize = 200;

fn too_long(text: &str) -> Option<&'static str> {
    (text.len() > LONGEST)
        .then_some("names have at most 200 bytes: files and folders are named after them")
}

fn broken_word(text: &str) -> Option<&'static str> {
    let is_letter = |byte: u8| byte.is_ascii_alphanumeric() || matches!(byte, b'_' | b'-');
    let is_word = !text.is_empty() && text.bytes().all(is_letter);
    (!is_word)
        .then_some("use letters, digits, `_` and `-`")
        .or_else(|| too_long(text))
}

fn broken_component(text: &str) -> Option<&'static str> {
    let is_component = !matches!(text, "" | "." | "..")
        && !text.contains(['/', '\\'])
        && !text.contains(char::is_control);
    (!is_component)
        .then_some(
            "it is one name, not a path: no `/`, `\\` or control characters, not `.` or `..`",
        )
        .or_else(|| too_long(text))
}

/// Reads a text that must be a name of type `N`.
///
/// # Errors
///
/// Fails if it is none.
pub fn text_of<'de, N, D>(from: D) -> Result<String, D::Error>
where
    N: Deserialize<'de> + fmt::Display,
    D: serde::Deserializer<'de>,
{
    N::deserialize(from).map(|name| name.to_string())
}

impl ArtifactName {
    /// Returns the name of an artifact that a stage declares.
    pub(crate) fn declared(name: &'static str) -> Self {
        let fault = broken_word(name);
        assert!(fault.is_none(), "`{name}` is not a name for an artifact");
        Self(name.to_owned())
    }
}

/// One output of one stage, written `stage.artifact`.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
pub struct NodeName {
    /// The stage's name in the pipeline file.
    pub stage: StageName,
    /// The artifact's name.
    pub artifact: ArtifactName,
}

impl NodeName {
    /// Reads `stage.artifact`.
    pub fn parse(text: &str) -> Option<Self> {
        let (stage, artifact) = text.split_once('.')?;
        Some(Self {
            stage: stage.parse().ok()?,
            artifact: artifact.parse().ok()?,
        })
    }
}

impl fmt::Display for NodeName {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}.{}", self.stage, self.artifact)
    }
}

/// One partition of one output.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct UnitName {
    /// The output.
    pub node: NodeName,
    /// The partition's key.
    pub partition: PartitionKey,
}

impl UnitName {
    /// Names a unit.
    pub fn new(node: &NodeName, partition: &PartitionKey) -> Self {
        Self {
            node: node.clone(),
            partition: partition.clone(),
        }
    }
}

impl fmt::Display for UnitName {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} `{}`", self.node, self.partition)
    }
}
