//! From latent codes to motions: decoded, in the object's frame, in seconds, within limits.

use std::sync::Arc;

use cgf::{Cgf, HandDerivative, HandMotionState, JointRange, ObjectFeature, Random, RestingObject};
use motion::{HandRates, JointRates, Motion, Step};
use nalgebra::Point3;
use rayon::prelude::*;
use robot::{Depth, WrongDof};
use spatial::{Object, Pose, RestingPose, Table, Twist};

use crate::{
    CodeOrigin, Redraws, SampledObject, SamplingError, SamplingOptions,
    codes::{self, Code, CodeSource},
};

/// What motions are sampled of.
pub struct SamplingTask<'a> {
    /// The options.
    pub options: &'a SamplingOptions,
    /// The grasping function.
    pub cgf: &'a Cgf,
    /// The object.
    pub object: SampledObject<'a>,
    /// The object whose shape the function sees instead, as it rests most often; the motions are placed about
    /// `object` all the same.
    pub shown: Option<SampledObject<'a>>,
    /// When a motion is drawn again; none: every motion is drawn once, and not measured.
    pub redraws: Option<Redraws<'a>>,
    /// Seed of all random numbers.
    pub seed: u64,
    /// Whether the rest of the motions is to be left.
    pub is_canceled: &'a (dyn Fn() -> bool + Sync),
}

/// Codes that are decoded between two looks at whether the sampling was canceled.
const CHUNK: usize = 256;

/// The motions of one object.
#[derive(Debug, Clone, PartialEq)]
pub struct SampledMotions {
    /// Whether the function was trained on motions to the object.
    pub is_learned: bool,
    /// The motions, by their numbers.
    pub motions: Vec<SampledMotion>,
}

/// A sampled motion, and the draws that were refused for it.
#[derive(Debug, Clone, PartialEq)]
pub struct SampledMotion {
    /// The draw that was kept.
    pub draw: Draw,
    /// Its latent code.
    pub latent: Vec<f64>,
    /// The hand in the object's frame; the last step is the grasp.
    pub motion: Motion<Object>,
    /// The other draws, by `draw_n`.
    pub refused: Vec<Draw>,
}

/// A draw of a motion.
#[derive(Debug, Clone, PartialEq)]
pub struct Draw {
    /// Which draw of its motion it is, from 1.
    pub draw_n: u32,
    /// Origin of its latent code.
    pub origin: CodeOrigin,
    /// Pose of the object on the table.
    pub table_from_object: Pose<Table, Object>,
    /// Greatest joint limit excess before clamping, in radians (meters if prismatic); 0 if none.
    pub limit_excess_rad: f64,
    /// Greatest depth of the hand in object and table over the motion; none if not measured.
    pub depth: Option<Depth>,
}

/// Samples the motions of one object, in the order of their numbers. With redraws, a motion whose hand is too deep in
/// object or table is drawn again; the shallowest is kept, the first among equals.
///
/// # Errors
///
/// Fails if a named demonstration is unknown, the shown object has no resting orientation, the function cannot be
/// applied to the object, or it is canceled.
pub fn sample(task: &SamplingTask<'_>) -> Result<SampledMotions, SamplingError> {
    let &SamplingTask {
        options, cgf, seed, ..
    } = task;
    let rests = codes::rests(options, &task.object);
    let source = CodeSource::new(options, cgf, &task.object, &rests)?;
    let decoder = Decoder::new(task, &rests)?;
    // Every motion has its own random numbers, whatever becomes of the others.
    let mut randoms: Vec<Random> = (0..options.n)
        .map(|number| Random::new(seed, number as u64))
        .collect();
    let mut kept: Vec<Option<SampledMotion>> = (0..options.n).map(|_| None).collect();
    let mut left: Vec<usize> = (0..options.n).collect();
    let max_draws = task.redraws.map_or(1, |redraws| redraws.max_draws);
    for draw_n in (1..).take(max_draws) {
        let drawn: Vec<(usize, Code)> = left
            .iter()
            .map(|&number| (number, source.draw(number, draw_n, &mut randoms[number])))
            .collect();
        let measured: Vec<(usize, SampledMotion)> = decoder
            .decode(&drawn)?
            .into_par_iter()
            .map(|(number, motion)| Ok((number, motion.measured(task.redraws.as_ref())?)))
            .collect::<Result<_, WrongDof>>()?;
        left.clear();
        for (number, motion) in measured {
            if task
                .redraws
                .is_some_and(|most| motion.depth_m() > most.max_depth_m)
            {
                left.push(number);
            }
            kept[number] = Some(match kept[number].take() {
                Some(kept) => kept.merged(motion),
                None => motion,
            });
        }
        left.sort_unstable();
    }
    let mut motions: Vec<SampledMotion> = kept.into_iter().flatten().collect();
    for motion in &mut motions {
        motion.refused.sort_by_key(|draw| draw.draw_n);
    }
    Ok(SampledMotions {
        is_learned: codes::is_learned(cgf, &task.object),
        motions,
    })
}

