//! What a program's options name beside its inputs and is not there: said before anything is made, all of it, each
//! with its line.

use std::{fs, os::unix::fs::symlink, process::Command};

use super::{TABLE, place, place_of};
use crate::engine::place::{Place, stderr, stdout};

/// The faults and their lines in the pipeline file.
const FAULTS: [(&str, &str); 5] = [
    (
        "`code` names `none/*.py`, which is no file here",
        "none/*.py",
    ),
    (
        "`lock` names `requirements.txt`, which is no file here",
        "requirements.txt",
    ),
    (
        "`files.hand` names `data/hand.bin`, which is no file here",
        "data/hand.bin",
    ),
    (
        "`files.pipe` names `pipe`, which is neither a file nor a folder",
        "\"pipe\"",
    ),
    (
        "`files.round` names a folder in which `round/again` leads back",
        "\"round\"",
    ),
];

fn lacking() -> Place {
    let options = "code = [\n    \"SCRIPT\",\n    \"none/*.py\",\n]\nlock = \"requirements.txt\"\n\
                   files.hand = \"data/hand.bin\"\nfiles.pipe = \"pipe\"\nfiles.round = \"round\"\ntimeout_s";
    let place = place_of(&TABLE.replacen("timeout_s", options, 1), "true");
    let made = Command::new("mkfifo").arg(place.path("pipe")).status();
    assert!(made.unwrap().success());
    fs::create_dir(place.path("round")).unwrap();
    symlink(".", place.path("round/again")).unwrap();
    place
}

#[test]
fn what_a_later_program_names_and_lacks_is_said_before_anything_is_made() {
    let place = lacking();
    let text = fs::read_to_string(place.pipeline()).unwrap();
    let line = |part: &str| {
        let before = text.lines().position(|line| line.contains(part)).unwrap();
        format!("own.toml:{}", before + 1)
    };
    for command in ["plan", "run"] {
        let ran = place.command(command, &[]).output().unwrap();
        let said = stderr(&ran);
        assert_eq!(ran.status.code(), Some(2), "{command}: {said}");
        for (message, part) in FAULTS {
            assert!(
                said.contains(&format!("stage `lines`: {message}")),
                "{message}: {said}"
            );
            assert!(said.contains(&line(part)), "{message}: {said}");
        }
        assert!(place.log().is_empty(), "{command}");
    }
    let ran = place.command("doctor", &[]).output().unwrap();
    let said = stdout(&ran);
    assert_eq!(ran.status.code(), Some(1), "{said}");
    for (message, part) in FAULTS {
        let row = said.lines().find(|row| row.contains(message));
        let row = row.unwrap_or_else(|| panic!("{message}: {said}"));
        assert!(row.starts_with("missing  lines"), "{row}");
        assert!(row.ends_with(&line(part)), "{row}");
    }
    // What is not asked for needs nothing.
    place.run_well(&["--until", "split"]);
}

#[test]
fn a_value_given_beside_the_file_is_named_there() {
    let place = place("true");
    let given = ["--set", "lines.files.hand=\"hand.bin\""];
    let ran = place.command("plan", &given).output().unwrap();
    let said = stderr(&ran);
    assert_eq!(ran.status.code(), Some(2), "{said}");
    assert!(said.contains("--> the command line"), "{said}");
    assert!(said.contains("`files.hand` names `hand.bin`"), "{said}");
}
