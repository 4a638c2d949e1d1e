//! The instructions of a binary pickle, as values that refer to each other.
//!
//! A pickle is a program for a machine with a stack and a memory. Every value that it makes is kept
//! once, in one list, and named by its place there; values never contain each other. So nothing
//! here recurses or copies: a file that refers to one thing a million times, nests deeply or is its
//! own part costs no more than its length. No class is ever called: objects stay as written down.
//!
//! Instructions: `pickletools` of Python's standard library, protocols 2 to 5.

use super::{ManoError, machine::Machine};

/// Largest accepted file in bytes; the licensed ones have 3.8 million.
const MAX_BYTES: usize = 64 << 20;
/// Maximum number of accepted instructions; the licensed files have less than a thousand.
const MAX_STEPS: usize = 1 << 17;

/// The place of a value in the list of all.
pub(super) type Ref = usize;

/// A value of a pickle.
#[derive(Debug)]
pub(super) enum Value<'a> {
    /// `None`, a number or a set: nothing that a hand model is read from.
    Other,
    Bool(bool),
    Int(i64),
    /// Bytes, or a string of Python 2.
    Bytes(&'a [u8]),
    Text(&'a str),
    /// A tuple or a list.
    Sequence(Vec<Ref>),
    Dict(Vec<(Ref, Ref)>),
    /// A function or class by its name, without its module: modules were renamed over the years.
    Global(&'a [u8]),
    /// Result of a call of a function or class, with the state given to it afterwards.
    Object {
        callable: Ref,
        args: Ref,
        state: Option<Ref>,
    },
}

/// All values of one pickle.
pub(super) struct Pickle<'a> {
    values: Vec<Value<'a>>,
    root: Ref,
}

impl<'a> Pickle<'a> {
    /// Reads a pickle.
    pub(super) fn read(bytes: &'a [u8]) -> Result<Self, ManoError> {
        if bytes.len() > MAX_BYTES {
            return Err(ManoError::TooLarge {
                found: bytes.len(),
                limit: MAX_BYTES,
            });
        }
        let mut machine = Machine::new(bytes);
        let mut start = 0;
        for _ in 0..MAX_STEPS {
            start = machine.at;
            match machine.step() {
                Ok(None) => {}
                Ok(Some(root)) => {
                    return Ok(Self {
                        values: machine.values,
                        root,
                    });
                }
                Err(what) => return Err(ManoError::Pickle { what, at: start }),
            }
        }
        Err(ManoError::Pickle {
            what: "more instructions than a hand model has",
            at: start,
        })
    }

    /// Returns the value that the pickle is.
    pub(super) fn root(&self) -> Ref {
        self.root
    }

    /// Returns a value.
    pub(super) fn value(&self, at: Ref) -> &Value<'a> {
        // Every reference was made together with its value.
        self.values.get(at).unwrap_or(&Value::Other)
    }

    /// Returns the entry of a dictionary by its key; the last one counts.
    pub(super) fn entry(&self, dict: Ref, key: &str) -> Option<Ref> {
        let Value::Dict(entries) = self.value(dict) else {
            return None;
        };
        let found = entries
            .iter()
            .rev()
            .find(|(name, _)| self.name(*name) == Some(key.as_bytes()));
        found.map(|&(_, value)| value)
    }

    /// Returns the bytes of a string of Python 2 or 3.
    pub(super) fn name(&self, at: Ref) -> Option<&'a [u8]> {
        match self.value(at) {
            Value::Bytes(bytes) => Some(bytes),
            Value::Text(text) => Some(text.as_bytes()),
            _ => None,
        }
    }

    /// Returns the items of a tuple or list.
    pub(super) fn items(&self, at: Ref) -> Option<&[Ref]> {
        match self.value(at) {
            Value::Sequence(items) => Some(items),
            _ => None,
        }
    }

    /// Returns the name of what an object was made by, its arguments and its state.
    pub(super) fn object(&self, at: Ref) -> Option<(&'a [u8], &[Ref], Option<Ref>)> {
        let Value::Object {
            callable,
            args,
            state,
        } = self.value(at)
        else {
            return None;
        };
        let Value::Global(name) = self.value(*callable) else {
            return None;
        };
        Some((name, self.items(*args)?, *state))
    }
}
