//! The log of a unit: everything that its program printed, up to a limit.

use std::{
    collections::VecDeque,
    fs::{self, File},
    io::Write,
    path::{Path, PathBuf},
    sync::{Mutex, PoisonError},
};

use crate::error::ProgramError;

/// Lines that an error shows.
const SHOWN_LINES: usize = 12;
/// Longest line that an error shows, in characters.
const SHOWN_WIDTH: usize = 200;

/// A log being written.
pub(crate) struct Log {
    path: PathBuf,
    written: Mutex<Written>,
}

struct Written {
    file: File,
    last_lines: VecDeque<String>,
}

impl Log {
    /// Begins the log of an attempt; that of the last one is overwritten.
    pub(crate) fn begin(path: &Path) -> Result<Self, ProgramError> {
        if let Some(folder) = path.parent() {
            fs::create_dir_all(folder).map_err(ProgramError::at(folder))?;
        }
        let file = File::create(path).map_err(ProgramError::at(path))?;
        Ok(Self {
            path: path.to_owned(),
            written: Mutex::new(Written {
                file,
                last_lines: VecDeque::new(),
            }),
        })
    }

    pub(crate) fn path(&self) -> &Path {
        &self.path
    }

    /// Adds a line, or a part of a line too long to be held.
    pub(crate) fn line(&self, bytes: &[u8]) {
        // A poisoned lock only means that another reader panicked.
        let mut written = self.written.lock().unwrap_or_else(PoisonError::into_inner);
        // A log that cannot be written is no reason to fail a unit that can be made.
        let _unwritten = written.file.write_all(bytes);
        let text = String::from_utf8_lossy(bytes);
        let text = text.trim_end();
        if text.is_empty() {
            return;
        }
        let shown = text
            .chars()
            .take(SHOWN_WIDTH)
            .filter(|letter| !letter.is_control() || *letter == '\t');
        written.last_lines.push_back(shown.collect());
        if written.last_lines.len() > SHOWN_LINES {
            written.last_lines.pop_front();
        }
    }

    /// Returns the last lines, for an error.
    pub(crate) fn last_lines(&self) -> String {
        let written = self.written.lock().unwrap_or_else(PoisonError::into_inner);
        let lines: Vec<String> = written
            .last_lines
            .iter()
            .map(|line| format!("  {line}"))
            .collect();
        lines.join("\n")
    }

    /// Returns the last line.
    pub(crate) fn last_line(&self) -> Option<String> {
        let written = self.written.lock().unwrap_or_else(PoisonError::into_inner);
        written.last_lines.back().cloned()
    }
}
