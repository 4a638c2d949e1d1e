//! Something else than a file or a folder lies in the place of one in the lake: a pipe, a folder, a file, a link in a
//! circle, to nowhere, to a device or to a pipe, a socket. No command waits for it or panics, and a run heals it or
//! names it with the command that does. `PIPELINE_IN_THE_WAY` sets how many are tried.

use std::{
    fs,
    os::unix::{fs::symlink, net::UnixListener},
    path::{Path, PathBuf},
    process::Command,
    time::Duration,
};

use rand::seq::IndexedRandom;

use crate::engine::place::{CHAIN, Place, chances, number, program, put, read, well};

/// A command that takes longer waits for something.
const HANGS: Duration = Duration::from_mins(1);

/// Places in a lake: `*` is any name in its folder. What a lake has only at times stands there before.
const PLACES: [&str; 45] = [
    "again.json",
    "blobs",
    "blobs/*",
    "blobs/*/*",
    "changing",
    "copies",
    "copies/manifests",
    "copies/manifests/*",
    "copies/recipes/*",
    "copies/runs/*",
    "copies/tags/*",
    "detached",
    "effects",
    "every",
    "every/*",
    "every/*/*/*/*",
    "files",
    "files/*/*/*/*",
    "files/*/*/*/*/*",
    "identity",
    "locks",
    "locks/*",
    "logs",
    "manifests",
    "manifests/*",
    "newest",
    "newest/*",
    "outbox",
    "recipes",
    "recipes/*",
    "reports",
    "resume",
    "runs",
    "runs/*",
    "seen.cache",
    "sources.cache",
    "staging",
    "tables",
    "tables/runs/*",
    "tables/runs/*/*",
    "tables/parts/*/*/*/*",
    "tags",
    "tags/*",
    "units/*/*",
    "views.sql",
];

/// What lies there instead.
const THINGS: [&str; 10] = [
    "pipe",
    "folder",
    "full folder",
    "file",
    "circle",
    "nowhere",
    "device",
    "endless device",
    "link to a pipe",
    "socket",
];

fn lay(thing: &str, path: &Path, aside: &Path) {
    match fs::symlink_metadata(path) {
        Ok(found) if found.is_dir() => fs::remove_dir_all(path).unwrap(),
        Ok(_) => fs::remove_file(path).unwrap(),
        Err(_) => fs::create_dir_all(path.parent().unwrap()).unwrap(),
    }
    let pipe = |path: &Path| {
        let made = Command::new("mkfifo").arg(path).status().unwrap();
        assert!(made.success());
    };
    match thing {
        "pipe" => pipe(path),
        "folder" => fs::create_dir(path).unwrap(),
        "full folder" => {
            fs::create_dir(path).unwrap();
            put(&path.join("inside"), b"inside");
        }
        "file" => put(path, b"a file"),
        "circle" => symlink(path, path).unwrap(),
        "nowhere" => symlink(aside.join("nowhere"), path).unwrap(),
        "device" => symlink("/dev/null", path).unwrap(),
        "endless device" => symlink("/dev/zero", path).unwrap(),
        "link to a pipe" => {
            pipe(&aside.join("a_pipe"));
            symlink(aside.join("a_pipe"), path).unwrap();
        }
        "socket" => {
            // Its name may be longer than a socket's may be.
            let short = aside.join("s");
            drop(UnixListener::bind(&short).unwrap());
            fs::rename(short, path).unwrap();
        }
        other => unreachable!("{other}"),
    }
}

/// The first path that a pattern of names matches, or itself.
fn found(lake: &Path, pattern: &str) -> Option<PathBuf> {
    let mut path = lake.to_owned();
    for name in pattern.split('/') {
        path = if name == "*" {
            let mut entries: Vec<PathBuf> = fs::read_dir(&path)
                .ok()?
                .map(|entry| entry.unwrap().path())
                .collect();
            entries.sort();
            entries.into_iter().next()?
        } else {
            path.join(name)
        };
    }
    Some(path)
}

