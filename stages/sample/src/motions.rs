//! From latent codes to candidates: decoded, in the object's frame, in seconds, within limits.

use cgf::{Cgf, JointRange, MovingGrasp, Random, Scene};
use nalgebra::{Point3, UnitQuaternion};
use schemas::{
    candidates::{Candidate, Rates, Step},
    objects::Object,
};
use spatial::Rest;

use crate::{
    SampleConfig, SampleError,
    draw::{self, Draw, Source},
};

/// What the candidates say drew them.
const GENERATOR: &str = "cgf";

/// Draws and decodes all motions of one object, in the order of their names.
///
/// # Errors
///
/// Fails if a named demonstration is unknown or the function cannot be applied to the object.
pub(crate) fn sample(
    config: &SampleConfig,
    cgf: &Cgf,
    object: &Object,
    seed: u64,
) -> Result<Vec<Candidate>, SampleError> {
    let rests = draw::rests(config, object);
    let source = Source::new(config, cgf, object, &rests)?;
    let draws: Vec<Draw> = (0..config.per_object)
        .map(|number| source.draw(number, &mut Random::new(seed, number as u64)))
        .collect();
    let times = Cgf::times(config.steps);
    let mut candidates: Vec<Option<Candidate>> = vec![None; draws.len()];
    for (idx, rest) in rests.iter().enumerate() {
        let numbers: Vec<usize> = (0..draws.len())
            .filter(|&number| draws[number].rest == idx)
            .collect();
        if numbers.is_empty() {
            continue;
        }
        let feature = cgf.feature(&Scene {
            object: object.name.clone(),
            rest: *rest,
            points_in_object: object
                .points_m
                .iter()
                .map(|&point| Point3::from(point))
                .collect(),
        })?;
        let latents: Vec<Vec<f64>> = numbers
            .iter()
            .map(|&number| draws[number].latent.clone())
            .collect();
        let motions = cgf.decode_with_rates(&feature, &latents, &times)?;
        let ranges = &cgf.description().joint_ranges;
        let placed = Placed::new(rest, ranges, config.duration_s);
        for ((number, latent), motion) in numbers.into_iter().zip(latents).zip(motions) {
            let (steps, limit_excess_rad) = placed.steps(motion, &times);
            candidates[number] = Some(Candidate {
                candidate_id: format!("{}-{number:05}", object.name),
                generator: GENERATOR.to_owned(),
                latent,
                table_from_object: rest.table_from_object(),
                limit_excess_rad,
                steps,
            });
        }
    }
    Ok(candidates.into_iter().flatten().collect())
}

/// Where and how fast motions take place.
struct Placed<'a> {
    object_from_table: spatial::Pose<spatial::Object, spatial::Table>,
    ranges: &'a [JointRange],
    duration_s: f64,
}

impl<'a> Placed<'a> {
    fn new(rest: &Rest, ranges: &'a [JointRange], duration_s: f64) -> Self {
        Self {
            object_from_table: rest.table_from_object().inverse(),
            ranges,
            duration_s,
        }
    }

    /// Puts a motion into the object's frame, its joints within their limits, its time into seconds;
    /// says how far outside its limits a joint was at most.
    fn steps(&self, motion: Vec<MovingGrasp>, times: &[f64]) -> (Vec<Step>, f64) {
        let mut excess = 0.0_f64;
        let steps = motion.into_iter().zip(times).map(|(moving, t)| {
            let mut q_rad = moving.grasp.q_rad;
            let mut rates = self.rates(
                &moving.velocity,
                &moving.acceleration,
                &self.object_from_table.isometry().rotation,
            );
            for (idx, (q, range)) in q_rad.iter_mut().zip(self.ranges).enumerate() {
                let within = range.clamp(*q);
                if within != *q {
                    excess = excess.max((*q - within).abs());
                    *q = within;
                    rates.q_velocity_rad_per_s[idx] = 0.0;
                    rates.q_acceleration_rad_per_s2[idx] = 0.0;
                }
            }
            Step {
                time_s: (1.0 - t) * self.duration_s,
                object_from_palm: self.object_from_table * moving.grasp.table_from_palm,
                q_rad,
                rates,
            }
        });
        (steps.collect(), excess)
    }

    /// Takes rates per unit of t, which falls from 1 to 0 in `duration_s`, to rates per second along
    /// the axes of another frame.
    fn rates(
        &self,
        velocity: &cgf::HandRate,
        acceleration: &cgf::HandRate,
        rotation: &UnitQuaternion<f64>,
    ) -> Rates {
        let by_second = -1.0 / self.duration_s;
        let palm = |rate: &cgf::HandRate, factor: f64| {
            let linear = rotation * rate.linear * factor;
            let angular = rotation * rate.angular * factor;
            [
                linear.x, linear.y, linear.z, angular.x, angular.y, angular.z,
            ]
        };
        let joints = |rate: &cgf::HandRate, factor: f64| -> Vec<f64> {
            rate.q.iter().map(|rate| rate * factor).collect()
        };
        Rates {
            palm_velocity: palm(velocity, by_second),
            palm_acceleration: palm(acceleration, by_second.powi(2)),
            q_velocity_rad_per_s: joints(velocity, by_second),
            q_acceleration_rad_per_s2: joints(acceleration, by_second.powi(2)),
        }
    }
}
