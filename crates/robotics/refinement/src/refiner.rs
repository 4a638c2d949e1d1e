//! One motion: the grasp first, then the approach backward from it.

use motion::{Motion, Step};
use nalgebra::{Point3, UnitQuaternion, Vector3};
use posture::{
    CollisionPenalty, ContactTarget, Environment, EnvironmentTerms, Hand, Loss, PairResidual,
    Posed, Posture, PosturePrior, Residual, RootMotion, SearchOptions, SelfGapTerms, Smoothness,
    Solver, SolverError, Target, Task, Terms,
};
use spatial::{Object, Pose};

use crate::{RefinementConfig, RefinementError, balance::ForceBalance, grasp::RefinedGrasp};

/// Share of the motion, at its end, over which the fingers go from the grasp to the squeeze.
const SQUEEZE_SHARE: f64 = 0.1;

/// A refined motion.
#[derive(Debug, Clone, PartialEq)]
pub struct Refined {
    /// The hand in the object's frame, with the hand's joints, at the times of the given motion.
    pub motion: Motion<Object>,
    /// Displacement of the palm at the grasp, in meters.
    pub palm_moved_m: f64,
    /// Deepest that the hand is in the object before it closes, in meters.
    pub approach_penetration_m: f64,
    /// Weighted squared residuals of object, table, contact, balance and, if it is on, self-collision at the grasp,
    /// and of the greatest depth in the object before the hand closes, in m²; smaller is better.
    pub residual_m2: f64,
    /// Change of the joints' commands at the last step, as the root of its sum of squares over the joints, in radians
    /// (meters if prismatic).
    pub joints_moved_rad: f64,
    /// Whether a finger opposes the thumb on the object's surface, so that contact forces can balance.
    pub is_opposed: bool,
}

/// Refines motions of a hand to one object.
pub struct Refiner<'a> {
    pub(crate) hand: &'a Hand,
    pub(crate) config: &'a RefinementConfig,
    pub(crate) solver: Solver<'a>,
    pub(crate) payload: Payload,
    /// Terms of fingers and palm against each other, with memory of the posture before; `None` if they are off.
    self_gaps: Option<SelfGapTerms<'a>>,
}

/// Load of a grasp.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Payload {
    /// The object's center of mass in its own frame, in meters.
    pub center_of_mass_in_object: Point3<f64>,
    /// Its mass, in kilograms.
    pub mass_kg: f64,
}

/// A hand at one step, with its points in the object's frame.
#[derive(Clone)]
pub(crate) struct PosedHand {
    pub(crate) posture: Posture,
    pub(crate) points: Vec<Point3<f64>>,
}

/// Cost terms of a step: object and table, fingers and palm, and the balance of forces at the grasp.
pub(crate) struct StepTerms<'a> {
    pub(crate) surroundings: EnvironmentTerms<'a>,
    pub(crate) self_gaps: Option<SelfGapTerms<'a>>,
    pub(crate) balance: Option<ForceBalance<'a>>,
}

impl Terms for StepTerms<'_> {
    fn residuals(&mut self, posed: &Posed<'_>, residuals: &mut Vec<Residual>) {
        self.surroundings.residuals(posed, residuals);
        if let Some(balance) = &self.balance {
            balance.residuals(posed, residuals);
        }
    }

    fn pair_residuals(&mut self, posed: &Posed<'_>, residuals: &mut Vec<PairResidual>) {
        if let Some(self_gaps) = &mut self.self_gaps {
            self_gaps.pair_residuals(posed, residuals);
        }
    }
}

impl<'a> Refiner<'a> {
    /// Returns a refiner of a hand's motions to an object of this mass.
    pub fn new(hand: &'a Hand, config: &'a RefinementConfig, payload: Payload) -> Self {
        Self {
            hand,
            config,
            solver: Solver::new(&hand.compiled),
            payload,
            self_gaps: (config.self_collision_weight > 0.0).then(|| {
                SelfGapTerms::new(
                    hand.self_collision(),
                    config.self_collision_margin_m,
                    config.self_collision_weight,
                )
            }),
        }
    }

