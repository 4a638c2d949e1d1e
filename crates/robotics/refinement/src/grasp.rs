//! The grasp: where the fingers end, and how they squeeze from there.

use nalgebra::{Point3, UnitQuaternion, Vector3};
use posture::{
    ContactTarget, Environment, HandPoint, Posture, PosturePrior, RootMotion, SearchOptions, Target,
};
use spatial::Pose;

use crate::{
    RefinementError,
    balance::{Fingertip, ForceBalance},
    refiner::{PosedHand, Refiner, StepTerms, displaced, task},
};

/// Share of the contact weight above which a tip's force counts.
const MIN_CONTACT_SHARE: f64 = 0.5;
/// Iterations at the grasp relative to other steps.
const GRASP_ITERATIONS: usize = 3;
/// Steps before the grasp from which the motion is followed forward, as another way to the grasp.
const APPROACH_STEPS: usize = 16;
/// Factor on the object's weight on the way from a drawn grasp to one that keeps out of the object: at once,
/// it would be pushed out on whichever side is nearest.
const SOFT_FACTOR: f64 = 0.1;
/// Residual above which a grasp is rotated and searched again, in m²: with the default weights, a residual wrench of
/// 0.07 times the thumb's force, or a tip 2.4 mm off.
const RESTART_RESIDUAL_M2: f64 = 5e-5;
/// Divisor of a step's iterations: after so many a rotated grasp is given up, unless its cost is below
/// `PROMISING_COST` times the best one's.
const TRIAL_DIVISOR: usize = 2;
/// Cost relative to the best grasp's below which a rotated one is searched to its end.
const PROMISING_COST: f64 = 1.5;
/// Standard gravity, in m/s².
const GRAVITY_M_PER_S2: f64 = 9.806_65;
/// Landmark of the thumb's tip.
const THUMB_TIP: usize = 4;

/// A refined grasp.
pub(crate) struct RefinedGrasp {
    /// The hand with its tips on the surface.
    pub(crate) placed: PosedHand,
    /// Offset of each joint's command beyond the grasp, in radians.
    pub(crate) squeeze_rad: Vec<f64>,
    /// Weighted squared residuals of object, table, contact and balance, in m².
    pub(crate) residual_m2: f64,
    /// Whether the balance is defined.
    pub(crate) is_opposed: bool,
}

