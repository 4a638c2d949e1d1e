//! The depot as the lake asks it: a failure means doing without.

use std::sync::{Arc, Mutex, OnceLock};

use depot::{Content, Depot, DepotError, Entry, Link, Put, PutMode};

use super::keys;
use crate::mutex::lock;

/// A depot, of whose layout's version the first request makes sure.
pub(crate) struct Remote {
    link: Link,
    /// Whether the depot had a layout when it was first asked.
    is_laid_out: OnceLock<bool>,
    /// Whether its layout was written.
    laid_out: Mutex<bool>,
}

impl Remote {
    pub(crate) fn new(depot: Arc<dyn Depot>) -> Self {
        Self {
            link: Link::new(depot),
            is_laid_out: OnceLock::new(),
            laid_out: Mutex::new(false),
        }
    }

    /// The link, whose depot has this layout or is empty, or is offline.
    pub(crate) fn link(&self) -> &Link {
        self.is_laid_out();
        &self.link
    }

    fn is_laid_out(&self) -> bool {
        *self.is_laid_out.get_or_init(|| {
            let Ok(Some(found)) = self.link.read(keys::FORMAT) else {
                return false;
            };
            if found != keys::VERSION {
                let found = String::from_utf8_lossy(&found).trim().to_owned();
                self.link.give_up(format!(
                    "its layout is `{found}`, which this version of the program does not know"
                ));
            }
            true
        })
    }

    /// The link, of which nothing is asked by this.
    pub(crate) fn idle(&self) -> &Link {
        &self.link
    }

    /// The link to a depot that has this layout.
    ///
    /// # Errors
    ///
    /// Fails if the depot is offline.
    pub(crate) fn to_write(&self) -> Result<&Link, DepotError> {
        let mut laid_out = lock(&self.laid_out);
        if !*laid_out {
            if !self.is_laid_out() {
                let version = Content::of_bytes(keys::VERSION.to_vec());
                self.link.put(keys::FORMAT, version, PutMode::IfAbsent)?;
            }
            *laid_out = true;
        }
        Ok(&self.link)
    }

    /// Returns a small file; `None` if there is none or the depot is offline.
    pub(crate) fn read(&self, key: &str) -> Option<Vec<u8>> {
        self.link().read(key).ok().flatten()
    }

    /// Lists the files below a prefix; `None` if the depot is offline.
    pub(crate) fn list(&self, prefix: &str) -> Option<Vec<Entry>> {
        self.link().list(prefix).ok()
    }

    /// Stores a small file if there is none at its key; returns the bytes of another that is there.
    ///
    /// # Errors
    ///
    /// Fails if the depot is offline or unreliable.
    pub(crate) fn create(&self, key: &str, bytes: &[u8]) -> Result<Option<Vec<u8>>, DepotError> {
        // A store may say that there is a file and have none, where another's answer was lost.
        const TRIES: usize = 3;
        let link = self.to_write()?;
        for _ in 0..TRIES {
            let content = Content::of_bytes(bytes.to_vec());
            if link.put(key, content, PutMode::IfAbsent)? == Put::New {
                return Ok(None);
            }
            if let Some(there) = link.read(key)? {
                return Ok((there != bytes).then_some(there));
            }
        }
        Err(DepotError::Unreliable {
            why: format!("it says that `{key}` is there, and has none"),
        })
    }
}
