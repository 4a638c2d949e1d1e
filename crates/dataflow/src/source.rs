//! Places in a pipeline file.

use std::{fmt, ops::Range, path::PathBuf};

/// A place in a pipeline file that can be shown with its line and a caret.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Location {
    /// The file.
    pub path: PathBuf,
    /// Line, from 1.
    pub line: usize,
    /// Column, from 1.
    pub column: usize,
    /// The line's text.
    pub text: String,
    /// Number of characters to underline.
    pub width: usize,
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
            path: path.to_owned(),
            line: before.matches('\n').count() + 1,
            column,
            text: text.to_owned(),
            width: length.clamp(1, in_line),
        }
    }
}

impl fmt::Display for Location {
    /// Writes the place as compilers do: arrow, line number, text, carets.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let gutter = self.line.to_string();
        let blank = " ".repeat(gutter.len());
        writeln!(
            f,
            "{blank} --> {}:{}:{}",
            self.path.display(),
            self.line,
            self.column
        )?;
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
        assert_eq!((location.line, location.column, location.width), (2, 1, 9));
        let shown = location.to_string();
        assert!(
            shown.ends_with("2 | kl_wieght = 1e-3\n  | ^^^^^^^^^"),
            "{shown}"
        );
    }
}
