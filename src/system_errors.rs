//! Descriptions of operating-system errors.

use std::io::{Error, ErrorKind};

/// Prefix of the error number at the end of a system message.
const NUMBER: &str = " (os error ";

/// `EMFILE`: the process has too many open files.
const TOO_MANY_OPEN_FILES: i32 = 24;

/// `ENFILE`: the system has too many open files.
const TOO_MANY_OPEN_FILES_IN_ALL: i32 = 23;

/// `EIO`: input/output error of a device.
const INPUT_OUTPUT: i32 = 5;

/// Replaces the system's messages and error numbers in a text with descriptions.
pub(crate) fn in_words(message: &str) -> String {
    let mut text = message.to_owned();
    let mut from = 0;
    while let Some((before, code)) = next_number(&text, from) {
        let said = Error::from_raw_os_error(code).to_string();
        let number = format!("{NUMBER}{code})");
        let end = before + number.len();
        // The text before the number is usually the system's own.
        let start = text
            .get(..end)
            .filter(|shown| shown.ends_with(&said))
            .map_or(before, |_| end - said.len());
        let words = if start < before {
            words(code)
        } else {
            String::new()
        };
        text.replace_range(start..end, &words);
        from = start + words.len();
    }
    text
}

/// Finds the next error number from an offset on, and its position.
fn next_number(text: &str, from: usize) -> Option<(usize, i32)> {
    let mut from = from;
    loop {
        let before = from + text.get(from..)?.find(NUMBER)?;
        let digits = before + NUMBER.len();
        let code = text.get(digits..)?.split(')').next()?;
        if let Ok(code) = code.parse() {
            return Some((before, code));
        }
        from = digits;
    }
}

fn words(code: i32) -> String {
    let err = Error::from_raw_os_error(code);
    let known = match code {
        TOO_MANY_OPEN_FILES => Some("too many open files; `ulimit -n` says how many may be open"),
        TOO_MANY_OPEN_FILES_IN_ALL => Some("too many open files on this machine"),
        INPUT_OUTPUT => Some("the disk or device fails"),
        _ => by_kind(err.kind()),
    };
    let own = || {
        let said = err.to_string();
        let said = said.split(NUMBER).next().unwrap_or_default();
        let mut letters = said.chars();
        let first = letters.next().map(char::to_lowercase);
        first.into_iter().flatten().chain(letters).collect()
    };
    known.map_or_else(own, str::to_owned)
}

fn by_kind(kind: ErrorKind) -> Option<&'static str> {
    Some(match kind {
        ErrorKind::NotFound => "there is no such file or folder",
        ErrorKind::PermissionDenied => "permission denied",
        ErrorKind::AlreadyExists => "it is there already",
        ErrorKind::StorageFull => "no space left on the disk",
        ErrorKind::QuotaExceeded => "no space left in the disk quota",
        ErrorKind::ReadOnlyFilesystem => "the file system is read-only",
        ErrorKind::FileTooLarge => "the file is larger than is allowed",
        ErrorKind::NotADirectory => "a part of the path is a file, not a folder",
        ErrorKind::IsADirectory => "it is a folder",
        ErrorKind::DirectoryNotEmpty => "the folder is not empty",
        ErrorKind::InvalidFilename => "the name is too long",
        ErrorKind::StaleNetworkFileHandle => "the network file system is no longer there",
        ErrorKind::OutOfMemory => "out of memory",
        ErrorKind::ConnectionRefused => "nothing listens there",
        ErrorKind::ConnectionReset => "the other side broke the connection off",
        ErrorKind::BrokenPipe => "the other side has closed the connection",
        ErrorKind::TimedOut => "no answer in time",
        ErrorKind::AddrInUse => "something else listens there already",
        ErrorKind::AddrNotAvailable => "this machine has no such address",
        ErrorKind::HostUnreachable | ErrorKind::NetworkUnreachable => {
            "the network has no way to it"
        }
        _ => return None,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The system's message of an error, as it appears in other messages.
    fn said(code: i32) -> String {
        Error::from_raw_os_error(code).to_string()
    }

    #[test]
    fn common_errors_are_said_in_words() {
        for (code, words) in [
            (2, "there is no such file or folder"),
            (13, "permission denied"),
            (20, "a part of the path is a file, not a folder"),
            (21, "it is a folder"),
            (23, "too many open files on this machine"),
            (
                24,
                "too many open files; `ulimit -n` says how many may be open",
            ),
            (28, "no space left on the disk"),
            (30, "the file system is read-only"),
        ] {
            assert_eq!(in_words(&said(code)), words);
            let within = format!("cannot write `a`: {}; and more", said(code));
            assert_eq!(
                in_words(&within),
                format!("cannot write `a`: {words}; and more")
            );
        }
    }

    #[test]
    fn no_number_of_an_error_is_left_in_any_message() {
        for code in 1..134 {
            let text = in_words(&format!("{} and {}", said(code), said(28)));
            assert!(!text.contains("os error"), "{code}: {text}");
            assert!(!text.starts_with(char::is_uppercase), "{code}: {text}");
            assert!(text.ends_with(" and no space left on the disk"), "{text}");
        }
    }

    #[test]
    fn other_text_is_left_unchanged() {
        for text in [
            "",
            "a (os error",
            "(os error x)",
            "done (os error x) (os error y",
        ] {
            assert_eq!(in_words(text), text);
        }
        assert_eq!(in_words("their own words (os error 28)"), "their own words");
    }
}