    /// Refines a motion of the hand in the frame of the object, as the object rests on its table.
    ///
    /// # Errors
    ///
    /// Fails if the motion is of another hand, or the refined steps do not form one.
    pub fn refine(
        &mut self,
        environment: &Environment,
        motion: &Motion<Object>,
    ) -> Result<Refined, RefinementError> {
        let motion = motion.reordered(&self.hand.model.joint_names())?;
        let drawn = motion.steps().iter().map(|step| {
            let posture = Posture::new(&step.frame_from_palm, step.q_rad.clone());
            self.place(posture)
        });
        let drawn: Vec<PosedHand> = drawn.collect::<Result<_, _>>()?;
        let [first_s, end_s] = [motion.first().time_s, motion.grasp().time_s];
        let remaining =
            |step: &Step<Object>| (end_s - step.time_s) / (end_s - first_s).max(f64::MIN_POSITIVE);
        let open_at =
            |step: &Step<Object>| posture::openness(remaining(step), self.config.closing_share);
        let openness: Vec<f64> = motion.steps().iter().map(open_at).collect();
        let clearances_m: Vec<f64> = openness
            .iter()
            .map(|open| self.config.clearance_m * open)
            .collect();
        let RefinedGrasp {
            placed,
            squeeze_rad,
            mut residual_m2,
            is_opposed,
        } = self.grasp(environment, &drawn, &clearances_m)?;
        let mut refined = vec![placed];
        for idx in (0..drawn.len() - 1).rev() {
            let Some(after) = refined.last() else { break };
            let moved = displaced(self.hand, &drawn[idx], &drawn[idx + 1], after);
            let mut terms = self.terms(environment, clearances_m[idx], 1.0, Vec::new());
            let start = moved.posture.clone();
            let most = self.config.max_iterations;
            let step = self.search(&drawn[idx], Some(&moved), start, most, &mut terms)?;
            refined.push(step.0);
        }
        refined.reverse();
        let mut approach_penetration_m = 0.0_f64;
        let mut steps = Vec::with_capacity(refined.len());
        for ((step, refined), open) in motion.steps().iter().zip(&refined).zip(&openness) {
            let (root, q) = (refined.posture.root, &refined.posture.q);
            let q = with_squeeze(self.hand, q, &squeeze_rad, remaining(step));
            let posture = self.clear_of_itself(environment, Posture { root, q })?;
            if *open >= 1.0 {
                let mut terms = self.terms(environment, 0.0, 1.0, Vec::new());
                self.solver
                    .place(&task(&[], None, None), &posture, &mut terms)?;
                let depth_m = terms.surroundings.object_depth_m(&self.solver.posed());
                approach_penetration_m = approach_penetration_m.max(depth_m);
            }
            steps.push(Step {
                time_s: step.time_s,
                frame_from_palm: root.pose(),
                q_rad: posture.q,
                rates: (),
            });
        }
        residual_m2 += (self.config.object_weight * approach_penetration_m).powi(2);
        let last = drawn.len() - 1;
        let [from, to] = [&drawn, &refined].map(|steps| steps[last].posture.root.translation());
        let given = motion;
        let motion = Motion::of_joints(given.joints().clone(), steps)?;
        let joints = given.grasp().q_rad.iter().zip(&motion.grasp().q_rad);
        let squares = joints.map(|(given, refined)| (refined - given).powi(2));
        Ok(Refined {
            joints_moved_rad: squares.sum::<f64>().sqrt(),
            is_opposed,
            motion: motion.differentiated()?,
            palm_moved_m: (to - from).norm(),
            approach_penetration_m,
            residual_m2,
        })
    }

    /// Searches a step near where it was drawn, from a posture; `moved` is where the displacement of the step
    /// after would take it. Returns the cost too.
    pub(crate) fn search(
        &mut self,
        drawn: &PosedHand,
        moved: Option<&PosedHand>,
        start: Posture,
        max_iterations: usize,
        terms: &mut StepTerms<'_>,
    ) -> Result<(PosedHand, f64), RefinementError> {
        let config = self.config;
        let contacts = &terms.surroundings.contacts;
        let targets: Vec<Target> = (self.hand.points.iter().zip(&drawn.points))
            .enumerate()
            .map(|(point, (of_hand, at))| {
                let touching = contacts.iter().find(|contact| contact.point == point);
                let share = touching.map_or(0.0, |contact| contact.weight / config.contact_weight);
                let factor = 1.0 - share * (1.0 - config.contact_position_factor);
                Target {
                    point,
                    point_in_object: *at,
                    weight: (config.position_weight * of_hand.weight * factor).powi(2),
                }
            })
            .collect();
        let smoothness = moved.map(|moved| Smoothness {
            points: &moved.points,
            point_weight: config.smoothness_weight.powi(2),
            posture: &moved.posture,
            joint_weight: config.joint_smoothness_weight.powi(2),
            root_weight: 0.0,
        });
        let prior = PosturePrior {
            q: &drawn.posture.q,
            weight: config.joint_weight.powi(2),
        };
        let task = task(&targets, smoothness, Some(prior));
        let options = SearchOptions::new(max_iterations, RootMotion::Free);
        let mut posture = start;
        let outcome = self.solver.minimize(&task, &mut posture, &options, terms)?;
        if let (Some(own), Some(used)) = (&mut self.self_gaps, &terms.self_gaps) {
            own.remember(used);
        }
        Ok((self.place(posture)?, outcome.cost))
    }

