//! Training data: motions above a table, and the objects that lie on it.

use motion::{HandState, Motion};
use nalgebra::{Point3, UnitQuaternion};
use schemas::training::Split;
use spatial::{Object, Pose, RestingPose, Table};

use crate::{CgfError, config::InputFrame, precision::narrow, random::Random};

/// An object in its resting pose: its surface above the table.
#[derive(Debug, Clone, PartialEq)]
pub struct RestingObject {
    /// The object's name.
    pub object: String,
    /// Its resting pose.
    pub rest: RestingPose,
    /// Points on its surface, in the object frame, in meters, in random order.
    pub points_in_object: Vec<Point3<f64>>,
}

/// The frame in which the network sees an object: the table's or the object's own.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum NetworkFrame {}

/// An object as the network sees it.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct View {
    /// The object's name.
    pub(crate) object: String,
    /// Pose of the network's frame, in the table and in the object.
    pub(crate) table_from_network: Pose<Table, NetworkFrame>,
    pub(crate) object_from_network: Pose<Object, NetworkFrame>,
    /// Points on the surface, in meters.
    pub(crate) points_in_network: Vec<Point3<f64>>,
}

impl View {
    /// Returns the view of an object in its resting pose.
    pub(crate) fn of(scene: &RestingObject, frame: InputFrame) -> Result<Self, CgfError> {
        const MIN_POINTS: usize = 32;
        let table_from_object = *scene.rest.table_from_object();
        let (table_from_network, network_from_object) = match frame {
            InputFrame::Resting => (Pose::identity(), Pose::new(table_from_object)),
            InputFrame::Object => (Pose::new(table_from_object), Pose::identity()),
        };
        let found = scene.points_in_object.len();
        if found < MIN_POINTS {
            return Err(CgfError::TooFewPoints {
                object: scene.object.clone(),
                expected: MIN_POINTS,
                found,
            });
        }
        let points = scene.points_in_object.iter();
        let points_in_network: Vec<_> = points.map(|&point| network_from_object * point).collect();
        if points_in_network
            .iter()
            .any(|p| !p.coords.iter().all(|x| x.is_finite()))
        {
            return Err(CgfError::NotFinite {
                name: scene.object.clone(),
                what: "a surface point",
            });
        }
        Ok(Self {
            object: scene.object.clone(),
            table_from_network,
            object_from_network: network_from_object.inverse(),
            points_in_network,
        })
    }

    /// Returns the first `n` of the points after a rotation, fewer are repeated: `xyz` in meters.
    pub(crate) fn cloud(&self, n: usize, rotation: &UnitQuaternion<f64>) -> Vec<f32> {
        let points = self.points_in_network.iter().cycle().take(n);
        points
            .flat_map(|point| <[f64; 3]>::from((rotation * point).coords))
            .map(narrow)
            .collect()
    }
}

/// One motion to learn from.
#[derive(Debug, Clone, PartialEq)]
pub struct TrainingMotion<F = Table> {
    /// The recording's name.
    pub name: String,
    /// Index of the scene in which it was recorded.
    pub scene: usize,
    /// Whether it is learned from.
    pub split: Split,
    /// The hand over time, its joints in the hand's order; the last step is the grasp.
    pub motion: Motion<F, ()>,
    /// The latent code whose motion it is to become; none: the encoder's.
    pub code: Option<Vec<f64>>,
}

impl TrainingMotion {
    /// Returns the motion as the network sees it.
    pub(crate) fn expressed_in(
        &self,
        table_from_network: &Pose<Table, NetworkFrame>,
    ) -> TrainingMotion<NetworkFrame> {
        TrainingMotion {
            name: self.name.clone(),
            scene: self.scene,
            split: self.split,
            motion: self.motion.expressed_in(&table_from_network.inverse()),
            code: self.code.clone(),
        }
    }
}

impl<F> TrainingMotion<F> {
    pub(crate) fn check(&self, dof: usize) -> Result<(), CgfError> {
        let name = || self.name.clone();
        let found = self.motion.steps().len();
        if found < 2 {
            return Err(CgfError::TooFewSteps {
                name: name(),
                found,
            });
        }
        let found = self.motion.joints().len();
        if found != dof {
            return Err(CgfError::WrongDof {
                name: name(),
                expected: dof,
                found,
            });
        }
        Ok(())
    }

    /// Returns the network's times of all steps: 1 at the first, 0 at the grasp.
    pub fn times(&self) -> Vec<f64> {
        let steps = self.motion.steps().iter();
        steps.map(|step| self.t_of(step.time_s)).collect()
    }

