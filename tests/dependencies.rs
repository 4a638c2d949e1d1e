//! Dependency directions: `.deny.toml` says who may know about what, and this test enforces it from
//! the manifests alone, so that it needs no tool.

use std::{collections::BTreeMap, fs, path::Path};

use toml_edit::{DocumentMut, Item};

/// Direct dependencies of every workspace crate, by crate; development dependencies left out.
fn dependencies() -> BTreeMap<String, Vec<String>> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut manifests = vec![root.join("Cargo.toml"), root.join("schemas/Cargo.toml")];
    for folder in ["crates", "stages"] {
        for entry in fs::read_dir(root.join(folder)).unwrap() {
            let folder = entry.unwrap().path();
            let own = ["Cargo.toml", "report/Cargo.toml"].map(|name| folder.join(name));
            manifests.extend(own.into_iter().filter(|manifest| manifest.is_file()));
        }
    }
    let read = |path: &Path| {
        fs::read_to_string(path)
            .unwrap()
            .parse::<DocumentMut>()
            .unwrap()
    };
    manifests
        .iter()
        .map(|path| {
            let manifest = read(path);
            let name = manifest["package"]["name"].as_str().unwrap().to_owned();
            let table = manifest.get("dependencies").and_then(Item::as_table);
            let names = table.into_iter().flat_map(|table| table.iter());
            (name, names.map(|(name, _)| name.to_owned()).collect())
        })
        .collect()
}

#[test]
fn only_the_wrappers_know_what_is_denied() {
    let deny = include_str!("../.deny.toml")
        .parse::<DocumentMut>()
        .unwrap();
    let rules = deny["bans"]["deny"].as_array().unwrap();
    assert!(rules.len() > 10);
    for rule in rules {
        let rule = rule.as_inline_table().unwrap();
        let denied = rule["name"].as_str().unwrap();
        let wrappers: Vec<&str> = rule["wrappers"]
            .as_array()
            .unwrap()
            .iter()
            .map(|name| name.as_str().unwrap())
            .collect();
        for (name, dependencies) in dependencies() {
            if dependencies.iter().any(|dependency| dependency == denied) {
                assert!(
                    wrappers.contains(&name.as_str()),
                    "`{name}` must not depend on `{denied}`"
                );
            }
        }
    }
}

#[test]
fn planning_has_never_heard_of_cells_nor_of_files() {
    let dependencies = dependencies();
    for stranger in [
        "cell",
        "zenoh",
        "lake",
        "dataflow",
        "schemas",
        "robot_meshes",
    ] {
        let of_planning = ["motion", "planning"].map(|planner| &dependencies[planner]);
        let knows = |names: &&Vec<String>| names.iter().any(|name| name == stranger);
        assert!(!of_planning.iter().any(knows), "{stranger}");
    }
}

#[test]
fn engine_and_charts_have_never_heard_of_hands() {
    let dependencies = dependencies();
    assert_eq!(dependencies["charts"], ["thiserror"]);
    for stranger in [
        "spatial", "robot", "schemas", "lake", "arrow", "mcap", "nalgebra",
    ] {
        assert!(
            !dependencies["dataflow"].iter().any(|name| name == stranger),
            "{stranger}"
        );
    }
    let part_of_a_stage = |name: &String| name.starts_with("stage-") || name.starts_with("report-");
    for (name, dependencies) in &dependencies {
        let is_stage = name.starts_with("stage-");
        assert!(
            !is_stage || !dependencies.iter().any(part_of_a_stage),
            "stages meet in schemas, and `{name}` imports another"
        );
        // What results are made of has never heard of reports: editing one makes no result again.
        let is_result = !name.starts_with("report-") && name != "pipeline";
        let report = dependencies
            .iter()
            .find(|other| other.starts_with("report-") || *other == "charts");
        assert!(
            !is_result || report.is_none(),
            "`{name}` must not depend on {report:?}"
        );
    }
}
