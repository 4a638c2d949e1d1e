//! `draws`: every draw of a motion, one partition per object, one row per draw.
//!
//! A generator may draw a motion several times and keep one draw, the candidate. `refused = ''` selects those;
//! their motions are in `candidates`, under the same `candidate_id`. Every other draw has its reason. A motion none of
//! whose draws was kept has no candidate. Rows are in the order of the motions, then of the draws.

use arrow_array::RecordBatch;
use spatial::{Object, Pose};

use crate::{
    SchemaError, Table,
    candidates::{Candidate, Candidates, DrawSource},
    columns::{Reader, Row, columns, words},
    table::table,
};

words! {
    /// Why a draw was refused.
    #[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
    pub enum Refusal: "refusal" {
        /// The hand is too deep in the object.
        Object = "object",
        /// The hand is too deep in the table.
        Table = "table",
        /// Another draw of the motion had a smaller residual.
        Residual = "residual",
        /// Its refinement changed another draw of the motion less.
        Change = "change",
        /// No motion of the hand could be formed of it.
        Motion = "motion",
    }
}

columns! {
    /// A draw of a motion.
    #[derive(Debug, Clone, PartialEq)]
    pub struct Draw {
        candidate_id: String => "name of the motion, the same for all its draws",
        generator: String => "what drew it",
        /// Source of the draw.
        source: DrawSource,
        refused: Option<Refusal>
            => "empty for the candidate, else why: too deep in `object` or `table`, a larger `residual` than it, or no `motion` of the hand",
        fault: String => "what is wrong with its motion, if it was refused as `motion`; else empty",
        depth_m: Option<f64> ["m"]
            => "deepest that the hand was in object or table when it was drawn; null if not measured",
        residual_m2: Option<f64> ["m²"]
            => "residual of the refinement: depth, missing contact, unbalanced force; null if not refined",
        table_from_object: Pose<spatial::Table, Object> ["m, 1"] => "how the object lies: xyz, xyzw",
        limit_excess_rad: f64 ["rad"]
            => "farthest that a joint was drawn outside its limits, before it was put back to them",
    }
}

/// The draws for one object.
pub type Draws = Vec<Draw>;
table! {"draws", 1, per "object", rows: Draw, beside "candidates"}

impl Draw {
    /// Returns the draw that is this candidate.
    pub fn kept(candidate: &Candidate) -> Self {
        Self {
            candidate_id: candidate.candidate_id.clone(),
            generator: candidate.generator.clone(),
            source: candidate.source.clone(),
            refused: None,
            fault: String::new(),
            depth_m: candidate.depth_m,
            residual_m2: candidate.residual_m2,
            table_from_object: candidate.table_from_object,
            limit_excess_rad: candidate.limit_excess_rad,
        }
    }

    /// Returns the draw of a motion that is no candidate.
    pub fn refused(candidate: &Candidate, refusal: Refusal) -> Self {
        Self {
            refused: Some(refusal),
            ..Self::kept(candidate)
        }
    }

    /// Returns the draw of a candidate of which no motion of the hand could be formed.
    pub fn without_motion(candidate: &Candidate, fault: String) -> Self {
        Self {
            fault,
            ..Self::refused(candidate, Refusal::Motion)
        }
    }

    /// Reads the draws of candidates whose generator wrote no table of draws: each was kept. In `candidates/4` and
    /// `candidates/5` refused draws are rows, too.
    ///
    /// # Errors
    ///
    /// Fails as [`Table::from_batch`] of [`Candidates`] does.
    pub fn of_candidates(batch: &RecordBatch) -> Result<Draws, SchemaError> {
        let from = Reader::new(batch, Candidates::VERSION)?;
        let draw = |row| {
            Ok(Self {
                candidate_id: from.cell("candidate_id", row)?,
                generator: from.cell("generator", row)?,
                source: DrawSource::read(&from, row)?,
                refused: from.cell_if_there("refused", row)?.flatten(),
                fault: String::new(),
                depth_m: from.cell("depth_m", row)?,
                residual_m2: from.cell("residual_m2", row)?,
                table_from_object: from.cell("table_from_object", row)?,
                limit_excess_rad: from.cell("limit_excess_rad", row)?,
            })
        };
        (0..batch.num_rows()).map(draw).collect()
    }
}