impl SampledMotion {
    fn measured(mut self, redraws: Option<&Redraws<'_>>) -> Result<Self, WrongDof> {
        let depth = |redraws: &Redraws<'_>| {
            let table_from_object = &self.draw.table_from_object;
            redraws.probe.deepest(table_from_object, &self.motion)
        };
        self.draw.depth = redraws.map(depth).transpose()?;
        Ok(self)
    }

    /// Greatest depth in object or table, in meters; 0 if not measured.
    fn depth_m(&self) -> f64 {
        self.draw.depth.unwrap_or_default().deepest_m()
    }

    /// Merges two draws of a motion: keeps the less deep, this one if they are equal, and adds the other
    /// to its refused draws.
    fn merged(self, other: Self) -> Self {
        let is_less = other.depth_m() < self.depth_m();
        let (mut kept, lost) = if is_less {
            (other, self)
        } else {
            (self, other)
        };
        kept.refused.extend(lost.refused);
        kept.refused.push(lost.draw);
        kept
    }
}

/// A function at one object that lies on a table: latent codes become motions at any times.
pub struct PlacedFunction<'a> {
    cgf: &'a Cgf,
    feature: ObjectFeature,
    rest: RestingPose,
}

impl<'a> PlacedFunction<'a> {
    /// Shows a function an object in a resting pose.
    ///
    /// # Errors
    ///
    /// Fails if the object has too few points or they are not finite.
    pub fn new(
        cgf: &'a Cgf,
        object: &SampledObject<'_>,
        rest: RestingPose,
    ) -> Result<Self, SamplingError> {
        let feature = cgf.feature(&RestingObject {
            object: object.name.to_owned(),
            rest,
            points_in_object: object.points(),
        })?;
        Ok(Self { cgf, feature, rest })
    }

    /// Decodes codes of the network's width at these times in seconds, increasing within `0..=duration_s`, the grasp's
    /// time: each motion is in the object's frame and within joint limits, with exact rates.
    ///
    /// # Errors
    ///
    /// Fails if a code has another width, if times do not increase or one is not finite, if an output is no motion, and
    /// if it is canceled.
    pub fn decode(
        &self,
        latents: &[Vec<f64>],
        times_s: &[f64],
        duration_s: f64,
        is_canceled: &dyn Fn() -> bool,
    ) -> Result<Vec<Motion<Object>>, SamplingError> {
        let times: Vec<f64> = times_s
            .iter()
            .map(|time_s| 1.0 - time_s / duration_s)
            .collect();
        let description = self.cgf.description();
        let joints: Arc<[String]> = description.joints.as_slice().into();
        let placed = MotionPlacement::new(&self.rest, &description.joint_ranges, duration_s);
        let mut motions = Vec::with_capacity(latents.len());
        for latents in latents.chunks(CHUNK) {
            if is_canceled() {
                return Err(SamplingError::Canceled);
            }
            for motion in (self.cgf).decode_with_rates(&self.feature, latents, &times)? {
                let (mut steps, _excess) = placed.steps(motion, &times);
                for (step, &time_s) in steps.iter_mut().zip(times_s) {
                    step.time_s = time_s;
                }
                motions.push(Motion::of_joints(Arc::clone(&joints), steps)?);
            }
        }
        Ok(motions)
    }
}

/// Takes latent codes to motions of one object.
struct Decoder<'a> {
    options: &'a SamplingOptions,
    cgf: &'a Cgf,
    joints: Arc<[String]>,
    /// The object whose shape the function sees.
    shown: &'a SampledObject<'a>,
    /// Resting poses of the object, each with the corresponding one of the shown object.
    rests: Vec<(&'a RestingPose, RestingPose)>,
    /// Shape features of the exact points in each resting pose; empty with noise on the points.
    features: Vec<ObjectFeature>,
    times: Vec<f64>,
    seed: u64,
    is_canceled: &'a (dyn Fn() -> bool + Sync),
}

impl<'a> Decoder<'a> {
    fn new(task: &'a SamplingTask<'a>, rests: &'a [RestingPose]) -> Result<Self, SamplingError> {
        let most_often = task.shown.as_ref().map(|shown| {
            let rest = shown
                .orientations
                .first()
                .map(|orientation| orientation.rest);
            rest.ok_or_else(|| SamplingError::NoRest(shown.name.to_owned()))
        });
        let most_often = most_often.transpose()?;
        let mut decoder = Self {
            options: task.options,
            cgf: task.cgf,
            joints: task.cgf.description().joints.as_slice().into(),
            shown: task.shown.as_ref().unwrap_or(&task.object),
            rests: rests
                .iter()
                .map(|rest| (rest, most_often.unwrap_or(*rest)))
                .collect(),
            features: Vec::new(),
            times: Cgf::times(task.options.steps),
            seed: task.seed,
            is_canceled: task.is_canceled,
        };
        if task.options.point_noise == 0.0 {
            let points = decoder.shown.points();
            let features = (0..rests.len()).map(|rest| decoder.feature(rest, points.clone()));
            decoder.features = features.collect::<Result<_, _>>()?;
        }
        Ok(decoder)
    }