    /// Returns the network's times of the last `n` steps, ending in 0 at the grasp; the first step
    /// again where there are fewer.
    pub(crate) fn last_times(&self, n: usize) -> Vec<f64> {
        let mut times = self.times();
        times.drain(..times.len().saturating_sub(n));
        while times.len() < n {
            times.insert(0, 1.0);
        }
        times
    }

    /// Returns the network's times of `n` recorded steps, from far to near, drawn for this motion; a step
    /// is drawn again only where there are fewer.
    ///
    /// Equal seeds give equal times for motions of one name.
    pub(crate) fn recorded_times(&self, n: usize, seed: u64) -> Vec<f64> {
        // The name tells motions apart (FNV-1a), so that a motion has the same times wherever it stands.
        let stream = self.name.bytes().fold(0xcbf2_9ce4_8422_2325, |hash, byte| {
            (hash ^ u64::from(byte)).wrapping_mul(0x0100_0000_01b3)
        });
        let mut random = Random::new(seed, stream);
        let times = self.times();
        let mut drawn: Vec<usize> = if times.len() >= n {
            let mut order = random.permutation(times.len());
            order.truncate(n);
            order
        } else {
            (0..n).map(|_| random.index(times.len())).collect()
        };
        drawn.sort_unstable();
        drawn.into_iter().map(|step| times[step]).collect()
    }

    /// The network's time of a second of the recording: 1 at the first step, 0 at the grasp.
    fn t_of(&self, time_s: f64) -> f64 {
        let (first, last) = (self.motion.first().time_s, self.motion.grasp().time_s);
        (last - time_s) / (last - first)
    }

    /// Returns the hand at the network's time `t` in 0..=1: between two steps, positions on a line and
    /// the rotation on the shortest arc.
    pub fn at(&self, t: f64) -> HandState<F> {
        let last = self.motion.grasp().time_s;
        HandState::from(self.motion.at(last - t * self.motion.duration_s()))
    }
}

/// Turns a hand about its frame's origin.
pub(crate) fn turned(
    grasp: HandState<NetworkFrame>,
    rotation: &UnitQuaternion<f64>,
) -> HandState<NetworkFrame> {
    grasp.expressed_in(&Pose::from_parts([0.0; 3], *rotation))
}

#[cfg(test)]
mod tests {
    use motion::Step;
    use nalgebra::{Isometry3, Vector3};
    use spatial::{Pose, Table};

    use super::{HandState, Motion, TrainingMotion};
    use crate::HandDistance;
    use schemas::training::Split;

    fn step(time_s: f64, x: f64, angle: f64) -> Step<Table, ()> {
        let isometry = Isometry3::new(Vector3::new(x, 0.0, 0.0), Vector3::new(0.0, 0.0, angle));
        Step {
            time_s,
            frame_from_palm: Pose::new(isometry),
            q_rad: vec![angle],
            rates: (),
        }
    }

    #[test]
    fn time_runs_backwards_and_between_steps() {
        let steps = vec![
            step(0.0, 1.0, 0.0),
            step(1.0, 0.5, 0.4),
            step(4.0, 0.0, 1.0),
        ];
        let track = TrainingMotion {
            name: "a".to_owned(),
            scene: 0,
            split: Split::Training,
            motion: Motion::new(&["a"], steps).unwrap(),
            code: None,
        };
        for (t, step) in [(0.0, 2), (0.75, 1), (1.0, 0)] {
            let error =
                HandDistance::between(&track.at(t), &HandState::from(&track.motion.steps()[step]));
            assert!(
                error.position_m < 1e-12 && error.rotation_rad < 1e-7,
                "{error:?}"
            );
        }
        let between = track.at(0.875);
        assert!((between.frame_from_palm.translation.x - 0.75).abs() < 1e-12);
        assert!((between.frame_from_palm.rotation.angle() - 0.2).abs() < 1e-12);
        assert_eq!(track.last_times(2), [0.75, 0.0]);
        assert_eq!(track.last_times(5), [1.0, 1.0, 1.0, 0.75, 0.0]);
        assert_eq!(track.recorded_times(3, 7), [1.0, 0.75, 0.0]);
        let again = track.recorded_times(9, 7);
        assert!(
            again.len() == 9 && again.is_sorted_by(|a, b| a >= b),
            "{again:?}"
        );
        assert_eq!(again, track.recorded_times(9, 7));
    }
}
