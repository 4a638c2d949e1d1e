//! Locations in a pipeline file and in command-line overrides.

use std::{fmt, ops::Range, path::PathBuf};

/// A location that can be displayed with its line and carets.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Location {
    /// The line's file, or the command line.
    pub source: Source,
    /// Column, from 1.
    pub column: usize,
    /// The line's text.
    pub text: String,
    /// Number of characters to underline.
    pub width: usize,
}

/// The file of a line, or the command line.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Source {
    /// In a pipeline file.
    File {
        /// The file.
        path: PathBuf,
        /// Line, from 1.
        line: usize,
    },
    /// On the command line.
    Argument,
}

impl Location {
    /// Finds the line and column of a byte range.
    pub(crate) fn of(path: &std::path::Path, source: &str, span: Range<usize>) -> Self {
        let start = span.start.min(source.len());
        let before = source.get(..start).unwrap_or_default();
        let line_start = before.rfind('\n').map_or(0, |at| at + 1);
        let text = source
            .get(line_start..)
            .and_then(|rest| rest.lines().next())
            .unwrap_or_default();
        let column = before.get(line_start..).unwrap_or_default().chars().count() + 1;
        let in_line = text.chars().count().saturating_sub(column - 1).max(1);
        let length = source
            .get(start..span.end.min(source.len()))
            .map_or(1, |span| span.chars().count());
        Self {
            source: Source::File {
                path: path.to_owned(),
                line: before.matches('\n').count() + 1,
            },
            column,
            text: text.to_owned(),
            width: length.clamp(1, in_line),
        }
    }

    /// Finds the column of a byte range of what follows `--set`.
    pub(crate) fn in_set(argument: &str, part: Range<usize>) -> Self {
        let length = |range: Range<usize>| argument.get(range).unwrap_or_default().chars().count();
        let text = format!("--set {argument}");
        let before = text.chars().count() - argument.chars().count();
        Self {
            source: Source::Argument,
            column: before + length(0..part.start) + 1,
            text,
            width: length(part).max(1),
        }
    }
}

impl fmt::Display for Location {
    /// Writes the location as compilers do: arrow, line number, text, carets.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (gutter, place) = match &self.source {
            Source::File { path, line } => {
                let place = format!("{}:{line}:{}", path.display(), self.column);
                (line.to_string(), place)
            }
            Source::Argument => (" ".to_owned(), "the command line".to_owned()),
        };
        let blank = " ".repeat(gutter.len());
        writeln!(f, "{blank} --> {place}")?;
        writeln!(f, "{blank} |")?;
        writeln!(f, "{gutter} | {}", self.text)?;
        let indent: String = self
            .text
            .chars()
            .take(self.column - 1)
            .map(|c| if c == '\t' { '\t' } else { ' ' })
            .collect();
        write!(f, "{blank} | {indent}{}", "^".repeat(self.width))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_at_the_key() {
        let source = "seed = 7\nkl_wieght = 1e-3\n";
        let location = Location::of("a.toml".as_ref(), source, 9..18);
        assert_eq!((location.column, location.width), (1, 9));
        let shown = location.to_string();
        assert!(
            shown.ends_with("2 | kl_wieght = 1e-3\n  | ^^^^^^^^^"),
            "{shown}"
        );
        assert!(shown.starts_with("  --> a.toml:2:1\n"), "{shown}");
    }

    #[test]
    fn points_into_an_argument() {
        let location = Location::in_set("train.epochs=many", 13..17);
        let shown = location.to_string();
        let lines: Vec<&str> = shown.lines().collect();
        assert_eq!(lines[0], "  --> the command line");
        assert_eq!(lines[2], "  | --set train.epochs=many");
        assert_eq!(lines[3], "  |                    ^^^^");
    }
}