    /// Returns a posture whose fingers were moved as little as possible to their margins from each other and from the
    /// palm, above the table; as it is where they keep them, or if the term is off.
    fn clear_of_itself(
        &mut self,
        environment: &Environment,
        mut posture: Posture,
    ) -> Result<Posture, SolverError> {
        let Some(self_gaps) = &mut self.self_gaps else {
            return Ok(posture);
        };
        let nothing = task(&[], None, None);
        if self.solver.place(&nothing, &posture, self_gaps)? <= 0.0 {
            return Ok(posture);
        }
        let commanded = posture.q.clone();
        let prior = PosturePrior {
            q: &commanded,
            weight: self.config.joint_weight.powi(2),
        };
        let mut terms = self.terms(environment, 0.0, 0.0, Vec::new());
        let task = task(&[], None, Some(prior));
        let options = SearchOptions::new(self.config.max_iterations, RootMotion::Fixed);
        self.solver
            .minimize(&task, &mut posture, &options, &mut terms)?;
        Ok(posture)
    }

    /// Places the hand.
    pub(crate) fn place(&mut self, posture: Posture) -> Result<PosedHand, SolverError> {
        let nothing = task(&[], None, None);
        self.solver
            .place(&nothing, &posture, &mut posture::NoTerms)?;
        let posed = self.solver.posed();
        let points = (0..self.hand.points.len()).filter_map(|point| posed.point(point));
        Ok(PosedHand {
            points: points.collect(),
            posture,
        })
    }

    pub(crate) fn terms<'t>(
        &self,
        environment: &'t Environment,
        clearance_m: f64,
        object_weight_factor: f64,
        contacts: Vec<ContactTarget>,
    ) -> StepTerms<'t>
    where
        'a: 't,
    {
        StepTerms {
            surroundings: EnvironmentTerms {
                hand: self.hand,
                environment,
                collision_penalty: CollisionPenalty {
                    object_weight: object_weight_factor * self.config.object_weight,
                    clearance_m,
                    table_weight: self.config.table_weight,
                    table_margin_m: self.config.table_margin_m,
                },
                contacts,
            },
            self_gaps: self.self_gaps.clone(),
            balance: None,
        }
    }
}

pub(crate) fn task<'t>(
    targets: &'t [Target],
    smoothness: Option<Smoothness<'t>>,
    prior: Option<PosturePrior<'t>>,
) -> Task<'t> {
    Task {
        targets,
        loss: Loss::Squared,
        vectors: None,
        smoothness,
        prior,
    }
}

/// Returns a drawn step moved as its neighbor was: by as much along the axes, about the palm's origin, and in each
/// joint as far as its limits let it.
pub(crate) fn displaced(
    hand: &Hand,
    drawn: &PosedHand,
    neighbor: &PosedHand,
    refined: &PosedHand,
) -> PosedHand {
    let [here, drawn_there, there] =
        [drawn, neighbor, refined].map(|placed| placed.posture.root.pose());
    let turn: UnitQuaternion<f64> = there.rotation * drawn_there.rotation.inverse();
    let along: Vector3<f64> = there.translation.vector - drawn_there.translation.vector;
    let pose = Pose::from_parts(here.translation.vector + along, turn * here.rotation);
    let joints = hand.model.joints().iter();
    let of_joints = drawn.posture.q.iter().zip(&neighbor.posture.q);
    let q = of_joints.zip(&refined.posture.q).zip(joints);
    let q = q.map(|(((q, drawn), refined), joint)| joint.clamp(q + refined - drawn));
    let points = drawn.points.iter().zip(&neighbor.points);
    let points = points
        .zip(&refined.points)
        .map(|((point, drawn), refined)| point + (refined - drawn));
    PosedHand {
        posture: Posture::new(&pose, q.collect()),
        points: points.collect(),
    }
}

