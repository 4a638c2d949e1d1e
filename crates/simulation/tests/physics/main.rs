//! Rollouts through the public interface: known grasps, refusals, determinism, divergence.

mod errors;
mod grasps;
mod scene;
