//! The effective values of every shipped pipeline file: of every option that affects a result, with
//! defaults, extended files and shared values.
//!
//! `effective/defaults.txt` has the default of every option of every kind of stage, `effective/cgf.txt` what
//! `cgf.toml` sets to something else, and each other file its differences from `cgf.toml` and, of stages
//! that this does not have, from the defaults. `PIPELINE_WRITE_GOLDEN=1 cargo test --release --test suite golden`
//! writes them.

use std::{collections::BTreeMap, fs, path::Path};

use dataflow::Pipeline;
use serde_json::Value;
use stage_retarget::Retarget;

use crate::program::bench::{golden, pipeline_files};

/// The shipped files, by their paths below `pipelines` without the ending.
fn files() -> Vec<String> {
    let names = pipeline_files().into_iter().map(|path| {
        let name = path.with_extension("");
        let below = name.strip_prefix(concat!(env!("CARGO_MANIFEST_DIR"), "/pipelines"));
        below.unwrap().to_str().unwrap().to_owned()
    });
    names.collect()
}

fn parsed(file: &str) -> Pipeline {
    let path = format!("pipelines/{file}.toml");
    let text = fs::read_to_string(&path).unwrap();
    let read = Pipeline::parse(path.as_ref(), &text, &pipeline::kinds(), None, &[]);
    read.unwrap_or_else(|err| panic!("{path}: {err}"))
}

/// The values of a file by their keys.
fn effective(file: &str) -> BTreeMap<String, String> {
    let read = parsed(file);
    let mut values = BTreeMap::from([("seed".to_owned(), read.seed.to_string())]);
    for stage in &read.stages {
        let mut add = |key: String, value: String| values.insert(key, value);
        let name = &stage.name;
        add(format!("{name}.kind"), stage.kind.name.to_owned());
        let share = stage.max_skipped_fraction.to_string();
        add(format!("{name}.max_skipped_fraction"), share);
        for (input, node) in &stage.inputs {
            add(format!("{name}.inputs.{input}"), node.to_string());
        }
        flatten(name.as_str(), &stage.config(), &mut values);
    }
    values
}

fn flatten(key: &str, value: &Value, values: &mut BTreeMap<String, String>) {
    match value {
        Value::Object(options) if !options.is_empty() => {
            for (name, value) in options {
                flatten(&format!("{key}.{name}"), value, values);
            }
        }
        value => {
            values.insert(key.to_owned(), value.to_string());
        }
    }
}

/// The default of every option of every kind of stage, by kind and key.
fn defaults() -> BTreeMap<String, String> {
    let mut defaults = BTreeMap::new();
    for kind in pipeline::kinds() {
        for option in kind.options() {
            let key = format!("{}.{}", kind.name, option.key);
            defaults.extend(option.default.map(|default| (key, default)));
        }
    }
    defaults
}

/// The defaults of the stages of a file, by their keys.
fn usual(file: &str, defaults: &BTreeMap<String, String>) -> BTreeMap<String, String> {
    let mut usual = BTreeMap::new();
    for stage in parsed(file).stages {
        let of_kind = format!("{}.", stage.kind.name);
        for (key, default) in defaults {
            let option = key.strip_prefix(&of_kind);
            usual.extend(option.map(|key| (format!("{}.{key}", stage.name), default.clone())));
        }
    }
    usual
}

/// The values that differ from others, and the stages that are left out.
fn told(values: &BTreeMap<String, String>, beside: &BTreeMap<String, String>) -> String {
    let differ = values
        .iter()
        .filter(|(key, value)| beside.get(*key) != Some(*value));
    let here = differ.map(|(key, value)| format!("{key} = {value}\n"));
    let stage = |key: &str| key.split('.').next().unwrap_or_default().to_owned();
    let is_gone = |key: &&String| !values.keys().any(|other| stage(other) == stage(key));
    let mut gone: Vec<String> = beside
        .keys()
        .filter(is_gone)
        .map(|key| stage(key))
        .collect();
    gone.dedup();
    let gone = gone.into_iter().map(|stage| format!("without {stage}\n"));
    here.chain(gone).collect()
}

