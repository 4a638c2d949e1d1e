//! Errors that say what to do next.

use std::{error::Error, fmt};

/// An error that can say what to do next.
pub trait Advise: Error + Send + Sync + 'static {
    /// The next action: an edit or a command that can be pasted.
    fn hint(&self) -> Option<String>;

    /// The stage's input of which too little is there, if that is what is wrong: the hint then goes
    /// on with the command that lists what was left out of it.
    fn lacks(&self) -> Option<&'static str> {
        None
    }
}

/// An error of any kind that can say what to do next.
#[derive(Debug)]
pub struct Advised(pub Box<dyn Advise>);

impl<E: Advise> From<E> for Advised {
    fn from(err: E) -> Self {
        Self(Box::new(err))
    }
}

impl fmt::Display for Advised {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.fmt(f)
    }
}

impl Error for Advised {
    fn source(&self) -> Option<&(dyn Error + 'static)> {
        self.0.source()
    }
}
