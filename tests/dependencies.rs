//! Dependency directions: `.deny.toml` says which crate may know about what, and this test enforces it
//! from the manifests alone, so that it needs no tool; the files of the engine and of the lake depend on
//! each other in one direction.

use std::{
    collections::{BTreeMap, BTreeSet},
    fs,
    path::Path,
};

use toml_edit::{DocumentMut, Item};

/// Direct dependencies of every workspace crate, by crate; development dependencies left out.
fn dependencies() -> BTreeMap<String, Vec<String>> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut manifests = vec![root.join("Cargo.toml"), root.join("schemas/Cargo.toml")];
    for folder in [
        "crates",
        "crates/engine",
        "crates/learning",
        "crates/physics",
        "crates/robotics",
        "crates/tools",
        "stages",
        "stages/baselines",
    ] {
        for entry in fs::read_dir(root.join(folder)).unwrap() {
            let manifest = entry.unwrap().path().join("Cargo.toml");
            manifests.extend(Some(manifest).filter(|manifest| manifest.is_file()));
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
fn denied_dependencies_have_no_users_but_their_wrappers() {
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
fn computations_depend_on_neither_cells_nor_files() {
    let dependencies = dependencies();
    for stranger in [
        "cell",
        "zenoh",
        "lake",
        "dataflow",
        "schemas",
        "robot_meshes",
    ] {
        for computing in [
            "calibration",
            "cem_mpc",
            "dex_retargeting",
            "motion",
            "planning",
            "refinement",
            "retargeting",
            "rrt_connect",
            "sampling",
            "screening",
        ] {
            let knows = dependencies[computing].iter().any(|name| name == stranger);
            assert!(!knows, "{computing}: {stranger}");
        }
    }
}

#[test]
fn engine_and_charts_are_independent_of_hands() {
    let dependencies = dependencies();
    assert!(dependencies["charts"].is_empty());
    for stranger in [
        "spatial", "robot", "schemas", "lake", "arrow", "mcap", "nalgebra",
    ] {
        assert!(
            !dependencies["dataflow"].iter().any(|name| name == stranger),
            "{stranger}"
        );
    }
}

#[test]
fn no_crate_but_the_program_and_the_python_module_depends_on_a_stage() {
    let is_stage = |name: &String| name.starts_with("stage-");
    let dependencies = dependencies();
    assert!(dependencies["pipeline"].iter().any(is_stage));
    let is_face = |name: &String| ["pipeline", "python"].contains(&name.as_str());
    for (name, dependencies) in dependencies.iter().filter(|(name, _)| !is_face(name)) {
        let stage = dependencies.iter().find(|name| is_stage(name));
        assert_eq!(
            stage, None,
            "stages meet in schemas, and `{name}` imports one"
        );
    }
}

/// A module, by its path from the crate's root, which is empty.
type Module = Vec<String>;

/// The source of every module of a crate, without comments and tests.
fn modules(folder: &Path, at: &Module, found: &mut BTreeMap<Module, String>) {
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        let mut module = at.clone();
        module.push(path.file_stem().unwrap().to_str().unwrap().to_owned());
        if path.is_dir() {
            modules(&path, &module, found);
            continue;
        }
        let text = fs::read_to_string(&path).unwrap();
        let text = text.split("#[cfg(test)]\nmod tests").next().unwrap();
        let lines = text.lines().map(|line| line.split("//").next().unwrap());
        if module == ["lib"] {
            module.clear();
        }
        found.insert(module, lines.collect::<Vec<_>>().join("\n"));
    }
}

/// The names in `a::{b, c::d}`, each a path, and what follows them.
fn paths<'t>(text: &'t str, above: &Module, found: &mut Vec<Module>) -> &'t str {
    let mut path = above.clone();
    let mut rest = text.trim_start();
    loop {
        if let Some(inner) = rest.strip_prefix('{') {
            rest = inner;
            loop {
                rest = paths(rest, &path, found).trim_start();
                match rest.strip_prefix(',') {
                    Some(next) => rest = next,
                    None => return rest.strip_prefix('}').unwrap_or(rest),
                }
            }
        }
        let end = rest.find(|c: char| !c.is_alphanumeric() && c != '_');
        let (name, after) = rest.split_at(end.unwrap_or(rest.len()));
        if !name.is_empty() {
            path.push(name.to_owned());
        }
        let Some(next) = after.strip_prefix("::") else {
            found.push(path);
            return after.strip_prefix(" as ").map_or(after, |alias| {
                alias.trim_start_matches(|c: char| c.is_alphanumeric() || c == '_')
            });
        };
        rest = next;
    }
}

/// Every path in a module's source that begins with one of these words and `::`, from the crate's root.
fn used(module: &Module, text: &str) -> Vec<Module> {
    let mut found = Vec::new();
    let above = module.split_last().map_or(&[][..], |(_, above)| above);
    let declared = text
        .lines()
        .filter_map(|line| line.trim().strip_suffix(';')?.rsplit_once("mod "));
    let children = declared.map(|(_, child)| (child, [module, &[child.to_owned()][..]].concat()));
    let words = [
        ("crate", Vec::new()),
        ("super", above.to_vec()),
        ("self", module.clone()),
    ];
    for (word, root) in words.into_iter().chain(children) {
        for (start, _) in text.match_indices(&format!("{word}::")) {
            let before = text[..start].chars().next_back();
            if !before.is_some_and(|c| c.is_alphanumeric() || matches!(c, '_' | ':')) {
                paths(&text[start + word.len() + 2..], &root, &mut found);
            }
        }
    }
    found
}

/// The module in which a path's item is, where the root's re-exports of modules' items lead.
fn module_of(path: &[String], all: &BTreeMap<Module, String>, exports: &[Module]) -> Module {
    let is_module = |end: &usize| all.contains_key(&path[..*end]);
    let end = (1..=path.len()).rev().find(is_module).unwrap_or(0);
    let export = exports.iter().find(|export| {
        end == 0 && export.len() > 1 && !path.is_empty() && export.last() == path.first()
    });
    export.map_or_else(
        || path[..end].to_vec(),
        |export| module_of(&export[..export.len() - 1], all, &[]),
    )
}

#[test]
fn files_of_engine_and_lake_depend_on_each_other_in_one_direction() {
    for name in ["dataflow", "lake"] {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR"))
            .join("crates/engine")
            .join(name);
        let mut all = BTreeMap::new();
        modules(&folder.join("src"), &Vec::new(), &mut all);
        let root = &all[&Vec::new()];
        let exports = used(&Vec::new(), root);
        let mut left: BTreeMap<&Module, BTreeSet<Module>> = BTreeMap::new();
        for (module, text) in all.iter().filter(|(module, _)| !module.is_empty()) {
            let uses = used(module, text).into_iter();
            let mut uses: BTreeSet<Module> =
                uses.map(|path| module_of(&path, &all, &exports)).collect();
            uses.remove(module);
            uses.remove(&Vec::new());
            left.insert(module, uses);
        }
        assert!(
            left.values().map(BTreeSet::len).sum::<usize>() > 50,
            "{name}"
        );
        // What needs nothing that is left is in no circle.
        while let Some((&module, _)) = left.iter().find(|(_, uses)| uses.is_empty()) {
            left.remove(module);
            for uses in left.values_mut() {
                uses.remove(module);
            }
        }
        assert!(
            left.is_empty(),
            "files of `{name}` need each other: {left:#?}"
        );
    }
}
