//! A motion goes through its steps.

use motion::MotionSpline;
use proptest::prelude::*;

use crate::swings::motions;

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    /// Every step is met with its rates, and rates are derivatives.
    #[test]
    fn a_course_meets_its_steps_and_its_rates_are_its_derivatives(
        motion in motions(&["a", "b", "c"]),
        share in 0.001..0.999_f64,
    ) {
        let spline = MotionSpline::through(motion.clone()).unwrap();
        for step in motion.steps() {
            let found = spline.at(step.time_s);
            let off = step.frame_from_palm.inverse() * found.frame_from_palm;
            prop_assert!(off.translation.vector.norm() < 1e-9);
            prop_assert!(off.rotation.angle() < 1e-7);
            let (found_rates, rates) = (&found.rates, &step.rates);
            let off = found_rates.palm_velocity.angular - rates.palm_velocity.angular;
            prop_assert!(off.norm() < 1e-6);
            let off = found_rates.palm_acceleration.angular - rates.palm_acceleration.angular;
            prop_assert!(off.norm() < 1e-4);
            prop_assert!((found.q_rad[1] - step.q_rad[1]).abs() < 1e-9);
        }
        let (time, h) = (share * spline.duration_s(), 1e-5);
        let [before, now, after] = [-h, 0.0, h].map(|d| spline.at(time + d));
        let [a, b] = [&before, &after].map(|step| step.frame_from_palm.rotation);
        let spin = (b * a.inverse()).scaled_axis() / (2.0 * h);
        let [before, now, after] = [before, now, after].map(|step| step.rates);
        let angular = now.palm_velocity.angular;
        prop_assert!((spin - angular).norm() < 1e-3, "{spin} {angular}");
        let rate = (after.palm_velocity.angular - before.palm_velocity.angular) / (2.0 * h);
        let angular = now.palm_acceleration.angular;
        prop_assert!((rate - angular).norm() < 2e-2 * (1.0 + angular.norm()));
        let rate = (after.joints.velocity[0] - before.joints.velocity[0]) / (2.0 * h);
        let found = now.joints.acceleration[0];
        prop_assert!((rate - found).abs() < 2e-2 * (1.0 + found.abs()));
    }
}
