//! What a report cannot say of a goal without contradicting it, the robot or itself.
//!
//! A report decides what is stored of a motion. One that was made up, cut, frozen or mixed up with another
//! must not pass for a success; one that a cell gives of what it did must pass, late and noisy as robots
//! are. What is compared and within what, `README.md` says.

use motion::{Carrier, JointTrack, PalmPoint};
use nalgebra::Isometry3;
use robot::{Joint, JointKind};
use schemas::executions::Outcome;

use crate::{Goal, Report, Sample};

/// Longest time between two samples, before the first and after the last, in seconds.
const GAP_S: f64 = 0.1;
/// How much longer than its goal a motion may be watched, in seconds.
const LONGER_S: f64 = 5.0;
/// How long after its time, and how long before it, a command may be seen, in seconds.
const LATE_S: f64 = 0.25;
const EARLY_S: f64 = 0.05;
/// How far a command may be from the goal's course, in radians and in meters.
const COMMAND_RAD: f64 = 0.05;
const COMMAND_M: f64 = 0.005;
/// How far a joint may be measured outside its limits, in radians and in meters: it gives way, and its
/// encoder is not exact.
const LIMIT_RAD: f64 = 0.2;
const LIMIT_M: f64 = 0.02;
/// How far a palm that flies may be from the goal's course, in meters and radians.
const PALM_M: f64 = 0.05;
const PALM_RAD: f64 = 0.3;
/// From this on a joint is told to move on the way to the grasp, in radians and in meters, and this share
/// of it must be seen: fingers may be held up by the object.
const MOVES_RAD: f64 = 0.1;
const MOVES_M: f64 = 0.01;
const MOVED_SHARE: f64 = 0.1;
/// Share of the object's rise that the palm must have made.
const PALM_SHARE: f64 = 0.5;
/// How far from where the goal has it the object may lie at first, in meters.
const ELSEWHERE_M: f64 = 0.3;
/// Coordinates that nothing on a table has, in meters.
const FAR_M: f64 = 10.0;
/// How far the rise that is told may be from that of the samples, in meters: the object may fall between
/// the last sample and the last look.
const LIFT_M: f64 = 0.03;
/// How much lower than lifted the samples may show an object that was held, in meters.
const HELD_M: f64 = 0.01;
/// Time between two looks at a goal's course, in seconds.
const LOOK_S: f64 = 0.005;

/// What a report contradicts.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum Contradiction {
    /// It is about something else.
    #[error("it is about goal `{found}`")]
    Goal {
        /// The goal that it names.
        found: String,
    },
    /// It says something that no report says.
    #[error("`{outcome}` is no outcome of a goal that the cell took")]
    Outcome {
        /// What it says.
        outcome: &'static str,
    },
    /// It is of other joints, or of these in another order.
    #[error("its joints are `{found}`, the goal's are `{expected}`")]
    Joints {
        /// Its joints.
        found: String,
        /// The goal's.
        expected: String,
    },
    /// It says that something was carried out and does not show it.
    #[error("it says `{outcome}` and has no samples")]
    NoSamples {
        /// What it says.
        outcome: &'static str,
    },
    /// Its samples are not at times of the motion, one after the other.
    #[error("sample {row} is at {time_s} s, expected after {after_s} s and up to {until_s} s")]
    Times {
        /// The sample, from 0.
        row: usize,
        /// When it is.
        time_s: f64,
        /// When the one before is.
        after_s: f64,
        /// When it may be at the latest.
        until_s: f64,
    },
    /// It ends before the motion.
    #[error("it says `succeeded` and ends after {time_s} s, the motion after {end_s} s")]
    Short {
        /// When the last sample is.
        time_s: f64,
        /// When the hold ends.
        end_s: f64,
    },
    /// Something is where nothing is.
    #[error("sample {row} has the {what} {far_m} m away")]
    Far {
        /// The sample.
        row: usize,
        /// What.
        what: &'static str,
        /// Its largest coordinate.
        far_m: f64,
    },
    /// The object lay elsewhere.
    #[error("the object is {off_m:.4} m from where the goal has it at first")]
    Elsewhere {
        /// How far.
        off_m: f64,
    },
    /// A joint is where it cannot be.
    #[error("sample {row} has joint `{joint}` at {q}, outside {lower} to {upper}")]
    Limit {
        /// The sample.
        row: usize,
        /// The joint.
        joint: String,
        /// Its position.
        q: f64,
        /// Its limits.
        lower: f64,
        /// Its limits.
        upper: f64,
    },
    /// The goal moves something nowhere: no report can be told from it.
    #[error("the goal has a controller without points, or a turn that no palm can follow")]
    NoCourse,
    /// A joint was told something else.
    #[error(
        "sample {row} has joint `{joint}` told to be at {q}, the goal tells {least:.4} to {most:.4} then"
    )]
    Command {
        /// The sample.
        row: usize,
        /// The joint.
        joint: String,
        /// What it was told.
        q: f64,
        /// The least that the goal tells it about then.
        least: f64,
        /// The most.
        most: f64,
    },
    /// A palm that flies is elsewhere.
    #[error(
        "sample {row} has the palm {off_m:.4} m and {off_rad:.4} rad from where the goal has it"
    )]
    Palm {
        /// The sample.
        row: usize,
        /// How far it is.
        off_m: f64,
        /// By how much it is turned.
        off_rad: f64,
    },
    /// A joint has not moved.
    #[error(
        "joint `{joint}` is told to move by {told:.4} to the grasp and has moved by {moved:.4}"
    )]
    Still {
        /// The joint.
        joint: String,
        /// By how much it was told to.
        told: f64,
        /// By how much it has.
        moved: f64,
    },
    /// The rise is not that of the samples.
    #[error("it says that the object rose by {said_m} m, its samples say {shown_m:.4} m")]
    Lift {
        /// What it says.
        said_m: f64,
        /// What its samples say.
        shown_m: f64,
    },
    /// What was held was not lifted.
    #[error(
        "it says `succeeded` and has the object {rise_m:.4} m up after {time_s} s, the goal asks for {lifted_m} m"
    )]
    Low {
        /// How far the object has risen.
        rise_m: f64,
        /// When.
        time_s: f64,
        /// How far it must have.
        lifted_m: f64,
    },
    /// The object rose without the hand.
    #[error("it says `succeeded` and has the object {object_m:.4} m up and the palm {palm_m:.4} m")]
    PalmLow {
        /// How far the object has risen.
        object_m: f64,
        /// How far the palm has.
        palm_m: f64,
    },
}

