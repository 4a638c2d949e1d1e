//! This workspace: an edit changes the code of exactly the stages that it can change.

use std::{
    collections::{BTreeMap, BTreeSet},
    fs,
    path::{Path, PathBuf},
};

use rand::{Rng, SeedableRng, seq::IndexedRandom};
use rand_chacha::ChaCha8Rng;
use tempfile::TempDir;
use toml_edit::DocumentMut;

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

/// The sources in a folder and below.
fn sources(folder: &Path) -> Vec<PathBuf> {
    files(folder, "rs")
}

/// The files of a kind in a folder and below, ordered.
fn files(folder: &Path, kind: &str) -> Vec<PathBuf> {
    let mut files = Vec::new();
    let mut open = vec![folder.to_owned()];
    while let Some(folder) = open.pop() {
        for entry in fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                open.push(path);
            } else if path.extension().is_some_and(|found| found == kind) {
                files.push(path);
            }
        }
    }
    files.sort();
    files
}

#[test]
fn layout_a_comment_and_a_test_in_every_source_of_every_crate_change_no_code() {
    let mut copy = Copy::new();
    assert!(copy.digests.len() > 200, "{:?}", copy.digests);
    let before = copy.digests.clone();
    let mut laid_out_n = 0;
    for path in sources(copy.root()) {
        let name = path.strip_prefix(copy.root()).unwrap();
        let more = "// A comment.\n\n/// A test.\n#[cfg(test)]\nmod more {\n    use super::*;\n\n    \
                    #[test]\n    fn seven() {\n        assert_eq!(3 + 4, 7);\n    }\n}\n";
        let text = fs::read_to_string(&path).unwrap();
        let has_whole_strings = |line: &str| {
            line.replace("\\\"", "")
                .matches('"')
                .count()
                .is_multiple_of(2)
        };
        // Where every string ends in its line, lines may move.
        let text = if text.lines().all(has_whole_strings) && !text.contains("r#") {
            laid_out_n += 1;
            text.replace('\n', "\n\n    ") + "\n"
        } else {
            text
        };
        put(copy.root(), name.to_str().unwrap(), &(text + more));
    }
    assert!(laid_out_n > 200, "{laid_out_n}");
    copy.changed();
    assert_eq!(copy.digests, before);
}

