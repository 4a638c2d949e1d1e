//! Contradictions between a report and its goal, the robot or itself.
//!
//! A report decides what is stored of a motion. A fabricated, truncated, frozen or mixed-up report
//! must not pass as a success; a genuine one must pass, with the delay and noise of real robots.
//! `README.md` lists the checks and their tolerances.

use motion::{JointTrack, PalmPoint, PalmTrajectory};
use robot::{Joint, JointKind};
use schemas::executions::Outcome;
use spatial::{Palm, Pose, Table};

use crate::{
    Goal, Report, Sample,
    text::{number, rounded},
};

/// Longest time between two samples, before the first and after the last, in seconds.
const GAP_S: f64 = 0.1;
/// Longest recording beyond the end of the goal's motion, in seconds.
const MAX_OVERRUN_S: f64 = 5.0;
/// Largest delay of a command after its time, and largest lead before it, in seconds.
const LATE_S: f64 = 0.25;
const EARLY_S: f64 = 0.05;
/// Largest difference of a command from the goal's trajectory, in radians and in meters.
const COMMAND_RAD: f64 = 0.05;
const COMMAND_M: f64 = 0.005;
/// Largest measured excess over a joint's limits, in radians and in meters: joints are compliant
/// and encoders inexact.
const LIMIT_RAD: f64 = 0.2;
const LIMIT_M: f64 = 0.02;
/// Largest distance of a free-flying palm from the goal's trajectory, in meters and radians.
const PALM_M: f64 = 0.05;
const PALM_RAD: f64 = 0.3;
/// Smallest commanded displacement in the reach that counts as a motion, in radians and
/// in meters, and the share of it that must be measured: a joint whose reading is frozen shows none of it, a finger
/// that the object blocks from the start a little.
const MOVES_RAD: f64 = 0.1;
const MOVES_M: f64 = 0.01;
const MOVED_SHARE: f64 = 0.02;
/// Smallest rise of the palm, as a share of the object's.
const PALM_SHARE: f64 = 0.5;
/// Largest distance of the object's first pose from the goal's, in meters.
const MAX_START_ERROR_M: f64 = 0.3;
/// Implausibly large coordinate for anything on a table, in meters.
const IMPLAUSIBLE_M: f64 = 10.0;
/// Largest difference between the reported rise and that of the samples, in meters: the object may
/// fall after the last sample and before the final measurement.
const LIFT_M: f64 = 0.03;
/// Largest distance of a held object's samples below the required lift, in meters.
const HELD_M: f64 = 0.01;
/// Sampling period of a goal's trajectory, in seconds.
const SAMPLE_PERIOD_S: f64 = 0.005;

