//! From latent codes to candidates: decoded, in the object's frame, in seconds, within limits.

use std::sync::Arc;

use cgf::{Cgf, HandDerivative, HandMotionState, JointRange, ObjectFeature, Random, RestingObject};
use motion::{HandRates, JointRates, Motion, Step};
use nalgebra::Point3;
use rayon::prelude::*;
use robot::{Depth, WrongDof};
use schemas::{
    candidates::Candidate,
    draws::{Draw as DrawRow, Draws},
    objects::Object,
};
use spatial::{Object as InObject, Pose, RestingPose, Table, Twist};

use crate::{
    SampleConfig, SampleError,
    draw::{self, Draw, Source},
    penetration::{PenetrationProbe, deeper_in},
};

/// Generator name of the candidates.
const GENERATOR: &str = "cgf";

/// Draws and decodes all motions of one object, in the order of their names. With a probe, a motion whose
/// hand is too deep in object or table is drawn again, as often as the configuration says; the least
/// deep is kept, and the others are refused. Returns the candidates and all draws. The function sees the shape of `other`, if there is
/// one.
///
/// # Errors
///
/// Fails if a named demonstration is unknown or the function cannot be applied to the object.
pub(crate) fn sample(
    config: &SampleConfig,
    cgf: &Cgf,
    object: &Object,
    other: Option<&Object>,
    probe: Option<PenetrationProbe<'_>>,
    seed: u64,
) -> Result<(Vec<Candidate>, Draws), SampleError> {
    let rests = draw::rests(config, object);
    let source = Source::new(config, cgf, object, &rests)?;
    let decoder = Decoder::new(config, cgf, object, other, &rests, seed)?;
    // Every motion has its own random numbers, whatever becomes of the others.
    let mut randoms: Vec<Random> = (0..config.per_object)
        .map(|number| Random::new(seed, number as u64))
        .collect();
    let mut kept: Vec<Option<MeasuredDraw>> = (0..config.per_object).map(|_| None).collect();
    let mut left: Vec<usize> = (0..config.per_object).collect();
    let rounds = if config.redraws() { config.draws } else { 1 };
    for draw_n in (1..).take(rounds) {
        let draws: Vec<(usize, Draw)> = left
            .iter()
            .map(|&number| (number, source.draw(number, draw_n, &mut randoms[number])))
            .collect();
        let measured: Vec<(usize, MeasuredDraw)> = decoder
            .decode(&draws)?
            .into_par_iter()
            .map(|(number, candidate)| Ok((number, MeasuredDraw::new(candidate, probe)?)))
            .collect::<Result<_, WrongDof>>()?;
        left.clear();
        for (number, draw) in measured {
            if draw
                .candidate
                .depth_m
                .is_some_and(|depth_m| depth_m > config.max_depth_m)
            {
                left.push(number);
            }
            kept[number] = Some(match kept[number].take() {
                Some(kept) => kept.merged(draw),
                None => draw,
            });
        }
        left.sort_unstable();
    }
    let mut candidates = Vec::with_capacity(kept.len());
    let mut rows = Draws::new();
    for kept in kept.into_iter().flatten() {
        let mut draws = kept.refused;
        draws.push(DrawRow::kept(&kept.candidate));
        draws.sort_by_key(|draw| draw.source.draw_n);
        rows.extend(draws);
        candidates.push(kept.candidate);
    }
    Ok((candidates, rows))
}

/// A draw of a motion, with how deep the hand is in things, and the draws that were refused for it.
struct MeasuredDraw {
    depth: Depth,
    candidate: Candidate,
    refused: Draws,
}

impl MeasuredDraw {
    fn new(candidate: Candidate, probe: Option<PenetrationProbe<'_>>) -> Result<Self, WrongDof> {
        let measured = probe.map(|probe| probe.deepest(&candidate)).transpose()?;
        Ok(Self {
            depth: measured.unwrap_or_default(),
            candidate: Candidate {
                depth_m: measured.map(Depth::deepest_m),
                residual_m2: None,
                ..candidate
            },
            refused: Draws::new(),
        })
    }

