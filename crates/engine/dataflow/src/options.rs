//! Options of a run: stages, reruns and threads.

use crate::{error::Failure, graph::Node, name::StageName, pipeline::Pipeline};

/// Options of a run: stages, reruns and threads.
#[derive(Debug, Clone, Default)]
pub struct RunOptions {
    /// Stop after this stage.
    pub until: Option<String>,
    /// Run only this stage; its inputs must be in the store.
    pub only: Option<String>,
    /// Rerun these stages, even if their results are in the store.
    pub fresh: Vec<String>,
    /// Rerun every stage.
    pub fresh_all: StoreUse,
    /// Number of worker threads; 0 for one per core.
    pub jobs: usize,
}

/// Whether stored results are used.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum StoreUse {
    /// Stored results are used.
    #[default]
    UseStore,
    /// Everything is rerun.
    MakeAgain,
}

impl RunOptions {
    /// Returns the outputs to visit: with `only`, also those that its stage depends on, which are
    /// recalled and not made.
    pub(crate) fn nodes<'p>(&self, pipeline: &'p Pipeline) -> Result<Vec<&'p Node>, Failure> {
        for name in self.until.iter().chain(&self.only).chain(&self.fresh) {
            if pipeline.find(name).is_none() {
                return Err(Failure::NoStage {
                    name: name.clone(),
                    known: pipeline
                        .stages
                        .iter()
                        .map(|stage| stage.name.to_string())
                        .collect(),
                });
            }
        }
        if let Some(only) = &self.only {
            return Ok(pipeline.upstream_of_stage(only));
        }
        let last = match &self.until {
            Some(stage) => pipeline
                .nodes
                .iter()
                .rposition(|node| node.name.stage == **stage),
            None => None,
        };
        let count = last.map_or(pipeline.nodes.len(), |last| last + 1);
        Ok(pipeline.nodes.iter().take(count).collect())
    }

    /// Whether a stage's results are taken from the store and never made.
    pub(crate) fn only_recalls(&self, stage: &StageName) -> bool {
        self.only.as_ref().is_some_and(|only| *stage != **only)
    }

    /// Whether a stage's units are made even if their results are in the store.
    pub(crate) fn is_forced(&self, stage: &StageName) -> bool {
        let named = self.fresh.iter().any(|fresh| *stage == **fresh);
        (named || self.fresh_all == StoreUse::MakeAgain) && !self.only_recalls(stage)
    }
}
