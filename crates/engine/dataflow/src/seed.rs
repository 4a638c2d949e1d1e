//! Seeds of units.

use crate::name::{PartitionKey, StageName};

/// The seed of one unit: of the pipeline's seed, the stage's name and the partition alone.
pub fn unit_seed(seed: u64, stage: &StageName, partition: &PartitionKey) -> u64 {
    let mut hasher = blake3::Hasher::new();
    hasher.update(&seed.to_le_bytes());
    hasher.update(stage.as_str().as_bytes());
    hasher.update(&[0]);
    hasher.update(partition.as_str().as_bytes());
    let mut first = [0; 8];
    first.copy_from_slice(&hasher.finalize().as_bytes()[..8]);
    u64::from_le_bytes(first)
}
