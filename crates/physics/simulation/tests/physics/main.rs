//! Rollouts through the public interface: known grasps, refusals, determinism, divergence, shortcuts,
//! agreement with recorded verdicts of another engine.

mod bodies;
mod compliance;
mod episode;
mod errors;
mod feedforward;
mod grasps;
mod known;
mod protocols;
mod recorded;
mod rests;
mod scene;
mod shortcuts;
mod strict;
