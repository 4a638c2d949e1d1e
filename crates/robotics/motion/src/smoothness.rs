//! Smoothness of a motion, by the definitions of [`Smoothness`].

use nalgebra::{UnitQuaternion, Vector3};
use robot::{RobotModel, WrongDof};
use spatial::{Object, Palm, Pose};

use crate::HandState;

/// Total variation of a motion, of its velocity and of its acceleration, all dimensionless. Less is
/// smoother.
///
/// Of a channel x with n steps, taken as equally long: y = (x − x₀)/(xₙ₋₁ − x₀), which goes from 0 to 1;
/// v its gradient by the time in units of the duration (central differences, one-sided at the ends), a
/// the gradient of v; and of each of them Σ|difference of neighbors|. A straight line has 1, 0 and 0.
/// A motion that ends where it began has no such measure: every number of it is 0, and its columns are null.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Variation {
    /// Of the position.
    pub position: f64,
    /// Of the velocity.
    pub velocity: f64,
    /// Of the acceleration.
    pub acceleration: f64,
}

/// Smoothness of a candidate, by one definition.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Variations {
    /// Of the joints.
    pub joints: Variation,
    /// Of the hand's links in space.
    pub cartesian: Variation,
}

/// Smoothness of a motion, by three definitions.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Smoothness {
    /// The mean over channels (Ye et al., *Learning Continuous Grasping Function with a Dexterous Hand
    /// from Human Demonstrations*, 2023, section IV): one channel per joint; one per coordinate of each
    /// link's origin in the object's frame. A channel that ends within 10⁻⁶ of where it began is left
    /// out. The paper's tables have the logarithm (base 10) of its mean over motions, but for the
    /// position.
    pub paper: Variations,
    /// The same as the released code computes it (github.com/jianglongye/cgf): joints and the three
    /// coordinates of the palm together; the time of a step 1/n, not 1/(n − 1), of the duration; the root
    /// link counted twice; and links placed with the palm's Euler angles (about its own x, y, z) read as a
    /// rotation vector, which is a mistake of that code.
    pub released: Variations,
    /// With all joints (or all coordinates of all links) as one vector: y = (x − x₀)/‖xₙ₋₁ − x₀‖ and
    /// Σ‖difference of neighbors‖, so that a channel that hardly moves cannot outweigh the others.
    pub robust: Variations,
}

/// Net motion below which a channel has no shape of its own, in rad or m.
const STANDING: f64 = 1e-6;

/// Measures a motion of a hand at equally spaced times by all definitions; its joints are in the hand's order.
///
/// # Errors
///
/// Fails if the motion has not as many joints as the hand.
pub fn smoothness(steps: &[HandState<Object>], model: &RobotModel) -> Result<Smoothness, WrongDof> {
    let joints: Vec<Vec<f64>> = steps.iter().map(|step| step.q_rad.clone()).collect();
    let with_palm: Vec<Vec<f64>> = steps
        .iter()
        .map(|step| {
            let palm = step.frame_from_palm.translation.vector;
            palm.iter().chain(&step.q_rad).copied().collect()
        })
        .collect();
    let links: Vec<Vec<f64>> = steps
        .iter()
        .map(|step| origins(model, step, &step.frame_from_palm))
        .collect::<Result<_, _>>()?;
    let misread: Vec<Vec<f64>> = steps
        .iter()
        .map(|step| {
            let mut origins = origins(model, step, &misread(&step.frame_from_palm))?;
            // The released hand has a link `palm` at its root.
            origins.extend_from_within(..origins.len().min(3));
            Ok(origins)
        })
        .collect::<Result<_, _>>()?;
    let own = 1.0 / steps.len().saturating_sub(1).max(1) as f64;
    let released = 1.0 / steps.len().max(1) as f64;
    Ok(Smoothness {
        paper: Variations {
            joints: of_channels(&joints, own),
            cartesian: of_channels(&links, own),
        },
        released: Variations {
            joints: of_channels(&with_palm, released),
            cartesian: of_channels(&misread, released),
        },
        robust: Variations {
            joints: of_vector(&joints, own),
            cartesian: of_vector(&links, own),
        },
    })
}

