//! Damaged files in a lake: a byte flipped behind an unchanged size and time, half a file, an empty
//! one.

use std::{
    collections::BTreeMap,
    fs::{self, File, Permissions},
    os::unix::fs::{MetadataExt, PermissionsExt},
    path::{Path, PathBuf},
    process::Command,
};

use rand::{Rng, seq::IndexedRandom};
use rand_chacha::ChaCha8Rng;

use crate::place::{
    CHAIN, Place, chances, files_below, number, published, put, read, stderr, stdout, well,
};

/// What is shown is the same files as the blobs, or copies that the next run replaces; nothing else
/// depends on the rest.
const NOT_KEPT: [&str; 5] = ["tables", "files", "views.sql", "staging", "locks"];

/// What happened to a file.
#[derive(Debug, Clone, Copy)]
enum Damage {
    Flip,
    Half,
    Empty,
}

/// Damages a random file that the lake keeps, as a failing disk does: its time stays the same. Returns
/// the file's path in the lake.
fn damage(
    rng: &mut ChaCha8Rng,
    lake: &Path,
    is_wanted: impl Fn(&Path) -> bool,
) -> (PathBuf, Damage) {
    let files = files_below(lake);
    let kept = files.iter().filter(|path| {
        let name = path.strip_prefix(lake).unwrap();
        let is_left = NOT_KEPT.iter().any(|left| name.starts_with(left));
        !is_left && is_wanted(name) && fs::metadata(path).unwrap().len() > 0
    });
    // Each folder has the same chance, however many files are in it.
    let mut by_folder: BTreeMap<_, Vec<&PathBuf>> = BTreeMap::new();
    for path in kept {
        let name = path.strip_prefix(lake).unwrap();
        by_folder.entry(name.iter().next()).or_default().push(path);
    }
    let folders: Vec<_> = by_folder.into_values().collect();
    let path = *folders.choose(rng).unwrap().choose(rng).unwrap();
    let what = *[Damage::Flip, Damage::Flip, Damage::Half, Damage::Empty]
        .choose(rng)
        .unwrap();
    let before = fs::metadata(path).unwrap();
    let mut bytes = read(path);
    match what {
        Damage::Flip => {
            let place = rng.random_range(0..bytes.len());
            bytes[place] ^= 1 << rng.random_range(0..8);
        }
        Damage::Half => bytes.truncate(bytes.len() / 2),
        Damage::Empty => bytes.clear(),
    }
    fs::set_permissions(path, Permissions::from_mode(0o644)).unwrap();
    put(path, &bytes);
    let file = File::options().write(true).open(path).unwrap();
    file.set_modified(before.modified().unwrap()).unwrap();
    fs::set_permissions(path, before.permissions()).unwrap();
    assert_eq!(
        fs::metadata(path).unwrap().mtime_nsec(),
        before.mtime_nsec()
    );
    (path.strip_prefix(lake).unwrap().to_owned(), what)
}

/// Copies a lake with times and hard links.
fn copy(from: &Path, to: &Path) {
    let mut command = Command::new("cp");
    command.arg("-a").arg(from).arg(to);
    well(command);
}

/// A lake with two runs in it, the newest with the values of the file.
fn place_with_a_lake() -> Place {
    let place = Place::with_inputs(CHAIN, 5);
    place.run_well(&["--set", "second.add=5"]);
    place.run_well(&[]);
    place
}

#[test]
fn verify_finds_every_damaged_file() {
    let mut rng = chances("verify");
    let place = place_with_a_lake();
    let lake = place.path("damaged");
    let mut missed = Vec::new();
    let n_times: usize = number("PIPELINE_FLIPS", 100);
    for _ in 0..n_times {
        copy(&place.lake(), &lake);
        let (name, what) = damage(&mut rng, &lake, |_| true);
        let verified = place.bare(&lake, "verify").output().unwrap();
        let said = stdout(&verified);
        let file = name.file_name().unwrap().to_string_lossy();
        if verified.status.code() != Some(1) || !said.contains(&*file) {
            let code = verified.status.code();
            missed.push(format!("{what:?} of {}: {code:?} {said}", name.display()));
        }
        fs::remove_dir_all(&lake).unwrap();
    }
    assert!(
        missed.is_empty(),
        "missed {} of {n_times}:\n{}",
        missed.len(),
        missed.join("\n")
    );
    let verified = well(place.bare(&place.lake(), "verify"));
    assert!(
        !stdout(&verified).contains("error"),
        "{}",
        stdout(&verified)
    );
}

#[test]
fn a_run_that_needs_a_damaged_file_makes_it_again() {
    const CHANGE: [&str; 2] = ["--set", "first.add=9"];
    let mut rng = chances("damage before use");
    let place = place_with_a_lake();
    let expected = place.undisturbed(&CHANGE);
    let lake = place.path("damaged");
    for _ in 0..number("PIPELINE_FLIPS", 60) {
        copy(&place.lake(), &lake);
        let (name, what) = damage(&mut rng, &lake, |_| true);
        let ran = place.command_in(&lake, "run", &CHANGE).output().unwrap();
        let context = format!("{what:?} of {}: {}", name.display(), stderr(&ran));
        assert_eq!(ran.status.code(), Some(0), "{context}");
        assert_eq!(published(&lake), expected, "{context}");
        fs::remove_dir_all(&lake).unwrap();
    }
}

#[test]
fn after_any_damage_a_fresh_run_leaves_a_clean_lake() {
    let mut rng = chances("damage before a fresh run");
    let place = place_with_a_lake();
    let expected = place.undisturbed(&[]);
    let lake = place.path("damaged");
    for _ in 0..number("PIPELINE_FLIPS", 20) {
        copy(&place.lake(), &lake);
        let (name, what) = damage(&mut rng, &lake, |name| name.starts_with("blobs"));
        let ran = place
            .command_in(&lake, "run", &["--fresh"])
            .output()
            .unwrap();
        let context = format!("{what:?} of {}: {}", name.display(), stderr(&ran));
        assert_eq!(ran.status.code(), Some(0), "{context}");
        assert_eq!(published(&lake), expected, "{context}");
        fs::remove_dir_all(&lake).unwrap();
    }
}