impl Refiner<'_> {
    /// Refines the last step: from the drawn grasp, and along the approach, where the fingers come from outside
    /// and so end on the right side of thin things; where its residual stays large, also from the better of them,
    /// rotated about its fingertips.
    pub(crate) fn grasp(
        &mut self,
        environment: &Environment,
        drawn: &[PosedHand],
        clearances_m: &[f64],
    ) -> Result<RefinedGrasp, RefinementError> {
        let grasp = &drawn[drawn.len() - 1];
        let contacts = self.contacts(environment, grasp);
        let starts = self.starts(environment, drawn, clearances_m, &contacts)?;
        let mut terms = self.terms(environment, 0.0, 1.0, contacts.clone());
        terms.balance = self.balance(environment, &contacts, grasp);
        let mut best = (grasp.clone(), f64::INFINITY);
        let most = GRASP_ITERATIONS * self.config.max_iterations;
        for start in starts {
            let found = self.search(grasp, None, start, most, &mut terms)?;
            keep_cheaper(&mut best, found);
        }
        let found = best.0.clone();
        for start in restarts(&found, &contacts, self.config.restart_angle_rad) {
            if self.residual_m2(&best.0, &mut terms)?.0 < RESTART_RESIDUAL_M2 {
                break;
            }
            self.try_restart(&mut best, grasp, start, &mut terms)?;
        }
        let (placed, _) = best;
        let (residual_m2, is_opposed) = self.residual_m2(&placed, &mut terms)?;
        let squeezed = self.squeezed(environment, &placed, &terms)?;
        let joints = squeezed.q.iter().zip(&placed.posture.q);
        Ok(RefinedGrasp {
            squeeze_rad: joints.map(|(squeezed, q)| squeezed - q).collect(),
            placed,
            residual_m2,
            is_opposed,
        })
    }

    /// Searches the grasp from a rotated start, to its end only where that is promising; replaces `best` and its cost
    /// by what costs less.
    fn try_restart(
        &mut self,
        best: &mut (PosedHand, f64),
        drawn: &PosedHand,
        start: Posture,
        terms: &mut StepTerms<'_>,
    ) -> Result<(), RefinementError> {
        let most = self.config.max_iterations;
        let trial = most.div_ceil(TRIAL_DIVISOR);
        let mut found = self.search(drawn, None, start, trial, terms)?;
        if found.1 < PROMISING_COST * best.1 {
            let (start, rest) = (found.0.posture, GRASP_ITERATIONS * most - trial);
            found = self.search(drawn, None, start, rest, terms)?;
        }
        keep_cheaper(best, found);
        Ok(())
    }

    /// Returns the weighted squared residuals of a grasp, in m², and whether its balance is defined.
    fn residual_m2(
        &mut self,
        placed: &PosedHand,
        terms: &mut StepTerms<'_>,
    ) -> Result<(f64, bool), RefinementError> {
        let none = task(&[], None, None);
        let residual_m2 = self.solver.place(&none, &placed.posture, terms)?;
        let posed = self.solver.posed();
        let balance = terms.balance.as_ref();
        if balance.is_some_and(|balance| balance.is_defined(&posed)) {
            return Ok((residual_m2, true));
        }
        // No finger opposes the thumb, or a tip is where the object has no surface: what is left is the thumb's
        // force, the object's weight, and a torque of that force at the characteristic length.
        let unbalanced = (1.0 + self.relative_load()).powi(2) + 1.0;
        let unbalanced = self.config.balance_weight.powi(2) * unbalanced;
        Ok((residual_m2 + unbalanced, false))
    }

    /// Returns where to search the grasp from. Fingers may be in each other there: the searches from there part them.
    fn starts(
        &mut self,
        environment: &Environment,
        drawn: &[PosedHand],
        clearances_m: &[f64],
        contacts: &[ContactTarget],
    ) -> Result<Vec<Posture>, RefinementError> {
        let most = self.config.max_iterations;
        let last = drawn.len() - 1;
        let grasp = &drawn[last];
        let mut soft = self.terms(environment, 0.0, SOFT_FACTOR, contacts.to_vec());
        soft.self_gaps = None;
        let start = grasp.posture.clone();
        let (start, _) = self.search(grasp, None, start, GRASP_ITERATIONS * most, &mut soft)?;
        let mut starts = vec![start.posture];
        let from = drawn.len().saturating_sub(APPROACH_STEPS);
        if from < last {
            let mut here = drawn[from].clone();
            for idx in from..last {
                let start = if idx == from {
                    here.posture.clone()
                } else {
                    displaced(self.hand, &drawn[idx], &drawn[idx - 1], &here).posture
                };
                let mut terms = self.terms(environment, clearances_m[idx], 1.0, Vec::new());
                terms.self_gaps = None;
                here = self.search(&drawn[idx], None, start, most, &mut terms)?.0;
            }
            starts.push(displaced(self.hand, grasp, &drawn[last - 1], &here).posture);
        }
        Ok(starts)
    }

    /// Returns the hand with its palm where it is and its tips beyond their contacts: each along its planned force,
    /// `squeeze_m` for a force of the thumb's, or along the surface's normal if none is planned. The drives' stiffness
    /// turns that into forces, up to their torque limits.
    fn squeezed(
        &mut self,
        environment: &Environment,
        grasp: &PosedHand,
        terms: &StepTerms<'_>,
    ) -> Result<Posture, RefinementError> {
        let squeeze_m = self.config.squeeze_m;
        let contacts = &terms.surroundings.contacts;
        if squeeze_m <= 0.0 || contacts.is_empty() {
            return Ok(grasp.posture.clone());
        }
        let nothing = task(&[], None, None);
        self.solver
            .place(&nothing, &grasp.posture, &mut posture::NoTerms)?;
        let posed = self.solver.posed();
        let balance = terms.balance.as_ref();
        let planned = balance.and_then(|balance| balance.forces(&posed));
        let planned = planned.unwrap_or_default();
        let targets = contacts.iter().map(|contact| {
            let at = grasp.points[contact.point];
            let force = planned.iter().find(|(point, _)| *point == contact.point);
            let normal = || -environment.signed_distance(&at).gradient_in_object;
            Target {
                point: contact.point,
                point_in_object: at + force.map_or_else(normal, |(_, force)| *force) * squeeze_m,
                weight: 1.0,
            }
        });
        let targets: Vec<Target> = targets.collect();
        let prior = PosturePrior {
            q: &grasp.posture.q,
            weight: self.config.joint_weight.powi(2),
        };
        let options = SearchOptions::new(self.config.max_iterations, RootMotion::Fixed);
        // The object yields, the table does not.
        let mut terms = self.terms(environment, 0.0, 0.0, Vec::new());
        let mut posture = grasp.posture.clone();
        let task = task(&targets, None, Some(prior));
        self.solver
            .minimize(&task, &mut posture, &options, &mut terms)?;
        Ok(posture)
    }

    /// Returns the object's weight relative to the thumb's force.
    fn relative_load(&self) -> f64 {
        self.payload.mass_kg * GRAVITY_M_PER_S2 / self.config.thumb_force_n
    }

    /// Returns which tips of a drawn grasp should touch.
    pub(crate) fn contacts(
        &self,
        environment: &Environment,
        grasp: &PosedHand,
    ) -> Vec<ContactTarget> {
        let config = self.config;
        let contact = |(point, (of_hand, at)): (usize, (&HandPoint, &Point3<f64>))| {
            let radius_m = of_hand.tip_radius_m?;
            let off_m = environment.signed_distance(at).distance_m - radius_m;
            let share = posture::contact_share(off_m, config.contact_distance_m);
            (share > 0.0 && config.contact_weight > 0.0).then_some(ContactTarget {
                point,
                distance_m: radius_m,
                weight: share * config.contact_weight,
            })
        };
        let points = self.hand.points.iter().zip(&grasp.points);
        points.enumerate().filter_map(contact).collect()
    }

    /// Returns the term of forces of the tips that should touch, if the thumb and a finger do.
    pub(crate) fn balance<'t>(
        &self,
        environment: &'t Environment,
        contacts: &[ContactTarget],
        grasp: &PosedHand,
    ) -> Option<ForceBalance<'t>> {
        if self.config.balance_weight <= 0.0 {
            return None;
        }
        let near = |contact: &&ContactTarget| {
            contact.weight >= MIN_CONTACT_SHARE * self.config.contact_weight
        };
        let tips = contacts.iter().filter(near).map(|contact| {
            let of_hand = &self.hand.points[contact.point];
            Fingertip {
                point: contact.point,
                radius_m: of_hand.tip_radius_m.unwrap_or(0.0),
                is_thumb: of_hand.keypoint == THUMB_TIP,
                drawn_in_object: grasp.points[contact.point],
            }
        });
        ForceBalance::new(
            environment,
            self.payload.center_of_mass_in_object,
            self.relative_load(),
            tips.collect(),
            self.config.balance_friction,
            self.config.balance_weight,
        )
    }
}