/// Runs a command of the program within a limit of time; returns its exit code and what it says.
fn said(place: &Place, arguments: &[&str]) -> (i32, String) {
    let mut command = Command::new("timeout");
    command
        .args(["--signal=KILL", &HANGS.as_secs().to_string()])
        .arg(program())
        .args(arguments)
        .args(["--lake", "lake"])
        .current_dir(place.path(""))
        .env("OWN_STAGES_LOG", place.log_file())
        .env_remove("PIPELINE_DEPOT");
    let ran = command.output().unwrap();
    let text = [ran.stdout, ran.stderr].concat();
    let text = String::from_utf8_lossy(&text).into_owned();
    let code = ran.status.code().unwrap_or(-1);
    assert!(
        code != 137 && code >= 0,
        "{arguments:?} hangs or is killed ({code}): {text}"
    );
    assert!(!text.contains("panicked"), "{arguments:?}: {text}");
    (code, text)
}

/// Returns the command in a hint that moves something away.
fn command_in(text: &str) -> Option<&str> {
    let (_, rest) = text.split_once("`mv ")?;
    let (command, _) = rest.split_once('`')?;
    Some(command)
}

/// Does what a hint says.
fn moved(place: &Place, command: &str) {
    let mut shell = Command::new("sh");
    shell
        .args(["-c", &format!("mv {command}")])
        .current_dir(place.path(""));
    assert!(shell.status().unwrap().success(), "{command}");
}

/// Runs and verifies, and does what is advised, until nothing is.
fn is_healed(place: &Place, context: &str) {
    let mut text = String::new();
    for _ in 0..3 {
        let (code, said_by_run) = said(place, &["run", "own.toml"]);
        assert_eq!(code, 0, "{context}: {said_by_run}");
        let verified = said(place, &["verify"]);
        if verified.0 == 0 {
            return;
        }
        text = verified.1;
        if text.contains("`pipeline verify --drop`") {
            text += &said(place, &["verify", "--drop"]).1;
        }
        if let Some(command) = command_in(&text) {
            moved(place, command);
        }
    }
    panic!("{context}: {text}");
}

#[test]
fn what_is_no_file_is_not_waited_for_and_can_be_healed() {
    let place = Place::with_inputs(CHAIN, 2);
    place.run_well(&[]);
    let mut tag = place.bare(&place.lake(), "tag");
    tag.args(["1", "good"]);
    well(tag);
    let (kept, lake) = (place.path("kept"), place.lake());
    fs::rename(&lake, &kept).unwrap();
    let pairs: Vec<(&str, &str)> = PLACES
        .iter()
        .flat_map(|at| THINGS.iter().map(move |thing| (*at, *thing)))
        .collect();
    let n_pairs = number("PIPELINE_IN_THE_WAY", 20_usize);
    let mut rng = chances("in the way");
    for (at, thing) in pairs.choose_multiple(&mut rng, n_pairs) {
        let copied = Command::new("cp").arg("-a").arg(&kept).arg(&lake).status();
        assert!(copied.unwrap().success());
        let aside = place.path("aside");
        fs::create_dir(&aside).unwrap();
        let path = found(&lake, at).unwrap_or_else(|| panic!("a lake has no {at}"));
        lay(thing, &path, &aside);
        let context = format!("{thing} at {at}");
        for arguments in [
            &["plan", "own.toml"][..],
            &["runs"],
            &["query", "select count(*) from all_parts"],
            &["query", "select status from runs"],
            &["inspect", "split.parts", "p000"],
            &["lineage", "gather.whole"],
            &["gc", "--dry-run"],
            &["verify"],
        ] {
            let (code, text) = said(&place, arguments);
            let has_advice = code == 0 || text.contains("hint: ");
            assert!(has_advice, "{context}: {arguments:?} ({code}): {text}");
        }
        let (code, text) = said(&place, &["run", "own.toml"]);
        if code != 0 {
            let name = path.file_name().unwrap().to_str().unwrap();
            assert!(text.contains(name), "{context}: {text}");
            if let Some(command) = command_in(&text) {
                moved(&place, command);
            } else {
                assert!(
                    text.contains("`pipeline verify --drop`"),
                    "{context}: {text}"
                );
                said(&place, &["verify", "--drop"]);
            }
        }
        is_healed(&place, &context);
        assert_eq!(
            read(&kept.join("views.sql")),
            read(&lake.join("views.sql")),
            "{context}"
        );
        let removed = Command::new("sh")
            .args(["-c", "rm -rf lake lake.* aside"])
            .current_dir(place.path(""))
            .status();
        assert!(removed.unwrap().success());
    }
}
