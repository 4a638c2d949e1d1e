//! Tracking error of one object's trajectories.

use dataflow::{
    BoxedDiagnostic, Context, Inputs, Line, OptionsUsed, Outcome, Output, Scope, Sum, Unit, counted,
};
use lake::{ReadInputs, WriteArtifact};
use schemas::{Table, tracking::TrackingSummary, trajectories::Trajectory};

use crate::{Retarget, RetargetConfig};

/// Depth below the table, in meters, that is more than measurement and thin objects explain.
const BELOW_TABLE_M: f64 = 0.003;

dataflow::metrics! {
    /// Metrics of an object's trajectories.
    pub struct TrackingMetrics {
        /// Number of trajectories.
        trajectories_n: Sum,
        /// Number of fingertips compared, over all steps.
        tips_n: Sum,
        /// Sum of their distances from their landmarks, in meters.
        tip_error_sum_m: Sum,
    }
}

/// The report `tracking`: how well an object's trajectories follow.
pub struct TrackingReport;

impl Output for TrackingReport {
    type Stage = Retarget;
    type Metrics = TrackingMetrics;
    type Inputs<'a> = &'a Inputs;

    const ARTIFACT: &'static str = TrackingSummary::NAME;
    const SCHEMA: &'static str = TrackingSummary::VERSION;
    const PARTITION: &'static str = TrackingSummary::PARTITION;
    const OPTIONS: OptionsUsed = OptionsUsed::NONE;
    /// Says how far fingertips are from their landmarks, of whichever object.
    const LINE: Option<Line<TrackingMetrics>> = Some(|summary| {
        let all = &summary.metrics;
        format!(
            "{}, {}, tip error {:.1} mm",
            counted(summary.n_made, "object"),
            counted(all.trajectories_n, "trajectory"),
            1000.0 * all.tip_error_sum_m / all.tips_n.max(1.0)
        )
    });

    /// One unit per object that has trajectories.
    fn units(_config: &RetargetConfig, scope: &Scope) -> Result<Vec<Unit>, BoxedDiagnostic> {
        Ok(scope
            .chosen_by_label(Trajectory::NAME, "object", &[])?
            .into_iter()
            .map(|(object, keys)| {
                Unit::new(object)
                    .with_label("object", object)
                    .reading(Trajectory::NAME, keys)
            })
            .collect())
    }

    /// Makes the report on one object's trajectories.
    fn make(
        _config: &RetargetConfig,
        inputs: &Inputs,
        cx: &Context,
    ) -> Result<Outcome<TrackingMetrics>, BoxedDiagnostic> {
        let trajectories: Vec<Trajectory> = inputs.all()?;
        if trajectories.is_empty() {
            return Ok(Outcome::skipped("it has no trajectory"));
        }
        let report = report(&trajectories);
        cx.write(&report)?;
        let tips_n = trajectories
            .iter()
            .flat_map(|trajectory| &trajectory.tracking)
            .map(|tracking| tracking.tip_errors_m.len())
            .sum::<usize>() as f64;
        let metrics = TrackingMetrics {
            trajectories_n: trajectories.len() as f64,
            tips_n,
            tip_error_sum_m: tips_n * report.tip_error_mean_m,
        };
        Ok(Outcome::Made(metrics))
    }
}

/// Sums up the trajectories of one object.
fn report(trajectories: &[Trajectory]) -> TrackingSummary {
    let rates = || {
        let steps = trajectories.iter().flat_map(|one| one.motion.steps());
        steps.map(|step| &step.rates.joints)
    };
    let tracking = || trajectories.iter().flat_map(|one| &one.tracking);
    let grasps = || trajectories.iter().filter_map(|one| one.tracking.last());
    let tips = Spread::of(tracking().flat_map(|step| step.tip_errors_m.iter().copied()));
    let gaps = Spread::of(grasps().flat_map(|grasp| grasp.contact_gaps_m.iter().map(|g| g.abs())));
    let depths = Spread::of(grasps().map(|grasp| grasp.penetration_m));
    let speeds = Spread::of(rates().flat_map(|joints| joints.velocity.iter().map(|v| v.abs())));
    let accelerations =
        Spread::of(rates().flat_map(|joints| joints.acceleration.iter().map(|a| a.abs())));
    let below = Spread::of(grasps().map(|grasp| {
        if grasp.table_penetration_m > BELOW_TABLE_M {
            1.0
        } else {
            0.0
        }
    }));
    let margins = Spread::of(tracking().map(|step| step.limit_margin_rad));
    TrackingSummary {
        trajectories_n: count(trajectories.len()),
        steps_n: count(tracking().count()),
        tip_error_mean_m: tips.mean(),
        tip_error_median_m: tips.quantile(0.5),
        tip_error_p95_m: tips.quantile(0.95),
        limit_margin_least_rad: margins.quantile(0.0),
        contacts_n: count(gaps.sorted.len()),
        contact_gap_median_m: gaps.quantile(0.5),
        contact_gap_p90_m: gaps.quantile(0.9),
        penetration_median_m: depths.quantile(0.5),
        penetration_p90_m: depths.quantile(0.9),
        below_table_share: below.mean(),
        q_velocity_p95_rad_per_s: speeds.quantile(0.95),
        q_acceleration_p95_rad_per_s2: accelerations.quantile(0.95),
    }
}

