//! Label: the first word of a line for people, in the color of its kind.

use std::fmt;

use clap::builder::styling::{AnsiColor, Style};

/// Declares the labels with their words.
macro_rules! labels {
    ($($color:ident { $($name:ident $word:literal,)* })*) => {
        /// First word of a line for people.
        #[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
        pub(crate) enum Label {
            $($($name,)*)*
        }

        impl Label {
            /// Returns its word.
            pub(crate) const fn word(self) -> &'static str {
                match self {
                    $($(Self::$name => $word,)*)*
                }
            }

            fn color(self) -> Option<AnsiColor> {
                match self {
                    $($(Self::$name)|* => color!($color),)*
                }
            }
        }
    };
}

macro_rules! color {
    (Plain) => {
        None
    };
    ($color:ident) => {
        Some(AnsiColor::$color)
    };
}

labels! {
    Red {
        Error "error:",
        Fail "fail",
        Lost "lost",
        Missing "missing",
        Wrong "wrong",
    }
    Yellow {
        Doubtful "doubtful",
        Drop "drop",
        Interrupted "interrupted:",
        Note "note",
        Pending "pending",
        Queue "queue",
        Repair "repair",
        Run "run",
        Skip "skip",
        Unset "unset",
        Wait "wait",
        Warn "warn",
    }
    Green {
        Cached "cached",
        Done "done",
        Ok "ok",
    }
    Cyan {
        Hint "hint:",
        Next "next",
    }
    Plain {
        Adopt "adopt",
        Attach "attach",
        Cell "cell",
        Depot "depot",
        Detach "detach",
        Goal "goal",
        Kept "kept",
        Left "left",
        Object "object",
        Report "report",
        Router "router",
        Stop "stop",
    }
}

impl Label {
    /// Columns of a label without a colon, before a line's text.
    const WIDTH: usize = 6;

    /// Returns the style of its word.
    fn style(self) -> Style {
        let style = Style::new().fg_color(self.color().map(Into::into));
        if self == Self::Error {
            style.bold()
        } else {
            style
        }
    }

    /// Returns a line that begins with its word, with the word in color.
    pub(crate) fn painted(self, line: &str) -> String {
        let style = self.style();
        match line.strip_prefix(self.word()) {
            Some(rest) if style != Style::new() => {
                format!("{style}{}{style:#}{rest}", self.word())
            }
            Some(_) | None => line.to_owned(),
        }
    }

    /// Returns a line of text behind it.
    pub(crate) fn line(self, text: impl fmt::Display) -> String {
        let word = self.word();
        let width = if word.ends_with(':') { 0 } else { Self::WIDTH };
        format!("{word:<width$} {text}")
    }
}
