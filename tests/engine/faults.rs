//! Faults of whole files anywhere in a lake: deleted, emptied, exchanged, replaced, foreign, or a
//! bit flipped behind an unchanged size and time. `PIPELINE_FAULTS` sets their number.

use std::{
    collections::{BTreeMap, BTreeSet},
    fs::{self, File},
    os::unix::fs::MetadataExt,
    path::{Path, PathBuf},
    process::Output,
};

use rand::{Rng, seq::IndexedRandom};
use rand_chacha::ChaCha8Rng;

use crate::engine::place::{
    CHAIN, Place, chances, files_below, number, put, read, stderr, stdout, well, write_unnoticed,
};

/// Questions about every kind of table, and the run that they are about.
const QUESTIONS: [(&str, &[&str]); 6] = [
    (
        "select stage, part, name, bytes, sum from parts order by stage, part",
        &[],
    ),
    (
        "select stage, part, name, bytes, sum from parts order by stage, part",
        &["--run", "old"],
    ),
    (
        "select run, stage, part, fingerprint, sum from all_parts order by run, stage, part",
        &[],
    ),
    (
        "select run, stage, partition, metric, value from metrics \
         order by run, stage, partition, metric",
        &[],
    ),
    (
        "select u.run, u.stage, u.partition, u.result, r.status, a.file, a.digest from units u \
         join runs r on r.run = u.run join artifacts a on a.run = u.run and a.stage = u.stage \
         and a.partition = u.partition order by u.run, u.stage, u.partition, a.file",
        &[],
    ),
    (
        "select run, stage, key, value from settings order by run, stage, key",
        &[],
    ),
];

/// Folders of published files.
const SHOWN: [&str; 4] = ["tables", "files", "reports", "every"];

/// Caches: without one the next run only takes longer.
const CACHES: [&str; 3] = ["newest", "seen.cache", "sources.cache"];

/// Kind of fault of a file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum What {
    Deleted,
    Emptied,
    Flipped,
    /// Two files of one folder have changed names.
    Exchanged,
    /// The bytes of another file of the folder lie there.
    Replaced,
    /// A copy of the file lies beside it under another name.
    Foreign,
}

const WHAT: [What; 6] = [
    What::Deleted,
    What::Emptied,
    What::Flipped,
    What::Exchanged,
    What::Replaced,
    What::Foreign,
];

struct Fault {
    what: What,
    /// The file, below the lake.
    name: PathBuf,
    /// Whether `verify` has to find it.
    matters: bool,
    /// Whether bytes are lost that no run of the pipeline makes again.
    is_final: bool,
}

impl Fault {
    /// Harms a random file, each folder with the same chance; `None` where there is nothing with which
    /// to exchange it.
    fn draw(rng: &mut ChaCha8Rng, lake: &Path) -> Option<Self> {
        let folders = files_by_folder(lake);
        let files = folders.choose(rng).unwrap();
        let path = files.choose(rng).unwrap();
        let what = *WHAT.choose(rng).unwrap();
        let bytes = read(path);
        let others: Vec<&PathBuf> = files.iter().filter(|other| read(other) != bytes).collect();
        let name = path.strip_prefix(lake).unwrap().to_owned();
        let is = |folders: &[&str]| folders.iter().any(|folder| name.starts_with(folder));
        let is_old = name.starts_with("units") && !is_needed(lake, path);
        let is_shown_nowhere = is_old && !String::from_utf8_lossy(&bytes).contains("part.parquet");
        let other = match what {
            What::Exchanged | What::Replaced => Some(*others.choose(rng)?),
            What::Deleted | What::Emptied | What::Flipped | What::Foreign => None,
        };
        let exchanged = other.filter(|_| what == What::Exchanged);
        let mut harmed = [Some(path), exchanged].into_iter().flatten();
        let fault = Self {
            what,
            matters: what != What::Deleted || !(is(&CACHES) || is(&["copies"]) || is_shown_nowhere),
            is_final: what != What::Foreign && harmed.any(|path| is_lost(lake, path, what)),
            name: name.clone(),
        };
        match what {
            What::Deleted => fs::remove_file(path).unwrap(),
            What::Emptied => write_unnoticed(path, b""),
            What::Flipped => {
                let mut flipped = bytes;
                if flipped.is_empty() {
                    return None;
                }
                let place = rng.random_range(0..flipped.len());
                flipped[place] ^= 1 << rng.random_range(0..8);
                write_unnoticed(path, &flipped);
            }
            What::Exchanged => {
                let other = other?;
                let aside = lake.join("aside");
                fs::rename(path, &aside).unwrap();
                fs::rename(other, path).unwrap();
                fs::rename(&aside, other).unwrap();
            }
            What::Replaced => {
                let bytes = read(other?);
                let written = fs::metadata(path).unwrap().modified().unwrap();
                fs::remove_file(path).unwrap();
                put(path, &bytes);
                let file = File::options().write(true).open(path).unwrap();
                file.set_modified(written).unwrap();
            }
            What::Foreign => {
                let beside = foreign(lake, path)?;
                fs::create_dir_all(beside.parent().unwrap()).unwrap();
                put(&beside, &bytes);
            }
        }
        Some(fault)
    }