    /// Encodes these points of the shown object, which lies in the resting pose of this number.
    fn feature(
        &self,
        rest: usize,
        points: Vec<Point3<f64>>,
    ) -> Result<ObjectFeature, SamplingError> {
        Ok(self.cgf.feature(&RestingObject {
            object: self.shown.name.to_owned(),
            rest: self.rests[rest].1,
            points_in_object: points,
        })?)
    }

    /// Decodes codes, each with the number of its motion. With noise on the points, each motion has its own cloud.
    fn decode(
        &self,
        codes: &[(usize, Code)],
    ) -> Result<Vec<(usize, SampledMotion)>, SamplingError> {
        let noise = self.options.point_noise;
        if noise > 0.0 {
            let decoded = codes.par_iter().map(|one| {
                let (number, code) = one;
                let points = noisy(self.shown, noise, self.seed, *number);
                self.decode_resting_pose(&self.feature(code.rest, points)?, code.rest, &[one])
            });
            let decoded: Vec<Vec<(usize, SampledMotion)>> = decoded.collect::<Result<_, _>>()?;
            return Ok(decoded.into_iter().flatten().collect());
        }
        let mut motions = Vec::with_capacity(codes.len());
        for (rest, feature) in self.features.iter().enumerate() {
            let codes: Vec<&(usize, Code)> =
                codes.iter().filter(|(_, code)| code.rest == rest).collect();
            for codes in codes.chunks(CHUNK) {
                motions.extend(self.decode_resting_pose(feature, rest, codes)?);
            }
        }
        Ok(motions)
    }

    /// Returns the latent codes: those of the prior as the function draws them for the object.
    fn latents(
        &self,
        feature: &ObjectFeature,
        codes: &[&(usize, Code)],
    ) -> Result<Vec<Vec<f64>>, SamplingError> {
        let is_prior = |code: &Code| code.origin == CodeOrigin::Prior;
        let noise = codes.iter().filter(|(_, code)| is_prior(code));
        let noise = noise.map(|(_, code)| code.latent.clone()).collect();
        let mut drawn = self.cgf.prior_codes(feature, noise)?.into_iter();
        let of = |(_, code): &&(usize, Code)| {
            let drawn = is_prior(code).then(|| drawn.next()).flatten();
            drawn.unwrap_or_else(|| code.latent.clone())
        };
        Ok(codes.iter().map(of).collect())
    }

    /// Decodes the codes of one resting pose.
    fn decode_resting_pose(
        &self,
        feature: &ObjectFeature,
        rest: usize,
        codes: &[&(usize, Code)],
    ) -> Result<Vec<(usize, SampledMotion)>, SamplingError> {
        if (self.is_canceled)() {
            return Err(SamplingError::Canceled);
        }
        let latents = self.latents(feature, codes)?;
        let decoded = self.cgf.decode_with_rates(feature, &latents, &self.times)?;
        let (rest, _) = self.rests[rest];
        let ranges = &self.cgf.description().joint_ranges;
        let placed = MotionPlacement::new(rest, ranges, self.options.duration_s);
        let of_code = |(((number, code), latent), motion): ((&(usize, Code), _), _)| {
            let (steps, limit_excess_rad) = placed.steps(motion, &self.times);
            let motion = SampledMotion {
                draw: Draw {
                    draw_n: code.draw_n,
                    origin: code.origin.clone(),
                    table_from_object: rest.table_from_object(),
                    limit_excess_rad,
                    depth: None,
                },
                latent,
                motion: Motion::of_joints(Arc::clone(&self.joints), steps)?,
                refused: Vec::new(),
            };
            Ok((*number, motion))
        };
        let codes = codes.iter().copied().zip(latents).zip(decoded);
        codes.map(of_code).collect()
    }
}

/// Returns the object's points as they are seen for one motion: each off by `noise` times the object's extent along
/// each axis (standard deviation).
fn noisy(object: &SampledObject<'_>, noise: f64, seed: u64, motion: usize) -> Vec<Point3<f64>> {
    let points = object.points();
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
    object_from_table: Pose<Object, Table>,
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
    fn steps(&self, motion: Vec<HandMotionState>, times: &[f64]) -> (Vec<Step<Object>>, f64) {
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
    fn rates(&self, velocity: &HandDerivative, acceleration: &HandDerivative) -> HandRates<Object> {
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
