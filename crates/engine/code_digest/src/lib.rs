//! Digests of the code that decides a stage's results, for the build script of a program.
//!
//! The build script is one call: [`emit`]. It digests each crate of the workspace that the program
//! depends on, and the program reads them by name, `dataflow::code!("stage-retarget")`.
//!
//! A crate's code has a part for the crate itself, one for each crate of the workspace that it links,
//! and one for the locked versions of everything else. A part is a digest of the *tokens* below `src/`:
//! comments, documentation, layout and tests do not count, and of the manifest only what decides the
//! build. A file that a source includes counts by its bytes. No version number is bumped by hand.
//!
//! The manifest can say more:
//!
//! ```toml
//! [package.metadata.code]
//! reports = ["src/report.rs"] # for people: this module, with its folder, decides no result
//! decides = ["src/table.rs"]  # of an engine: only these files decide results
//! ```
//!
//! Reports are outputs of their own, with a code of their own (`report-retarget`). A crate that no
//! module but that of reports names, such as `charts`, is in theirs alone. What could let a report
//! change a result ends the build: another module that names the reports' (they are public under their
//! own name, and not exported again), and in a report a macro or an `impl` for a type of another module.
//!
//! What it deliberately leaves out: tests and benches outside `src/`, development dependencies, and the
//! compiler. It expects of macros that they do not read documentation.

mod locked;
mod member;
mod source;
mod tokens;
mod workspace;

use std::{env, fs, path::Path};

use toml_edit::DocumentMut;
pub use workspace::{Code, Part, Workspace};

/// Result of reading a crate; an error is a sentence for the output of the build, which nothing matches on.
pub type Result<T> = std::result::Result<T, String>;

/// Writes the code of every crate of the workspace that the program depends on to a variable,
/// `PIPELINE_CODE_` and its name, and asks cargo to run the script again when one of the sources changes.
///
/// # Panics
///
/// Panics if a source cannot be read, which fails the build with that message.
pub fn emit() {
    let folder = env::var("CARGO_MANIFEST_DIR").unwrap_or_else(|_| ".".to_owned());
    let instructions = instructions(folder.as_ref()).unwrap_or_else(|err| fail(&err));
    say(&instructions);
}

fn instructions(folder: &Path) -> Result<String> {
    let mut workspace = Workspace::of(folder)?;
    let mut lines = String::new();
    for code in workspace.linked(folder)? {
        let parts = code.parts.iter();
        let parts: Vec<String> = parts
            .map(|part| format!("{}={}", part.name, part.digest))
            .collect();
        let (name, parts) = (code.name, parts.join(";"));
        lines += &format!("cargo::rustc-env=PIPELINE_CODE_{name}={parts}\n");
    }
    for path in workspace.watched() {
        lines += &format!("cargo::rerun-if-changed={}\n", path.display());
    }
    Ok(lines)
}

#[expect(
    clippy::print_stdout,
    reason = "a build script talks to cargo on stdout"
)]
fn say(instructions: &str) {
    print!("{instructions}");
}

#[expect(clippy::panic, reason = "a build script fails by panicking")]
fn fail(err: &str) -> ! {
    panic!("{err}")
}

fn read(path: &Path) -> Result<String> {
    fs::read_to_string(path).map_err(|err| format!("cannot read `{}`: {err}", path.display()))
}

fn read_toml(path: &Path) -> Result<DocumentMut> {
    let parsed = read(path)?.parse();
    parsed.map_err(|err| format!("cannot parse `{}`: {err}", path.display()))
}