fn count(n: usize) -> i64 {
    i64::try_from(n).unwrap_or(i64::MAX)
}

/// Numbers in ascending order.
struct Spread {
    sorted: Vec<f64>,
}

impl Spread {
    fn of(numbers: impl Iterator<Item = f64>) -> Self {
        let mut sorted: Vec<f64> = numbers.collect();
        sorted.sort_by(f64::total_cmp);
        Self { sorted }
    }

    /// Returns the mean; 0 of nothing.
    fn mean(&self) -> f64 {
        self.sorted.iter().sum::<f64>() / self.sorted.len().max(1) as f64
    }

    /// Returns the least number that this share of all do not exceed; 0 of nothing.
    fn quantile(&self, share: f64) -> f64 {
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "a share of a count"
        )]
        let at = (share * self.sorted.len() as f64).ceil() as usize;
        self.sorted
            .get(at.saturating_sub(1))
            .copied()
            .unwrap_or(0.0)
    }
}

#[cfg(test)]
mod tests {
    use motion::{JointRates, Motion, Step};
    use nalgebra::{Isometry3, Vector3};
    use schemas::trajectories::{Tracking, TrajectoryRates};
    use spatial::{Pose, RestingPose};

    use super::*;

    #[test]
    fn a_report_sums_up_steps_and_grasps() {
        let step = |time_s: f64, speed: f64| Step {
            time_s,
            frame_from_palm: Pose::new(Isometry3::identity()),
            q_rad: vec![0.0],
            rates: TrajectoryRates {
                joints: JointRates {
                    velocity: vec![-speed],
                    acceleration: vec![0.0],
                },
                ..TrajectoryRates::zero(1)
            },
        };
        let tracking = |tip: f64, depth: f64| Tracking {
            tip_errors_m: vec![tip, 2.0 * tip],
            contact_gaps_m: vec![-depth],
            limit_margin_rad: tip,
            penetration_m: depth,
            table_penetration_m: depth,
            ..Tracking::default()
        };
        let trajectory = |depth: f64| Trajectory {
            sequence: "s".to_owned(),
            object: "box".to_owned(),
            keypoints: Vec::new(),
            tips: Vec::new(),
            rest: RestingPose {
                up_in_object: Vector3::z_axis(),
                height_m: 0.0,
            },
            motion: Motion::new(&["j"], vec![step(0.0, 0.01), step(1.0, 0.03)]).unwrap(),
            // What is deep before the grasp does not count.
            tracking: vec![tracking(0.01, 1.0), tracking(0.03, depth)],
        };
        let report = report(&[trajectory(0.002), trajectory(0.004)]);
        assert_eq!(
            (report.trajectories_n, report.steps_n, report.contacts_n),
            (2, 4, 2)
        );
        assert!((report.tip_error_mean_m - 0.03).abs() < 1e-12);
        assert_eq!(
            (report.tip_error_median_m, report.tip_error_p95_m),
            (0.02, 0.06)
        );
        assert_eq!(report.limit_margin_least_rad, 0.01);
        assert_eq!(
            (report.penetration_median_m, report.penetration_p90_m),
            (0.002, 0.004)
        );
        assert_eq!(
            (report.contact_gap_median_m, report.below_table_share),
            (0.002, 0.5)
        );
        assert_eq!(report.q_velocity_p95_rad_per_s, 0.03);
    }
}
