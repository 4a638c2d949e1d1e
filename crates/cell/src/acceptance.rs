//! Checks before a cell accepts a goal.

use motion::{JointTrack, PalmPoint, PalmTrajectory, Timed};
use nalgebra::Vector3;
use robot::{Joint, JointKind};
use spatial::Peaks;

use crate::{CellRobot, Goal, Grasp, PalmLimits, Rejection, RejectionCode, text::number};

/// Longest goal accepted, in bytes: a minute of 16 joints at 333 Hz.
pub(crate) const MAX_GOAL_BYTES: usize = 8 * 1024 * 1024;
/// Fewest points of a controller.
const MIN_POINTS: usize = 2;
/// Largest commanded excess of a finger over the URDF's limits, whatever the goal's tolerance, in
/// radians (meters if prismatic): it presses on its stop then.
const MAX_TOLERANCE_RAD: f64 = 0.1;
/// Longest motion, in seconds.
const MAX_DURATION_S: f64 = 600.0;
/// Relative excess of a joint's speed attributed to rounding.
const ROUNDING: f64 = 1e-6;
/// Relative excess of a palm's peaks attributed to rounding: bounds of angular ones are no tighter.
const PALM_ROUNDING: f64 = 1e-4;
/// Excess of a position over a limit attributed to rounding, in radians (meters if prismatic).
const ROUNDING_RAD: f64 = 1e-6;
/// Limits of a free-flying palm: at least three times what the shipped pipelines need, and small
/// enough to keep it in a room of the workspace's size.
pub(crate) const PALM: PalmLimits = PalmLimits {
    speed_m_per_s: 3.0,
    acceleration_m_per_s2: 60.0,
    turn_rad_per_s: 12.0,
    turn_acceleration_rad_per_s2: 250.0,
    workspace_m: [[-2.0, -2.0, -0.5], [2.0, 2.0, 2.0]],
};

/// Checks a message's length before it is parsed.
pub(crate) fn check_length(bytes: &[u8]) -> Result<(), Rejection> {
    if bytes.len() <= MAX_GOAL_BYTES {
        return Ok(());
    }
    refuse(
        RejectionCode::TooLarge,
        format!("{} bytes, expected at most {MAX_GOAL_BYTES}", bytes.len()),
    )
}

/// Checks that the robot can execute a goal: its joints, their limits, times and the object.
pub(crate) fn check(
    goal: &Goal,
    robot: &CellRobot,
    object_is_here: impl Fn(&str) -> bool,
) -> Result<(), Rejection> {
    if goal.robot != robot.digest {
        let expected = &robot.digest;
        return refuse(
            RejectionCode::Robot,
            format!(
                "the goal is for robot {}, this one is {expected}",
                goal.robot
            ),
        );
    }
    check_phases(&goal.grasp)?;
    check_tolerances(goal)?;
    let tolerance = goal.grasp.limit_tolerance_rad.min(MAX_TOLERANCE_RAD);
    check_track(
        &goal.hand,
        "hand",
        robot.hand.joints(),
        tolerance + ROUNDING_RAD,
    )?;
    match (&goal.carrier, &robot.arm) {
        (PalmTrajectory::Palm(points), None) => {
            check_times("palm", points)?;
            check_palm(points, &PALM)?;
        }
        (PalmTrajectory::Arm(track), Some(arm)) => {
            check_track(track, "arm", arm.joints(), ROUNDING_RAD)?;
        }
        (PalmTrajectory::Palm(_), Some(_)) => {
            let problem = "the goal commands a free-flying palm; this cell has an arm".to_owned();
            return refuse(RejectionCode::Joints, problem);
        }
        (PalmTrajectory::Arm(_), None) => {
            return refuse(RejectionCode::Joints, "this cell has no arm".to_owned());
        }
    }
    if object_is_here(&goal.object) {
        Ok(())
    } else {
        refuse(
            RejectionCode::Object,
            format!("no object `{}` lies before the robot", goal.object),
        )
    }
}

/// Checks the track of a joint controller.
fn check_track(
    track: &JointTrack,
    controller: &str,
    joints: &[Joint],
    tolerance: f64,
) -> Result<(), Rejection> {
    let wrong = |problem: String| refuse(RejectionCode::Joints, problem);
    let known = |name: &String| {
        let found = joints.iter().find(|joint| joint.name == *name);
        found.ok_or_else(|| {
            let problem = format!("the {controller} has no joint `{name}`");
            Rejection::new(RejectionCode::Joints, problem)
        })
    };
    let ordered = track.joints.iter().map(known);
    let ordered: Vec<&Joint> = ordered.collect::<Result<_, _>>()?;
    let missing = joints
        .iter()
        .find(|joint| !track.joints.contains(&joint.name));
    if let Some(joint) = missing {
        return wrong(format!("joint `{}` is missing", joint.name));
    }
    if track.joints.len() != joints.len() {
        return wrong("a joint is named twice".to_owned());
    }
    check_times(controller, &track.points)?;
    check_limits(track, &ordered, tolerance)
}

