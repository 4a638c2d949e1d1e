//! This workspace: an edit changes the code of exactly the stages that it can change.

use std::{
    collections::{BTreeMap, BTreeSet},
    fs,
    path::{Path, PathBuf},
};

use rand::{SeedableRng, seq::IndexedRandom};
use rand_chacha::ChaCha8Rng;
use tempfile::TempDir;

use super::{append, changed, digests, put};

/// What no source ends with.
const SEVEN: &str = "const SEVEN: u8 = 7;\n";

/// A copy of what this workspace is built from, but for its tests.
struct Copy {
    folder: TempDir,
    digests: BTreeMap<String, String>,
}

impl Copy {
    fn new() -> Self {
        let root = Path::new(env!("CARGO_MANIFEST_DIR"));
        let folder = TempDir::new().unwrap();
        for name in ["Cargo.toml", "Cargo.lock"] {
            fs::copy(root.join(name), folder.path().join(name)).unwrap();
        }
        for name in ["crates", "schemas", "stages"] {
            copy(&root.join(name), &folder.path().join(name));
        }
        let digests = digests(folder.path()).unwrap();
        Self { folder, digests }
    }

    fn root(&self) -> &Path {
        self.folder.path()
    }

    /// Returns the codes, of stages or reports, that changed since the last time.
    fn changed(&mut self) -> BTreeSet<String> {
        let after = digests(self.root()).unwrap();
        let parts = changed(&self.digests, &after);
        self.digests = after;
        let codes = parts.iter().map(|part| part.split(' ').next().unwrap());
        of_stages(codes)
    }

    /// Returns what another number in the last line of a source changes.
    fn changed_by_number(&mut self, name: &str) -> BTreeSet<String> {
        let text = fs::read_to_string(self.root().join(name)).unwrap();
        put(
            self.root(),
            name,
            &text.replace(SEVEN, "const SEVEN: u8 = 8;\n"),
        );
        self.changed()
    }

    /// The codes, of stages or reports, that have a part of this crate.
    fn linking(&self, part: &str) -> BTreeSet<String> {
        let parts = self
            .digests
            .keys()
            .map(|name| name.split_once(' ').unwrap());
        let linking = parts.filter(|(_, linked)| *linked == part);
        of_stages(linking.map(|(code, _)| code))
    }
}

fn of_stages<'a>(codes: impl Iterator<Item = &'a str>) -> BTreeSet<String> {
    let is_of_stage = |code: &&str| code.starts_with("stage-") || code.starts_with("report-");
    codes.filter(is_of_stage).map(str::to_owned).collect()
}

fn copy(from: &Path, to: &Path) {
    fs::create_dir_all(to).unwrap();
    for entry in fs::read_dir(from).unwrap() {
        let (path, to) = {
            let entry = entry.unwrap();
            (entry.path(), to.join(entry.file_name()))
        };
        if !path.is_dir() {
            fs::copy(&path, &to).unwrap();
        } else if !["tests", "examples", "fuzz"]
            .iter()
            .any(|name| path.ends_with(name))
        {
            copy(&path, &to);
        }
    }
}

/// The sources below `src` of every crate.
fn sources(folder: &Path) -> Vec<PathBuf> {
    let mut sources = Vec::new();
    let mut open = vec![folder.to_owned()];
    while let Some(folder) = open.pop() {
        for entry in fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                open.push(path);
            } else if path.extension().is_some_and(|kind| kind == "rs") {
                sources.push(path);
            }
        }
    }
    sources.sort();
    sources
}

#[test]
fn a_comment_and_a_test_in_every_source_of_every_crate_change_no_code() {
    let mut copy = Copy::new();
    assert!(copy.digests.len() > 200, "{:?}", copy.digests);
    let before = copy.digests.clone();
    for path in sources(copy.root()) {
        let name = path.strip_prefix(copy.root()).unwrap();
        let more = "// A comment.\n\n/// A test.\n#[cfg(test)]\nmod more {\n    use super::*;\n\n    \
                    #[test]\n    fn seven() {\n        assert_eq!(3 + 4, 7);\n    }\n}\n";
        append(copy.root(), name.to_str().unwrap(), more);
    }
    copy.changed();
    assert_eq!(copy.digests, before);
}