/// Replaces the best grasp and its cost by what costs less.
fn keep_cheaper(best: &mut (PosedHand, f64), found: (PosedHand, f64)) {
    if found.1 < best.1 {
        *best = found;
    }
}

/// Returns a grasp rotated by an angle, and then by twice that, both ways about each axis of the palm, the mean of its
/// touching tips staying where it is.
fn restarts(grasp: &PosedHand, contacts: &[ContactTarget], angle_rad: f64) -> Vec<Posture> {
    if angle_rad <= 0.0 || contacts.is_empty() {
        return Vec::new();
    }
    let tips = contacts
        .iter()
        .map(|contact| grasp.points[contact.point].coords);
    let center = tips.sum::<Vector3<f64>>() / contacts.len() as f64;
    let pose = grasp.posture.root.pose();
    let axes = [Vector3::x_axis(), Vector3::y_axis(), Vector3::z_axis()];
    let rotations = [1.0, 2.0].into_iter().flat_map(|times| {
        let axes = axes.into_iter();
        axes.flat_map(move |axis| [(axis, times * angle_rad), (axis, -times * angle_rad)])
    });
    let posture = |(axis, angle_rad)| {
        let rotation = UnitQuaternion::from_axis_angle(&(pose.rotation * axis), angle_rad);
        let along = rotation * (pose.translation.vector - center) + center;
        let pose = Pose::from_parts(along, rotation * pose.rotation);
        Posture::new(&pose, grasp.posture.q.clone())
    };
    rotations.map(posture).collect()
}

#[cfg(test)]
mod tests {
    use motion::Motion;
    use posture::Hand;
    use spatial::Object;

    use super::*;
    use crate::{
        RefinementConfig,
        fixture::{self, reach},
        refiner::Refined,
    };

    fn refine(hand: &Hand, config: &RefinementConfig, motion: &Motion<Object>) -> Refined {
        let mut refiner = Refiner::new(hand, config, fixture::payload());
        refiner.refine(&fixture::environment(), motion).unwrap()
    }

    /// Distance of each touching fingertip's surface from the object at the last step, in meters.
    fn gaps_m(hand: &Hand, drawn: &Motion<Object>, moved: &Motion<Object>) -> Vec<f64> {
        let (config, environment) = (RefinementConfig::default(), fixture::environment());
        let mut refiner = Refiner::new(hand, &config, fixture::payload());
        let [drawn, grasp] = [drawn.grasp(), moved.grasp()].map(|step| {
            let posture = Posture::new(&step.frame_from_palm, step.q_rad.clone());
            refiner.place(posture).unwrap()
        });
        let contacts = refiner.contacts(&environment, &drawn);
        let gap = |contact: &ContactTarget| {
            let at = &grasp.points[contact.point];
            environment.signed_distance(at).distance_m - contact.distance_m
        };
        contacts.iter().map(gap).collect()
    }

