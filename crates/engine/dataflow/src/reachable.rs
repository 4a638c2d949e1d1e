//! The units reachable from a pipeline file.

use crate::{
    digest::Digest,
    error::Failure,
    pipeline::Pipeline,
    state::{Certainty, State},
    store::Store,
};

/// Returns the fingerprints of every unit whose result a run of this pipeline would take from the
/// store.
///
/// # Errors
///
/// Fails if a stage cannot list its units or the store cannot be read.
pub fn reachable_fingerprints(
    pipeline: &Pipeline,
    store: &dyn Store,
) -> Result<Vec<Digest>, Failure> {
    store.enter(&pipeline.name)?;
    let mut state = State::new(pipeline, store);
    let mut digests = Vec::new();
    for node in &pipeline.nodes {
        state.recall_some(node, Certainty::Unknown, |digest| {
            let outcome = store.recall(digest)?;
            digests.extend(outcome.is_some().then_some(*digest));
            Ok(outcome)
        })?;
    }
    Ok(digests)
}
