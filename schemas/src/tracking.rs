//! `tracking`: tracking quality of each object's trajectories against their demonstrations, one
//! partition and one row per object.

use crate::{columns::columns, table::table};

columns! {
    /// Tracking quality of one object's trajectories against their demonstrations.
    #[derive(Debug, Clone, PartialEq)]
    pub struct TrackingSummary {
        trajectories_n: i64 => "trajectories",
        steps_n: i64 => "their steps",
        contacts_n: i64 => "finger tips that should touch the object at the grasp",
        tip_error_mean_m: f64 ["m"] => "mean distance of finger tips to their landmarks, all steps",
        tip_error_median_m: f64 ["m"] => "median of it",
        tip_error_p95_m: f64 ["m"] => "95th percentile of it",
        limit_margin_least_rad: f64 ["rad"] => "least distance of a joint to its limit, all steps",
        /// On either side; 0 if no tip should touch it.
        contact_gap_median_m: f64 ["m"]
            => "median distance from the surface of the tips that should touch it, at the grasp",
        contact_gap_p90_m: f64 ["m"] => "90th percentile of it",
        penetration_median_m: f64 ["m"]
            => "median of the greatest depth of a link inside the object, at the grasp",
        penetration_p90_m: f64 ["m"] => "90th percentile of it",
        below_table_share: f64 ["1"]
            => "share whose hand is more than 3 mm below the table at the grasp",
        q_velocity_p95_rad_per_s: f64 ["rad/s"] => "95th percentile of the joints' speeds, all steps",
        q_acceleration_p95_rad_per_s2: f64 ["rad/s²"]
            => "95th percentile of the joints' accelerations, all steps",
    }
}

table! {"tracking", 1, per "object", row: TrackingSummary}