    #[test]
    fn squeeze_commands_the_touching_fingertips_into_the_object_and_moves_nothing_else() {
        let hand = fixture::hand();
        let drawn = reach(&hand, 0.0, 0.55);
        let still = RefinementConfig {
            squeeze_m: 0.0,
            ..RefinementConfig::default()
        };
        let touching = refine(&hand, &still, &drawn).motion;
        let squeezing = refine(&hand, &RefinementConfig::default(), &drawn).motion;
        let [before, after] = [&touching, &squeezing].map(|motion| gaps_m(&hand, &drawn, motion));
        let pressed = before.iter().zip(&after).filter(|(before, after)| {
            assert!(before.abs() < 0.001 && after <= before, "{before} {after}");
            **after < *before - 0.004
        });
        // The thumb and what opposes it; a finger whose force is not needed stays on the surface.
        assert!(pressed.count() >= 2, "{before:?} {after:?}");
        let changes = touching.steps().iter().zip(squeezing.steps());
        for (idx, (touching, squeezing)) in changes.enumerate() {
            assert_eq!(touching.frame_from_palm, squeezing.frame_from_palm);
            // The squeeze is the last tenth of twenty steps.
            assert_eq!(idx < 19, touching.q_rad == squeezing.q_rad, "step {idx}");
            for (q, joint) in squeezing.q_rad.iter().zip(hand.model.joints()) {
                assert!((joint.lower..=joint.upper).contains(q), "{q} {joint:?}");
            }
        }
    }

    #[test]
    fn a_weaker_thumb_leaves_a_larger_residual_for_the_same_object() {
        let hand = fixture::hand();
        let drawn = reach(&hand, 0.0, 0.55);
        let residual_m2 = |thumb_force_n: f64| {
            let config = RefinementConfig {
                thumb_force_n,
                ..RefinementConfig::default()
            };
            refine(&hand, &config, &drawn).residual_m2
        };
        let [strong, weak] = [residual_m2(7.0), residual_m2(0.35)];
        assert!(weak > 3.0 * strong, "{strong} {weak}");
    }

    #[test]
    fn restarts_rotate_the_grasp_about_the_mean_of_its_touching_fingertips() {
        let hand = fixture::hand();
        let (config, environment) = (RefinementConfig::default(), fixture::environment());
        let mut refiner = Refiner::new(&hand, &config, fixture::payload());
        let drawn = reach(&hand, 0.0, 0.55);
        let grasp = drawn.grasp();
        let posture = Posture::new(&grasp.frame_from_palm, grasp.q_rad.clone());
        let grasp = refiner.place(posture).unwrap();
        let contacts = refiner.contacts(&environment, &grasp);
        let mean = |placed: &PosedHand| {
            let tips = contacts
                .iter()
                .map(|contact| placed.points[contact.point].coords);
            tips.sum::<Vector3<f64>>() / contacts.len() as f64
        };
        let before = mean(&grasp);
        let found = restarts(&grasp, &contacts, 0.5);
        assert_eq!(found.len(), 12);
        for (idx, posture) in found.into_iter().enumerate() {
            let pose = posture.root.pose();
            let angle_rad = pose.rotation.angle_to(&grasp.posture.root.pose().rotation);
            let expected_rad = if idx < 6 { 0.5 } else { 1.0 };
            assert!((angle_rad - expected_rad).abs() < 1e-9, "{angle_rad}");
            let placed = refiner.place(posture).unwrap();
            assert!((mean(&placed) - before).norm() < 1e-9);
        }
        assert!(restarts(&grasp, &contacts, 0.0).is_empty());
        assert!(restarts(&grasp, &[], 0.5).is_empty());
    }

    #[test]
    fn restarts_reduce_the_residual_of_a_grasp_that_does_not_balance() {
        let hand = fixture::hand();
        let drawn = reach(&hand, 0.02, 0.65);
        let residual_m2 = |restart_angle_rad: f64| {
            let config = RefinementConfig {
                restart_angle_rad,
                ..RefinementConfig::default()
            };
            refine(&hand, &config, &drawn).residual_m2
        };
        let [without, with] = [residual_m2(0.0), residual_m2(0.5)];
        assert!(without > RESTART_RESIDUAL_M2, "{without}");
        assert!(with < 0.1 * without, "{without} {with}");
    }
}
