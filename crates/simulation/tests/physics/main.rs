//! Rollouts through the public interface: known grasps, refusals, determinism, divergence,
//! agreement with recorded verdicts of another engine.

mod errors;
mod feedforward;
mod grasps;
mod recorded;
mod scene;