/// Returns the coordinates of all links' origins.
fn origins(
    model: &RobotModel,
    step: &HandState<Object>,
    object_from_palm: &Pose<Object, Palm>,
) -> Result<Vec<f64>, WrongDof> {
    let palm_from_links = model.forward_kinematics(&step.q_rad)?;
    let origins = palm_from_links.iter().flat_map(|palm_from_link| {
        let origin: Vector3<f64> = (*object_from_palm * *palm_from_link).translation.vector;
        [origin.x, origin.y, origin.z]
    });
    Ok(origins.collect())
}

/// Returns the pose with its angles about its own x, y and z taken for a rotation vector.
fn misread(pose: &Pose<Object, Palm>) -> Pose<Object, Palm> {
    let rotation = pose.rotation.to_rotation_matrix();
    let r = rotation.matrix();
    let angles = Vector3::new(
        (-r[(1, 2)]).atan2(r[(2, 2)]),
        r[(0, 2)].clamp(-1.0, 1.0).asin(),
        (-r[(0, 1)]).atan2(r[(0, 0)]),
    );
    Pose::from_parts(
        pose.translation.vector,
        UnitQuaternion::from_scaled_axis(angles),
    )
}

/// Returns the mean over the channels that move; `steps` are `(step, channel)`.
fn of_channels(steps: &[Vec<f64>], step_time: f64) -> Variation {
    let channels_n = steps.first().map_or(0, Vec::len);
    let mut sum = [0.0; 3];
    let mut moving_n = 0_usize;
    for channel in 0..channels_n {
        let alone: Vec<Vec<f64>> = steps
            .iter()
            .map(|step| step.get(channel).copied().into_iter().collect())
            .collect();
        if let Some(of_one) = variation(&alone, step_time) {
            moving_n += 1;
            for (sum, number) in sum.iter_mut().zip(of_one) {
                *sum += number;
            }
        }
    }
    let [position, velocity, acceleration] = sum.map(|sum| sum / moving_n.max(1) as f64);
    Variation {
        position,
        velocity,
        acceleration,
    }
}

/// Returns that of all channels as one vector.
fn of_vector(steps: &[Vec<f64>], step_time: f64) -> Variation {
    let [position, velocity, acceleration] = variation(steps, step_time).unwrap_or_default();
    Variation {
        position,
        velocity,
        acceleration,
    }
}

/// Returns the total variation of a vector's course, of its velocity and of its acceleration, in units
/// of its net motion; `None` if it has none.
fn variation(steps: &[Vec<f64>], step_time: f64) -> Option<[f64; 3]> {
    let net = distance(steps.first()?, steps.last()?);
    if net.is_nan() || net <= STANDING {
        return None;
    }
    let velocity = gradient(steps, step_time);
    let acceleration = gradient(&velocity, step_time);
    let total = |steps: &[Vec<f64>]| {
        let pairs = steps.windows(2);
        pairs.map(|pair| distance(&pair[0], &pair[1])).sum::<f64>() / net
    };
    Some([total(steps), total(&velocity), total(&acceleration)])
}

fn distance(a: &[f64], b: &[f64]) -> f64 {
    let squares = a.iter().zip(b).map(|(a, b)| (b - a).powi(2));
    squares.sum::<f64>().sqrt()
}

