//! Charts of diversity and plausibility of an object's motions, beside its demonstrations.

use charts::{Bars, Captions, Sample, Scale, Series, bars, histogram, lines, scatter};
use dataflow::Context;
use diversity::{ComparedMotion, Diversity};
use lake::{LakeError, WriteArtifact};
use motion::Step;
use schemas::{
    sampling::SampleMeasures,
    trajectories::{Trajectory, TrajectoryRates},
};
use spatial::{Object, Pose, RestingPose, Table};

/// Motions of which each is a dot of its own; more would make pictures of megabytes.
const DOTS: usize = 1000;
/// Ranges into which depths and angles are sorted.
const BINS: usize = 30;
/// Cosine of the angle, 30°, up to which an object lies as in another motion: orientations that were seen
/// within 20° count as one, and are put where the object is stable, up to 10° away.
const LIES_ALIKE: f64 = 0.866;

/// Data of an object's charts.
pub(crate) struct Charts<'a> {
    /// Names of the hand's joints.
    pub(crate) joints: &'a [String],
    /// Plausibility of each motion.
    pub(crate) sampled: &'a [SampleMeasures],
    /// Diversity of the motions.
    pub(crate) drawn: &'a Diversity,
    /// Diversity of the object's demonstrations.
    pub(crate) shown: &'a Diversity,
}

/// Measures how different an object's demonstrations are, of those in which it lies as in one of the
/// motions that were drawn.
pub(crate) fn of_shown(shown: &[Trajectory], drawn: &[ComparedMotion]) -> Diversity {
    let n_steps = drawn.iter().map(|motion| motion.steps.len()).min();
    let motions = shown.iter().filter_map(|shown| {
        Some(ComparedMotion {
            table_from_object: alike(drawn, &shown.rest)?,
            steps: at_equal_times(&shown.motion, n_steps?),
        })
    });
    Diversity::of(&motions.collect::<Vec<_>>())
}

/// Pose of the object in the motion whose resting pose is nearest to this one.
fn alike(drawn: &[ComparedMotion], rest: &RestingPose) -> Option<Pose<Table, Object>> {
    let up = |motion: &ComparedMotion| (motion.table_from_object * *rest.up_in_object).z;
    let nearest = drawn.iter().max_by(|a, b| up(a).total_cmp(&up(b)));
    let alike = nearest.filter(|motion| up(motion) > LIES_ALIKE)?;
    Some(alike.table_from_object)
}

/// The recorded steps nearest to `n` equal times from the first to the grasp.
fn at_equal_times(
    shown: &motion::Motion<Object, TrajectoryRates>,
    n: usize,
) -> Vec<&Step<Object, TrajectoryRates>> {
    let (first_s, duration_s) = (shown.first().time_s, shown.duration_s());
    let last = n.saturating_sub(1).max(1) as f64;
    let nearest = |number: usize| {
        let time_s = first_s + duration_s * number as f64 / last;
        let off = |step: &&Step<Object, TrajectoryRates>| (step.time_s - time_s).abs();
        shown
            .steps()
            .iter()
            .min_by(|a, b| off(a).total_cmp(&off(b)))
    };
    (0..n).filter_map(nearest).collect()
}