/// A contradiction of a report.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Contradiction {
    /// The report is about another goal.
    #[error("it is about goal `{found}`")]
    Goal {
        /// The goal that it names.
        found: String,
    },
    /// The outcome is not possible for an accepted goal.
    #[error("`{outcome}` is not an outcome of a goal that the cell accepted")]
    Outcome {
        /// The outcome.
        outcome: &'static str,
    },
    /// The joints differ from the goal's, or are in another order.
    #[error("its joints are `{found}`, the goal's are `{expected}`")]
    Joints {
        /// The report's joints.
        found: String,
        /// The goal's.
        expected: String,
    },
    /// The report claims that the motion was executed but has no samples.
    #[error("outcome `{outcome}` without samples")]
    NoSamples {
        /// The claimed outcome.
        outcome: &'static str,
    },
    /// The times of the samples do not increase, have a gap, or exceed the motion.
    #[error("sample {row} is at {time_s} s, expected after {after_s} s and up to {until_s} s", time_s = number(*.time_s), after_s = number(*.after_s), until_s = number(*.until_s))]
    Times {
        /// The sample, from 0.
        row: usize,
        /// Its time.
        time_s: f64,
        /// Time of the previous sample.
        after_s: f64,
        /// Latest permitted time.
        until_s: f64,
    },
    /// The samples end before the motion.
    #[error(
        "outcome `succeeded`, but the samples end after {time_s} s, the motion after {end_s} s", time_s = number(*.time_s), end_s = number(*.end_s))]
    Short {
        /// Time of the last sample.
        time_s: f64,
        /// End of the hold.
        end_s: f64,
    },
    /// A position is implausibly far away.
    #[error("sample {row}: implausible {what} position, {far_m} m", far_m = number(*.far_m))]
    Far {
        /// The sample.
        row: usize,
        /// The palm or the object.
        what: &'static str,
        /// Its largest coordinate.
        far_m: f64,
    },
    /// The object started away from the goal's pose.
    #[error("the object is {off_m} m from where the goal has it at first", off_m = rounded(*.off_m))]
    StartPose {
        /// The distance.
        off_m: f64,
    },
    /// A joint is outside its limits.
    #[error("sample {row} has joint `{joint}` at {q}, outside {lower} to {upper}", q = number(*.q), lower = number(*.lower), upper = number(*.upper))]
    Limit {
        /// The sample.
        row: usize,
        /// The joint.
        joint: String,
        /// Its position.
        q: f64,
        /// Lower limit.
        lower: f64,
        /// Upper limit.
        upper: f64,
    },
    /// The goal is empty or has a turn that cannot be interpolated: no report can be checked
    /// against it.
    #[error("the goal has a controller without points, or a turn that no palm can follow")]
    NoCommands,
    /// A commanded position differs from the goal's.
    #[error(
        "sample {row} has joint `{joint}` commanded to {q}, the goal commands {least} to {most} then", q = number(*.q), least = rounded(*.least), most = rounded(*.most))]
    Command {
        /// The sample.
        row: usize,
        /// The joint.
        joint: String,
        /// The reported command.
        q: f64,
        /// The least that the goal commands around that time.
        least: f64,
        /// The greatest.
        most: f64,
    },
    /// A free-flying palm is off the goal's trajectory.
    #[error(
        "sample {row} has the palm {off_m} m and {off_rad} rad from where the goal has it", off_m = rounded(*.off_m), off_rad = rounded(*.off_rad))]
    Palm {
        /// The sample.
        row: usize,
        /// Its distance.
        off_m: f64,
        /// Its angle.
        off_rad: f64,
    },
    /// A joint did not move.
    #[error(
        "joint `{joint}` is commanded to move by {commanded} to the grasp and has moved by {moved}", commanded = rounded(*.commanded), moved = rounded(*.moved))]
    Still {
        /// The joint.
        joint: String,
        /// The commanded displacement.
        commanded: f64,
        /// The measured displacement.
        moved: f64,
    },
    /// The reported rise differs from that of the samples.
    #[error("reported rise {reported_m} m differs from that of the samples, {sampled_m} m", reported_m = number(*.reported_m), sampled_m = rounded(*.sampled_m))]
    Lift {
        /// The reported rise.
        reported_m: f64,
        /// The rise of the samples.
        sampled_m: f64,
    },
    /// The object was not lifted high enough.
    #[error(
        "outcome `succeeded`, but the object rose {rise_m} m after {time_s} s, below the required \
         {lifted_m} m", rise_m = rounded(*.rise_m), time_s = number(*.time_s), lifted_m = number(*.lifted_m))]
    Low {
        /// Rise of the object.
        rise_m: f64,
        /// Time of the sample.
        time_s: f64,
        /// The required rise.
        lifted_m: f64,
    },
    /// The object rose without the hand.
    #[error(
        "outcome `succeeded`, but the object rose {object_m} m and the palm only {palm_m} m", object_m = rounded(*.object_m), palm_m = rounded(*.palm_m))]
    PalmLow {
        /// Rise of the object.
        object_m: f64,
        /// Rise of the palm.
        palm_m: f64,
    },
}

