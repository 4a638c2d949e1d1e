//! The files that a program depends on beside its inputs: its code, its lock file and its own files.

use std::{
    collections::BTreeMap,
    fs, io,
    path::{Path, PathBuf},
};

use dataflow::{Diagnostic, FileFault, SourceFile};

use crate::{config::ProgramConfig, error::ProgramError};

/// Prefix of the names of the files that the program reads: `files.NAME`, or `files.NAME/…` below a folder.
pub(crate) const FILES: &str = "files.";

/// Lists every file outside the lake on which the program depends, once each, in the order of the names.
pub(crate) fn sources(config: &ProgramConfig) -> Result<Vec<SourceFile>, ProgramError> {
    let Named { found, faults } = named(config);
    if let Some(fault) = faults.into_iter().next() {
        return Err(fault.error);
    }
    let sources = found.into_iter();
    Ok(sources
        .map(|(name, path)| SourceFile::new(name, path))
        .collect())
}

/// Returns everything that the options name and that cannot be used.
pub(crate) fn file_faults(config: &ProgramConfig) -> Vec<FileFault> {
    let faults = named(config).faults.into_iter();
    let faults = faults.map(|fault| FileFault {
        problem: fault.error.after_option(),
        hint: fault.error.hint(),
        key: fault.key,
        element: fault.element,
    });
    faults.collect()
}

/// The files that the options name.
#[derive(Default)]
struct Named {
    /// By the name under which each counts.
    found: BTreeMap<String, PathBuf>,
    faults: Vec<Fault>,
}

/// What an option names and cannot be used.
struct Fault {
    key: String,
    /// Position in a list.
    element: Option<usize>,
    error: ProgramError,
}

fn named(config: &ProgramConfig) -> Named {
    let mut all = Named::default();
    for element in &config.command {
        let path = Path::new(element);
        // Interpreters from PATH are the environment, which the lock file stands for.
        if path.is_file() && names_a_file(element) {
            all.found.insert(element.clone(), path.to_owned());
        }
    }
    for (idx, pattern) in config.code.iter().enumerate() {
        match matching(pattern) {
            Ok(paths) => {
                let paths = paths.into_iter();
                all.found
                    .extend(paths.map(|path| (path.display().to_string(), path)));
            }
            Err(error) => all.faults.push(Fault {
                key: "code".to_owned(),
                element: Some(idx),
                error,
            }),
        }
    }
    if let Some(lock) = &config.lock {
        all.take("lock", lock.display().to_string(), lock);
    }
    for (name, path) in &config.files {
        let root = format!("{FILES}{name}");
        if path.is_dir() {
            all.collect(&root, path, &root, &[]);
        } else {
            all.take(&root, root.clone(), path);
        }
    }
    all
}

/// Returns the files that a pattern of `code` matches: at least one.
fn matching(pattern: &str) -> Result<Vec<PathBuf>, ProgramError> {
    let unreadable = |reason: String| ProgramError::Pattern {
        pattern: pattern.to_owned(),
        reason,
    };
    let paths = glob::glob(pattern).map_err(|err| unreadable(err.to_string()))?;
    let mut found = Vec::new();
    for path in paths {
        let path = path.map_err(|err| unreadable(err.to_string()))?;
        if path.is_file() && !is_cache(&path) {
            found.push(path);
        }
    }
    if found.is_empty() {
        return Err(ProgramError::NoCode {
            pattern: pattern.to_owned(),
        });
    }
    Ok(found)
}

impl Named {
    fn refuse(&mut self, key: &str, error: ProgramError) {
        self.faults.push(Fault {
            key: key.to_owned(),
            element: None,
            error,
        });
    }

    /// Takes a file under a name, or says why it cannot be read. A pipe would be waited for without end.
    fn take(&mut self, key: &str, name: String, path: &Path) {
        let path = path.to_owned();
        let option = key.to_owned();
        match fs::metadata(&path) {
            Err(err) if err.kind() == io::ErrorKind::NotFound => {
                self.refuse(key, ProgramError::NoFile { option, path });
            }
            Ok(found) if !found.is_file() => {
                self.refuse(key, ProgramError::NotAFile { option, path });
            }
            Ok(_) => match fs::File::open(&path) {
                Ok(_) => drop(self.found.insert(name, path)),
                Err(source) => self.unreadable(key, &path, source),
            },
            Err(source) => self.unreadable(key, &path, source),
        }
    }

    fn unreadable(&mut self, key: &str, path: &Path, source: io::Error) {
        let error = ProgramError::Unopened {
            option: key.to_owned(),
            path: path.to_owned(),
            source,
        };
        self.refuse(key, error);
    }

    /// Takes the files below a folder; `above` are the folders that led to it.
    fn collect(&mut self, key: &str, folder: &Path, name: &str, above: &[PathBuf]) {
        let listed = fs::canonicalize(folder).and_then(|real| {
            let entries = fs::read_dir(folder)?.collect::<Result<Vec<_>, _>>()?;
            Ok((real, entries))
        });
        let (real, entries) = match listed {
            Ok(listed) => listed,
            Err(source) => return self.unreadable(key, folder, source),
        };
        if above.contains(&real) {
            let error = ProgramError::LinkCircle {
                option: key.to_owned(),
                path: folder.to_owned(),
            };
            return self.refuse(key, error);
        }
        let above = [above, &[real]].concat();
        for entry in entries {
            let path = entry.path();
            let name = format!("{name}/{}", entry.file_name().to_string_lossy());
            if path.is_dir() {
                self.collect(key, &path, &name, &above);
            } else {
                self.take(key, name, &path);
            }
        }
    }
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