#[test]
fn a_number_changes_the_stages_that_link_it_and_no_others() {
    let mut copy = Copy::new();
    let named = |codes: &[&str]| codes.iter().map(|&code| code.to_owned()).collect();
    let simulation = "crates/physics/simulation/src/lib.rs";
    let edited = [
        ("stages/refine/src/refine.rs", &["stage-refine"][..]),
        (
            "stages/screen/src/screen.rs",
            &["report-screen", "stage-screen"],
        ),
        ("stages/screen/src/report/rates.rs", &["report-screen"]),
        ("stages/ingest/src/report.rs", &["report-ingest"]),
        (
            "crates/tools/statistics/src/lib.rs",
            &["report-screen", "stage-report"],
        ),
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

/// A crate that a stage or its reports link.
struct Crate {
    name: String,
    sources: Vec<Module>,
}

/// A source of a crate.
struct Module {
    /// Its path below the copy.
    path: String,
    /// The part of the codes that it is in, or why it is in none, by what its crate declares.
    part: Result<String, &'static str>,
}

impl Crate {
    fn read(copy: &Path, folder: &Path) -> Self {
        let manifest = fs::read_to_string(folder.join("Cargo.toml")).unwrap();
        let package = manifest.parse::<DocumentMut>().unwrap()["package"].clone();
        let name = package["name"].as_str().unwrap().to_owned();
        let declared = |key: &str| -> Option<Vec<PathBuf>> {
            let paths = package.get("metadata")?.get("code")?.get(key)?.as_array()?;
            let paths = paths.iter().map(|path| path.as_str().unwrap());
            Some(paths.map(|path| folder.join(path)).collect())
        };
        let (reports, decides) = (declared("reports"), declared("decides"));
        let paths = sources(&folder.join("src"));
        let of_tests = paths.iter().flat_map(|path| modules_of_tests(path));
        let of_tests: Vec<PathBuf> = of_tests.collect();
        // A module's folder is the module too.
        let is_in = |path: &Path, modules: &[PathBuf]| {
            let mut modules = modules.iter().map(|module| module.with_extension(""));
            modules.any(|module| path.with_extension("").starts_with(module))
        };
        let part = |path: &Path| {
            if is_in(path, &of_tests) {
                Err("its module is declared for tests")
            } else if is_in(path, reports.as_deref().unwrap_or_default()) {
                Ok(name.replace("stage-", "report-"))
            } else if decides.as_ref().is_none_or(|some| is_in(path, some)) {
                Ok(name.clone())
            } else {
                Err("`decides` of its crate, an engine, leaves it out")
            }
        };
        let module = |path: &PathBuf| Module {
            path: path.strip_prefix(copy).unwrap().display().to_string(),
            part: part(path),
        };
        let sources = paths.iter().map(module).collect();
        Self { name, sources }
    }
}

/// The files of the modules that a source declares for tests alone.
fn modules_of_tests(source: &Path) -> Vec<PathBuf> {
    let text = fs::read_to_string(source).unwrap();
    let folder = match source.file_stem().unwrap().to_str().unwrap() {
        "lib" | "main" => source.with_file_name(""),
        _ => source.with_extension(""),
    };
    let declared = text.split("#[cfg(test)]\n").skip(1).filter_map(|rest| {
        let name = rest.lines().next()?.strip_suffix(';')?;
        let name = name.strip_prefix("pub(crate) ").unwrap_or(name);
        Some(folder.join(name.strip_prefix("mod ")?))
    });
    declared.collect()
}

/// Lines of a text, and where each begins.
type Lines<'a> = Vec<(usize, &'a str)>;

fn lines(text: &str) -> impl Iterator<Item = (usize, &str)> {
    let start = |line: &str| line.as_ptr() as usize - text.as_ptr() as usize;
    text.split_inclusive('\n')
        .map(move |line| (start(line), line))
}

fn is_comment(line: &str) -> bool {
    line.trim_start().starts_with("//")
}

/// Returns the lines before the first test that count. An included file must be there, so its name stays.
fn code_of(text: &str) -> Lines<'_> {
    let code = text.split("#[cfg(test)]").next().unwrap_or_default();
    let counts = |line: &str| !is_comment(line) && !line.contains("include");
    lines(code).filter(|(_, line)| counts(line)).collect()
}

/// Returns the comments, and the lines of the module of tests.
fn comments_and_tests_of(text: &str) -> Lines<'_> {
    let tests = "#[cfg(test)]\nmod tests {\n";
    let start = text.find(tests).map_or(text.len(), |at| at + tests.len());
    let end = text[start..].find("\n}\n").map_or(start, |end| start + end);
    lines(text)
        .filter(|(at, line)| is_comment(line) || (start..end).contains(at))
        .collect()
}

/// Operators, each with another.
const OPERATORS: [[&str; 2]; 10] = [
    [" + ", " - "],
    [" - ", " * "],
    [" * ", " / "],
    [" / ", " + "],
    [" < ", " <= "],
    [" > ", " >= "],
    [" == ", " != "],
    [" != ", " == "],
    [" && ", " || "],
    [" || ", " && "],
];

