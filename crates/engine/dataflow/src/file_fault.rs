//! Files that options name and that cannot be used.

/// A file or folder outside the lake that an option names, and that cannot be used.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct FileFault {
    /// Dotted key in the stage's table, e.g. `files.model`.
    pub key: String,
    /// Position in a list, from 0; `None` if the option is no list.
    pub element: Option<usize>,
    /// Description of the fault, to be read after the key: `names `model.bin`, which is no file here`.
    pub problem: String,
    /// Suggested fix.
    pub hint: Option<String>,
}

impl FileFault {
    /// The option or its element, as [`crate::pipeline`] remembers where it stands.
    pub(crate) fn place(&self) -> String {
        place_of(&self.key, self.element)
    }
}

/// Names an option, or an element of one that is a list.
pub(crate) fn place_of(key: &str, element: Option<usize>) -> String {
    element.map_or_else(|| key.to_owned(), |idx| format!("{key}[{idx}]"))
}

impl std::fmt::Display for FileFault {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "`{}` {}", self.key, self.problem)
    }
}
