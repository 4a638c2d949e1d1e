//! Making units outside this process.

use crate::{context::Progress, error::Failure, graph::NodeName};

/// Someone who makes units in other processes, perhaps on other machines, that share the store and
/// the pipeline's file with this one and nothing else.
pub trait Elsewhere: Sync {
    /// Makes one unit and returns when its result is in the store: whether it was made now, and not
    /// before by somebody else. `forced` makes it although a result is there already.
    ///
    /// # Errors
    ///
    /// Fails as the unit fails, or if its process dies.
    fn make(
        &self,
        node: &NodeName,
        partition: &str,
        forced: Forced,
        progress: &Progress,
    ) -> Result<bool, Failure>;
}

/// Whether a unit is made although its result is in the store.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Forced {
    /// It is made all the same.
    Yes,
    /// The result in the store is taken.
    No,
}
