//! `pipeline new`

use std::{
    fs, io,
    path::{Path, PathBuf},
    process,
};

use lake::write_atomic;

use crate::{
    arguments::NewArgs,
    command_line::Program,
    label::Label,
    outcome::{CommandError, CommandOutcome},
};

/// Maximum entries named of a folder that is not empty.
const NAMED: usize = 3;

/// Placeholder of the project's name in its README.
const NAME: &str = "NAME";

/// The files of a new project, by path, with those of this repository at the same place: `build.rs` lists them.
const FILES: &[(&str, &str)] = include!(concat!(env!("OUT_DIR"), "/project_files.rs"));

/// Writes a project in which the main job runs.
pub(crate) fn new(program: &Program, args: &NewArgs) -> Result<CommandOutcome, CommandError> {
    let name = &args.name;
    check_name(name)?;
    let folder = Path::new(name);
    check_empty(folder)?;
    // Written beside its path, then renamed: a project appears whole or not at all.
    let beside = PathBuf::from(format!(".{name}.{}.new", process::id()));
    let written = write(&beside, name)
        .and_then(|()| fs::rename(&beside, folder).map_err(anyhow::Error::from));
    if let Err(err) = written {
        let _gone = fs::remove_dir_all(&beside);
        let context = format!("cannot make the project `{name}`");
        return Err(CommandError::failed(err.context(context), None));
    }
    program.say(Label::Done, format!("the project `{name}` is there"));
    program.say(
        Label::Next,
        format!("`cd {name}`, then `pipeline run pipelines/cgf.toml`; its README says more"),
    );
    Ok(CommandOutcome::Done)
}

/// Checks that a name is a valid folder name on every system, without quotes.
fn check_name(name: &str) -> Result<(), CommandError> {
    let is_word = |letter: char| letter.is_ascii_alphanumeric() || letter == '_' || letter == '-';
    let begins_well = name.starts_with(|letter: char| letter.is_ascii_alphanumeric());
    if begins_well && name.chars().all(is_word) {
        return Ok(());
    }
    let hint = match Path::new(name).file_name().and_then(|last| last.to_str()) {
        Some(last) if name.contains('/') && check_name(last).is_ok() => {
            format!("go to the folder in which it is to be, then `pipeline new {last}`")
        }
        _ => "use ASCII letters, digits, `_` and `-`, a letter or digit first, e.g. `my_lab`"
            .to_owned(),
    };
    Err(CommandError::usage(
        format!("`{name}` is not a name for a project"),
        hint,
    ))
}

/// Checks that nothing is overwritten.
fn check_empty(folder: &Path) -> Result<(), CommandError> {
    let entries = match fs::read_dir(folder) {
        Ok(entries) => entries,
        Err(err) if err.kind() == io::ErrorKind::NotFound => return Ok(()),
        Err(err) => {
            return Err(CommandError::usage(
                format!("cannot make a project in `{}`: {err}", folder.display()),
                "choose another name",
            ));
        }
    };
    let mut names: Vec<String> = entries
        .flatten()
        .map(|entry| format!("`{}`", entry.file_name().to_string_lossy()))
        .collect();
    if names.is_empty() {
        return Ok(());
    }
    names.sort();
    let n_more = names.len().saturating_sub(NAMED);
    names.truncate(NAMED);
    let more = if n_more > 0 {
        format!(" and {n_more} more")
    } else {
        String::new()
    };
    Err(CommandError::usage(
        format!(
            "`{}` is not empty: it has {}{more}",
            folder.display(),
            names.join(", ")
        ),
        "choose another name, or empty the folder first; nothing was written",
    ))
}

fn write(folder: &Path, name: &str) -> anyhow::Result<()> {
    let readme = include_str!("new/readme.md").replacen(NAME, name, 1);
    for (path, text) in FILES {
        write_atomic(&folder.join(path), text.as_bytes())?;
    }
    write_atomic(&folder.join("README.md"), readme.as_bytes())?;
    Ok(())
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::*;

    /// The files below a folder of the repository that people wrote.
    fn below(folder: &str, found: &mut BTreeSet<String>) {
        let root = Path::new(env!("CARGO_MANIFEST_DIR"));
        for entry in fs::read_dir(root.join(folder)).unwrap() {
            let path = format!("{folder}/{}", entry.unwrap().file_name().to_string_lossy());
            if root.join(&path).is_dir() {
                below(&path, found);
            } else {
                found.insert(path);
            }
        }
    }

    #[test]
    fn a_new_project_has_every_pipeline_hand_and_robot() {
        let mut there = BTreeSet::from([
            ".gitignore".to_owned(),
            "data/sample/recipe.toml".to_owned(),
        ]);
        for folder in ["data/access", "data/hands", "data/robots", "pipelines"] {
            below(folder, &mut there);
        }
        // They document this repository, not a project.
        there.remove("pipelines/README.md");
        there.remove("pipelines/studies/README.md");
        there.remove("pipelines/profiles.md");
        there.remove("pipelines/studies/paper_tables.md");
        there.retain(|path| !path.starts_with("pipelines/studies/tables/"));
        // They need a program or a trained function of this repository.
        there.remove("pipelines/camera.toml");
        there.remove("pipelines/depth.toml");
        there.remove("pipelines/registered.toml");
        there.remove("pipelines/studies/views.toml");
        there.remove("pipelines/studies/views_hand.toml");
        there.remove("pipelines/studies/views_registered.toml");
        there.remove("pipelines/studies/views_true.toml");
        there.remove("pipelines/pretrained.toml");
        there.remove("pipelines/studies/pretrained.toml");
        there.remove("pipelines/studies/agreement_pretrained.toml");
        there.remove("pipelines/studies/agreement.toml");
        there.remove("pipelines/studies/agreement_hand.toml");
        there.remove("pipelines/studies/agreement_parts.toml");
        there.remove("pipelines/studies/hands.toml");
        there.remove("pipelines/generator.toml");
        let written = FILES.iter().map(|(path, _)| (*path).to_owned());
        assert_eq!(written.collect::<BTreeSet<_>>(), there);
    }

    #[test]
    fn links_in_a_new_project_lead_to_files_of_it() {
        let mut written: BTreeSet<&str> = FILES.iter().map(|(path, _)| *path).collect();
        written.insert("README.md");
        let is_page = |path: &str| Path::new(path).extension().is_some_and(|it| it == "md");
        for (path, text) in FILES.iter().filter(|(path, _)| is_page(path)) {
            for link in text.split("](").skip(1) {
                let link = link.split(')').next().unwrap();
                let target = Path::new(path).parent().unwrap().join(link);
                let is_there = written.contains(target.to_str().unwrap());
                assert!(is_there || link.contains("://"), "{path}: {link}");
            }
        }
    }

    #[test]
    fn names_are_plain() {
        for name in ["my_lab", "a", "2026-lab", "Lab-2"] {
            assert!(check_name(name).is_ok(), "{name}");
        }
        for name in [
            "", ".", "..", "-x", "_x", "a b", "a/b", "/a", "a.b", "ä", "a\n", ".git",
        ] {
            let said = check_name(name);
            let Err(CommandError::Usage { message, hint }) = said else {
                panic!("{name}: {said:?}");
            };
            assert!(message.contains("is not a name for a project"), "{message}");
            assert!(hint.is_some());
        }
    }
}