/// Checks a report for contradictions.
pub(crate) fn check(
    report: &Report,
    goal_id: &str,
    goal: &Goal,
    robot: &[Joint],
) -> Result<(), Contradiction> {
    let outcome = report.outcome;
    if report.goal_id != goal_id {
        return Err(Contradiction::Goal {
            found: report.goal_id.clone(),
        });
    }
    let is_whole = match outcome {
        Outcome::Succeeded | Outcome::Failed => true,
        Outcome::Aborted | Outcome::Stopped | Outcome::Unknown => false,
        Outcome::Rejected => {
            return Err(Contradiction::Outcome {
                outcome: outcome.as_str(),
            });
        }
    };
    let Some((first, last)) = report.samples.first().zip(report.samples.last()) else {
        return if is_whole {
            Err(Contradiction::NoSamples {
                outcome: outcome.as_str(),
            })
        } else {
            check_lift(report.lift_m, 0.0)
        };
    };
    let joints = joints_of(&report.joints, goal, robot)?;
    check_times(&report.samples, goal, outcome)?;
    check_places(&report.samples, goal)?;
    let commanded = CommandedSamples::of(goal).ok_or(Contradiction::NoCommands)?;
    let history = if is_whole {
        History::Recent
    } else {
        History::Any
    };
    for (row, sample) in report.samples.iter().enumerate() {
        check_joints(row, sample, &joints, &commanded, history)?;
        commanded.check_palm(row, sample, history)?;
    }
    if is_whole {
        check_motion(&report.samples, &joints, &commanded, goal)?;
    }
    check_lift(report.lift_m, height_m(last) - height_m(first))?;
    match outcome {
        Outcome::Succeeded => check_success(report, goal, first, last),
        Outcome::Failed
        | Outcome::Aborted
        | Outcome::Stopped
        | Outcome::Unknown
        | Outcome::Rejected => Ok(()),
    }
}

/// Past commands that may still be in effect.
#[derive(Clone, Copy)]
enum History {
    /// Those of the last fraction of a second.
    Recent,
    /// All up to then: the motion may have been aborted at any of them.
    Any,
}

/// Returns the goal's joints in its order, which must be that of the report.
fn joints_of<'a>(
    found: &[String],
    goal: &Goal,
    robot: &'a [Joint],
) -> Result<Vec<&'a Joint>, Contradiction> {
    let expected = goal.joint_names();
    let known = |name: &String| robot.iter().find(|joint| joint.name == *name);
    let joints: Option<Vec<&Joint>> = expected.iter().map(known).collect();
    joints
        .filter(|_| found == expected)
        .ok_or_else(|| Contradiction::Joints {
            found: found.join("`, `"),
            expected: expected.join("`, `"),
        })
}

fn check_times(samples: &[Sample], goal: &Goal, outcome: Outcome) -> Result<(), Contradiction> {
    let end_s = goal.end_s();
    let mut after_s = -f64::EPSILON;
    for (row, sample) in samples.iter().enumerate() {
        let until_s = (after_s + GAP_S).min(end_s + MAX_OVERRUN_S);
        let time_s = sample.time_s;
        if time_s <= after_s || time_s > until_s {
            return Err(Contradiction::Times {
                row,
                time_s,
                after_s,
                until_s,
            });
        }
        after_s = time_s;
    }
    if outcome == Outcome::Succeeded && after_s < end_s - GAP_S {
        return Err(Contradiction::Short {
            time_s: after_s,
            end_s,
        });
    }
    Ok(())
}

fn check_places(samples: &[Sample], goal: &Goal) -> Result<(), Contradiction> {
    for (row, sample) in samples.iter().enumerate() {
        for (what, place) in [
            ("palm", sample.table_from_palm.translation),
            ("object", sample.table_from_object.translation),
        ] {
            let far_m = place.vector.amax();
            if far_m > IMPLAUSIBLE_M {
                return Err(Contradiction::Far { row, what, far_m });
            }
        }
    }
    let laid = goal.table_from_object.translation.vector;
    let off_m = samples.first().map_or(0.0, |first| {
        (first.table_from_object.translation.vector - laid).norm()
    });
    if off_m > MAX_START_ERROR_M {
        return Err(Contradiction::StartPose { off_m });
    }
    Ok(())
}

