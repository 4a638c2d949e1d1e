//! One crate of the workspace: the digest of its own code, and what it links.

use std::{
    collections::BTreeSet,
    fs, io,
    path::{Path, PathBuf},
};

use blake3::Hasher;
use toml_edit::{DocumentMut, Item, TableLike, Value};

use crate::{
    Result, read, read_toml,
    source::{Source, add},
};

/// A crate of the workspace.
#[derive(Debug)]
pub(crate) struct Member {
    pub(crate) name: String,
    pub(crate) manifest: DocumentMut,
    pub(crate) results: OwnCode,
    /// The code of its module of reports, if it has one.
    pub(crate) reports: Option<OwnCode>,
    /// Files and folders that it was read from.
    pub(crate) watched: BTreeSet<PathBuf>,
}

/// A crate's code, or its module's of reports.
#[derive(Debug)]
pub(crate) struct OwnCode {
    /// 16 hexadecimal digits of BLAKE3.
    pub(crate) digest: String,
    /// All words in it, among them the names of crates.
    pub(crate) words: BTreeSet<String>,
}

impl Member {
    pub(crate) fn read(folder: &Path) -> Result<Self> {
        let path = folder.join("Cargo.toml");
        let manifest = read_toml(&path)?;
        let mut watched = BTreeSet::from([path, folder.join("src")]);
        let sources = sources(folder)?;
        let outside = sources
            .iter()
            .filter(|source| !source.path.starts_with("src/"));
        watched.extend(outside.map(|source| folder.join(&source.path)));
        let declared = files(&manifest, "reports").unwrap_or_default();
        let (reports, deciding): (Vec<Source>, Vec<Source>) =
            sources.into_iter().partition(|source| {
                let folders = declared.iter().map(|path| path.trim_end_matches(".rs"));
                let mut folders = folders.map(|folder| format!("{folder}/"));
                declared.contains(&source.path.as_str())
                    || folders.any(|folder| source.path.starts_with(&folder))
            });
        check_apart(folder, &deciding, &reports, &declared)?;
        let decides = files(&manifest, "decides");
        let counts = |path: &str| decides.as_ref().is_none_or(|paths| paths.contains(&path));
        let mut results = own_code(folder, &deciding, counts, &mut watched)?;
        results.digest = with_settings(&manifest, &results.digest);
        let reports = match &*reports {
            [] => None,
            reports => Some(own_code(folder, reports, |_| true, &mut watched)?),
        };
        let name = manifest["package"].get("name").and_then(Item::as_str);
        Ok(Self {
            name: name.unwrap_or_default().to_owned(),
            results,
            reports,
            watched,
            manifest,
        })
    }

    /// What is linked into the program or its build script, by name.
    pub(crate) fn dependencies(&self) -> impl Iterator<Item = (&str, &Item)> {
        dependencies(&self.manifest)
    }
}

fn dependencies(manifest: &DocumentMut) -> impl Iterator<Item = (&str, &Item)> {
    let per_target = manifest.get("target").and_then(Item::as_table_like);
    let per_target = per_target.into_iter().flat_map(TableLike::iter);
    let all = per_target
        .map(|(_, target)| target)
        .chain([manifest.as_item()]);
    all.flat_map(|item| ["dependencies", "build-dependencies"].map(|key| item.get(key)))
        .filter_map(|item| item?.as_table_like())
        .flat_map(TableLike::iter)
}

/// Adds to a digest what the manifest says beyond the names of dependencies, which count by what they
/// name.
fn with_settings(manifest: &DocumentMut, digest: &str) -> String {
    let mut hasher = Hasher::new();
    add(&mut hasher, 'c', digest);
    for item in [manifest["package"].get("edition"), manifest.get("features")] {
        add(&mut hasher, 'm', &values(item));
    }
    for (name, item) in dependencies(manifest) {
        let is_plain = |table: &dyn TableLike| {
            table.len() == 1 && (table.contains_key("workspace") || table.contains_key("path"))
        };
        if !item.as_table_like().is_some_and(is_plain) {
            add(&mut hasher, 'd', &format!("{name} {}", values(Some(item))));
        }
    }
    short(&hasher)
}