    fn describe(&self) -> String {
        format!("{:?} {}", self.what, self.name.display())
    }
}

/// The files that may be harmed, by folder.
fn files_by_folder(lake: &Path) -> Vec<Vec<PathBuf>> {
    let mut by_folder: BTreeMap<Option<PathBuf>, Vec<PathBuf>> = BTreeMap::new();
    for path in files_below(lake) {
        let name = path.strip_prefix(lake).unwrap();
        if name.starts_with("locks") || name.starts_with("staging") {
            continue;
        }
        let mut folders = name.parent().unwrap().iter();
        // Tables of runs and of artifacts, and files with copies, are each a separate folder.
        let folder = folders.next().map(|first| match folders.next() {
            Some(second) if first == "tables" || first == "copies" => Path::new(first).join(second),
            _ => PathBuf::from(first),
        });
        by_folder.entry(folder).or_default().push(path);
    }
    by_folder.into_values().collect()
}

/// A name beside a file that the lake has no use for.
fn foreign(lake: &Path, path: &Path) -> Option<PathBuf> {
    let name = path.strip_prefix(lake).unwrap();
    let folder = path.parent().unwrap();
    if name.iter().count() == 1 {
        return None;
    }
    if SHOWN.iter().any(|shown| name.starts_with(shown)) {
        let above = folder.file_name().unwrap().to_str().unwrap();
        let other = match above.split_once('=') {
            Some(("run", _)) => "run=99".to_owned(),
            Some((column, value)) => format!("{column}={}x", &value[1..]),
            None => "foreign".to_owned(),
        };
        return Some(folder.with_file_name(other).join(path.file_name().unwrap()));
    }
    let file = path.file_name().unwrap().to_str().unwrap();
    let first = if file.starts_with('9') { '8' } else { '9' };
    Some(folder.join(format!("{first}{}", &file[1..])))
}

fn inode(path: &Path) -> u64 {
    fs::metadata(path).unwrap().ino()
}

/// Whether the newest run has the unit of a record.
fn is_needed(lake: &Path, record: &Path) -> bool {
    let unit = record.file_stem().unwrap().to_str().unwrap();
    let runs = files_below(&lake.join("runs"));
    let newest = String::from_utf8(read(runs.last().unwrap())).unwrap();
    let lists = files_below(&lake.join("manifests"));
    let mut lists = lists
        .iter()
        .filter(|list| newest.contains(list.file_stem().unwrap().to_str().unwrap()));
    lists.any(|list| String::from_utf8(read(list)).unwrap().contains(unit))
}

/// Whether something that only old runs made is lost when this happens to a file.
fn is_lost(lake: &Path, path: &Path, what: What) -> bool {
    let name = path.strip_prefix(lake).unwrap();
    if name.starts_with("units") {
        return !is_needed(lake, path);
    }
    // A file that is linked elsewhere is put back, unless its bytes are changed in place.
    let is_in_place = matches!(what, What::Emptied | What::Flipped);
    let is_only_one = fs::metadata(path).unwrap().nlink() == 1;
    (is_in_place || is_only_one) && is_old_blob(lake, path)
}

/// Whether a file is, or is linked to, bytes that only old runs made.
fn is_old_blob(lake: &Path, path: &Path) -> bool {
    let is_linked = |folder: &str| {
        let files = files_below(&lake.join(folder));
        files.iter().any(|file| inode(file) == inode(path))
    };
    let is_copied = || {
        let tables = files_below(&lake.join("tables"));
        tables.iter().any(|file| read(file) == read(path))
    };
    let is_newest = ["tables", "files", "reports"].into_iter().any(is_linked);
    is_linked("blobs") && !is_newest && !is_copied()
}

/// A lake with two runs in it, the newest with the values of the file, the other tagged.
fn place_with_a_lake() -> Place {
    let place = Place::with_inputs(CHAIN, 4);
    place.run_well(&["--set", "first.add=5"]);
    let mut tag = place.bare(&place.lake(), "tag");
    tag.args(["1", "old"]);
    well(tag);
    place.run_well(&[]);
    place.run_well(&[]);
    well(place.bare(&place.lake(), "verify"));
    place
}

fn ask(place: &Place, (sql, run): (&str, &[&str])) -> Output {
    let mut query = place.bare(&place.lake(), "query");
    query.args([sql, "--format", "csv"]).args(run);
    query.output().unwrap()
}

