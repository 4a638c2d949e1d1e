//! The artifacts that a program can make.

use arrow_array::RecordBatch;
use arrow_schema::Schema;
use dataflow::Inputs;
use schemas::{
    SchemaError, Table, candidates::Candidates, demonstrations::Demonstration,
    pose_errors::PoseErrors, robustness::RobustnessTable, rollouts::Rollouts,
    smoothness::SmoothnessTable, trajectories::Trajectory,
};

use crate::{error::TableFault, result};

/// The artifacts of a project that its programs can make, beside tables of their own.
pub trait Artifacts: Sized + Sync + 'static {
    /// These artifacts.
    const KNOWN: &'static [KnownArtifact];
}

/// One artifact that a program can make.
#[derive(Debug, Clone, Copy)]
pub struct KnownArtifact {
    /// Its name.
    pub artifact: &'static str,
    /// Name and version of its schema.
    pub schema: &'static str,
    /// Kind of item that one partition holds.
    pub partition: &'static str,
    /// Files that it must have beside its table.
    pub files: &'static [&'static str],
    /// Its table, if it has one.
    pub(crate) table: Option<KnownTable>,
}

/// The table of an artifact.
#[derive(Debug, Clone, Copy)]
pub(crate) struct KnownTable {
    /// The columns.
    pub(crate) schema: fn() -> Schema,
    /// Checks the rows of a partition by the artifact's own rules, and returns them as they are stored.
    pub(crate) checked: fn(&str, &RecordBatch) -> Result<RecordBatch, SchemaError>,
    /// Checks the rows against the unit's inputs.
    pub(crate) against: fn(&Inputs, &str, &RecordBatch) -> Result<(), TableFault>,
}

impl KnownArtifact {
    /// Returns the artifact that is a table of this type.
    pub const fn table<T: Table>() -> Self {
        Self::checked_against::<T>(|_, _, _| Ok(()))
    }

    /// Returns an artifact of files without a schema.
    pub const fn of_files(
        artifact: &'static str,
        schema: &'static str,
        partition: &'static str,
        files: &'static [&'static str],
    ) -> Self {
        Self {
            artifact,
            schema,
            partition,
            files,
            table: None,
        }
    }

    const fn checked_against<T: Table>(
        against: fn(&Inputs, &str, &RecordBatch) -> Result<(), TableFault>,
    ) -> Self {
        Self {
            artifact: T::NAME,
            schema: T::VERSION,
            partition: T::PARTITION,
            files: &[],
            table: Some(KnownTable {
                schema: T::schema,
                checked: |key, batch| T::from_batch(key, batch)?.to_batch(),
                against,
            }),
        }
    }
}

/// This project's artifacts.
#[derive(Debug)]
pub enum ProjectArtifacts {}

impl Artifacts for ProjectArtifacts {
    const KNOWN: &'static [KnownArtifact] = &[
        KnownArtifact::table::<Candidates>(),
        KnownArtifact::table::<Demonstration>(),
        KnownArtifact::checked_against::<Rollouts>(result::one_rollout_per_candidate),
        KnownArtifact::table::<RobustnessTable>(),
        KnownArtifact::table::<PoseErrors>(),
        KnownArtifact::table::<SmoothnessTable>(),
        KnownArtifact::table::<Trajectory>(),
    ];
}
