//! A depot in which somebody has changed what machines believe: names that are paths, records of other
//! units, sizes, links, and files that are cut or have more in them. `PIPELINE_ATTACKS` sets their number.

use std::{
    collections::{BTreeMap, BTreeSet},
    fs,
    os::unix::fs::symlink,
    path::{Path, PathBuf},
    process::{Command, Output},
};

use rand::{Rng, seq::IndexedRandom};
use rand_chacha::ChaCha8Rng;
use serde_json::{Value, json};

use crate::engine::place::{
    Place, assert_same, chances, files_below, number, published, put, read, stderr, stdout,
};

/// Files of a folder, and a stage with tables and one without.
const SMALL: &str = r#"
[stages.split]
kind = "split"
root = "INPUTS"
table = true

[stages.first]
kind = "map"
inputs.parts = "split.parts"
add = 1
table = true
"#;

/// Texts that are no name of anything; `OUTSIDE` stands for a folder beside the lake.
const NOT_NAMES: [&str; 14] = [
    "../../../../../../../../../../../OUTSIDE/kept",
    "../../../../../../../outside/kept",
    "../../../../../outside/new",
    "../views.sql",
    "../../runs/000009.json",
    "OUTSIDE/kept",
    "OUTSIDE/new",
    "a/b",
    "..\\..\\outside\\kept",
    "nul\0nul",
    "..",
    ".",
    "",
    "LONG",
];

/// Kind of attack.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
enum Class {
    /// Another name of a file, a stage, a partition, a pipeline, a column or a table.
    Name,
    /// The digests of two records, or in one, are exchanged.
    Digests,
    /// The file is that of something else, or says that it is.
    OtherUnit,
    /// Another size of a file.
    Size,
    /// A link or a pipe instead of a file or folder.
    Link,
    /// The file is cut.
    Truncated,
    /// It has a field more.
    ExtraField,
    /// It has a field twice.
    DuplicateKey,
}

const CLASSES: [Class; 8] = [
    Class::Name,
    Class::Digests,
    Class::OtherUnit,
    Class::Size,
    Class::Link,
    Class::Truncated,
    Class::ExtraField,
    Class::DuplicateKey,
];

/// Folders of a depot's files.
const PLACES: [&str; 4] = ["units", "runs", "recipes", "blobs"];

/// A copy of a depot under attack.
struct Attacked<'a> {
    depot: PathBuf,
    outside: PathBuf,
    rng: &'a mut ChaCha8Rng,
}

/// The body of a sealed file.
fn body(path: &Path) -> Value {
    let mut sealed: Value = serde_json::from_slice(&read(path)).unwrap();
    sealed["body"].take()
}

/// Writes a sealed file, whose body is this text.
fn seal(path: &Path, body: &str) {
    let digest = blake3::hash(body.as_bytes());
    fs::remove_file(path).unwrap();
    let text = format!("{{\"blake3\":\"{digest}\",\"body\":{body}}}\n");
    put(path, text.as_bytes());
}

