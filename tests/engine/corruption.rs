//! Damaged files in a lake: a byte flipped behind an unchanged size and time, half a file, an empty
//! one. `PIPELINE_FLIPS` sets their number.

use std::{
    collections::{BTreeMap, BTreeSet},
    fs::{self, File},
    os::unix::fs::MetadataExt,
    path::{Path, PathBuf},
    time::Duration,
};

use rand::{Rng, seq::IndexedRandom};
use rand_chacha::ChaCha8Rng;

use crate::engine::place::{
    CHAIN, Place, assert_same, chances, files_below, number, read, stderr, stdout, well,
    write_unnoticed,
};

/// Paths that are not damaged. Published files are the same files as the blobs, or copies that the
/// next run replaces; nothing else depends on the rest.
const NOT_KEPT: [&str; 6] = ["tables", "files", "every", "views.sql", "staging", "locks"];

/// Kind of damage to a file.
#[derive(Debug, Clone, Copy)]
enum What {
    Flip,
    Half,
    Empty,
}

/// A damaged file.
struct Damage {
    path: PathBuf,
    what: What,
    before: Vec<u8>,
}

impl Damage {
    /// Damages a random file that the lake keeps, behind an unchanged time.
    fn draw(rng: &mut ChaCha8Rng, lake: &Path) -> Self {
        let path = kept_files(lake)
            .choose(rng)
            .unwrap()
            .choose(rng)
            .unwrap()
            .clone();
        let what = *[What::Flip, What::Flip, What::Half, What::Empty]
            .choose(rng)
            .unwrap();
        let before = read(&path);
        let mut bytes = before.clone();
        match what {
            What::Flip => {
                let place = rng.random_range(0..bytes.len());
                bytes[place] ^= 1 << rng.random_range(0..8);
            }
            What::Half => bytes.truncate(bytes.len() / 2),
            What::Empty => bytes.clear(),
        }
        write_unnoticed(&path, &bytes);
        Self { path, what, before }
    }

    fn undo(self) {
        write_unnoticed(&self.path, &self.before);
    }

    /// Returns the damage and the file's path.
    fn name(&self, lake: &Path) -> String {
        let name = self.path.strip_prefix(lake).unwrap();
        format!("{:?} {}", self.what, name.display())
    }
}

/// The files that may be damaged, by folder, so that each folder has the same chance however many
/// files are in it. Of the blobs those in use are taken, of which there are always some.
fn kept_files(lake: &Path) -> Vec<Vec<PathBuf>> {
    let inode = |path: &Path| fs::metadata(path).unwrap().ino();
    let all = files_below(lake);
    let is_shown = |path: &&PathBuf| {
        let name = path.strip_prefix(lake).unwrap();
        name.starts_with("tables") || name.starts_with("files")
    };
    let shown: BTreeSet<u64> = all
        .iter()
        .filter(is_shown)
        .map(|path| inode(path))
        .collect();
    let mut by_folder: BTreeMap<_, Vec<PathBuf>> = BTreeMap::new();
    for path in &all {
        let name = path.strip_prefix(lake).unwrap();
        let is_kept = !NOT_KEPT.iter().any(|left| name.starts_with(left));
        let is_in_use = !name.starts_with("blobs") || shown.contains(&inode(path));
        if is_kept && is_in_use && fs::metadata(path).unwrap().len() > 0 {
            by_folder
                .entry(name.iter().next())
                .or_default()
                .push(path.clone());
        }
    }
    by_folder.into_values().collect()
}

/// A lake with two runs in it, the newest with the values of the file.
fn place_with_a_lake() -> Place {
    let place = Place::with_inputs(CHAIN, 5);
    // Digests of files that have not changed for long are remembered.
    for path in files_below(&place.inputs()) {
        let file = File::options().write(true).open(path).unwrap();
        let written = file.metadata().unwrap().modified().unwrap();
        file.set_modified(written - Duration::from_hours(1))
            .unwrap();
    }
    place.run_well(&["--set", "second.add=5"]);
    place.run_well(&[]);
    place
}

#[test]
fn verify_finds_every_damaged_file() {
    let mut rng = chances("verify");
    let place = place_with_a_lake();
    let lake = place.lake();
    let n_times: usize = number("PIPELINE_FLIPS", 100);
    let mut missed = Vec::new();
    for _ in 0..n_times {
        let damage = Damage::draw(&mut rng, &lake);
        let verified = place.bare(&lake, "verify").output().unwrap();
        let said = stdout(&verified);
        let file = damage.path.file_name().unwrap().to_string_lossy();
        if verified.status.code() != Some(1) || !said.contains(&*file) {
            let code = verified.status.code();
            missed.push(format!("{}: {code:?} {said}", damage.name(&lake)));
        }
        damage.undo();
    }
    let n_missed = missed.len();
    missed.truncate(20);
    let missed = missed.join("\n");
    assert_eq!(n_missed, 0, "missed of {n_times}:\n{missed}");
    well(place.bare(&lake, "verify"));
}

#[test]
fn a_run_that_needs_a_damaged_file_makes_it_again() {
    let mut rng = chances("damage before use");
    let mut place = Place::new("");
    for time in 0..number("PIPELINE_FLIPS", 40) {
        // Each time a value is new to the lake, so that the first stage's output is read.
        let add = 10 + time % 240;
        if add == 10 {
            place = place_with_a_lake();
        }
        let change = format!("first.add={add}");
        let change = [
            "--set",
            &change,
            "--set",
            &format!("gather.min_bytes={time}"),
        ];
        let damage = Damage::draw(&mut rng, &place.lake());
        let ran = place.command("run", &change).output().unwrap();
        let context = format!("{}: {}", damage.name(&place.lake()), stderr(&ran));
        assert_eq!(ran.status.code(), Some(0), "{context}");
        assert_same(&place.published(), &place.undisturbed(&change), &context);
    }
}

#[test]
fn after_any_damage_a_fresh_run_is_right() {
    let mut rng = chances("damage before a fresh run");
    let place = place_with_a_lake();
    let expected = place.undisturbed(&[]);
    for _ in 0..number("PIPELINE_FLIPS", 20) {
        let damage = Damage::draw(&mut rng, &place.lake());
        let ran = place.command("run", &["--fresh"]).output().unwrap();
        let context = format!("{}: {}", damage.name(&place.lake()), stderr(&ran));
        assert_eq!(ran.status.code(), Some(0), "{context}");
        assert_same(&place.published(), &expected, &context);
    }
}
