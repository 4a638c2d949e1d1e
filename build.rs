//! Digests the code of every stage, for `dataflow::code!`, and lists the files of a new project, for `pipeline new`.

use std::{
    collections::BTreeMap,
    env,
    error::Error,
    fs, io,
    path::{Path, PathBuf},
};

/// What a new project has of this repository, at the same place: the files with these endings at or below these paths.
/// Meshes and keys that people put beside them stay out.
const PROJECT: [(&str, &[&str]); 6] = [
    (".gitignore", &[".gitignore"]),
    ("data/access", &[".json5", ".md"]),
    ("data/hands", &[".toml", ".md"]),
    ("data/robots", &[".urdf"]),
    ("data/sample/recipe.toml", &[".toml"]),
    ("pipelines", &[".toml"]),
];

/// Programs and trained functions of this repository: a pipeline file that needs one stays out too, and one that extends it.
const OF_REPOSITORY: [&str; 2] = ["stages/program/examples/", "data/checkpoints/"];

fn main() -> Result<(), Box<dyn Error>> {
    code_digest::emit();
    let flags = env::var("CARGO_ENCODED_RUSTFLAGS").unwrap_or_default();
    let has_own_linker = env::var_os("RUSTC_LINKER").is_some() || flags.contains("linker");
    if env::var("TARGET")? == "x86_64-unknown-linux-gnu"
        && !has_own_linker
        && !flags.contains("fuse-ld")
    {
        // Identical code folding by rust-lld, the default linker of this platform: the program is a tenth smaller.
        // Folded functions share one name in backtraces.
        println!("cargo::rustc-link-arg-bins=-Wl,--icf=all");
    }
    let root = PathBuf::from(env::var("CARGO_MANIFEST_DIR")?);
    let mut files = BTreeMap::new();
    for (name, endings) in PROJECT {
        println!("cargo::rerun-if-changed={name}");
        list(&root, name, endings, &mut files)?;
    }
    while let Some(name) = orphan(&root, &files)? {
        files.remove(&name);
    }
    let listed = files.iter().map(|(name, path)| {
        let path = path.display().to_string();
        format!("({name:?}, include_str!({path:?})),\n")
    });
    let listed = format!("&[\n{}]\n", listed.collect::<String>());
    write(
        &Path::new(&env::var("OUT_DIR")?).join("project_files.rs"),
        &listed,
    )?;
    Ok(())
}

/// Adds the files with these endings at or below a path, each with its place on this machine.
fn list(
    root: &Path,
    name: &str,
    endings: &[&str],
    files: &mut BTreeMap<String, PathBuf>,
) -> io::Result<()> {
    let path = root.join(name);
    if path.is_dir() {
        for entry in fs::read_dir(path)? {
            let below = entry?.file_name();
            list(root, &format!("{name}/{}", below.display()), endings, files)?;
        }
    } else if endings.iter().any(|ending| name.ends_with(ending)) {
        let text = fs::read_to_string(&path)?;
        if !OF_REPOSITORY.iter().any(|place| text.contains(place)) {
            files.insert(name.to_owned(), path);
        }
    }
    Ok(())
}

/// Returns a pipeline file that extends one of the repository that is not among these.
fn orphan(root: &Path, files: &BTreeMap<String, PathBuf>) -> io::Result<Option<String>> {
    let kept: Vec<PathBuf> = files
        .values()
        .map(|path| path.canonicalize())
        .collect::<Result<_, _>>()?;
    for (name, path) in files {
        let text = fs::read_to_string(path)?;
        let extended = text
            .lines()
            .find_map(|line| line.strip_prefix("extends = "));
        let Some(extended) = extended.map(|extended| extended.trim_matches('"')) else {
            continue;
        };
        let extended = path
            .parent()
            .unwrap_or(root)
            .join(extended)
            .canonicalize()?;
        if !kept.contains(&extended) {
            return Ok(Some(name.clone()));
        }
    }
    Ok(None)
}

#[expect(
    clippy::disallowed_methods,
    reason = "cargo runs a build script that was cut off again"
)]
fn write(path: &Path, text: &str) -> io::Result<()> {
    fs::write(path, text)
}