impl Attacked<'_> {
    fn files(&self, place: &str) -> Vec<PathBuf> {
        files_below(&self.depot.join(place))
    }

    fn any(&mut self, place: &str) -> PathBuf {
        self.files(place).choose(self.rng).unwrap().clone()
    }

    fn two(&mut self, place: &str) -> [PathBuf; 2] {
        let files = self.files(place);
        let two: Vec<&PathBuf> = files.choose_multiple(self.rng, 2).collect();
        [two[0].clone(), two[1].clone()]
    }

    fn not_a_name(&mut self) -> String {
        let name = NOT_NAMES.choose(self.rng).unwrap();
        let outside = self.outside.display().to_string();
        let long = "x".repeat(300);
        let name = name.replace("/OUTSIDE", &outside);
        name.replace("OUTSIDE", &outside).replace("LONG", &long)
    }

    /// Changes the body of a file as long as that changes it.
    fn edit(&mut self, path: &Path, change: impl FnOnce(&mut Self, &mut Value)) -> Vec<PathBuf> {
        let before = body(path);
        let mut after = before.clone();
        change(self, &mut after);
        assert_ne!(before, after, "{}", path.display());
        seal(path, &after.to_string());
        vec![path.to_owned()]
    }

    /// Makes an attack; returns the files of which `verify --depot` has to name one, or `None` if this class
    /// has none at this place.
    fn attack(&mut self, class: Class, place: &str) -> Option<Vec<PathBuf>> {
        let is_blob = place == "blobs";
        match class {
            Class::Name if place == "units" => {
                let path = self.any(place);
                let name = self.not_a_name();
                Some(
                    self.edit(&path, |this, record| match this.rng.random_range(0..4) {
                        0 => record["stage"] = json!(name),
                        1 => record["partition"] = json!(name),
                        _ => rename_a_file(record, &name),
                    }),
                )
            }
            Class::Name if place == "runs" => {
                let path = self.any(place);
                let name = self.not_a_name();
                Some(
                    self.edit(&path, |this, run| match this.rng.random_range(0..5) {
                        0 => run["pipeline"] = json!(name),
                        1 => run["run"]["record"]["pipeline"] = json!(name),
                        2 => run["run"]["record"]["outputs"][0]["partition"] = json!(name),
                        3 => {
                            let file = json!({"digest": "0".repeat(64), "size": 1});
                            run["run"]["history"] = json!({name: file});
                        }
                        _ => rename_a_file(&mut run["units"][0], &name),
                    }),
                )
            }
            Class::Name if place == "recipes" => {
                let path = self.any(place);
                let name = self.not_a_name();
                Some(self.edit(&path, |_, recipe| recipe["output"] = json!(name)))
            }
            Class::Digests if place == "units" => {
                let [path, other] = self.two(place);
                let other = body(&other);
                Some(self.edit(&path, |this, record| {
                    match this.rng.random_range(0..3) {
                        0 => record["fingerprint"] = other["fingerprint"].clone(),
                        1 => {
                            record["outcome"]["files"] = {
                                // Of two units with equal bytes the labels differ.
                                record["outcome"]["labels"] = json!({"of": "another"});
                                other["outcome"]["files"].clone()
                            }
                        }
                        _ => {
                            let files = record["outcome"]["files"].as_object_mut().unwrap();
                            let digests: Vec<Value> = files.values().rev().cloned().collect();
                            for (file, digest) in files.values_mut().zip(digests) {
                                *file = digest;
                            }
                        }
                    }
                }))
            }
            Class::Digests if place == "runs" => {
                let path = self.any(place);
                Some(self.edit(&path, |_, run| {
                    let other = run["units"][1]["fingerprint"].clone();
                    run["units"][0]["fingerprint"] = other;
                }))
            }
            // Two files change names.
            Class::Digests => {
                let [path, other] = self.two(place);
                let bytes = read(&path);
                fs::rename(&other, &path).unwrap();
                put(&other, &bytes);
                Some(vec![path, other])
            }
            Class::OtherUnit if place == "units" => {
                let [path, other] = self.two(place);
                if self.rng.random_bool(0.3) {
                    let bytes = read(&other);
                    fs::remove_file(&path).unwrap();
                    put(&path, &bytes);
                    return Some(vec![path]);
                }
                Some(
                    self.edit(&path, |this, record| match this.rng.random_range(0..4) {
                        0 => record["partition"] = json!("another"),
                        1 => record["seed"] = json!(record["seed"].as_u64().unwrap() ^ 1),
                        2 => record["stage"] = json!("another"),
                        _ => record["outcome"]["provisional"] = json!(true),
                    }),
                )
            }
            Class::OtherUnit => {
                let path = self.any(place);
                let beside = path.with_file_name(format!("{}.json", "7".repeat(64)));
                fs::copy(&path, &beside).unwrap();
                if place == "runs" {
                    let folder = self.depot.join("runs/another");
                    fs::create_dir(&folder).unwrap();
                    let moved = folder.join(path.file_name().unwrap());
                    fs::rename(&beside, &moved).unwrap();
                    return Some(vec![moved]);
                }
                Some(vec![beside])
            }
            Class::Size if place == "units" => {
                let path = self.any(place);
                Some(self.edit(&path, |this, record| {
                    let files = record["outcome"]["files"].as_object_mut().unwrap();
                    let file = files.values_mut().next().unwrap();
                    let size = file["size"].as_u64().unwrap();
                    let sizes = [size + 1, size - 1, 0, u64::MAX, u64::MAX / 2];
                    file["size"] = json!(sizes.choose(this.rng).unwrap());
                }))
            }
            Class::Size if is_blob => {
                let path = self.any(place);
                let mut bytes = read(&path);
                bytes.extend_from_slice(b"more");
                fs::remove_file(&path).unwrap();
                put(&path, &bytes);
                Some(vec![path])
            }
            Class::Link => {
                let path = self.any(place);
                let aside = self.outside.join("kept");
                match self.rng.random_range(0..6) {
                    0 => {
                        fs::rename(&path, self.outside.join("same")).unwrap();
                        symlink(self.outside.join("same"), &path).unwrap();
                    }
                    1 => {
                        fs::remove_file(&path).unwrap();
                        symlink(aside, &path).unwrap();
                    }
                    2 => {
                        fs::remove_file(&path).unwrap();
                        symlink(&path, &path).unwrap();
                    }
                    3 => {
                        fs::remove_file(&path).unwrap();
                        let made = Command::new("mkfifo").arg(&path).status().unwrap();
                        assert!(made.success());
                    }
                    4 => {
                        fs::remove_file(&path).unwrap();
                        fs::create_dir(&path).unwrap();
                        put(&path.join("inside"), b"inside");
                    }
                    _ => {
                        let folder = path.parent().unwrap();
                        if folder.parent() == Some(&self.depot) {
                            return None;
                        }
                        fs::rename(folder, self.outside.join("folder")).unwrap();
                        symlink(self.outside.join("folder"), folder).unwrap();
                        return Some(vec![folder.to_owned()]);
                    }
                }
                Some(vec![path])
            }
            Class::Truncated => {
                let path = self.any(place);
                let bytes = read(&path);
                let left = self.rng.random_range(0..bytes.len());
                fs::remove_file(&path).unwrap();
                put(&path, &bytes[..left]);
                Some(vec![path])
            }
            Class::ExtraField if !is_blob => {
                let path = self.any(place);
                Some(self.edit(&path, |this, body| {
                    let mut tables = Vec::new();
                    tables_in(body, "", &mut tables);
                    let table = body.pointer_mut(tables.choose(this.rng).unwrap());
                    let table = table.unwrap().as_object_mut().unwrap();
                    table.insert("path".to_owned(), json!("../../x"));
                }))
            }
            Class::DuplicateKey if !is_blob => {
                let path = self.any(place);
                let body = body(&path).to_string();
                let (first, _) = body[1..].split_once(':').unwrap();
                let doubled = match body.find("\"files\":{\"") {
                    Some(at) if self.rng.random_bool(0.7) => {
                        let at = at + "\"files\":{".len();
                        let (name, _) = body[at..].split_once(':').unwrap();
                        let other = json!({"digest": "1".repeat(64), "size": 1});
                        format!("{}{name}:{other},{}", &body[..at], &body[at..])
                    }
                    _ => format!("{{{first}:null,{}", &body[1..]),
                };
                seal(&path, &doubled);
                Some(vec![path])
            }
            Class::Name | Class::Size | Class::ExtraField | Class::DuplicateKey => None,
        }
    }
}