/// Checks the durations of a motion's phases.
fn check_phases(grasp: &Grasp) -> Result<(), Rejection> {
    let parts = [
        ("reach_s", grasp.reach_s),
        ("squeeze_s", grasp.squeeze_s),
        ("pause_s", grasp.pause_s),
        ("lift_s", grasp.lift_s),
        ("hold_s", grasp.hold_s),
    ];
    for (name, part_s) in parts {
        if !(part_s.is_finite() && (0.0..=MAX_DURATION_S).contains(&part_s)) {
            let found = number(part_s);
            let problem = format!("`{name}` is {found} s, expected 0 to {MAX_DURATION_S}");
            return refuse(RejectionCode::Times, problem);
        }
    }
    let all_s: f64 = parts.iter().map(|(_, part_s)| part_s).sum();
    if all_s > MAX_DURATION_S {
        let all_s = number(all_s);
        let problem = format!("the motion lasts {all_s} s, expected up to {MAX_DURATION_S}");
        return refuse(RejectionCode::Times, problem);
    }
    Ok(())
}

/// Checks a goal's tolerances.
fn check_tolerances(goal: &Goal) -> Result<(), Rejection> {
    let grasp = &goal.grasp;
    for (name, tolerance) in [
        ("start_tolerance_rad", goal.start_tolerance_rad),
        ("limit_tolerance_rad", grasp.limit_tolerance_rad),
        ("table_tolerance_m", grasp.table_tolerance_m),
        ("early_tolerance_m", grasp.early_tolerance_m),
        ("lift_m", grasp.lift_m),
        ("lifted_m", grasp.lifted_m),
        ("max_slip_m_per_s", grasp.max_slip_m_per_s),
        ("knocked_m", grasp.knocked_m),
        ("knocked_rad", grasp.knocked_rad),
        ("strict.max_spin_rad_per_s", grasp.strict.max_spin_rad_per_s),
        (
            "strict.palm_table_tolerance_m",
            grasp.strict.palm_table_tolerance_m,
        ),
        ("strict.start_tolerance_m", grasp.strict.start_tolerance_m),
    ] {
        if !(tolerance.is_finite() && tolerance >= 0.0) {
            let tolerance = number(tolerance);
            let problem = format!("`{name}` is {tolerance}, expected 0 or more");
            return refuse(RejectionCode::Limits, problem);
        }
    }
    let fraction = grasp.close_fraction;
    if (0.0..=1.0).contains(&fraction) {
        return Ok(());
    }
    let fraction = number(fraction);
    let problem = format!("`close_fraction` is {fraction}, expected 0 to 1");
    refuse(RejectionCode::Limits, problem)
}

/// Checks the poses and rates of a free-flying palm against a cell's limits, at its points and between them.
///
/// # Errors
///
/// Fails with the refusal of a cell of these limits.
pub fn check_palm(points: &[PalmPoint], limits: &PalmLimits) -> Result<(), Rejection> {
    let kept = peaks_kept(limits);
    for point in points {
        let (velocity, acceleration) = (&point.velocity, &point.acceleration);
        let there = Peaks {
            speed: velocity.linear.norm(),
            acceleration: acceleration.linear.norm(),
            angular_speed: velocity.angular.norm(),
            angular_acceleration: acceleration.angular.norm(),
        };
        check_peaks(&there, &kept, &format!("after {} s", point.time_s))?;
    }
    for (from, to) in points.iter().zip(points.iter().skip(1)) {
        let between = || format!("between {} and {} s", from.time_s, to.time_s);
        let Some(segment) = from.segment(to) else {
            let problem = format!("the palm's rotation cannot be interpolated {}", between());
            return refuse(RejectionCode::Limits, problem);
        };
        let [least, most] = limits.workspace_m.map(Vector3::from);
        let [low, high] = segment.range();
        let is_inside = |axis: usize| low[axis] >= least[axis] && high[axis] <= most[axis];
        if !(0..3).all(is_inside) {
            let [low, high, least, most] = [low, high, least, most].map(<[f64; 3]>::from);
            return refuse(
                RejectionCode::Limits,
                format!(
                    "the palm would be at {low:?} to {high:?} m {}, outside {least:?} to {most:?}",
                    between()
                ),
            );
        }
        check_peaks(&segment.peaks(&kept), &kept, &between())?;
    }
    Ok(())
}

/// Returns the limits of a free-flying palm.
fn peaks_kept(limits: &PalmLimits) -> Peaks {
    Peaks {
        speed: limits.speed_m_per_s,
        acceleration: limits.acceleration_m_per_s2,
        angular_speed: limits.turn_rad_per_s,
        angular_acceleration: limits.turn_acceleration_rad_per_s2,
    }
}

/// Checks a palm's speeds and accelerations at some time.
fn check_peaks(found: &Peaks, kept: &Peaks, when: &str) -> Result<(), Rejection> {
    for (what, found, most, unit) in [
        ("move at", found.speed, kept.speed, "m/s"),
        (
            "accelerate at",
            found.acceleration,
            kept.acceleration,
            "m/s²",
        ),
        ("turn at", found.angular_speed, kept.angular_speed, "rad/s"),
        (
            "change its turn at",
            found.angular_acceleration,
            kept.angular_acceleration,
            "rad/s²",
        ),
    ] {
        if found > most * (1.0 + PALM_ROUNDING) {
            let found = number(found);
            return refuse(
                RejectionCode::Limits,
                format!("the palm would {what} {found} {unit} {when}, more than {most}"),
            );
        }
    }
    Ok(())
}