/// The sources of a crate but for those of tests, ordered by path.
fn sources(folder: &Path) -> Result<Vec<Source>> {
    let mut paths = Vec::new();
    list_sources(&folder.join("src"), &mut paths)?;
    paths.extend(
        [folder.join("build.rs")]
            .into_iter()
            .filter(|path| path.is_file()),
    );
    paths.sort();
    let sources = paths.iter().map(|path| {
        let below = path.strip_prefix(folder).unwrap_or(path);
        let below = below.to_string_lossy().replace('\\', "/");
        Ok(Source::new(below, &read(path)?))
    });
    let mut sources: Vec<Source> = sources.collect::<Result<_>>()?;
    let of_tests = sources.iter().flat_map(Source::of_tests);
    let of_tests: Vec<[String; 2]> = of_tests.collect();
    let is_tests = |source: &Source| {
        let path = &source.path;
        of_tests
            .iter()
            .any(|[file, folder]| path == file || path.starts_with(folder))
    };
    // A file under another name could be one of a test's.
    let mut others = sources.iter().filter(|source| !is_tests(source));
    if !others.any(Source::has_named_modules) {
        sources.retain(|source| !is_tests(source));
    }
    Ok(sources)
}

fn list_sources(folder: &Path, paths: &mut Vec<PathBuf>) -> Result<()> {
    let failed = |err: io::Error| format!("cannot read `{}`: {err}", folder.display());
    for entry in fs::read_dir(folder).map_err(failed)? {
        let path = entry.map_err(failed)?.path();
        if path.is_dir() {
            list_sources(&path, paths)?;
        } else if path.extension().is_some_and(|kind| kind == "rs") {
            paths.push(path);
        }
    }
    Ok(())
}

/// The files that a manifest names in `package.metadata.code`.
fn files<'a>(manifest: &'a DocumentMut, key: &str) -> Option<Vec<&'a str>> {
    let mut item = manifest.as_item();
    for key in ["package", "metadata", "code", key] {
        item = item.get(key)?;
    }
    let paths = item.as_array()?.iter();
    Some(paths.filter_map(Value::as_str).collect())
}

/// Refuses what could let a report change a result.
fn check_apart(
    folder: &Path,
    deciding: &[Source],
    reports: &[Source],
    declared: &[&str],
) -> Result<()> {
    let refuse = |source: &Source, fault: String| {
        Err(format!("`{}` {fault}", folder.join(&source.path).display()))
    };
    for path in declared {
        let module = Path::new(path).file_stem().unwrap_or_default();
        let module = module.to_string_lossy();
        if let Some(source) = deciding.iter().find(|source| source.uses(&module)) {
            return refuse(
                source,
                format!("uses `{module}`, which is for reports alone"),
            );
        }
    }
    let own: BTreeSet<&str> = reports.iter().flat_map(Source::defined).collect();
    for source in reports {
        if source.words().any(|word| word == "macro_rules") {
            return refuse(
                source,
                "has a macro, which other modules could use".to_owned(),
            );
        }
        let foreign = source
            .implementations()
            .find(|words| words.is_disjoint(&own));
        if let Some(words) = foreign {
            let words: Vec<&str> = words.into_iter().collect();
            let words = words.join("`, `");
            return refuse(
                source,
                format!("implements for types of other modules: `{words}`"),
            );
        }
    }
    Ok(())
}

/// Digests those of these sources that count, and what they include.
fn own_code(
    folder: &Path,
    sources: &[Source],
    counts: impl Fn(&str) -> bool,
    watched: &mut BTreeSet<PathBuf>,
) -> Result<OwnCode> {
    let mut hasher = Hasher::new();
    for source in sources.iter().filter(|source| counts(&source.path)) {
        source.digest(&mut hasher);
        let path = folder.join(&source.path);
        for included in source.includes() {
            let Some(name) = included else {
                let path = path.display();
                return Err(format!(
                    "`{path}` includes a file that no plain literal names"
                ));
            };
            let included = path.with_file_name(name);
            let bytes = fs::read(&included);
            let bytes =
                bytes.map_err(|err| format!("cannot read `{}`: {err}", included.display()))?;
            add(&mut hasher, 'i', &blake3::hash(&bytes).to_hex());
            watched.insert(included);
        }
    }
    let words = sources.iter().flat_map(Source::words);
    Ok(OwnCode {
        digest: short(&hasher),
        words: words.map(str::to_owned).collect(),
    })
}

/// Returns the values of a part of a manifest without comments; none in a line that has a quote after `#`.
pub(crate) fn values(item: Option<&Item>) -> String {
    let text = item.map(ToString::to_string).unwrap_or_default();
    let values = text.lines().map(|line| match line.split_once('#') {
        Some((value, comment)) if !comment.contains(['"', '\'']) => value.trim(),
        _ => line.trim(),
    });
    values
        .filter(|value| !value.is_empty())
        .collect::<Vec<_>>()
        .join("\n")
}

/// The first 16 hexadecimal digits of a digest: enough to distinguish versions.
pub(crate) fn short(hasher: &Hasher) -> String {
    hasher.finalize().to_hex()[..16].to_owned()
}