fn check_joints(
    row: usize,
    sample: &Sample,
    joints: &[&Joint],
    commanded: &CommandedSamples,
    history: History,
) -> Result<(), Contradiction> {
    let reported = sample.q_rad.iter().zip(&sample.q_command_rad);
    for (idx, (joint, (&q, &command))) in joints.iter().zip(reported).enumerate() {
        let (beyond, aside) = if joint.kind == JointKind::Prismatic {
            (LIMIT_M, COMMAND_M)
        } else {
            (LIMIT_RAD, COMMAND_RAD)
        };
        let Joint { lower, upper, .. } = **joint;
        if q < lower - beyond || q > upper + beyond {
            return Err(Contradiction::Limit {
                row,
                joint: joint.name.clone(),
                q,
                lower,
                upper,
            });
        }
        let [least, most] = commanded.range(idx, sample.time_s, history);
        if command < least - aside || command > most + aside {
            return Err(Contradiction::Command {
                row,
                joint: joint.name.clone(),
                q: command,
                least,
                most,
            });
        }
    }
    Ok(())
}

/// Checks that the joints move to the grasp as commanded, as far as samples exist.
fn check_motion(
    samples: &[Sample],
    joints: &[&Joint],
    commanded: &CommandedSamples,
    goal: &Goal,
) -> Result<(), Contradiction> {
    let seen_s = samples.last().map_or(0.0, |last| last.time_s);
    let until_s = goal.grasp.reach_s.min(seen_s - LATE_S);
    for (idx, joint) in joints.iter().enumerate() {
        let min_commanded = if joint.kind == JointKind::Prismatic {
            MOVES_M
        } else {
            MOVES_RAD
        };
        let [least, most] = commanded.range(idx, until_s - EARLY_S, History::Any);
        let commanded = most - least;
        let seen = samples
            .iter()
            .filter(|sample| sample.time_s <= until_s + LATE_S);
        let [least, most] = span(seen.map(|sample| sample.q_rad[idx]));
        let moved = most - least;
        if commanded > min_commanded && moved < MOVED_SHARE * commanded {
            return Err(Contradiction::Still {
                joint: joint.name.clone(),
                commanded,
                moved,
            });
        }
    }
    Ok(())
}

fn check_lift(reported_m: f64, sampled_m: f64) -> Result<(), Contradiction> {
    // A comparison with NaN is false.
    if (reported_m - sampled_m).abs() <= LIFT_M {
        return Ok(());
    }
    Err(Contradiction::Lift {
        reported_m,
        sampled_m,
    })
}

/// Checks that the hand lifted the object and held it until the end.
fn check_success(
    report: &Report,
    goal: &Goal,
    first: &Sample,
    last: &Sample,
) -> Result<(), Contradiction> {
    let grasp = &goal.grasp;
    let lifted_m = grasp.lifted_m;
    let low = |rise_m: f64, time_s: f64| {
        Err(Contradiction::Low {
            rise_m,
            time_s,
            lifted_m,
        })
    };
    if report.lift_m < lifted_m {
        return low(report.lift_m, last.time_s);
    }
    let held_s = goal.end_s() - grasp.hold_s + LATE_S;
    let held = |sample: &&Sample| sample.time_s >= held_s || std::ptr::eq(*sample, last);
    for sample in report.samples.iter().filter(held) {
        let rise_m = height_m(sample) - height_m(first);
        if rise_m < lifted_m - HELD_M {
            return low(rise_m, sample.time_s);
        }
    }
    let palm_m = |sample: &Sample| sample.table_from_palm.translation.z;
    let mut grasped = report.samples.iter();
    let grasped = grasped.rfind(|sample| sample.time_s <= grasp.reach_s + GAP_S);
    let risen_m = palm_m(last) - palm_m(grasped.unwrap_or(first));
    let object_m = height_m(last) - height_m(first);
    if risen_m < PALM_SHARE * object_m {
        return Err(Contradiction::PalmLow {
            object_m,
            palm_m: risen_m,
        });
    }
    Ok(())
}

fn height_m(sample: &Sample) -> f64 {
    sample.table_from_object.translation.z
}

/// A goal's trajectory, sampled.
struct CommandedSamples {
    /// Positions of each joint at each sampled time.
    q: Vec<Vec<f64>>,
    /// For each joint and sampled time, the least and the greatest up to then.
    until: Vec<Vec<[f64; 2]>>,
    /// Poses of the palm at each sampled time, if it is free-flying.
    palm: Option<Vec<Pose<Table, Palm>>>,
    samples_n: usize,
}

