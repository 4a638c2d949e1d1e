//! The depot as the lake asks it.

use std::sync::{Arc, Mutex};

use ::clock::lock;
use depot::{Depot, DepotError, Entry, Link, OutageListener, Patience, Put, PutMode};

use super::keys;

/// Tries of a file that came damaged, and of one that is said to be there and is not: what is damaged on its way is
/// whole the next time.
const TRIES: usize = 3;

/// A depot of whose layout's version the first request makes sure.
pub(crate) struct Remote {
    link: Link,
    layout: Arc<Layout>,
}

/// What is known of the layout, by all links of a process.
#[derive(Default)]
pub(crate) struct Layout {
    /// Whether the depot had one when it was first asked.
    found: Mutex<Option<bool>>,
    /// Whether it was written.
    written: Mutex<bool>,
}

impl Remote {
    pub(crate) fn new(
        depot: &Arc<dyn Depot>,
        layout: &Arc<Layout>,
        patience: Patience,
        on_outage: Option<Arc<OutageListener>>,
    ) -> Self {
        Self {
            link: Link::new(Arc::clone(depot), patience).with_outage_listener(on_outage),
            layout: Arc::clone(layout),
        }
    }

    /// The link, whose depot has this layout or is empty.
    ///
    /// # Errors
    ///
    /// Fails if the depot is offline or has another layout.
    pub(crate) fn link(&self) -> Result<&Link, DepotError> {
        self.is_laid_out()?;
        Ok(&self.link)
    }

    fn is_laid_out(&self) -> Result<bool, DepotError> {
        if let Some(found) = *lock(&self.layout.found) {
            return Ok(found);
        }
        let found = self.link.read(keys::FORMAT)?;
        if let Some(found) = found.as_ref().filter(|found| *found != keys::VERSION) {
            let found = String::from_utf8_lossy(found).trim().to_owned();
            return Err(self.link.give_up(DepotError::Layout { found }));
        }
        *lock(&self.layout.found) = Some(found.is_some());
        Ok(found.is_some())
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
        if !*lock(&self.layout.written) {
            if !self.is_laid_out()? {
                self.link
                    .put_bytes(keys::FORMAT, keys::VERSION, PutMode::IfAbsent)?;
            }
            *lock(&self.layout.written) = true;
        }
        Ok(&self.link)
    }

    /// Returns a small file, if there is one.
    ///
    /// # Errors
    ///
    /// Fails if the depot cannot be asked.
    pub(crate) fn read(&self, key: &str) -> Result<Option<Vec<u8>>, DepotError> {
        self.link()?.read(key)
    }

    /// Returns what is in a small file; `None` if there is none, or it is damaged there.
    ///
    /// # Errors
    ///
    /// Fails if the depot cannot be asked.
    pub(crate) fn parsed<T>(
        &self,
        key: &str,
        parse: impl Fn(&[u8]) -> Option<T>,
    ) -> Result<Option<T>, DepotError> {
        let link = self.link()?;
        for _ in 0..TRIES {
            let Some(bytes) = link.read(key)? else {
                return Ok(None);
            };
            if let Some(parsed) = parse(&bytes) {
                return Ok(Some(parsed));
            }
        }
        Ok(None)
    }

    /// Lists the files below a prefix.
    ///
    /// # Errors
    ///
    /// Fails if the depot cannot be asked.
    pub(crate) fn list(&self, prefix: &str) -> Result<Vec<Entry>, DepotError> {
        self.link()?.list(prefix)
    }

    /// Stores a small file if there is none at its key; returns the bytes of another that is there.
    ///
    /// # Errors
    ///
    /// Fails if the depot is offline or unreliable.
    pub(crate) fn create(&self, key: &str, bytes: &[u8]) -> Result<Option<Vec<u8>>, DepotError> {
        let link = self.to_write()?;
        // A store may say that there is a file and have none, where another's answer was lost.
        for _ in 0..TRIES {
            if link.put_bytes(key, bytes, PutMode::IfAbsent)? == Put::New {
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
