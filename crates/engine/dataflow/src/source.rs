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

/// Most columns of a displayed line.
const COLUMNS: usize = 100;

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

    /// Narrows the location of a dotted key to a byte range of it; the whole key if the range is not in it.
    pub(crate) fn narrowed(&self, key: &str, part: Range<usize>) -> Self {
        let start = self.column - 1;
        let written: String = self.text.chars().skip(start).take(self.width).collect();
        let count = |text: &str| text.chars().count();
        let found = written.split_once(key).and_then(|(before, _)| {
            Some((
                count(before) + count(key.get(..part.start)?),
                count(key.get(part)?),
            ))
        });
        match found {
            Some((offset, width)) => Self {
                column: self.column + offset,
                width,
                ..self.clone()
            },
            None => self.clone(),
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
        let excerpt = self.excerpt(COLUMNS.saturating_sub(gutter.len() + 3));
        writeln!(f, "{blank} --> {place}")?;
        writeln!(f, "{blank} |")?;
        writeln!(f, "{gutter} | {}", excerpt.text)?;
        let indent: String = excerpt
            .text
            .chars()
            .take(excerpt.column - 1)
            .map(|c| if c == '\t' { '\t' } else { ' ' })
            .collect();
        write!(f, "{blank} | {indent}{}", "^".repeat(excerpt.width))
    }
}

impl Location {
    /// Returns the part of the line around the carets that has at most so many characters, with `…` where it is
    /// cut.
    fn excerpt(&self, most: usize) -> Self {
        let n = self.text.chars().count();
        if n <= most {
            return self.clone();
        }
        let (start, width) = (self.column - 1, self.width.min(most / 2));
        let first = start.saturating_sub((most - width) / 2).min(n - most);
        let kept = self.text.chars().enumerate().skip(first).take(most);
        let text = kept.map(|(idx, c)| {
            let is_cut = (idx == first && idx > 0) || (idx + 1 == first + most && idx + 1 < n);
            if is_cut { '…' } else { c }
        });
        Self {
            text: text.collect(),
            column: start - first + 1,
            width,
            ..self.clone()
        }
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
    fn a_long_line_is_cut_around_the_carets() {
        let words = |n: usize| "abcdefghi ".repeat(n);
        for before in [0, 3, 40, 100_000] {
            for after in [0, 3, 40, 100_000] {
                for width in [1, 4, 90, 100_000] {
                    let text = format!("{}{}{}", words(before), "X".repeat(width), words(after));
                    let start = before * 10;
                    let location = Location::of("a.toml".as_ref(), &text, start..start + width);
                    let shown = location.to_string();
                    let lines: Vec<&str> = shown.lines().collect();
                    let columns = |line: &str| line.chars().count();
                    assert!(lines.iter().all(|line| columns(line) <= 100), "{shown}");
                    let carets = lines[3].chars().filter(|c| *c == '^').count();
                    assert!(carets > 0 && carets <= width, "{shown}");
                    let at = lines[3].chars().position(|c| c == '^').unwrap();
                    let marked: Vec<char> = lines[2].chars().skip(at).take(carets).collect();
                    assert!(marked.iter().all(|c| "X…".contains(*c)), "{shown}");
                    let is_whole = columns(&text) <= 96;
                    assert_eq!(!shown.contains('…'), is_whole, "{shown}");
                    assert!(shown.contains(&format!("a.toml:1:{}", start + 1)));
                }
            }
        }
    }

    #[test]
    fn a_part_of_a_key_is_found_in_its_quotes() {
        let source = "\"train.epohcs\" = [1]";
        let location = Location::of("a.toml".as_ref(), source, 0..14);
        let part = location.narrowed("train.epohcs", 6..12);
        assert_eq!((part.column, part.width), (8, 6));
        assert_eq!(location.narrowed("other", 0..2), location);
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