#[test]
fn a_number_changes_the_stages_that_link_it_and_no_others() {
    let mut copy = Copy::new();
    let named = |codes: &[&str]| codes.iter().map(|&code| code.to_owned()).collect();
    let simulation = "crates/physics/simulation/src/lib.rs";
    let edited = [
        ("stages/refine/src/stage.rs", &["stage-refine"][..]),
        (
            "stages/screen/src/stage.rs",
            &["report-screen", "stage-screen"],
        ),
        ("stages/screen/src/report/rates.rs", &["report-screen"]),
        ("stages/ingest/src/report.rs", &["report-ingest"]),
        ("crates/tools/statistics/src/lib.rs", &["report-screen"]),
        ("crates/tools/glb/src/motion.rs", &["stage-report"]),
        ("crates/tools/demonstrator/src/hand.rs", &[]),
        (
            "crates/tools/charts/src/style.rs",
            &[
                "report-sample",
                "report-screen",
                "report-train",
                "stage-report",
            ],
        ),
    ];
    for name in edited.iter().map(|(name, _)| *name).chain([simulation]) {
        append(copy.root(), name, SEVEN);
    }
    copy.changed();
    for (name, expected) in edited {
        let changed: BTreeSet<String> = copy.changed_by_number(name);
        assert_eq!(changed, named(expected), "{name}");
    }
    let by_simulation = copy.changed_by_number(simulation);
    assert_eq!(by_simulation, copy.linking("simulation"));
    for (stage, links) in [
        ("stage-screen", true),
        ("stage-refine", false),
        ("stage-train", false),
    ] {
        assert_eq!(by_simulation.contains(stage), links, "{stage}");
    }
    // The page's colors and motions are in no other result.
    for of_page in ["page.css", "player.js"] {
        append(
            copy.root(),
            &format!("stages/report/src/page/{of_page}"),
            "/* Edited. */\n",
        );
        assert_eq!(copy.changed(), named(&["stage-report"]), "{of_page}");
    }
}

/// The lines of code of a source, as a reader sees them: not after the tests' beginning.
fn lines_of_code(text: &str) -> impl Iterator<Item = (usize, &str)> {
    let code = text.split("#[cfg(test)]").next().unwrap();
    let lines = code.lines().enumerate();
    lines.filter(|(_, line)| !line.trim_start().starts_with("//"))
}

/// Returns the line with another digit, or without its last sign of arithmetic.
fn edited(line: &str, rng: &mut ChaCha8Rng) -> Option<String> {
    let code = line.split("//").next().unwrap();
    let places = code.char_indices().filter(|(at, c)| {
        let spaced = || code[..*at].ends_with(' ') && code[at + 1..].starts_with(' ');
        c.is_ascii_digit() || ['+', '-', '*', '/'].contains(c) && spaced()
    });
    let (at, old) = *places.collect::<Vec<_>>().choose(rng)?;
    let new = match old {
        '+' => "-",
        '-' | '*' | '/' => "+",
        '9' => "8",
        _ => "9",
    };
    Some(format!("{}{new}{}", &line[..at], &line[at + 1..]))
}

/// Crates that compute, each linked by a stage, by the names of their parts.
const COMPUTING: [(&str, &str); 15] = [
    ("cgf", "crates/learning/cgf"),
    ("geometry", "crates/robotics/geometry"),
    ("motion", "crates/robotics/motion"),
    ("planning", "crates/robotics/planning"),
    ("posture", "crates/robotics/posture"),
    ("robot", "crates/robotics/robot"),
    ("simulation", "crates/physics/simulation"),
    ("stage-cem_mpc", "stages/baselines/cem_mpc"),
    ("stage-ingest", "stages/ingest"),
    ("stage-refine", "stages/refine"),
    ("stage-retarget", "stages/retarget"),
    ("stage-rrt", "stages/baselines/rrt"),
    ("stage-sample", "stages/sample"),
    ("stage-screen", "stages/screen"),
    ("stage-train", "stages/train"),
];

/// Edits a token of a source of a crate; returns what was edited.
fn edit(copy: &Copy, folder: &str, rng: &mut ChaCha8Rng) -> String {
    let sources = sources(&copy.root().join(folder).join("src"));
    let for_tests = ["test", "fixture", "other_hands", "closed_forms", "/report"];
    loop {
        let path = sources.choose(rng).unwrap();
        let name = path.strip_prefix(copy.root()).unwrap().to_str().unwrap();
        let text = fs::read_to_string(path).unwrap();
        let lines: Vec<(usize, &str)> = lines_of_code(&text).collect();
        let Some((at, line)) = lines.choose(rng) else {
            continue;
        };
        let is_for_tests = for_tests.iter().any(|word| name.contains(word));
        if let Some(new) = edited(line, rng).filter(|_| !is_for_tests) {
            let mut lines: Vec<&str> = text.lines().collect();
            lines[*at] = &new;
            put(copy.root(), name, &lines.join("\n"));
            return format!("{name}: `{line}` to `{new}`");
        }
    }
}

#[test]
fn no_edit_of_a_token_in_what_computes_leaves_the_code_of_a_stage_as_it_is() {
    let mut copy = Copy::new();
    let mut rng = ChaCha8Rng::seed_from_u64(7);
    for _ in 0..2 {
        let edits = COMPUTING.map(|(part, folder)| (part, edit(&copy, folder, &mut rng)));
        let before = copy.digests.clone();
        copy.changed();
        for (part, edit) in edits {
            let of_stages = before
                .keys()
                .filter(|name| name.ends_with(&format!(" {part}")));
            for name in of_stages {
                assert_ne!(copy.digests[name], before[name], "{edit}");
            }
            assert!(!copy.linking(part).is_empty(), "{part}");
        }
    }
}

/// Documentation within a macro's arguments does not count, so none may read it.
#[test]
fn no_macro_of_this_workspace_reads_documentation() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    for folder in ["crates", "schemas", "stages"] {
        for path in sources(&root.join(folder)) {
            let text = fs::read_to_string(&path).unwrap();
            let signs: String = text.split_whitespace().collect();
            assert!(!signs.contains("#[doc=$"), "{}", path.display());
        }
    }
}