fn rename_a_file(record: &mut Value, name: &str) {
    let files = record["outcome"]["files"].as_object_mut().unwrap();
    let first = files.keys().next().unwrap().clone();
    let file = files.remove(&first).unwrap();
    files.insert(name.to_owned(), file);
}

/// Pointers to the tables in a value that have one of the fields of a record.
fn tables_in(value: &Value, at: &str, tables: &mut Vec<String>) {
    const FIELDS: [&str; 6] = ["fingerprint", "size", "kind", "pipeline", "result", "host"];
    match value {
        Value::Object(table) => {
            // Below others any key is one of the stage's.
            if FIELDS.iter().any(|field| table.contains_key(*field)) {
                tables.push(at.to_owned());
            }
            for (key, value) in table {
                tables_in(value, &format!("{at}/{key}"), tables);
            }
        }
        Value::Array(list) => {
            for (idx, value) in list.iter().enumerate() {
                tables_in(value, &format!("{at}/{idx}"), tables);
            }
        }
        _ => {}
    }
}

fn copy_folder(from: &Path, to: &Path) {
    for path in files_below(from) {
        let copy = to.join(path.strip_prefix(from).unwrap());
        fs::create_dir_all(copy.parent().unwrap()).unwrap();
        fs::copy(&path, &copy).unwrap();
    }
}

fn contents(folder: &Path) -> BTreeMap<PathBuf, Vec<u8>> {
    let files = files_below(folder).into_iter();
    files.map(|path| (path.clone(), read(&path))).collect()
}

