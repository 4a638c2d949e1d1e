//! The maps of a pipeline as programs, so that the engine's properties are tested over programs too.

use std::path::{Path, PathBuf};

/// The stage `map` as a program.
pub(crate) const MAP_PROGRAM: &str = include_str!("../own_stages/map.sh");

/// Kind of the maps of a pipeline.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Maps {
    /// Stages.
    Stages,
    /// Programs, which do the same.
    Programs,
}

impl Maps {
    /// Returns a pipeline, written with stages, with these.
    pub(crate) fn of(self, pipeline: &str) -> String {
        if self == Self::Stages {
            return pipeline.to_owned();
        }
        let script = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("tests/own_stages/map.sh");
        let mut text = String::new();
        let mut is_map = false;
        for line in pipeline.lines() {
            if line.starts_with("kind =") {
                is_map = line == r#"kind = "map""#;
            }
            match line {
                r#"kind = "map""# => {
                    text.push_str("kind = \"program\"\n");
                    text.push_str(&program_table(&script));
                }
                // Programs make no table beside the bytes.
                "table = true" if is_map => {}
                line if is_map && line.starts_with("add =") => {
                    text.push_str(&format!("options.{line}\n"));
                }
                line => {
                    text.push_str(line);
                    text.push('\n');
                }
            }
        }
        text
    }

    /// Returns the key of the option `add` of a map.
    pub(crate) fn add(self) -> &'static str {
        match self {
            Self::Stages => "add",
            Self::Programs => "options.add",
        }
    }
}

/// Returns the keys of the table of a program that maps, beside its kind, its inputs and its
/// options.
pub(crate) fn program_table(script: &Path) -> String {
    let script = script.display();
    format!("command = [\"sh\", \"{script}\"]\nmakes = \"parts\"\neach = \"parts\"\n")
}