    /// Merges two draws of a motion: keeps the less deep, this one if they are equal, and adds the other
    /// to its refused draws.
    fn merged(self, other: Self) -> Self {
        let is_less = other.depth.deepest_m() < self.depth.deepest_m();
        let (mut kept, lost) = if is_less {
            (other, self)
        } else {
            (self, other)
        };
        let row = DrawRow::refused(&lost.candidate, deeper_in(lost.depth));
        kept.refused.extend(lost.refused);
        kept.refused.push(row);
        kept
    }
}

/// Takes draws to candidates of one object.
struct Decoder<'a> {
    config: &'a SampleConfig,
    cgf: &'a Cgf,
    object: &'a Object,
    joints: Arc<[String]>,
    /// The object whose shape the function sees.
    shown: &'a Object,
    /// Resting poses of the object, each with the corresponding one of the shown object.
    rests: Vec<(&'a RestingPose, RestingPose)>,
    /// Shape features of the exact points in each resting pose; empty with noise on the points.
    features: Vec<ObjectFeature>,
    times: Vec<f64>,
    seed: u64,
}

impl<'a> Decoder<'a> {
    fn new(
        config: &'a SampleConfig,
        cgf: &'a Cgf,
        object: &'a Object,
        other: Option<&'a Object>,
        rests: &'a [RestingPose],
        seed: u64,
    ) -> Result<Self, SampleError> {
        let most_often = other.map(|other| {
            let rest = other.rests.first().map(|orientation| orientation.rest);
            rest.ok_or_else(|| SampleError::NoRest(other.name.clone()))
        });
        let most_often = most_often.transpose()?;
        let mut decoder = Self {
            config,
            cgf,
            object,
            joints: cgf.description().joints.as_slice().into(),
            shown: other.unwrap_or(object),
            rests: rests
                .iter()
                .map(|rest| (rest, most_often.unwrap_or(*rest)))
                .collect(),
            features: Vec::new(),
            times: Cgf::times(config.steps),
            seed,
        };
        if config.point_noise == 0.0 {
            let points = points(decoder.shown);
            let features = (0..rests.len()).map(|rest| decoder.feature(rest, points.clone()));
            decoder.features = features.collect::<Result<_, _>>()?;
        }
        Ok(decoder)
    }

    /// Encodes these points of the shown object, which lies in the resting pose of this number.
    fn feature(&self, rest: usize, points: Vec<Point3<f64>>) -> Result<ObjectFeature, SampleError> {
        Ok(self.cgf.feature(&RestingObject {
            object: self.shown.name.clone(),
            rest: self.rests[rest].1,
            points_in_object: points,
        })?)
    }

    /// Decodes draws, each with the number of its motion. With noise on the points, each motion has its own cloud.
    fn decode(&self, draws: &[(usize, Draw)]) -> Result<Vec<(usize, Candidate)>, SampleError> {
        if self.config.point_noise > 0.0 {
            let decoded = draws.par_iter().map(|one| {
                let (number, draw) = one;
                let points = noisy(self.shown, self.config.point_noise, self.seed, *number);
                self.decoded(&self.feature(draw.rest, points)?, draw.rest, &[one])
            });
            let decoded: Vec<Vec<(usize, Candidate)>> = decoded.collect::<Result<_, _>>()?;
            return Ok(decoded.into_iter().flatten().collect());
        }
        let mut candidates = Vec::with_capacity(draws.len());
        for (rest, feature) in self.features.iter().enumerate() {
            let draws: Vec<&(usize, Draw)> =
                draws.iter().filter(|(_, draw)| draw.rest == rest).collect();
            candidates.extend(self.decoded(feature, rest, &draws)?);
        }
        Ok(candidates)
    }

