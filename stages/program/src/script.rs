//! The first line of a script, `#!/usr/bin/env python3`, which names the program that runs it.

use std::{
    env, fmt,
    fs::File,
    io::{BufRead, BufReader, Read},
    path::{Path, PathBuf},
};

/// Longest first line that is looked at, in bytes: Linux reads 256.
const MAX_LINE: u64 = 256;

/// What is wrong with the first line of a script.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum FirstLine {
    /// It ends with a carriage return, as in files from Windows, which is taken for a part of the name.
    CarriageReturn,
    /// It names an interpreter that is not there.
    NoInterpreter(String),
    /// There is none: the file is no program of this machine, and nothing says what runs it.
    Missing,
}

impl FirstLine {
    /// Looks at the first line of the program that a command names: a path, or a word that is looked up in PATH.
    pub(crate) fn of(program: &Path) -> Option<Self> {
        let place = if program.components().count() > 1 {
            program.to_owned()
        } else {
            let folders = env::var_os("PATH")?;
            let places = env::split_paths(&folders).map(|folder| folder.join(program));
            places.into_iter().find(|place| place.is_file())?
        };
        let mut line = Vec::new();
        let file = place.is_file().then(|| File::open(&place).ok())??;
        let mut start = BufReader::new(file.take(MAX_LINE));
        start.read_until(b'\n', &mut line).ok()?;
        Self::in_line(&line)
    }

    fn in_line(line: &[u8]) -> Option<Self> {
        let Some(rest) = line.strip_prefix(b"#!") else {
            let is_text = !line.is_empty() && !line.contains(&0) && !line.starts_with(b"\x7fELF");
            return (is_text && std::str::from_utf8(line).is_ok()).then_some(Self::Missing);
        };
        if line.ends_with(b"\r\n") {
            return Some(Self::CarriageReturn);
        }
        let words = String::from_utf8_lossy(rest);
        let interpreter = words.split_whitespace().next()?;
        let is_there = PathBuf::from(interpreter).is_file();
        (!is_there).then(|| Self::NoInterpreter(interpreter.to_owned()))
    }

    /// Returns advice to the user, for a script of this name.
    pub(crate) fn hint(&self, script: &str) -> String {
        match self {
            Self::CarriageReturn => {
                format!("write it with line ends of Unix: `sed -i 's/\\r$//' {script}`")
            }
            Self::NoInterpreter(_) => "install the interpreter, correct the first line, e.g. \
                                       `#!/usr/bin/env python3`, or name the interpreter in `command`"
                .to_owned(),
            Self::Missing => "begin it with the program that runs it, e.g. `#!/usr/bin/env python3`, or name that \
                              program in `command`"
                .to_owned(),
        }
    }
}

impl fmt::Display for FirstLine {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::CarriageReturn => f.write_str(
                ", whose first line `#!…` ends with a carriage return, which counts as part of the interpreter's name",
            ),
            Self::NoInterpreter(interpreter) => {
                write!(f, ", whose first line names the interpreter `{interpreter}`, which is not there")
            }
            Self::Missing => f.write_str(", a text whose first line names no interpreter"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_first_line_is_told_from_a_program() {
        let found = |line: &str| FirstLine::in_line(line.as_bytes());
        assert_eq!(found("#!/bin/sh\n"), None);
        assert_eq!(found("#! /bin/sh -e\n"), None);
        assert_eq!(found("#!/bin/sh\r\n"), Some(FirstLine::CarriageReturn));
        assert_eq!(
            found("#!/usr/bin/env python3\r\n"),
            Some(FirstLine::CarriageReturn)
        );
        let missing = FirstLine::NoInterpreter("/opt/none/python".to_owned());
        assert_eq!(found("#!/opt/none/python -u\n"), Some(missing));
        assert_eq!(found("import sys\n"), Some(FirstLine::Missing));
        assert_eq!(found("\u{7f}ELF\n"), None);
        assert_eq!(found(""), None);
    }
}
