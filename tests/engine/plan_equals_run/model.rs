//! A model of the units to make, and of the reasons: computed in memory, comparing all dependencies
//! of a unit in full.

use std::{
    collections::{BTreeMap, BTreeSet},
    fmt,
};

use serde_json::Value;

use super::world::{StageSpec, World};

/// One partition of one stage.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct Unit {
    pub(super) stage: String,
    pub(super) partition: String,
}

impl Unit {
    pub(super) fn new(stage: &str, partition: &str) -> Self {
        Self {
            stage: stage.to_owned(),
            partition: partition.to_owned(),
        }
    }
}

impl fmt::Display for Unit {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}/{}", self.stage, self.partition)
    }
}

/// Expected action of a run on a unit.
pub(super) struct Expected {
    pub(super) made: bool,
    pub(super) forced: bool,
    /// Differences from the last time that a run came to it.
    pub(super) causes: BTreeSet<String>,
    /// Whether it gave one of the `parts` the last time a run came to it.
    pub(super) was_part: bool,
    /// Its bytes, if it is one of the `parts`.
    pub(super) data: Option<Vec<u8>>,
}

/// Dependencies of a unit.
#[derive(Debug, Clone, PartialEq, Eq)]
struct Reason {
    kind: &'static str,
    code: u8,
    config: BTreeMap<&'static str, Value>,
    /// Data that is read of each partition.
    inputs: BTreeMap<String, String>,
    files: BTreeMap<String, Vec<u8>>,
    seed: u64,
}

/// One of the `parts`.
struct Part {
    data: Vec<u8>,
    table: bool,
    label: String,
}

/// Every unit that was ever made, and how the newest run came to it.
#[derive(Default)]
pub(super) struct Model {
    made: BTreeSet<(Unit, String)>,
    last: BTreeMap<Unit, (Reason, bool)>,
}

impl Model {
    /// Returns a unit that a stage reads, or that one above it reads, and that was never made.
    pub(super) fn lacking(&self, world: &World, stage: &str) -> Option<Unit> {
        let above = world.with_ancestors(stage).into_iter();
        let units = above.filter(|name| name != stage).flat_map(|name| {
            let results = results(world, world.stage(&name)).into_iter();
            results.map(move |(partition, (reason, _))| {
                let unit = Unit::new(&name, &partition);
                (unit.clone(), (unit, format!("{reason:?}")))
            })
        });
        let mut lacking = units.filter(|(_, made)| !self.made.contains(made));
        lacking.next().map(|(unit, _)| unit)
    }

    /// Runs these stages.
    pub(super) fn run(
        &mut self,
        world: &World,
        visited: &BTreeSet<String>,
        is_forced: impl Fn(&str) -> bool,
    ) -> BTreeMap<Unit, Expected> {
        let mut expected = BTreeMap::new();
        for stage in visited {
            for (partition, (reason, part)) in results(world, world.stage(stage)) {
                let unit = Unit::new(stage, &partition);
                let made = (unit.clone(), format!("{reason:?}"));
                let forced = is_forced(stage);
                let last = self.last.get(&unit);
                let result = Expected {
                    made: forced || !self.made.contains(&made),
                    forced,
                    causes: match last {
                        Some((last, _)) => causes(Some(last), &reason),
                        None => self.renamed(world, &unit, &reason),
                    },
                    was_part: last.is_some_and(|(_, was_part)| *was_part),
                    data: part.map(|part| part.data),
                };
                self.made.insert(made);
                let is_part = result.data.is_some();
                self.last.insert(unit.clone(), (reason, is_part));
                expected.insert(unit, result);
            }
        }
        expected
    }
}

impl Model {
    /// The differences from the unit of a removed stage that differed only by name and inputs; from
    /// the nearest if there are several.
    fn renamed(&self, world: &World, unit: &Unit, reason: &Reason) -> BTreeSet<String> {
        let own = |reason: &Reason| (reason.kind, reason.code, reason.config.clone());
        let is_there = |name: &str| world.stages.iter().any(|stage| stage.name == name);
        let before = self.last.iter().filter(|(before, (last, _))| {
            before.partition == unit.partition
                && !is_there(&before.stage)
                && own(last) == own(reason)
        });
        let before = before.map(|(_, (last, _))| causes(Some(last), reason));
        match before.min_by_key(BTreeSet::len) {
            None => causes(None, reason),
            Some(mut differences) => {
                differences.insert("renamed".to_owned());
                differences
            }
        }
    }
}

