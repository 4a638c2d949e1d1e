//! The files that a program depends on beside its inputs: its code, its lock file and its own files.

use std::{
    collections::BTreeMap,
    fs,
    path::{Path, PathBuf},
};

use dataflow::SourceFile;

use crate::{config::ProgramConfig, error::ProgramError};

/// Prefix of the names of the files that the program reads: `files.NAME`, or `files.NAME/…` below a folder.
pub(crate) const FILES: &str = "files.";

/// Lists every file outside the lake on which the program depends, once each, in the order of the names.
pub(crate) fn sources(config: &ProgramConfig) -> Result<Vec<SourceFile>, ProgramError> {
    let mut found: BTreeMap<String, PathBuf> = BTreeMap::new();
    for element in &config.command {
        let path = Path::new(element);
        // Interpreters from PATH are the environment, which the lock file stands for.
        if path.is_file() && names_a_file(element) {
            found.insert(element.clone(), path.to_owned());
        }
    }
    for pattern in &config.code {
        let unreadable = |reason: String| ProgramError::Pattern {
            pattern: pattern.clone(),
            reason,
        };
        let paths = glob::glob(pattern).map_err(|err| unreadable(err.to_string()))?;
        let mut n_files = 0;
        for path in paths {
            let path = path.map_err(|err| unreadable(err.to_string()))?;
            if path.is_file() && !is_cache(&path) {
                found.insert(path.display().to_string(), path);
                n_files += 1;
            }
        }
        if n_files == 0 {
            return Err(ProgramError::NoCode {
                pattern: pattern.clone(),
            });
        }
    }
    if let Some(lock) = &config.lock {
        check_file("lock", lock)?;
        found.insert(lock.display().to_string(), lock.clone());
    }
    for (name, path) in &config.files {
        let root = format!("{FILES}{name}");
        if path.is_dir() {
            collect(path, &root, &mut found)?;
        } else {
            check_file(&root, path)?;
            found.insert(root, path.clone());
        }
    }
    let sources = found.into_iter();
    Ok(sources
        .map(|(name, path)| SourceFile { name, path })
        .collect())
}

/// Returns the command with the elements that name files as absolute paths.
pub(crate) fn absolute(config: &ProgramConfig) -> Result<Vec<PathBuf>, ProgramError> {
    let elements = config.command.iter().map(|element| {
        let path = Path::new(element);
        if path.is_file() && names_a_file(element) {
            // Not its canonical form: a virtual environment's Python is a link.
            std::path::absolute(path).map_err(ProgramError::at(path))
        } else {
            Ok(path.to_owned())
        }
    });
    elements.collect()
}

/// Returns the elements of the command that look like files, by an extension such as `.py`, and are none.
pub(crate) fn missing(config: &ProgramConfig) -> Vec<String> {
    let elements = config.command.iter().filter(|element| {
        let path = Path::new(element);
        let extension = path.extension().and_then(|extension| extension.to_str());
        extension.is_some_and(|text| text.chars().all(|letter| letter.is_ascii_alphabetic()))
            && !path.exists()
    });
    elements.cloned().collect()
}

/// Whether an element of a command is meant as a path: a bare word such as `python3` is looked up in PATH, even
/// beside a file of that name.
fn names_a_file(element: &str) -> bool {
    element.contains('/') || element.contains('.')
}

/// Whether a file is compiled code that an interpreter leaves beside the sources.
fn is_cache(path: &Path) -> bool {
    path.components()
        .any(|part| part.as_os_str() == "__pycache__")
}

fn check_file(option: &str, path: &Path) -> Result<(), ProgramError> {
    if path.is_file() {
        return Ok(());
    }
    Err(ProgramError::NoFile {
        option: option.to_owned(),
        path: path.to_owned(),
    })
}

fn collect(
    folder: &Path,
    name: &str,
    found: &mut BTreeMap<String, PathBuf>,
) -> Result<(), ProgramError> {
    for entry in fs::read_dir(folder).map_err(ProgramError::at(folder))? {
        let path = entry.map_err(ProgramError::at(folder))?.path();
        let name = format!(
            "{name}/{}",
            path.file_name().unwrap_or_default().to_string_lossy()
        );
        if path.is_dir() {
            collect(&path, &name, found)?;
        } else {
            found.insert(name, path);
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_bare_word_is_looked_up_and_a_path_is_code() {
        assert!(!names_a_file("python3"));
        assert!(names_a_file("judge.py"));
        assert!(names_a_file(".venv/bin/python"));
    }
}
