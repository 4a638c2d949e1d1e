//! Under a limit of the address space every command ends well, or in an error that says what is lacking.

use std::{
    fs,
    process::{Command, Output},
};

use tempfile::TempDir;

use crate::program::bench::{put, stderr};

/// Less than the program itself takes, in megabytes, is refused by the system before it begins.
fn own_mb() -> u64 {
    fs::metadata(env!("CARGO_BIN_EXE_pipeline")).unwrap().len() / 1_000_000
}

/// Runs the program with so many megabytes of address space.
fn limited(folder: &TempDir, mb: u64, arguments: &[&str]) -> Output {
    let script = format!("ulimit -v {}; exec \"$@\"", mb * 1000);
    Command::new("sh")
        .current_dir(folder.path())
        .args(["-c", &script, "sh", env!("CARGO_BIN_EXE_pipeline")])
        .args(arguments)
        .output()
        .unwrap()
}

#[test]
fn little_memory_ends_in_a_clear_error() {
    let folder = TempDir::new().unwrap();
    put(
        &folder.path().join("p.toml"),
        "seed = 7\n[stages.rows]\nkind = \"program\"\ncommand = [\"sh\", \"-c\", \"exit 3\"]\nmakes = \"rows\"\n\
         columns.x = { type = \"number\" }\nmax_skipped_fraction = 1.0\n",
    );
    let run: &[&str] = &["run", "p.toml", "--lake", "lake"];
    let commands: [&[&str]; 6] = [
        &["stages"],
        run,
        &["plan", "p.toml", "--lake", "lake"],
        &["verify", "--lake", "lake"],
        &["query", "select count(*) from runs", "--lake", "lake"],
        &["runs", "--lake", "lake"],
    ];
    // A lake that the others can read.
    let made = limited(&folder, 1_000_000, run);
    assert!(
        folder.path().join("lake/runs").exists(),
        "{}",
        stderr(&made)
    );
    let (mut n_refused, mut n_done) = (0, 0);
    for more in [25, 40, 60, 80, 100, 130, 180, 250, 400, 1300] {
        let mb = own_mb() + more;
        for arguments in commands {
            let ran = limited(&folder, mb, arguments);
            let said = stderr(&ran);
            let of = format!("{arguments:?} with {mb} MB: {said}");
            // No signal, and no panic.
            let code = ran
                .status
                .code()
                .unwrap_or_else(|| panic!("{:?}: {of}", ran.status));
            for part in ["panicked", "backtrace", "allocation of"] {
                assert!(!said.contains(part), "{of}");
            }
            if code == 1 && said.contains("memory") {
                n_refused += 1;
                assert!(
                    said.contains("`ulimit -v` allows ") && said.contains("hint: "),
                    "{of}"
                );
            } else {
                n_done += 1;
                assert!([0, 1, 3].contains(&code), "{of}");
                assert!(code != 1 || arguments == run, "{of}");
            }
        }
    }
    assert!(n_refused > 0 && n_done > 20, "{n_refused} {n_done}");
}