/// The units of a stage; those without a part are skipped, filtered, or tables.
fn results(world: &World, stage: &StageSpec) -> BTreeMap<String, (Reason, Option<Part>)> {
    let reason = |inputs, files| Reason {
        kind: stage.kind,
        // That of a program is a file.
        code: if stage.kind == "program" {
            1
        } else {
            world.version(stage.kind)
        },
        config: stage.config.clone(),
        inputs,
        files,
        seed: world.seed,
    };
    if stage.kind == "split" {
        return world
            .files
            .iter()
            .map(|(name, bytes)| {
                let files = BTreeMap::from([(format!("{name}.txt"), bytes.clone())]);
                let part = split(stage, name, bytes);
                (name.clone(), (reason(BTreeMap::new(), files), part))
            })
            .collect();
    }
    let upstream = world.stage(stage.reads.as_deref().unwrap());
    let parts: BTreeMap<String, Part> = results(world, upstream)
        .into_iter()
        .filter_map(|(name, (_, part))| Some((name, part?)))
        .collect();
    let no_files = BTreeMap::new;
    let whole = |part: &Part| format!("{:?} {} {}", part.data, part.table, part.label);
    match stage.kind {
        "map" | "program" => {
            let is_program = stage.kind == "program";
            let files = || {
                if is_program {
                    BTreeMap::from([(world.code.display().to_string(), world.code_text())])
                } else {
                    no_files()
                }
            };
            let units = parts.iter().map(|(name, part)| {
                let inputs = BTreeMap::from([(name.clone(), whole(part))]);
                let more = world.version(stage.kind) - 1;
                let mapped = Part {
                    data: change(&part.data, stage, more),
                    table: !is_program && is_on(stage),
                    label: part.label.clone(),
                };
                (name.clone(), (reason(inputs, files()), Some(mapped)))
            });
            units.collect()
        }
        "gather" => {
            let inputs = parts.iter();
            let inputs = inputs.map(|(name, part)| (name.clone(), format!("{:?}", part.data)));
            let unit = reason(inputs.collect(), no_files());
            BTreeMap::from([("all".to_owned(), (unit, None))])
        }
        _ => {
            let mut groups: BTreeMap<String, BTreeMap<String, String>> = BTreeMap::new();
            for (name, part) in &parts {
                let group = groups.entry(part.label.clone()).or_default();
                group.insert(name.clone(), whole(part));
            }
            let units = groups.into_iter();
            units
                .map(|(group, inputs)| (group, (reason(inputs, no_files()), None)))
                .collect()
        }
    }
}

fn split(stage: &StageSpec, name: &str, bytes: &[u8]) -> Option<Part> {
    let is_out = stage.lists("leave_out", name) || stage.lists("skip", name);
    if is_out || bytes.starts_with(b"bad") {
        return None;
    }
    let first = bytes.first().filter(|letter| letter.is_ascii_alphabetic());
    Some(Part {
        data: change(bytes, stage, 0),
        table: is_on(stage),
        label: first.map_or("other".to_owned(), |&letter| char::from(letter).to_string()),
    })
}

fn change(data: &[u8], stage: &StageSpec, more: u8) -> Vec<u8> {
    let add = stage.value("add").wrapping_add(more);
    let bytes = data.iter().map(|byte| byte.wrapping_add(add));
    match stage.value("modulo") {
        0 => bytes.collect(),
        modulo => bytes.map(|byte| byte % modulo).collect(),
    }
}

fn is_on(stage: &StageSpec) -> bool {
    stage.config["table"] == true
}

fn causes(last: Option<&Reason>, now: &Reason) -> BTreeSet<String> {
    let Some(last) = last else {
        return BTreeSet::from(["new".to_owned()]);
    };
    let mut causes = BTreeSet::new();
    assert_eq!(last.kind, now.kind, "names of stages say their kind");
    if last.code != now.code {
        causes.insert("code own_stages".to_owned());
    }
    if last.seed != now.seed {
        causes.insert("seed".to_owned());
    }
    for (key, new) in &now.config {
        let old = &last.config[key];
        if old != new {
            causes.insert(format!("config {key} {old} {new}"));
        }
    }
    differences("input parts", &last.inputs, &now.inputs, &mut causes);
    differences("file", &last.files, &now.files, &mut causes);
    causes
}

fn differences<V: PartialEq>(
    what: &str,
    last: &BTreeMap<String, V>,
    now: &BTreeMap<String, V>,
    causes: &mut BTreeSet<String>,
) {
    let names: BTreeSet<&String> = last.keys().chain(now.keys()).collect();
    for name in names {
        let change = match (last.get(name), now.get(name)) {
            (None, _) => "added",
            (_, None) => "removed",
            (old, new) if old != new => "changed",
            _ => continue,
        };
        causes.insert(format!("{what} {name} {change}"));
    }
}
