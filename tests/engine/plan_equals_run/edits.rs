//! Random edits, and random ways to run.

use rand::{Rng, seq::IndexedRandom};
use rand_chacha::ChaCha8Rng;
use serde_json::{Value, json};

use super::world::{ANCHOR, StageSpec, World};

/// Options of the run after an edit.
#[derive(Debug, Clone, Default)]
pub(super) struct Step {
    pub(super) until: Option<String>,
    pub(super) only: Option<String>,
    pub(super) fresh: Vec<String>,
    pub(super) fresh_all: bool,
}

impl Step {
    /// Mostly a plain run.
    pub(super) fn draw(rng: &mut ChaCha8Rng, world: &World) -> Self {
        let stage = world.stages.choose(rng).map(|stage| stage.name.clone());
        match rng.random_range(0..20) {
            0 | 1 => Self {
                until: stage,
                ..Self::default()
            },
            2 => Self {
                fresh: stage.into_iter().collect(),
                ..Self::default()
            },
            3 => Self {
                only: stage,
                ..Self::default()
            },
            4 => Self {
                only: stage.clone(),
                fresh: stage.into_iter().collect(),
                ..Self::default()
            },
            5 => Self {
                fresh_all: true,
                ..Self::default()
            },
            _ => Self::default(),
        }
    }
}

/// Beginnings give labels; some of these have equal bytes modulo 2.
const TEXTS: [&str; 8] = [
    "apple",
    "cpple",
    "banana",
    "bad apple",
    "avocado",
    "7 seas",
    "cherry",
    "bbnbnb",
];
const FILES: [&str; 6] = ["b", "c", "d", "e", "f", "g"];

/// Changes one thing and says which.
pub(super) fn edit(rng: &mut ChaCha8Rng, world: &mut World) -> String {
    match rng.random_range(0..20) {
        0..=3 => change_a_file(rng, world),
        4 => remove_a_file(rng, world),
        5 => {
            world.touched = world.files.keys().cloned().collect();
            "all files touched".to_owned()
        }
        6 => {
            let folder = format!("inputs_{}", rng.random_range(0..1_000_000));
            world.root.set_file_name(folder);
            format!("files moved to {}", world.root.display())
        }
        7..=11 => change_a_value(rng, world),
        12 => {
            world.seed = rng.random_range(7..9);
            format!("seed = {}", world.seed)
        }
        13 | 14 => {
            let kind = *["split", "map", "program", "gather", "group"]
                .choose(rng)
                .unwrap();
            if !world.second.remove(kind) {
                world.second.insert(kind.to_owned());
            }
            format!("code of {kind} is version {}", world.version(kind))
        }
        15 | 16 => add_a_stage(rng, world),
        17 => remove_a_stage(rng, world),
        _ => rewire_a_stage(rng, world),
    }
}

fn change_a_file(rng: &mut ChaCha8Rng, world: &mut World) -> String {
    let name = *FILES.choose(rng).unwrap();
    let text = *TEXTS.choose(rng).unwrap();
    world
        .files
        .insert(name.to_owned(), text.as_bytes().to_vec());
    format!("file {name} is `{text}`")
}

fn remove_a_file(rng: &mut ChaCha8Rng, world: &mut World) -> String {
    let name = *FILES.choose(rng).unwrap();
    world.files.remove(name);
    format!("no file {name}")
}

fn change_a_value(rng: &mut ChaCha8Rng, world: &mut World) -> String {
    let stage = rng.random_range(0..world.stages.len());
    let stage = &mut world.stages[stage];
    let keys: Vec<&'static str> = stage.config.keys().copied().collect();
    let key = *keys.choose(rng).unwrap();
    let value = match key {
        "add" | "options.add" => json!(rng.random_range(0..4)),
        "modulo" | "options.modulo" => json!([0, 1, 2].choose(rng).unwrap()),
        "min_bytes" => json!(rng.random_range(0..8)),
        "table" => json!(rng.random_bool(0.5)),
        _ => {
            let names = FILES.iter().filter(|_| rng.random_bool(0.2));
            names
                .copied()
                .filter(|&name| name != ANCHOR)
                .collect::<Value>()
        }
    };
    let said = format!("{}.{key} = {value}", stage.name);
    stage.config.insert(key, value);
    said
}

/// Stages whose parts a new stage, or a rewired `reader`, may read.
fn sources(world: &World, reader: Option<&str>) -> Vec<String> {
    let is_below =
        |name: &str| reader.is_some_and(|reader| world.with_ancestors(name).contains(reader));
    let stages = world.stages.iter();
    let stages = stages.filter(|stage| stage.makes_parts() && !is_below(&stage.name));
    stages.map(|stage| stage.name.clone()).collect()
}

fn add_a_stage(rng: &mut ChaCha8Rng, world: &mut World) -> String {
    let kind = *[
        "split", "map", "map", "program", "program", "gather", "group",
    ]
    .choose(rng)
    .unwrap();
    let name = format!("{kind}_{}", rng.random_range(1..4));
    if world.stages.iter().any(|stage| stage.name == name) {
        return format!("nothing: {name} is there");
    }
    let source = (kind != "split").then(|| sources(world, None).choose(rng).unwrap().clone());
    let stage = StageSpec::new(&name, kind, source.as_deref());
    // Stages may stand in any order.
    let place = rng.random_range(0..=world.stages.len());
    world.stages.insert(place, stage);
    format!("stage {name} added, reads {source:?}")
}

fn remove_a_stage(rng: &mut ChaCha8Rng, world: &mut World) -> String {
    let place = rng.random_range(0..world.stages.len());
    let is_only_source = {
        let splits = world.stages.iter().filter(|stage| stage.kind == "split");
        world.stages[place].kind == "split" && splits.count() == 1
    };
    if is_only_source || world.stages.len() == 1 {
        return "nothing: the only source stays".to_owned();
    }
    let gone = world.stages.remove(place);
    let split = world.stages.iter().find(|stage| stage.kind == "split");
    let instead = gone
        .reads
        .clone()
        .unwrap_or_else(|| split.unwrap().name.clone());
    for stage in &mut world.stages {
        if stage.reads.as_ref() == Some(&gone.name) {
            stage.reads = Some(instead.clone());
        }
    }
    format!("stage {} removed, {instead} is read instead", gone.name)
}

fn rewire_a_stage(rng: &mut ChaCha8Rng, world: &mut World) -> String {
    let place = rng.random_range(0..world.stages.len());
    let name = world.stages[place].name.clone();
    if world.stages[place].reads.is_none() {
        return format!("nothing: {name} reads no stage");
    }
    let source = sources(world, Some(&name)).choose(rng).unwrap().clone();
    world.stages[place].reads = Some(source.clone());
    format!("stage {name} reads {source}")
}
