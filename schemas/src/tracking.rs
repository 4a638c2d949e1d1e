//! `tracking`: how well the trajectories of each object follow their demonstrations, one partition
//! and one row per object.
//!
//! | column                      | type | unit   | meaning                                            |
//! |-----------------------------|------|--------|----------------------------------------------------|
//! | `trajectories_n`            | i64  |        | trajectories                                       |
//! | `steps_n`                   | i64  |        | their steps                                        |
//! | `tip_error_mean_m`          | f64  | m      | distance of finger tips to landmarks, all steps: mean |
//! | `tip_error_median_m`        | f64  | m      | median                                             |
//! | `tip_error_p95_m`           | f64  | m      | 95th percentile                                    |
//! | `limit_margin_least_rad`    | f64  | rad    | least distance of a joint to its limit, all steps  |
//! | `contacts_n`                | i64  |        | finger tips that should touch the object at the grasp |
//! | `contact_gap_median_m`      | f64  | m      | distance of touching tips from the surface at the grasp, either side: median |
//! | `contact_gap_p90_m`         | f64  | m      | 90th percentile                                    |
//! | `penetration_median_m`      | f64  | m      | greatest depth of a link in the object at the grasp: median |
//! | `penetration_p90_m`         | f64  | m      | 90th percentile                                    |
//! | `below_table_share`         | f64  | 1      | share whose hand is more than 3 mm below the table at the grasp |
//! | `q_velocity_p95_rad_per_s`  | f64  | rad/s  | joint speeds, all steps: 95th percentile           |
//! | `q_acceleration_p95_rad_per_s2` | f64 | rad/s² | joint accelerations: 95th percentile            |

use arrow_array::RecordBatch;
use arrow_schema::Schema;

use crate::Table;
use crate::columns::{Columns, Reader, SchemaError};

/// Bump on any change to the columns; readers reject every other version.
const VERSION: &str = "tracking/1";

/// How well the trajectories of one object follow their demonstrations.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct TrackingReport {
    /// Number of trajectories.
    pub trajectories_n: i64,
    /// Number of their steps.
    pub steps_n: i64,
    /// Mean distance of the finger tips to their landmarks over all steps, in meters.
    pub tip_error_mean_m: f64,
    /// Median of it, in meters.
    pub tip_error_median_m: f64,
    /// 95th percentile of it, in meters.
    pub tip_error_p95_m: f64,
    /// Least distance of a joint to its limit over all steps, in radians.
    pub limit_margin_least_rad: f64,
    /// Number of finger tips that should touch the object at the grasp; their gaps are 0 if it is 0.
    pub contacts_n: i64,
    /// Median distance from the surface, on either side, of the tips that should touch it at the
    /// grasp, in meters.
    pub contact_gap_median_m: f64,
    /// 90th percentile of it, in meters.
    pub contact_gap_p90_m: f64,
    /// Median of the greatest depth of a link inside the object at the grasp, in meters.
    pub penetration_median_m: f64,
    /// 90th percentile of it, in meters.
    pub penetration_p90_m: f64,
    /// Share of the trajectories whose hand is more than 3 mm below the table at the grasp.
    pub below_table_share: f64,
    /// 95th percentile of the joints' speeds over all steps, in rad/s.
    pub q_velocity_p95_rad_per_s: f64,
    /// 95th percentile of the joints' accelerations over all steps, in rad/s².
    pub q_acceleration_p95_rad_per_s2: f64,
}

/// A column: its name, unit, meaning, and where its number is.
type Column = (
    &'static str,
    &'static str,
    &'static str,
    fn(&mut TrackingReport) -> &mut f64,
);

/// The columns of numbers.
const NUMBERS: [Column; 11] = [
    (
        "tip_error_mean_m",
        "m",
        "mean distance of finger tips to their landmarks, all steps",
        |t| &mut t.tip_error_mean_m,
    ),
    ("tip_error_median_m", "m", "median of it", |t| {
        &mut t.tip_error_median_m
    }),
    ("tip_error_p95_m", "m", "95th percentile of it", |t| {
        &mut t.tip_error_p95_m
    }),
    (
        "limit_margin_least_rad",
        "rad",
        "least distance of a joint to its limit, all steps",
        |t| &mut t.limit_margin_least_rad,
    ),
    (
        "contact_gap_median_m",
        "m",
        "median distance from the surface of the tips that should touch it, at the grasp",
        |t| &mut t.contact_gap_median_m,
    ),
    ("contact_gap_p90_m", "m", "90th percentile of it", |t| {
        &mut t.contact_gap_p90_m
    }),
    (
        "penetration_median_m",
        "m",
        "median of the greatest depth of a link inside the object, at the grasp",
        |t| &mut t.penetration_median_m,
    ),
    ("penetration_p90_m", "m", "90th percentile of it", |t| {
        &mut t.penetration_p90_m
    }),
    (
        "below_table_share",
        "1",
        "share whose hand is more than 3 mm below the table at the grasp",
        |t| &mut t.below_table_share,
    ),
    (
        "q_velocity_p95_rad_per_s",
        "rad/s",
        "95th percentile of the joints' speeds, all steps",
        |t| &mut t.q_velocity_p95_rad_per_s,
    ),
    (
        "q_acceleration_p95_rad_per_s2",
        "rad/s²",
        "95th percentile of the joints' accelerations, all steps",
        |t| &mut t.q_acceleration_p95_rad_per_s2,
    ),
];

/// Returns the Arrow schema.
fn schema() -> Schema {
    columns(&[]).schema()
}

fn columns(reports: &[TrackingReport]) -> Columns {
    let mut c = Columns::new(VERSION);
    c.i64(
        "trajectories_n",
        "trajectories",
        reports.iter().map(|t| t.trajectories_n),
    );
    c.i64("steps_n", "their steps", reports.iter().map(|t| t.steps_n));
    c.i64(
        "contacts_n",
        "finger tips that should touch the object at the grasp",
        reports.iter().map(|t| t.contacts_n),
    );
    for (name, unit, about, number) in NUMBERS {
        let values = reports.iter().map(|report| *number(&mut report.clone()));
        c.f64(name, unit, about, values);
    }
    c
}

/// Returns one row; the object is the partition, not a column.
///
/// # Errors
///
/// Fails if a number is not finite.
fn to_batch(report: &TrackingReport) -> Result<RecordBatch, SchemaError> {
    columns(std::slice::from_ref(report)).into_batch()
}

/// Reads what [`to_batch`] wrote.
///
/// # Errors
///
/// Fails if the columns are of another version or there is not one row.
fn from_batch(batch: &RecordBatch) -> Result<TrackingReport, SchemaError> {
    let r = Reader::new(batch, VERSION)?;
    r.expect_rows(1)?;
    let mut report = TrackingReport {
        trajectories_n: r.i64("trajectories_n", 0)?,
        steps_n: r.i64("steps_n", 0)?,
        contacts_n: r.i64("contacts_n", 0)?,
        ..TrackingReport::default()
    };
    for (name, _, _, number) in NUMBERS {
        *number(&mut report) = r.f64(name, 0)?;
    }
    Ok(report)
}

impl Table for TrackingReport {
    const NAME: &'static str = "tracking";
    const VERSION: &'static str = VERSION;

    fn schema() -> Schema {
        schema()
    }

    fn to_batch(&self) -> Result<RecordBatch, SchemaError> {
        to_batch(self)
    }

    fn from_batch(_key: &str, batch: &RecordBatch) -> Result<Self, SchemaError> {
        from_batch(batch)
    }
}
