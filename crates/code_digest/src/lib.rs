//! Digests of the sources that a crate's results depend on, for its build script.
//!
//! A crate's `build.rs` is one call: [`emit`].
//!
//! The digest covers, crate by crate, `Cargo.toml` and every file below `src/` of the crate itself
//! and of the workspace crates that it depends on, and the locked versions of everything else that
//! those depend on. A crate with only some files that affect results (the engine, the lake) names
//! them in its manifest: `[package.metadata.code] decides = ["src/table.rs"]`. No version number is
//! bumped by hand: editing a source changes only that crate's digest, and crates that do not link
//! it keep their results.
//!
//! A crate's results cannot depend on code that it does not link. A stage's reports are therefore a
//! separate crate (`stages/STAGE/report`) that links the stage, so that editing them, or their
//! charts, does not change the digest of the stage's results.
//!
//! What it deliberately leaves out: documentation, tests and benches outside `src/`, development
//! dependencies, and the compiler.

mod locked;
mod workspace;

pub use workspace::{CodeError, Part, parts};

/// Name of the environment variable that passes the digests to the crate being built.
const VARIABLE: &str = "PIPELINE_CODE";

/// Writes the digests of the crate whose build script calls this to `PIPELINE_CODE`, and asks cargo
/// to run the script again when one of the sources changes.
///
/// # Panics
///
/// Panics if a source cannot be read, which fails the build with that message.
pub fn emit() {
    let folder = std::env::var("CARGO_MANIFEST_DIR").unwrap_or_else(|_| ".".to_owned());
    let parts = parts(folder.as_ref()).unwrap_or_else(|err| fail(&err));
    let line: Vec<String> = parts
        .iter()
        .map(|part| format!("{}={}", part.name, part.digest))
        .collect();
    for path in parts.iter().flat_map(|part| &part.watched) {
        say(&format!("cargo::rerun-if-changed={}", path.display()));
    }
    say(&format!("cargo::rustc-env={VARIABLE}={}", line.join(";")));
}

#[expect(
    clippy::print_stdout,
    reason = "a build script talks to cargo on stdout"
)]
fn say(instructions: &str) {
    println!("{instructions}");
}

#[expect(clippy::panic, reason = "a build script fails by panicking")]
fn fail(err: &CodeError) -> ! {
    panic!("{err}")
}
