//! A program with stages of its own: the commands of `pipeline`, other kinds of stages.
//!
//! This is all that a lab needs beside its stages; `pipeline::kinds()` would add the bundled ones.
//! The engine's tests and its bench run this program, since its stages cost nothing.
//!
//! ```sh
//! cargo run --release --workspace --example own_stages -- stages
//! ```

#[path = "stages.rs"]
mod stages;

use std::{env, process::ExitCode};

fn main() -> ExitCode {
    pipeline::command_line(&stages::kinds_with(version))
}

/// The version of a kind: the variable `OWN_STAGES_CODE`, e.g. `map=2,split=1`, stands for an edit of
/// its sources.
fn version(kind: &str) -> u8 {
    let chosen = env::var("OWN_STAGES_CODE").unwrap_or_default();
    let mut choices = chosen
        .split(',')
        .filter_map(|choice| choice.split_once('='));
    match choices.find(|(name, _)| *name == kind) {
        Some((_, "2")) => 2,
        _ => 1,
    }
}