/// Looks for what a report contradicts.
pub(crate) fn check(report: &Report, goal: &Goal, robot: &[Joint]) -> Result<(), Contradiction> {
    let outcome = report.outcome;
    if report.goal_id != goal.seal().goal_id {
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
    let course = Course::of(goal).ok_or(Contradiction::NoCourse)?;
    let history = if is_whole {
        History::Recent
    } else {
        History::Any
    };
    for (row, sample) in report.samples.iter().enumerate() {
        check_joints(row, sample, &joints, &course, history)?;
        course.check_palm(row, sample, history)?;
    }
    if is_whole {
        check_motion(&report.samples, &joints, &course, goal)?;
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

/// Which commands may still be seen.
#[derive(Clone, Copy)]
enum History {
    /// Those of a short time.
    Recent,
    /// Any that was given: the motion may have been broken off then.
    Any,
}

/// Returns the joints of the goal, in its order, which must be that of the report.
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
    let end_s = end_s(goal);
    let mut after_s = -f64::EPSILON;
    for (row, sample) in samples.iter().enumerate() {
        let until_s = (after_s + GAP_S).min(end_s + LONGER_S);
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
            ("palm", sample.table_from_palm.isometry()),
            ("object", sample.table_from_object.isometry()),
        ] {
            let far_m = place.translation.vector.amax();
            if far_m > FAR_M {
                return Err(Contradiction::Far { row, what, far_m });
            }
        }
    }
    let place = |pose: &Isometry3<f64>| pose.translation.vector;
    let laid = place(goal.table_from_object.isometry());
    let off_m = samples.first().map_or(0.0, |first| {
        (place(first.table_from_object.isometry()) - laid).norm()
    });
    if off_m > ELSEWHERE_M {
        return Err(Contradiction::Elsewhere { off_m });
    }
    Ok(())
}

fn check_joints(
    row: usize,
    sample: &Sample,
    joints: &[&Joint],
    course: &Course,
    history: History,
) -> Result<(), Contradiction> {
    let told = sample.q_rad.iter().zip(&sample.q_command_rad);
    for (idx, (joint, (&q, &command))) in joints.iter().zip(told).enumerate() {
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
        let [least, most] = course.range(idx, sample.time_s, history);
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

/// Checks that the joints move to the grasp as they are told, as far as it was watched.
fn check_motion(
    samples: &[Sample],
    joints: &[&Joint],
    course: &Course,
    goal: &Goal,
) -> Result<(), Contradiction> {
    let seen_s = samples.last().map_or(0.0, |last| last.time_s);
    let until_s = goal.grasp.reach_s.min(seen_s - LATE_S);
    for (idx, joint) in joints.iter().enumerate() {
        let least_told = if joint.kind == JointKind::Prismatic {
            MOVES_M
        } else {
            MOVES_RAD
        };
        let [least, most] = course.range(idx, until_s - EARLY_S, History::Any);
        let told = most - least;
        let seen = samples
            .iter()
            .filter(|sample| sample.time_s <= until_s + LATE_S);
        let [least, most] = span(seen.map(|sample| sample.q_rad[idx]));
        let moved = most - least;
        if told > least_told && moved < MOVED_SHARE * told {
            return Err(Contradiction::Still {
                joint: joint.name.clone(),
                told,
                moved,
            });
        }
    }
    Ok(())
}

fn check_lift(said_m: f64, shown_m: f64) -> Result<(), Contradiction> {
    // A comparison with what is no number is false.
    if (said_m - shown_m).abs() <= LIFT_M {
        return Ok(());
    }
    Err(Contradiction::Lift { said_m, shown_m })
}

/// Checks that the object was lifted, by the hand, and held until the end.
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
    let held_s = end_s(goal) - grasp.hold_s + LATE_S;
    let held = |sample: &&Sample| sample.time_s >= held_s || std::ptr::eq(*sample, last);
    for sample in report.samples.iter().filter(held) {
        let rise_m = height_m(sample) - height_m(first);
        if rise_m < lifted_m - HELD_M {
            return low(rise_m, sample.time_s);
        }
    }
    let palm_m = |sample: &Sample| sample.table_from_palm.isometry().translation.z;
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
    sample.table_from_object.isometry().translation.z
}

/// Returns when the hold of a goal ends, in seconds.
fn end_s(goal: &Goal) -> f64 {
    let grasp = &goal.grasp;
    grasp.reach_s + grasp.squeeze_s + grasp.pause_s + grasp.lift_s + grasp.hold_s
}

/// What a goal tells over time.
struct Course {
    /// Positions of each joint at each look.
    q: Vec<Vec<f64>>,
    /// For each joint and look, the least and the most up to then.
    until: Vec<Vec<[f64; 2]>>,
    /// Poses of the palm at each look, if it flies.
    palm: Option<Vec<Isometry3<f64>>>,
    looks_n: usize,
}

impl Course {
    /// Takes what a goal tells; `None` where that is nothing.
    fn of(goal: &Goal) -> Option<Self> {
        let looks_n = look(end_s(goal)) + 2;
        let times = || (0..looks_n).map(|idx| idx as f64 * LOOK_S);
        let (arm, palm) = match &goal.carrier {
            Carrier::Arm(arm) => (Some(arm), None),
            Carrier::Palm(points) => {
                let pose = |time_s| Some(*PalmPoint::between(points, time_s)?.isometry());
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
            looks_n,
        })
    }

    /// Returns the looks at which a command was given that may be seen at a time.
    fn looks(&self, time_s: f64, history: History) -> std::ops::Range<usize> {
        let last = (look(time_s + EARLY_S) + 2).min(self.looks_n);
        let first = match history {
            History::Recent => look(time_s - LATE_S),
            History::Any => 0,
        };
        first.min(last.saturating_sub(1))..last
    }

    /// Returns the least and the most that a joint was told of which something may be seen at a time.
    fn range(&self, joint: usize, time_s: f64, history: History) -> [f64; 2] {
        let looks = self.looks(time_s, history);
        match history {
            History::Recent => span(self.q[joint][looks].iter().copied()),
            History::Any => self.until[joint][looks.end - 1],
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
        let told = &palm[self.looks(sample.time_s, history)];
        let seen = sample.table_from_palm.isometry();
        let off = |pose: &Isometry3<f64>| {
            let off_m = (pose.translation.vector - seen.translation.vector).norm();
            (off_m, pose.rotation.angle_to(&seen.rotation))
        };
        let offs = told.iter().map(off);
        // The one that is nearest, each by how much may be.
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

/// Returns the number of the last look at or before a time, 0 before the first.
#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "a motion lasts ten minutes at most, and a cast saturates"
)]
fn look(time_s: f64) -> usize {
    (time_s / LOOK_S).floor().clamp(0.0, 1e6) as usize
}

/// Returns the positions of each joint of a track at some times; `None` if it has no points.
fn columns(track: &JointTrack, times: impl Iterator<Item = f64>) -> Option<Vec<Vec<f64>>> {
    let mut columns = vec![Vec::new(); track.joints.len()];
    for time_s in times {
        for (column, q) in columns.iter_mut().zip(track.at(time_s)?.q_rad) {
            column.push(q);
        }
    }
    Some(columns)
}

/// Returns the least and the most of some numbers up to each of them.
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
