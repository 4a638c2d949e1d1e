//! The texts of a pipeline file and of those that it extends, in one range of bytes.

use std::{
    ops::Range,
    path::{Path, PathBuf},
};

use crate::source::Location;

/// Texts laid end to end, so that a span names its file too.
#[derive(Debug, Default)]
pub(crate) struct Texts {
    all: Vec<File>,
}

#[derive(Debug)]
struct File {
    path: PathBuf,
    text: String,
    /// Offset of its start among all texts, in bytes.
    start: usize,
}

impl Texts {
    /// Adds a file's text, and returns it padded with as many blanks as the texts before it have
    /// bytes, so that the parser's spans are unique among all texts.
    pub(crate) fn add(&mut self, path: &Path, text: &str) -> String {
        let last = self.all.last();
        // One more, so that the end of a text is not the start of the next.
        let start = last.map_or(0, |last| last.start + last.text.len() + 1);
        self.all.push(File {
            path: path.to_owned(),
            text: text.to_owned(),
            start,
        });
        " ".repeat(start) + text
    }

    /// Returns the location of a span.
    pub(crate) fn location(&self, span: Range<usize>) -> Location {
        let after = self.all.partition_point(|file| file.start <= span.start);
        let found = after.checked_sub(1).and_then(|idx| self.all.get(idx));
        match found {
            Some(file) => {
                let own = span.start - file.start..span.end.saturating_sub(file.start);
                Location::of(&file.path, &file.text, own)
            }
            None => Location::of(Path::new(""), "", span),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::source::Source;

    #[test]
    fn a_span_names_its_file() {
        let mut texts = Texts::default();
        texts.add("a.toml".as_ref(), "seed = 7\n");
        let read = texts.add("b.toml".as_ref(), "x = 1\ny = 2\n");
        let at = read.find("y = 2").unwrap();
        let location = texts.location(at..at + 1);
        let source = Source::File {
            path: "b.toml".into(),
            line: 2,
        };
        assert_eq!(location.source, source);
        assert_eq!((location.column, location.text.as_str()), (1, "y = 2"));
        assert_eq!(texts.location(0..4).text, "seed = 7");
    }
}