impl Charts<'_> {
    /// Writes all charts; those in which there is nothing to draw are left out.
    pub(crate) fn put(&self, cx: &Context) -> Result<(), LakeError> {
        for (name, chart) in [
            ("grasps", self.grasps()),
            ("palm", self.palm()),
            ("joints", self.joints()),
            ("depth", self.depth()),
            ("limits", self.limits()),
        ] {
            cx.write_chart(name, chart)?;
        }
        Ok(())
    }

    /// Diversity of motions and of demonstrations, of each that has two comparable ones.
    fn both(&self) -> impl Iterator<Item = (&'static str, &Diversity)> {
        let both = [("sampled", self.drawn), ("demonstrations", self.shown)];
        both.into_iter()
            .filter(|(_, diversity)| diversity.compared_n > 0)
    }

    fn grasps(&self) -> Option<String> {
        let series = self.both().map(|(name, diversity)| {
            let compared = diversity.from_mean.iter().zip(&diversity.is_compared);
            let distances = compared.filter_map(|(distance, is_compared)| {
                let distance = distance.filter(|_| *is_compared)?;
                Some([1e3 * distance.palm_m, distance.q_rad.to_degrees()])
            });
            Series {
                name: name.to_owned(),
                points: distances.take(DOTS).collect(),
            }
        });
        let captions = Captions {
            title: "Grasps, each from the mean of its kind",
            x: "distance of the palm [mm]",
            y: "joints, root mean square [°]",
        };
        scatter(&captions, &series.collect::<Vec<_>>())
    }

    fn palm(&self) -> Option<String> {
        let series = self.both().map(|(name, diversity)| {
            let last = diversity.by_step.len().saturating_sub(1).max(1) as f64;
            let steps = diversity.by_step.iter().enumerate();
            Series {
                name: name.to_owned(),
                points: steps
                    .map(|(step, spread)| [step as f64 / last, 1e3 * spread.palm_m])
                    .collect(),
            }
        });
        let captions = Captions {
            title: "Spread of the palm over time",
            x: "part of the motion, 1 at the grasp",
            y: "root mean square distance from the mean [mm]",
        };
        lines(&captions, Scale::Linear, &series.collect::<Vec<_>>())
    }

    fn joints(&self) -> Option<String> {
        let series = self.both().map(|(name, diversity)| Bars {
            name: name.to_owned(),
            values: self
                .joints
                .iter()
                .cloned()
                .zip(
                    diversity
                        .joints_rad
                        .iter()
                        .map(|spread| spread.to_degrees()),
                )
                .collect(),
        });
        let captions = Captions {
            title: "Spread of the joints at the grasp",
            x: "root mean square distance from the mean [°]",
            y: "",
        };
        bars(&captions, self.joints, &series.collect::<Vec<_>>())
    }

    fn depth(&self) -> Option<String> {
        let sample = |name: &str, depth_m: fn(&SampleMeasures) -> f64| Sample {
            name: name.to_owned(),
            values: self.sampled.iter().map(|s| 1e3 * depth_m(s)).collect(),
        };
        let captions = Captions {
            title: "Depth of the hand in the object",
            x: "deepest point [mm]",
            y: "share of the motions [%]",
        };
        let samples = [
            sample("before the grasp", |s| s.approach_depth_m),
            sample("at the grasp", |s| s.grasp_depth_m),
        ];
        histogram(&captions, BINS, &samples)
    }

    fn limits(&self) -> Option<String> {
        let excess = self.sampled.iter().map(|s| s.limit_excess_rad.to_degrees());
        let sample = Sample {
            name: "sampled".to_owned(),
            values: excess.collect(),
        };
        let captions = Captions {
            title: "Joints outside their limits, before they are put back",
            x: "farthest of a motion [°]",
            y: "share of the motions [%]",
        };
        histogram(&captions, BINS, &[sample])
    }
}

#[cfg(test)]
mod tests {
    use motion::HandRates;
    use nalgebra::{Isometry3, Unit, Vector3};
    use schemas::trajectories::Tracking;

    use super::*;

    fn step<R>(time_s: f64, x: f64, rates: R) -> Step<Object, R> {
        Step {
            time_s,
            frame_from_palm: Pose::new(Isometry3::translation(x, 0.0, 0.2)),
            q_rad: vec![10.0 * x],
            rates,
        }
    }

    fn rest(tilt_rad: f64) -> RestingPose {
        RestingPose {
            up_in_object: Unit::new_normalize(Vector3::new(tilt_rad.sin(), 0.0, tilt_rad.cos())),
            height_m: 0.1,
        }
    }

    /// Comes from `x` in three steps, the second of them late.
    fn shown(tilt_rad: f64, x: f64) -> Trajectory {
        let steps = [(0.5, x), (2.0, 0.5 * x), (2.5, 0.1 * x)];
        let steps = steps.map(|(time_s, x)| step(time_s, x, TrajectoryRates::zero(1)));
        Trajectory {
            sequence: String::new(),
            object: "can".to_owned(),
            keypoints: Vec::new(),
            tips: Vec::new(),
            rest: rest(tilt_rad),
            motion: motion::Motion::new(&["j"], steps.into()).unwrap(),
            tracking: vec![Tracking::default(); 3],
        }
    }

    #[test]
    fn demonstrations_are_compared_in_the_orientation_of_the_draw() {
        let grasp = step(1.0, 0.0, HandRates::zero(1));
        let drawn = [0.0, 1.5].map(|tilt_rad| ComparedMotion {
            table_from_object: rest(tilt_rad).table_from_object(),
            steps: vec![&grasp; 5],
        });
        let found = of_shown(
            &[
                shown(0.1, 0.4),
                shown(-0.1, -0.4),
                // Alone in how it lies, and as nothing that was drawn.
                shown(1.4, 9.0),
                shown(-1.5, 9.0),
            ],
            &drawn,
        );
        assert_eq!(found.is_compared, [true, true, false]);
        let near = |a: f64, b: f64| assert!((a - b).abs() < 1e-9, "{a} {b}");
        // Times 0.5, 1, 1.5, 2 and 2.5 s: the nearest steps are the first twice, then the second twice.
        let expected = [0.4, 0.4, 0.2, 0.2, 0.04];
        assert_eq!(found.by_step.len(), expected.len());
        for (spread, expected) in found.by_step.iter().zip(expected) {
            near(spread.palm_m, expected);
        }
        near(found.joints_rad[0], 0.4);
        assert_eq!(of_shown(&[], &drawn).compared_n, 0);
        assert_eq!(of_shown(&[shown(0.0, 1.0)], &[]).compared_n, 0);
    }
}