/// The names of the folders and files in a folder.
fn names(folder: &Path) -> BTreeSet<PathBuf> {
    let entries = fs::read_dir(folder).unwrap();
    entries.map(|entry| entry.unwrap().path()).collect()
}

#[test]
fn an_attack_on_a_depot_touches_nothing_outside_the_lake_and_is_named() {
    let n_attacks: usize = number("PIPELINE_ATTACKS", 32);
    let mut rng = chances("attacks on a depot");
    let place = Place::with_inputs(SMALL, 3);
    // Other files are left in the depot.
    let tables = |mut published: BTreeMap<String, String>| {
        published.retain(|path, _| path.starts_with("tables/"));
        published
    };
    let expected = tables(place.undisturbed(&[]));
    let sound = place.path("sound");
    fs::create_dir(&sound).unwrap();
    let shared = |depot: &Path, lake: &Path, command: &str, arguments: &[&str]| -> Output {
        let mut asked = match command {
            "run" => place.command_in(lake, command, arguments),
            _ => place.bare(lake, command),
        };
        if command != "run" {
            asked.args(arguments);
        }
        asked.env("PIPELINE_DEPOT", depot).output().unwrap()
    };
    let first = shared(&sound, &place.lake(), "run", &[]);
    assert_eq!(first.status.code(), Some(0), "{}", stderr(&first));
    let mut wrong = Vec::new();
    let mut seen = BTreeSet::new();
    let mut n_done = 0;
    while n_done < n_attacks {
        // Every class at every place in turn, each with chances of its own.
        let class = CLASSES[n_done % CLASSES.len()];
        let there = PLACES[n_done / CLASSES.len() % PLACES.len()];
        n_done += 1;
        let scene = place.path(&format!("scene/{n_done}"));
        let [depot, lake, outside] = ["depot", "lake", "outside"].map(|name| scene.join(name));
        fs::create_dir_all(&outside).unwrap();
        fs::create_dir(&lake).unwrap();
        put(&outside.join("kept"), b"kept");
        copy_folder(&sound, &depot);
        let mut attacked = Attacked {
            depot: depot.clone(),
            outside: outside.clone(),
            rng: &mut rng,
        };
        let Some(named) = attacked.attack(class, there) else {
            continue;
        };
        seen.insert((class, there));
        let began = std::time::Instant::now();
        let before = (contents(&outside), names(&scene));
        let verified = shared(&depot, &place.lake(), "verify", &["--depot"]);
        let found = stdout(&verified);
        let is_named = named.iter().any(|path| {
            let key = path.strip_prefix(&depot).unwrap().display().to_string();
            found.contains(&key)
        });
        let about = format!("{n_done}: {class:?} at {named:?}");
        if verified.status.code() != Some(1) || !is_named {
            wrong.push(format!(
                "{about} is not named: {found}{}",
                stderr(&verified)
            ));
        }
        let run = shared(&depot, &lake, "run", &[]);
        if run.status.code() == Some(0) {
            assert_same(&tables(published(&lake)), &expected, &about);
        } else {
            wrong.push(format!("{about} fails a run: {}", stderr(&run)));
        }
        // These may fail, and say why.
        for (command, arguments) in [
            ("pull", vec![]),
            ("query", vec!["--depot", "select count(*) from all_parts"]),
        ] {
            let asked = shared(&depot, &lake, command, &arguments);
            if !matches!(asked.status.code(), Some(0 | 1)) {
                wrong.push(format!("{about} breaks {command}: {}", stderr(&asked)));
            }
        }
        // A file that nobody has any more is made again.
        let again = shared(&depot, &lake, "run", &[]);
        assert_eq!(again.status.code(), Some(0), "{about}: {}", stderr(&again));
        let alone = place.bare(&lake, "verify").output().unwrap();
        if alone.status.code() != Some(0) {
            wrong.push(format!("{about} harms the lake: {}", stdout(&alone)));
        }
        if before != (contents(&outside), names(&scene)) {
            wrong.push(format!(
                "{about} changes what is outside: {:?}",
                names(&scene)
            ));
        }
        println!("{about}: {:.1} s", began.elapsed().as_secs_f64());
        fs::remove_dir_all(&scene).unwrap();
    }
    assert!(
        wrong.is_empty(),
        "{} of {n_done}:\n{}",
        wrong.len(),
        wrong.join("\n")
    );
    assert!(seen.len() >= 20 || n_attacks < 32, "{seen:?}");
}
