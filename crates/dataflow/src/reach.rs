//! What a pipeline file, as it stands, still uses.

use std::collections::BTreeMap;

use crate::{
    digest::Digest,
    error::Failure,
    pipeline::Pipeline,
    stage::Labels,
    state::{Foretold, Known, State},
    store::{RecordOutcome, Store},
};

/// Returns the fingerprints of every unit whose result a run of this pipeline would take from the
/// store.
///
/// # Errors
///
/// Fails if a stage cannot list its units or the store cannot be read.
pub fn reached(pipeline: &Pipeline, store: &dyn Store) -> Result<Vec<Digest>, Failure> {
    store.enter(&pipeline.name)?;
    let mut state = State::new(pipeline, store);
    let mut reached = Vec::new();
    for node in &pipeline.nodes {
        let Some(listing) = state.listing(node)? else {
            state.grows(&node.name);
            continue;
        };
        let mut known = BTreeMap::new();
        for unit in listing.units {
            let found = match state.fingerprint(node, &unit)? {
                Some((_, digest)) => store.recall(&digest)?.map(|outcome| (digest, outcome)),
                None => None,
            };
            let Some((digest, outcome)) = found else {
                let open = Known::Open {
                    labels: Labels::new(),
                    foretold: Foretold::No,
                };
                known.insert(unit.partition, open);
                continue;
            };
            reached.push(digest);
            if matches!(*outcome, RecordOutcome::Made { .. }) {
                known.insert(unit.partition, Known::Made(outcome));
            }
        }
        state.insert(&node.name, known);
        if listing.may_grow {
            state.grows(&node.name);
        }
    }
    Ok(reached)
}