impl CommandedSamples {
    /// Samples a goal's trajectory; `None` if the goal has none.
    fn of(goal: &Goal) -> Option<Self> {
        let samples_n = sample_idx(goal.end_s()) + 2;
        let times = || (0..samples_n).map(|idx| idx as f64 * SAMPLE_PERIOD_S);
        let (arm, palm) = match &goal.carrier {
            PalmTrajectory::Arm(arm) => (Some(arm), None),
            PalmTrajectory::Palm(points) => {
                let pose = |time_s| PalmPoint::between(points, time_s);
                (None, Some(times().map(pose).collect::<Option<_>>()?))
            }
        };
        let mut q = Vec::new();
        for track in arm.into_iter().chain([&goal.hand]) {
            q.extend(columns(track, times())?);
        }
        let until = q.iter().map(|column| extremes(column)).collect();
        Some(Self {
            q,
            until,
            palm,
            samples_n,
        })
    }

    /// Returns the indices of the commands that may be in effect at a time.
    fn samples(&self, time_s: f64, history: History) -> std::ops::Range<usize> {
        let last = (sample_idx(time_s + EARLY_S) + 2).min(self.samples_n);
        let first = match history {
            History::Recent => sample_idx(time_s - LATE_S),
            History::Any => 0,
        };
        first.min(last.saturating_sub(1))..last
    }

    /// Returns the least and the greatest command of a joint that may be in effect at a time.
    fn range(&self, joint: usize, time_s: f64, history: History) -> [f64; 2] {
        let samples = self.samples(time_s, history);
        match history {
            History::Recent => span(self.q[joint][samples].iter().copied()),
            History::Any => self.until[joint][samples.end - 1],
        }
    }

    fn check_palm(
        &self,
        row: usize,
        sample: &Sample,
        history: History,
    ) -> Result<(), Contradiction> {
        let Some(palm) = &self.palm else {
            return Ok(());
        };
        let commanded = &palm[self.samples(sample.time_s, history)];
        let seen = &sample.table_from_palm;
        let off = |pose: &Pose<Table, Palm>| {
            let off_m = (pose.translation.vector - seen.translation.vector).norm();
            (off_m, pose.rotation.angle_to(&seen.rotation))
        };
        let offs = commanded.iter().map(off);
        // The nearest pose, with each error relative to its tolerance.
        let far = |(off_m, off_rad): &(f64, f64)| (off_m / PALM_M).max(off_rad / PALM_RAD);
        match offs.min_by(|a, b| far(a).total_cmp(&far(b))) {
            Some(off) if far(&off) > 1.0 => Err(Contradiction::Palm {
                row,
                off_m: off.0,
                off_rad: off.1,
            }),
            Some(_) | None => Ok(()),
        }
    }
}

/// Returns the index of the last sampled time at or before a time, 0 before the first.
#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "a motion lasts ten minutes at most, and a cast saturates"
)]
fn sample_idx(time_s: f64) -> usize {
    (time_s / SAMPLE_PERIOD_S).floor().clamp(0.0, 1e6) as usize
}

/// Returns the positions of each joint of a track at the given times; `None` if it has no points.
fn columns(track: &JointTrack, times: impl Iterator<Item = f64>) -> Option<Vec<Vec<f64>>> {
    let mut columns = vec![Vec::new(); track.joints.len()];
    for time_s in times {
        for (column, q) in columns.iter_mut().zip(track.at(time_s)?.q_rad) {
            column.push(q);
        }
    }
    Some(columns)
}

/// Returns the running minima and maxima of some numbers.
fn extremes(numbers: &[f64]) -> Vec<[f64; 2]> {
    let mut range = [f64::INFINITY, f64::NEG_INFINITY];
    let widened = numbers.iter().map(|&number| {
        range = [range[0].min(number), range[1].max(number)];
        range
    });
    widened.collect()
}

fn span(numbers: impl Iterator<Item = f64>) -> [f64; 2] {
    numbers.fold(
        [f64::INFINITY, f64::NEG_INFINITY],
        |[least, most], number| [least.min(number), most.max(number)],
    )
}