#[test]
fn shipped_files_have_the_golden_effective_values() {
    let (whole, defaults) = (effective("cgf"), defaults());
    let files = files().into_iter().map(|file| {
        let mut beside = usual(&file, &defaults);
        if file != "cgf" {
            beside.extend(whole.clone());
        }
        let found = told(&effective(&file), &beside);
        (file, found)
    });
    let of_kinds = ("defaults".to_owned(), told(&defaults, &BTreeMap::new()));
    let mut faults = Vec::new();
    for (file, found) in files.chain([of_kinds]) {
        let path = format!("tests/program/effective/{file}.txt");
        let expected = golden(Path::new(&path), &found);
        let lines = |text: &str| text.lines().map(str::to_owned).collect::<Vec<_>>();
        let (found, expected) = (lines(&found), lines(&expected));
        let gone = expected.iter().filter(|line| !found.contains(line));
        faults.extend(gone.map(|line| format!("{file}: - {line}")));
        let new = found.iter().filter(|line| !expected.contains(line));
        faults.extend(new.map(|line| format!("{file}: + {line}")));
    }
    assert!(faults.is_empty(), "{}", faults.join("\n"));
}

#[test]
fn every_shipped_file_is_short() {
    for file in files() {
        let text = fs::read_to_string(format!("pipelines/{file}.toml")).unwrap();
        assert!(text.lines().count() <= 80, "{file}");
    }
}

/// The rows of `profiles.md`: a setting with its value in each of the two files, `None` where it is the default's.
fn profiles() -> BTreeMap<String, [Option<String>; 2]> {
    let page = fs::read_to_string("pipelines/profiles.md").unwrap();
    let rows = page.lines().filter(|line| line.starts_with("| `"));
    let cells = rows.map(|row| {
        row.split('|')
            .map(|cell| cell.trim().trim_matches('`').to_owned())
    });
    let rows = cells.map(|mut cells| {
        let (setting, values) = (cells.nth(1).unwrap(), [cells.nth(1), cells.next()]);
        (
            setting,
            values.map(|value| value.filter(|value| !value.is_empty())),
        )
    });
    rows.collect()
}

#[test]
fn no_setting_of_the_papers_profiles_is_silent() {
    let whole = effective("cgf");
    let table = profiles();
    for (idx, file) in ["paper", "released"].into_iter().enumerate() {
        let values = effective(file);
        // Wiring, and a second screen by `table_lift`.
        let is_setting =
            |key: &str| !key.contains(".inputs.") && !key.starts_with("screen_table_lift.");
        let differs = |key: &String| whole.get(key) != values.get(key);
        for key in values.keys().filter(|key| is_setting(key) && differs(key)) {
            let told = table.get(key).and_then(|row| row[idx].as_ref());
            assert_eq!(told, values.get(key), "{file}: {key}");
        }
        // The hand counts by its content, and so is no effective value.
        let hand = table["retarget.hand"][idx].as_ref().unwrap();
        let read = parsed(file);
        let file_of_hand = read.find("retarget").unwrap();
        let file_of_hand = file_of_hand
            .options::<Retarget>()
            .unwrap()
            .hand_table
            .clone();
        assert_eq!(file_of_hand.file_stem().unwrap(), hand.as_str(), "{file}");
        for (key, row) in &table {
            let told = row[idx].as_ref().filter(|_| key != "retarget.hand");
            if let Some(told) = told {
                assert_eq!(values.get(key), Some(told), "{file}: {key}");
                assert_ne!(whole.get(key), Some(told), "{file}: {key} is the default");
            }
        }
        for key in whole.keys().filter(|key| {
            key.starts_with("screen.protocol.")
                && !["name", "squeeze_rad"].contains(&&key["screen.protocol.".len()..])
        }) {
            let own = key.replacen("screen.", "screen_table_lift.", 1);
            assert_eq!(values.get(&own), whole.get(key), "{file}: {own}");
        }
    }
}

#[test]
fn every_option_is_documented_and_user_specific_ones_have_no_default() {
    let mut required = Vec::new();
    for kind in pipeline::kinds() {
        for option in kind.options() {
            let key = format!("{}.{}", kind.name, option.key);
            assert!(!option.about.is_empty(), "{key}");
            if option.required {
                required.push(key);
            }
        }
    }
    required.sort();
    let hand = |kind: &str| format!("{kind}.hand");
    for kind in [
        "retarget", "train", "sample", "refine", "screen", "dispatch",
    ] {
        assert!(required.contains(&hand(kind)), "{kind}");
    }
    for key in [
        "ingest.root",
        "ingest.hand",
        "dispatch.cell",
        "dispatch.arm.table_from_base",
    ] {
        assert!(
            required.iter().any(|known| known == key),
            "{key}: {required:?}"
        );
    }
}