fn answers(place: &Place) -> Vec<String> {
    let asked = QUESTIONS.map(|question| ask(place, question));
    asked
        .iter()
        .map(|answer| {
            assert_eq!(answer.status.code(), Some(0), "{}", stderr(answer));
            stdout(answer)
        })
        .collect()
}

/// Returns every published file, by path below the lake.
fn shown(lake: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let mut shown = BTreeMap::new();
    for path in SHOWN
        .iter()
        .flat_map(|folder| files_below(&lake.join(folder)))
    {
        shown.insert(path.strip_prefix(lake).unwrap().to_owned(), read(&path));
    }
    shown.insert("views.sql".into(), read(&lake.join("views.sql")));
    shown
}

/// Differences between the published files before and now; rows of later runs may be added.
fn differences(
    before: &BTreeMap<PathBuf, Vec<u8>>,
    after: &BTreeMap<PathBuf, Vec<u8>>,
) -> Vec<String> {
    let runs = |shown: &BTreeMap<PathBuf, Vec<u8>>| -> BTreeSet<PathBuf> {
        let runs = shown.keys().filter(|name| name.starts_with("tables/runs"));
        let folders = runs.map(|name| name.parent().unwrap().file_name().unwrap().into());
        folders.collect()
    };
    let (old_runs, runs) = (runs(before), runs(after));
    let is_of_later_run = |name: &Path| {
        let mut later = runs.difference(&old_runs);
        later.any(|run| name.parent().unwrap().ends_with(run) && *run != Path::new("run=99"))
    };
    let names: BTreeSet<&PathBuf> = before.keys().chain(after.keys()).collect();
    let differ = names
        .into_iter()
        .filter(|name| before.get(*name) != after.get(*name) && !is_of_later_run(name));
    differ.map(|name| name.display().to_string()).collect()
}

#[test]
fn any_file_fault_is_found_and_repaired_and_falsifies_no_answer() {
    let mut rng = chances("whole files");
    let n_times: usize = number("PIPELINE_FAULTS", 25);
    let mut place = place_with_a_lake();
    let mut expected = answers(&place);
    let mut wrong: Vec<String> = Vec::new();
    let (mut n_answered, mut n_final) = (0, 0);
    let mut n_done = 0;
    while n_done < n_times {
        let lake = place.lake();
        let before = shown(&lake);
        let Some(fault) = Fault::draw(&mut rng, &lake) else {
            continue;
        };
        n_done += 1;
        let mut report = |what: String| wrong.push(format!("{}: {what}", fault.describe()));
        let verified = place.bare(&lake, "verify").output().unwrap();
        if fault.matters && verified.status.code() != Some(1) {
            report(format!("verify: {}", stderr(&verified)));
        }
        for (question, expected) in QUESTIONS.into_iter().zip(&expected) {
            let answer = ask(&place, question);
            if answer.status.code() == Some(0) {
                n_answered += 1;
                if stdout(&answer) != *expected {
                    report(format!("{question:?} answered:\n{}", stdout(&answer)));
                }
            } else if !stderr(&answer).contains("hint: ") {
                report(format!("{question:?}: {}", stderr(&answer)));
            }
        }
        let ran = place.command("run", &[]).output().unwrap();
        if ran.status.code() != Some(0) {
            report(format!("run: {}", stderr(&ran)));
        }
        let mut differ = differences(&before, &shown(&lake));
        if fault.is_final {
            n_final += 1;
            differ.retain(|name| !name.starts_with("every"));
        }
        if !differ.is_empty() {
            report(format!("after a run differ: {}", differ.join(", ")));
        }
        if !fault.is_final {
            // An unreferenced blob or record, or a list, is only removed on request.
            let verified = place.bare(&lake, "verify").output().unwrap();
            if fault.what != What::Foreign && verified.status.code() != Some(0) {
                report(format!("verify after a run: {}", stdout(&verified)));
            }
        }
        let mut drop = place.bare(&lake, "verify");
        drop.arg("--drop").output().unwrap();
        place.run_well(&[]);
        let verified = place.bare(&lake, "verify").output().unwrap();
        if verified.status.code() != Some(0) {
            report(format!("verify after --drop: {}", stdout(&verified)));
        }
        if fault.is_final || verified.status.code() != Some(0) || !differ.is_empty() {
            place = place_with_a_lake();
        }
        expected = answers(&place);
    }
    println!("{n_done} faults, {n_final} of them of what only old runs made; {n_answered} answers");
    let n_wrong = wrong.len();
    wrong.truncate(30);
    assert_eq!(n_wrong, 0, "of {n_times}:\n{}", wrong.join("\n"));
    assert!(n_answered > n_times, "questions were hardly ever answered");
}
