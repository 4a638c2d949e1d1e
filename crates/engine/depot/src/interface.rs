//! Interface of a depot.

use std::{
    io::{Cursor, Read},
    time::SystemTime,
};

use crate::DepotError;

/// Files by key, shared by machines. A key is a path of names joined by `/`.
///
/// Every method blocks, and may be called from several threads at once.
pub trait Depot: Send + Sync {
    /// Passes the bytes of a file to `sink`, piece by piece; returns whether there is such a file.
    ///
    /// # Errors
    ///
    /// Fails if the depot cannot be asked, or with the error of `sink`.
    fn get(&self, key: &str, sink: &mut Sink) -> Result<bool, DepotError>;

    /// Stores a file, whole or not at all: not if its content ends in an error.
    ///
    /// # Errors
    ///
    /// Fails if the depot cannot be asked or the content cannot be read. It may be stored all the
    /// same, where an answer was lost.
    fn put(&self, key: &str, content: Content, mode: PutMode) -> Result<Put, DepotError>;

    /// Returns a file's size and time, if there is such a file.
    ///
    /// # Errors
    ///
    /// Fails if the depot cannot be asked.
    fn head(&self, key: &str) -> Result<Option<Entry>, DepotError>;

    /// Passes every file whose key begins with `prefix` and `/`, in any order.
    ///
    /// # Errors
    ///
    /// Fails if the depot cannot be asked.
    fn list(&self, prefix: &str, each: &mut dyn FnMut(Entry)) -> Result<(), DepotError>;

    /// Removes a file, if there is one.
    ///
    /// # Errors
    ///
    /// Fails if the depot cannot be asked.
    fn remove(&self, key: &str) -> Result<(), DepotError>;
}

/// Receives the bytes of a file.
pub type Sink<'a> = dyn FnMut(&[u8]) -> std::io::Result<()> + 'a;

/// The bytes of a file to store.
pub struct Content {
    /// Number of bytes.
    pub size: u64,
    /// The bytes.
    pub reader: Box<dyn Read + Send>,
}

impl Content {
    /// Returns bytes in memory.
    pub fn of_bytes(bytes: Vec<u8>) -> Self {
        Self {
            size: bytes.len() as u64,
            reader: Box::new(Cursor::new(bytes)),
        }
    }
}

/// Whether a file replaces another at its key.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PutMode {
    /// The file at the key stays, if there is one.
    IfAbsent,
    /// The file at the key is replaced.
    Always,
}

/// Outcome of an upload.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Put {
    /// It is stored.
    New,
    /// A file is at its key, possibly this one, where an answer was lost.
    There,
}

/// A file in a depot.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Entry {
    /// Its key.
    pub key: String,
    /// Number of bytes.
    pub size: u64,
    /// When it was stored, by the depot's clock.
    pub modified: SystemTime,
}
