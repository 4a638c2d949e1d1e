//! Terms of use of a dataset.

use std::{fs, path::Path};

use dataflow::SourceFile;

use crate::{error::RecordingError, place};

/// File in a dataset's folder whose first line says what it is and under which terms it may be used.
const FILE: &str = "TERMS.txt";
/// Maximum size of it, in bytes: whole licenses are shorter.
const MAX_BYTES: u64 = 1 << 20;
/// Maximum length of the line that is taken, in characters.
const MAX_CHARS: usize = 200;

/// Returns the first line of a dataset's `TERMS.txt`, e.g. `DexYCB, CC BY-NC 4.0`; `None` without one.
///
/// # Errors
///
/// Fails if it is not a readable file of text, or if its first line is empty or longer than 200
/// characters.
pub(crate) fn of_dataset(root: &Path) -> Result<Option<String>, RecordingError> {
    let file = SourceFile::new(FILE.to_owned(), root.join(FILE));
    let Some(file) = place::find(file, MAX_BYTES)? else {
        return Ok(None);
    };
    let text = fs::read_to_string(&file.path).map_err(|source| RecordingError::Unreadable {
        file: file.name.clone(),
        source,
    })?;
    let line = text.lines().next().unwrap_or_default().trim();
    if line.is_empty() || line.chars().count() > MAX_CHARS {
        return Err(RecordingError::TermsLine { file: file.name });
    }
    Ok(Some(line.to_owned()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn first_line_is_taken_and_a_file_without_one_is_refused() {
        let root = tempfile::tempdir().unwrap();
        assert_eq!(of_dataset(root.path()).unwrap(), None);
        let check = |text: &[u8], expected: Option<&str>| {
            fs::write(root.path().join(FILE), text).unwrap();
            assert_eq!(of_dataset(root.path()).ok().flatten().as_deref(), expected);
        };
        check(b"Ours, CC0 \nand more\n", Some("Ours, CC0"));
        check(b"\nOurs\n", None);
        check("x".repeat(MAX_CHARS + 1).as_bytes(), None);
        check(b"\xff\xfe", None);
    }
}