/// Returns central differences, one-sided at the ends, as `numpy.gradient` does.
fn gradient(steps: &[Vec<f64>], step_time: f64) -> Vec<Vec<f64>> {
    let last = steps.len().saturating_sub(1);
    (0..steps.len())
        .map(|idx| {
            let (before, after) = (idx.saturating_sub(1), (idx + 1).min(last));
            let time = (after - before).max(1) as f64 * step_time;
            let neighbors = steps[before].iter().zip(&steps[after]);
            neighbors
                .map(|(before, after)| (after - before) / time)
                .collect()
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    const N: usize = 40;

    fn course(y: impl Fn(f64) -> f64) -> Vec<Vec<f64>> {
        let shares = (0..N).map(|step| step as f64 / (N - 1) as f64);
        shares.map(|share| vec![y(share)]).collect()
    }

    fn near(found: f64, expected: f64, tolerance: f64) {
        assert!((found - expected).abs() < tolerance, "{found} {expected}");
    }

    #[test]
    fn a_straight_line_has_one_and_nothing_else() {
        let line = of_channels(&course(|s| 3.0 - 2.0 * s), 1.0 / (N - 1) as f64);
        near(line.position, 1.0, 1e-12);
        near(line.velocity, 0.0, 1e-9);
        near(line.acceleration, 0.0, 1e-7);
    }

    /// Minimum jerk: 1.00, 0.58 and 1.35 are what the released code's formula gives in logarithms.
    #[test]
    fn minimum_jerk_has_the_known_figures() {
        let course = course(|s| s.powi(3) * (10.0 + s * (6.0 * s - 15.0)));
        let found = of_channels(&course, 1.0 / N as f64);
        near(found.position, 1.0, 1e-12);
        near(found.velocity.log10(), 0.58, 0.01);
        near(found.acceleration.log10(), 1.35, 0.01);
    }

    /// A motion of N steps has N - 1 intervals; the released code counts N.
    #[test]
    fn each_definition_has_its_own_time_of_a_step() {
        let hand = RobotModel::from_urdf(
            r#"<robot name="hand"><link name="palm"/><link name="finger"/>
            <joint name="j" type="revolute"><parent link="palm"/><child link="finger"/>
            <axis xyz="0 1 0"/><limit lower="0" upper="1" effort="1" velocity="1"/></joint></robot>"#,
        );
        let course = course(|s| s.powi(3) * (10.0 + s * (6.0 * s - 15.0)));
        let steps = course.iter().map(|q| HandState {
            frame_from_palm: Pose::identity(),
            q_rad: q.clone(),
        });
        let found = smoothness(&steps.collect::<Vec<_>>(), &hand.unwrap()).unwrap();
        let [own, released] = [N - 1, N].map(|n| 1.0 / n as f64);
        assert_eq!(found.paper.joints, of_channels(&course, own));
        assert_eq!(found.robust.joints, of_vector(&course, own));
        assert_eq!(found.released.joints, of_channels(&course, released));
    }

    #[test]
    fn a_channel_that_hardly_moves_rules_the_mean_and_not_the_vector() {
        // A bump of 0.1 and a net motion of 0.003, beside a joint that goes straight.
        let bump = |s: f64| 0.003 * s + 0.1 * (std::f64::consts::PI * s).sin();
        let both: Vec<Vec<f64>> = course(bump)
            .into_iter()
            .zip(course(|s| s))
            .map(|(a, b)| [a, b].concat())
            .collect();
        let alone = of_channels(&course(bump), 1.0 / (N - 1) as f64);
        near(alone.position, 67.0, 1.0);
        near(of_channels(&both, 1.0 / (N - 1) as f64).position, 34.0, 0.5);
        near(of_vector(&both, 1.0 / (N - 1) as f64).position, 1.03, 0.02);
    }

    #[test]
    fn motionless_hand_has_no_smoothness() {
        assert_eq!(of_channels(&course(|_| 0.4), 0.1), Variation::default());
        assert_eq!(of_vector(&course(|_| 0.4), 0.1), Variation::default());
        assert_eq!(of_channels(&[], 0.1), Variation::default());
    }

    #[test]
    fn angles_are_misread_as_the_released_code_does() {
        let [a, b, c] = [0.3, -0.5, 0.9];
        let about = |axis: Vector3<f64>, angle: f64| UnitQuaternion::from_scaled_axis(axis * angle);
        let rotation = about(Vector3::x(), a) * about(Vector3::y(), b) * about(Vector3::z(), c);
        let pose = Pose::from_parts(Vector3::new(1.0, 2.0, 3.0), rotation);
        let found = misread(&pose);
        near(
            (found.rotation.scaled_axis() - Vector3::new(a, b, c)).norm(),
            0.0,
            1e-12,
        );
        assert_eq!(found.translation, pose.translation);
    }
}