/// Returns joint positions with the squeeze, within the joints' limits; it begins where `SQUEEZE_SHARE` of the motion
/// remains.
fn with_squeeze(hand: &Hand, q_rad: &[f64], squeeze_rad: &[f64], remaining: f64) -> Vec<f64> {
    let share = 1.0 - posture::openness(remaining, SQUEEZE_SHARE);
    let joints = hand.model.joints().iter();
    let q = q_rad.iter().zip(squeeze_rad).zip(joints);
    q.map(|((q, squeeze), joint)| joint.clamp(q + share * squeeze))
        .collect()
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;

    use spatial::Palm;

    use super::*;
    use crate::fixture::{self, reach};

    fn refine(hand: &Hand, config: &RefinementConfig, motion: &Motion<Object>) -> Refined {
        let mut refiner = Refiner::new(hand, config, fixture::payload());
        refiner.refine(&fixture::environment(), motion).unwrap()
    }

    /// Greatest depth of the hand in the object and in the table, in meters.
    fn depths_m(hand: &Hand, motion: &Motion<Object>) -> [f64; 2] {
        let (config, environment) = (RefinementConfig::default(), fixture::environment());
        let mut refiner = Refiner::new(hand, &config, fixture::payload());
        let steps = motion.steps();
        let mut deepest = [0.0_f64; 2];
        for step in steps {
            let mut terms = refiner.terms(&environment, 0.0, 1.0, Vec::new());
            let posture = Posture::new(&step.frame_from_palm, step.q_rad.clone());
            let solver = &mut refiner.solver;
            solver
                .place(&task(&[], None, None), &posture, &mut terms)
                .unwrap();
            let posed = solver.posed();
            let found = [
                terms.surroundings.object_depth_m(&posed),
                terms.surroundings.table_depth_m(&posed),
            ];
            deepest = [0, 1].map(|idx: usize| deepest[idx].max(found[idx]));
        }
        deepest
    }

    #[test]
    fn a_motion_through_the_object_goes_around_it_within_the_limits() {
        let hand = fixture::hand();
        let drawn = reach(&hand, 0.12, 0.5);
        let refined = refine(&hand, &RefinementConfig::default(), &drawn).motion;
        let [before, after] = [&drawn, &refined].map(|motion| depths_m(&hand, motion)[0]);
        assert!(before > 0.02 && after < 0.004, "{before} m, then {after} m");
        for step in refined.steps() {
            for (q, joint) in step.q_rad.iter().zip(hand.model.joints()) {
                assert!(
                    (joint.lower..=joint.upper).contains(q),
                    "{q} outside {joint:?}"
                );
            }
        }
        let times = |motion: &Motion<Object>| -> Vec<f64> {
            motion.steps().iter().map(|step| step.time_s).collect()
        };
        assert_eq!(times(&refined), times(&drawn));
    }

    #[test]
    fn a_motion_below_the_table_rises_above_it() {
        let hand = fixture::hand();
        let down = Pose::new(nalgebra::Isometry3::translation(0.0, 0.0, -0.06));
        let drawn = reach(&hand, -0.1, 0.3).moved(&down);
        let refined = refine(&hand, &RefinementConfig::default(), &drawn).motion;
        let [before, after] = [&drawn, &refined].map(|motion| depths_m(&hand, motion)[1]);
        assert!(before > 0.02 && after < 0.001, "{before} m, then {after} m");
    }

    /// A motion whose fingers cross leaves at most 2 mm of them in each other with the term, at every step, and as much
    /// as it was drawn with without.
    #[test]
    fn fingers_that_cross_are_parted_at_every_step() {
        let hand = fixture::hand();
        let above = Pose::new(nalgebra::Isometry3::translation(0.0, 0.0, 0.3));
        let away = reach(&hand, -0.1, 0.3).moved(&above);
        let joint = |name: &str| hand.model.joint(name).unwrap();
        let ends = [
            ("joint_0.0", -0.45),
            ("joint_4.0", 0.45),
            ("joint_1.0", 1.0),
            ("joint_5.0", 1.0),
        ];
        let steps = away.steps().iter().map(|step| {
            let mut q_rad = step.q_rad.clone();
            for (name, end) in ends {
                let q = &mut q_rad[joint(name)];
                *q += step.time_s * (end - *q);
            }
            Step {
                time_s: step.time_s,
                frame_from_palm: step.frame_from_palm,
                q_rad,
                rates: (),
            }
        });
        let drawn = Motion::of_joints(Arc::clone(away.joints()), steps.collect()).unwrap();
        let drawn = drawn.differentiated().unwrap();
        let deepest_m = |motion: &Motion<Object>| {
            let mut gaps = robot::SelfGaps::default();
            let depths = motion.steps().iter().map(|step| {
                let poses = hand.model.forward_kinematics::<Palm>(&step.q_rad).unwrap();
                hand.self_collision().gaps(&poses, 0.0, &mut gaps);
                gaps.depth_m()
            });
            depths.fold(0.0, f64::max)
        };
        let apart = RefinementConfig {
            self_collision_weight: 3.0,
            ..RefinementConfig::default()
        };
        let without = refine(&hand, &RefinementConfig::default(), &drawn).motion;
        let with = refine(&hand, &apart, &drawn).motion;
        let [drawn, without, with] = [&drawn, &without, &with].map(deepest_m);
        assert!(drawn > 0.005 && without > 0.005, "{drawn} m, {without} m");
        assert!(with < 0.002, "{drawn} m, then {with} m");
    }

    #[test]
    fn the_squeeze_stays_within_the_joints_limits() {
        let hand = fixture::hand();
        let upper: Vec<f64> = (hand.model.joints().iter())
            .map(|joint| joint.upper)
            .collect();
        let squeeze_rad = vec![0.2; upper.len()];
        for remaining in [0.0, 0.05] {
            assert_eq!(with_squeeze(&hand, &upper, &squeeze_rad, remaining), upper);
        }
        let below: Vec<f64> = upper.iter().map(|q| q - 0.3).collect();
        let squeezed = with_squeeze(&hand, &below, &squeeze_rad, 0.0);
        assert!((squeezed[0] - below[0] - 0.2).abs() < 1e-12);
        assert_eq!(
            with_squeeze(&hand, &below, &squeeze_rad, SQUEEZE_SHARE),
            below
        );
    }

    #[test]
    fn a_grasp_is_opposed_where_thumb_and_finger_touch_and_its_change_is_that_of_the_joints() {
        let hand = fixture::hand();
        let config = RefinementConfig::default();
        let above = Pose::new(nalgebra::Isometry3::translation(0.0, 0.0, 0.3));
        for (drawn, is_opposed) in [
            (reach(&hand, 0.0, 0.55), true),
            (reach(&hand, -0.1, 0.3).moved(&above), false),
        ] {
            let refined = refine(&hand, &config, &drawn);
            assert_eq!(refined.is_opposed, is_opposed);
            let [from, to] = [&drawn, &refined.motion]
                .map(|motion| nalgebra::DVector::from_column_slice(&motion.grasp().q_rad));
            assert!((refined.joints_moved_rad - (to - from).norm()).abs() < 1e-12);
        }
    }

    #[test]
    fn a_motion_far_from_things_stays_as_it_is() {
        let hand = fixture::hand();
        let above = Pose::new(nalgebra::Isometry3::translation(0.0, 0.0, 0.3));
        let drawn = reach(&hand, -0.1, 0.3).moved(&above);
        let refined = refine(&hand, &RefinementConfig::default(), &drawn).motion;
        for (drawn, refined) in drawn.steps().iter().zip(refined.steps()) {
            let off = drawn.frame_from_palm.inv_mul(&refined.frame_from_palm);
            assert!(off.translation.vector.norm() < 1e-4, "{}", off.translation);
            let turned_rad = off.rotation.angle();
            assert!(turned_rad < 1e-3, "{turned_rad}");
            for (drawn, refined) in drawn.q_rad.iter().zip(&refined.q_rad) {
                assert!((drawn - refined).abs() < 1e-3, "{drawn} {refined}");
            }
        }
    }

    #[test]
    fn fingertips_near_the_surface_end_on_it() {
        let hand = fixture::hand();
        let drawn = reach(&hand, 0.0, 0.55);
        let gaps_m = |motion: &Motion<Object>| -> Vec<f64> {
            let (config, environment) = (RefinementConfig::default(), fixture::environment());
            let mut refiner = Refiner::new(&hand, &config, fixture::payload());
            let [drawn, grasp] = [drawn.grasp(), motion.grasp()].map(|step| {
                let posture = Posture::new(&step.frame_from_palm, step.q_rad.clone());
                refiner.place(posture).unwrap()
            });
            let contacts = refiner.contacts(&environment, &drawn);
            let gap = |contact: &ContactTarget| {
                let at = &grasp.points[contact.point];
                (environment.signed_distance(at).distance_m - contact.distance_m).abs()
            };
            contacts.iter().map(gap).collect()
        };
        let config = RefinementConfig {
            squeeze_m: 0.0,
            ..RefinementConfig::default()
        };
        let [before, after] = [
            gaps_m(&drawn),
            gaps_m(&refine(&hand, &config, &drawn).motion),
        ];
        let mean = |gaps: &[f64]| gaps.iter().sum::<f64>() / gaps.len() as f64;
        assert!(before.len() > 1, "{before:?}");
        assert!(
            mean(&before) > 0.004 && mean(&after) < 0.002,
            "{before:?}, then {after:?}"
        );
        let without = RefinementConfig {
            contact_weight: 0.0,
            ..config
        };
        let without = gaps_m(&refine(&hand, &without, &drawn).motion);
        assert!(mean(&without) > 0.003, "{without:?}");
    }

    /// The balance's gradient by the joints is that of its cost, tips and weights together.
    #[test]
    fn gradient_of_the_balance_is_that_of_its_cost() {
        let hand = fixture::hand();
        let config = RefinementConfig {
            balance_weight: 1.0,
            balance_friction: 0.0,
            ..RefinementConfig::default()
        };
        let environment = fixture::environment();
        let drawn = refine(&hand, &config, &reach(&hand, 0.0, 0.55)).motion;
        let mut refiner = Refiner::new(&hand, &config, fixture::payload());
        let grasp = drawn.grasp();
        let grasp = Posture::new(&grasp.frame_from_palm, grasp.q_rad.clone());
        let grasp = refiner.place(grasp).unwrap();
        let contacts = refiner.contacts(&environment, &grasp);
        let mut terms = refiner.terms(&environment, 0.0, 0.0, Vec::new());
        terms.surroundings.collision_penalty.table_weight = 0.0;
        terms.balance = refiner.balance(&environment, &contacts, &grasp);
        assert!(terms.balance.is_some());
        let none = task(&[], None, None);
        let mut gradient = vec![0.0; hand.compiled.unknowns()];
        let posture = grasp.posture.clone();
        let solver = &mut refiner.solver;
        let cost = solver
            .gradient(&none, &posture, &mut terms, &mut gradient)
            .unwrap();
        assert!(cost > 0.01, "{cost}");
        let n_root = gradient.len() - posture.q.len();
        let size = gradient[n_root..]
            .iter()
            .map(|slope| slope * slope)
            .sum::<f64>()
            .sqrt();
        for joint in 0..posture.q.len() {
            const H_RAD: f64 = 1e-5;
            let mut cost = |by_rad: f64| {
                let mut moved = posture.clone();
                moved.q[joint] += by_rad;
                solver.place(&none, &moved, &mut terms).unwrap()
            };
            let expected = (cost(H_RAD) - cost(-H_RAD)) / (2.0 * H_RAD);
            let found = gradient[n_root + joint];
            assert!(
                (found - expected).abs() < 0.03 * size + 1e-3,
                "{joint}: {found} {expected}, of {size}"
            );
        }
    }

    /// A refined motion does not depend on those refined before it, so threads may share them in any way.
    #[test]
    fn motions_are_refined_alike_after_others() {
        let hand = fixture::hand();
        let config = RefinementConfig::default();
        let environment = fixture::environment();
        let motions = [reach(&hand, 0.1, 0.5), reach(&hand, 0.0, 0.4)];
        let mut refiner = Refiner::new(&hand, &config, fixture::payload());
        for motion in motions.iter().chain(&motions) {
            let found = refiner.refine(&environment, motion).unwrap().motion;
            assert_eq!(found, refine(&hand, &config, motion).motion);
        }
    }
}