fn check_times<T: Timed>(controller: &str, points: &[T]) -> Result<(), Rejection> {
    let wrong = |problem: String| refuse(RejectionCode::Times, problem);
    if points.len() < MIN_POINTS {
        return wrong(format!(
            "{} points of the {controller}, expected at least {MIN_POINTS}",
            points.len()
        ));
    }
    if let Some(first) = points.first().filter(|first| first.time_s() != 0.0) {
        return wrong(format!(
            "the {controller}'s first point is at {} s, not at 0",
            number(first.time_s())
        ));
    }
    let mut last_s = f64::NEG_INFINITY;
    for (idx, point) in points.iter().enumerate() {
        let time_s = point.time_s();
        if time_s <= last_s || time_s > MAX_DURATION_S {
            let time_s = number(time_s);
            return wrong(format!(
                "point {idx} of the {controller} is at {time_s} s, expected after {last_s} and up to {MAX_DURATION_S}"
            ));
        }
        last_s = time_s;
    }
    Ok(())
}

/// Checks positions and velocities, at the points and between them.
fn check_limits(track: &JointTrack, joints: &[&Joint], tolerance: f64) -> Result<(), Rejection> {
    for (from, to) in track.points.iter().zip(track.points.iter().skip(1)) {
        let between = || format!("between {} and {} s", from.time_s, to.time_s);
        for (joint, segment) in joints.iter().zip(from.segments(to)) {
            let Joint {
                name, lower, upper, ..
            } = joint;
            let [low, high] = segment.range();
            let is_inside = low >= lower - tolerance && high <= upper + tolerance;
            if joint.kind != JointKind::Continuous && !is_inside {
                let q = number(if low < lower - tolerance { low } else { high });
                return refuse(
                    RejectionCode::Limits,
                    format!(
                        "joint `{name}` would be at {q} {}, outside {lower} to {upper}",
                        between()
                    ),
                );
            }
            let most = joint.velocity;
            let speed = segment.max_speed(most);
            if most > 0.0 && speed > most * (1.0 + ROUNDING) {
                let speed = number(speed);
                return refuse(
                    RejectionCode::Limits,
                    format!(
                        "joint `{name}` would move at {speed} per second {}, faster than {most}",
                        between()
                    ),
                );
            }
        }
    }
    Ok(())
}

fn refuse(code: RejectionCode, reason: String) -> Result<(), Rejection> {
    Err(Rejection::new(code, reason))
}

#[cfg(test)]
mod tests {
    use motion::{JointPoint, JointRates};
    use proptest::prelude::*;
    use robot::RobotModel;

    use super::*;

    const JOINT: &str = r#"<robot name="one"><link name="a"/><link name="b"/>
  <joint name="j" type="revolute"><parent link="a"/><child link="b"/><axis xyz="1 0 0"/>
    <limit lower="-1" upper="1" effort="1" velocity="2"/></joint></robot>"#;

    fn point(time_s: f64) -> impl Strategy<Value = JointPoint> {
        (-1.0..1.0_f64, -2.0..2.0_f64, -60.0..60.0_f64).prop_map(move |(q, velocity, change)| {
            JointPoint {
                time_s,
                q_rad: vec![q],
                rates: JointRates {
                    velocity: vec![velocity],
                    acceleration: vec![change],
                },
            }
        })
    }

    proptest! {
        /// Accepted motions keep the limits throughout, and motions that keep them are accepted.
        #[test]
        fn limits_hold_between_two_points(
            from in point(0.0),
            mut to in point(1.0),
            duration_s in 0.0005..1.0_f64,
            near in 0.0..1.0_f64,
        ) {
            // As near as the velocities allow, so that many are accepted.
            to.time_s = duration_s;
            let reach = from.q_rad[0] + (near - 0.5) * 3.0 * duration_s;
            to.q_rad[0] = reach.clamp(-1.0, 1.0);
            let track = JointTrack { joints: vec!["j".to_owned()], points: vec![from, to] };
            let robot = RobotModel::from_urdf(JOINT).unwrap();
            let joints: Vec<&Joint> = robot.joints().iter().collect();
            let taken = check_limits(&track, &joints, ROUNDING_RAD).is_ok();
            let mut most = [0.0_f64; 2];
            for look in 0..=2000 {
                let now = track.at(duration_s * f64::from(look) / 2000.0).unwrap();
                most[0] = most[0].max(now.q_rad[0].abs());
                most[1] = most[1].max(now.rates.velocity[0].abs() / 2.0);
            }
            let most = most[0].max(most[1]);
            prop_assert!(!taken || most <= 1.0 + 2e-6, "{most} is taken");
            prop_assert!(taken || most >= 1.0 - 1e-4, "{most} is refused");
        }
    }
}