    /// Decodes draws of one way in which the object lies.
    fn decoded(
        &self,
        feature: &ObjectFeature,
        rest: usize,
        draws: &[&(usize, Draw)],
    ) -> Result<Vec<(usize, Candidate)>, SampleError> {
        let latents: Vec<Vec<f64>> = draws.iter().map(|(_, draw)| draw.latent.clone()).collect();
        let motions = self.cgf.decode_with_rates(feature, &latents, &self.times)?;
        let (rest, _) = self.rests[rest];
        let ranges = &self.cgf.description().joint_ranges;
        let placed = MotionPlacement::new(rest, ranges, self.config.duration_s);
        let of_draw = |(((number, draw), latent), motion): ((&(usize, Draw), _), _)| {
            let (steps, limit_excess_rad) = placed.steps(motion, &self.times);
            let candidate = Candidate {
                candidate_id: format!("{}-{number:05}", self.object.name),
                generator: GENERATOR.to_owned(),
                source: draw.source.clone(),
                latent,
                table_from_object: rest.table_from_object(),
                limit_excess_rad,
                depth_m: None,
                residual_m2: None,
                motion: Motion::of_joints(Arc::clone(&self.joints), steps)?,
            };
            Ok((*number, candidate))
        };
        let draws = draws.iter().copied().zip(latents).zip(motions);
        draws.map(of_draw).collect()
    }
}

fn points(object: &Object) -> Vec<Point3<f64>> {
    let points = object.points_m.iter().map(|&point| Point3::from(point));
    points.collect()
}

/// Returns the object's points as they are seen for one motion: each off by `noise` times the object's extent along
/// each axis (standard deviation).
fn noisy(object: &Object, noise: f64, seed: u64, motion: usize) -> Vec<Point3<f64>> {
    let points = points(object);
    let coords = || points.iter().map(|point| point.coords);
    let most = coords().reduce(|a, b| a.sup(&b)).unwrap_or_default();
    let least = coords().reduce(|a, b| a.inf(&b)).unwrap_or_default();
    let deviation = (most - least) * noise;
    // A stream that the draw of no motion has.
    let mut random = Random::new(seed, u64::MAX - motion as u64);
    points
        .iter()
        .map(|point| point + deviation.map(|deviation| deviation * random.normal()))
        .collect()
}

/// Frame and duration of motions.
struct MotionPlacement<'a> {
    object_from_table: Pose<InObject, Table>,
    ranges: &'a [JointRange],
    duration_s: f64,
}

impl<'a> MotionPlacement<'a> {
    fn new(rest: &RestingPose, ranges: &'a [JointRange], duration_s: f64) -> Self {
        Self {
            object_from_table: rest.table_from_object().inverse(),
            ranges,
            duration_s,
        }
    }

    /// Puts a motion into the object's frame, its joints within their limits, its time into seconds;
    /// says how far outside its limits a joint was at most.
    fn steps(&self, motion: Vec<HandMotionState>, times: &[f64]) -> (Vec<Step<InObject>>, f64) {
        let mut excess = 0.0_f64;
        let steps = motion.into_iter().zip(times).map(|(moving, t)| {
            let mut q_rad = moving.grasp.q_rad;
            let mut rates = self.rates(&moving.velocity, &moving.acceleration);
            for (idx, (q, range)) in q_rad.iter_mut().zip(self.ranges).enumerate() {
                let within = range.clamp(*q);
                let outside = (*q - within).abs();
                if outside > 0.0 {
                    excess = excess.max(outside);
                    *q = within;
                    rates.joints.velocity[idx] = 0.0;
                    rates.joints.acceleration[idx] = 0.0;
                }
            }
            Step {
                time_s: (1.0 - t) * self.duration_s,
                frame_from_palm: self.object_from_table * moving.grasp.frame_from_palm,
                q_rad,
                rates,
            }
        });
        (steps.collect(), excess)
    }

    /// Takes rates per unit of t, which falls from 1 to 0 in `duration_s`, to rates per second along
    /// the object's axes.
    fn rates(
        &self,
        velocity: &HandDerivative,
        acceleration: &HandDerivative,
    ) -> HandRates<InObject> {
        let by_second = -1.0 / self.duration_s;
        let palm = |rate: &HandDerivative, factor: f64| {
            let palm = rate.palm.expressed_in(&self.object_from_table);
            Twist::new(palm.linear * factor, palm.angular * factor)
        };
        let joints = |rate: &HandDerivative, factor: f64| -> Vec<f64> {
            rate.q.iter().map(|rate| rate * factor).collect()
        };
        HandRates {
            palm_velocity: palm(velocity, by_second),
            palm_acceleration: palm(acceleration, by_second.powi(2)),
            joints: JointRates {
                velocity: joints(velocity, by_second),
                acceleration: joints(acceleration, by_second.powi(2)),
            },
        }
    }
}