/// Returns a line with another token at one place: of the three kinds a number, an operator or a name.
fn edited(
    line: &str,
    kind: usize,
    is_crate: impl Fn(&str) -> bool,
    rng: &mut ChaCha8Rng,
) -> Option<String> {
    let end = if is_comment(line) {
        None
    } else {
        line.find("//")
    };
    let code = &line[..end.unwrap_or(line.len())];
    let is_in_word = |c: char| c.is_alphanumeric() || c == '_';
    let token = |at: usize| {
        let (before, rest) = code.split_at(at);
        let is_start = !before.ends_with(|c| is_in_word(c) || c == '\'' || c == '\\');
        let word = &rest[..rest.find(|c| !is_in_word(c)).unwrap_or(rest.len())];
        match (kind, rest.chars().next()?) {
            (0, '9') if is_start => Some((1, "8".to_owned())),
            (0, '0'..='8') if is_start => Some((1, "9".to_owned())),
            (1, ' ') => {
                let [old, new] = OPERATORS.iter().find(|[old, _]| rest.starts_with(old))?;
                Some((old.len(), (*new).to_owned()))
            }
            // A name before a quote belongs to a literal. Without the name of a crate, another may be linked.
            (2, 'a'..='z' | 'A'..='Z') if is_start && !is_crate(word) => {
                let is_literal = rest[word.len()..].starts_with(['"', '\'', '#']);
                (!is_literal).then(|| (word.len(), format!("{word}_other")))
            }
            _ => None,
        }
    };
    let places = code
        .char_indices()
        .filter_map(|(at, _)| Some((at, token(at)?)));
    let (at, (n, new)) = places.collect::<Vec<_>>().choose(rng)?.clone();
    Some(format!("{}{new}{}", &line[..at], &line[at + n..]))
}

/// An edit of a token in words, and the part of its [`Module`].
type Edit = (String, Result<String, &'static str>);

impl Copy {
    /// The crates that stages or their reports link.
    fn crates(&self) -> Vec<Crate> {
        let manifests = files(self.root(), "toml");
        let manifests = manifests.iter().filter(|path| path.ends_with("Cargo.toml"));
        let folders =
            manifests.filter_map(|path| path.parent().filter(|&path| path != self.root()));
        let crates = folders.map(|folder| Crate::read(self.root(), folder));
        crates
            .filter(|one| !self.linking(&one.name).is_empty())
            .collect()
    }

    /// Edits a token in one source of every crate, in one of these lines; returns the edits and the parts
    /// that changed.
    fn edit_each(
        &mut self,
        crates: &[Crate],
        choice: fn(&str) -> Lines<'_>,
        rng: &mut ChaCha8Rng,
    ) -> (Vec<Edit>, Vec<String>) {
        let is_crate = |word: &str| crates.iter().any(|one| one.name.replace('-', "_") == word);
        let mut edit = |one: &Crate| loop {
            let (module, kind) = (one.sources.choose(rng).unwrap(), rng.random_range(0..3));
            // Another name in a report may end the build.
            if kind == 2 && module.part.as_ref().is_ok_and(|part| *part != one.name) {
                continue;
            }
            let path = &module.path;
            let text = fs::read_to_string(self.root().join(path)).unwrap();
            let Some(&(at, line)) = choice(&text).choose(rng) else {
                continue;
            };
            if let Some(new) = edited(line, kind, is_crate, rng) {
                let rest = &text[at + line.len()..];
                put(self.root(), path, &format!("{}{new}{rest}", &text[..at]));
                let edit = format!("{path}: `{}` to `{}`", line.trim(), new.trim());
                return (edit, module.part.clone());
            }
        };
        let edits = crates.iter().map(&mut edit).collect();
        let after = digests(self.root()).unwrap();
        let changed = changed(&self.digests, &after);
        self.digests = after;
        (edits, changed)
    }
}

#[test]
fn thirty_random_edits_of_a_token_change_all_that_links_it_and_those_of_comments_and_tests_nothing()
{
    let mut copy = Copy::new();
    let mut rng = ChaCha8Rng::seed_from_u64(7);
    let crates = copy.crates();
    let (edits, changed) = copy.edit_each(&crates, comments_and_tests_of, &mut rng);
    assert_eq!(changed, [] as [&str; 0], "{edits:#?}");
    let mut n_edits = 0;
    while n_edits < 30 {
        let (edits, changed) = copy.edit_each(&crates, code_of, &mut rng);
        let is_in = |part: &str, edit: &Edit| edit.1.as_deref() == Ok(part);
        for name in copy.digests.keys() {
            let (_, part) = name.split_once(' ').unwrap();
            // What its crate declares to be in no part changes none.
            let is_edited = edits.iter().any(|edit| is_in(part, edit));
            assert_eq!(changed.contains(name), is_edited, "{name}: {edits:#?}");
        }
        n_edits += edits.iter().filter(|(_, part)| part.is_ok()).count();
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
