//! One motion: the grasp first, then the approach backward from it.

use motion::{Motion, Step};
use nalgebra::{Point3, UnitQuaternion, Vector3};
use posture::{
    Contact, Environment, Hand, KeepOut, Loss, Posed, Posture, PosturePrior, Residual,
    SearchOptions, Smoothness, Solver, SolverError, Surroundings, Target, Task, Terms, Wrist,
};
use spatial::{Object, Pose};

use crate::{
    RefineConfig, RefineError,
    balance::{Balance, Fingertip, OBJECT_WEIGHT},
};

/// A tip counts as touching in full up to the configured distance and not at all at this multiple of it.
const CONTACT_FADE: f64 = 1.5;
/// Iterations at the grasp relative to other steps.
const GRASP_ITERATIONS: usize = 3;
/// Steps before the grasp from which the motion is followed forward, as another way to the grasp.
const APPROACH: usize = 16;
/// Factor on the object's weight on the way from a drawn grasp to one that keeps out of the object: at once,
/// it would be pushed out on whichever side is nearest.
const SOFT: f64 = 0.1;
/// Share of the cost that a further iteration may still bring when the search ends.
const TOLERANCE: f64 = 1e-4;
/// Decrease in m² below which nothing visible is left to find: a thirtieth of a millimeter.
const LEAST_DECREASE_M2: f64 = 1e-9;
/// Share of the contact weight above which a tip's force counts.
const MIN_CONTACT_SHARE: f64 = 0.5;
/// Squared residual wrench without an opposing finger: the thumb's force, the object's weight, and a torque of that
/// force at the characteristic length.
const UNBALANCED: f64 = (1.0 + OBJECT_WEIGHT) * (1.0 + OBJECT_WEIGHT) + 1.0;
/// Landmark of the thumb's tip.
const THUMB_TIP: usize = 4;

/// A refined motion.
pub(crate) struct Refined {
    /// The hand in the object's frame, with the hand's joints.
    pub(crate) motion: Motion<Object>,
    /// How far the palm was moved at the grasp, in meters.
    pub(crate) palm_moved_m: f64,
    /// Deepest that the hand is in the object before it closes, in meters.
    pub(crate) approach_penetration_m: f64,
    /// Weighted squared residuals of object, table, contact and balance at the grasp, and of the greatest depth in
    /// the object before the hand closes, in m²; smaller is better.
    pub(crate) residual_m2: f64,
}

/// Refines motions of one object.
pub(crate) struct Refiner<'a> {
    hand: &'a Hand,
    config: &'a RefineConfig,
    solver: Solver<'a>,
    /// The object's center of mass.
    center_in_object: Point3<f64>,
}

/// A hand at one step, with where its points are in the object's frame.
#[derive(Clone)]
struct Placed {
    posture: Posture,
    points: Vec<Point3<f64>>,
}

/// What a step asks: the terms of object and table, and at the grasp that of forces.
struct StepTerms<'a> {
    surroundings: Surroundings<'a>,
    balance: Option<Balance<'a>>,
}

impl Terms for StepTerms<'_> {
    fn residuals(&mut self, posed: &Posed<'_>, residuals: &mut Vec<Residual>) {
        self.surroundings.residuals(posed, residuals);
        if let Some(balance) = &mut self.balance {
            balance.residuals(posed, residuals);
        }
    }
}

impl<'a> Refiner<'a> {
    pub(crate) fn new(
        hand: &'a Hand,
        config: &'a RefineConfig,
        center_in_object: Point3<f64>,
    ) -> Self {
        Self {
            hand,
            config,
            solver: Solver::new(&hand.compiled),
            center_in_object,
        }
    }

    /// Refines a motion of an object on a table.
    ///
    /// # Errors
    ///
    /// Fails if the motion is of another hand.
    pub(crate) fn refine(
        &mut self,
        environment: &Environment,
        motion: &Motion<Object>,
    ) -> Result<Refined, RefineError> {
        let motion = motion.reordered(&self.hand.model.joint_names())?;
        let drawn = motion.steps().iter().map(|step| {
            let posture = Posture::new(&step.frame_from_palm, step.q_rad.clone());
            self.placed(posture)
        });
        let drawn: Vec<Placed> = drawn.collect::<Result<_, _>>()?;
        let [first_s, end_s] = [motion.first().time_s, motion.grasp().time_s];
        let open_at = |idx: usize| {
            let remaining_s = end_s - motion.steps()[idx].time_s;
            let share = remaining_s / (end_s - first_s).max(f64::MIN_POSITIVE);
            openness(share, self.config.closing_share)
        };
        let openness: Vec<f64> = (0..drawn.len()).map(open_at).collect();
        let clearances_m: Vec<f64> = openness
            .iter()
            .map(|open| self.config.clearance_m * open)
            .collect();
        let (grasp, mut residual_m2) = self.grasp(environment, &drawn, &clearances_m)?;
        let mut refined = vec![grasp];
        for idx in (0..drawn.len() - 1).rev() {
            let Some(after) = refined.last() else { break };
            let moved = moved(self.hand, &drawn[idx], &drawn[idx + 1], after);
            let mut terms = self.terms(environment, clearances_m[idx], 1.0, Vec::new());
            let start = moved.posture.clone();
            let most = self.config.max_iterations;
            let step = self.search(&drawn[idx], Some(&moved), start, most, &mut terms)?;
            refined.push(step.0);
        }
        refined.reverse();
        let mut approach_penetration_m = 0.0_f64;
        for (idx, step) in refined.iter().enumerate() {
            if openness[idx] < 1.0 {
                continue;
            }
            let mut terms = self.terms(environment, 0.0, 1.0, Vec::new());
            let task = task(&[], None, None);
            self.solver.place(&task, &step.posture, &mut terms)?;
            let depth_m = terms.surroundings.object_depth_m(&self.solver.posed());
            approach_penetration_m = approach_penetration_m.max(depth_m);
        }
        residual_m2 += (self.config.object_weight * approach_penetration_m).powi(2);
        let steps = motion.steps().iter().zip(&refined);
        let steps = steps.map(|(step, refined)| Step {
            time_s: step.time_s,
            frame_from_palm: refined.posture.root.pose(),
            q_rad: refined.posture.q.clone(),
            rates: (),
        });
        let last = drawn.len() - 1;
        let [from, to] = [&drawn, &refined].map(|steps| steps[last].posture.root.translation());
        let motion = Motion::of_joints(motion.joints().clone(), steps.collect())?;
        Ok(Refined {
            motion: motion.differentiated()?,
            palm_moved_m: (to - from).norm(),
            approach_penetration_m,
            residual_m2,
        })
    }

    /// Refines the last step: from the drawn grasp, and along the approach, where the fingers come from outside
    /// and so end on the right side of thin things. Returns it with its residual, in m².
    fn grasp(
        &mut self,
        environment: &Environment,
        drawn: &[Placed],
        clearances_m: &[f64],
    ) -> Result<(Placed, f64), RefineError> {
        let most = self.config.max_iterations;
        let last = drawn.len() - 1;
        let grasp = &drawn[last];
        let contacts = self.contacts(environment, grasp);
        let mut soft = self.terms(environment, 0.0, SOFT, contacts.clone());
        let (start, _) = self.search(
            grasp,
            None,
            grasp.posture.clone(),
            GRASP_ITERATIONS * most,
            &mut soft,
        )?;
        let mut starts = vec![start.posture];
        let from = drawn.len().saturating_sub(APPROACH);
        if from < last {
            let mut here = drawn[from].clone();
            for idx in from..last {
                let start = if idx == from {
                    here.posture.clone()
                } else {
                    moved(self.hand, &drawn[idx], &drawn[idx - 1], &here).posture
                };
                let mut terms = self.terms(environment, clearances_m[idx], 1.0, Vec::new());
                here = self.search(&drawn[idx], None, start, most, &mut terms)?.0;
            }
            starts.push(moved(self.hand, grasp, &drawn[last - 1], &here).posture);
        }
        let mut terms = self.terms(environment, 0.0, 1.0, contacts.clone());
        terms.balance = self.balance(environment, &contacts, grasp);
        let mut best: Option<(Placed, f64)> = None;
        for start in starts {
            let found = self.search(grasp, None, start, GRASP_ITERATIONS * most, &mut terms)?;
            if best.as_ref().is_none_or(|(_, cost)| found.1 < *cost) {
                best = Some(found);
            }
        }
        let placed = best.map_or_else(|| grasp.clone(), |(placed, _)| placed);
        let none = task(&[], None, None);
        let mut residual_m2 = self.solver.place(&none, &placed.posture, &mut terms)?;
        let posed = self.solver.posed();
        if terms
            .balance
            .as_ref()
            .is_none_or(|balance| !balance.is_defined(&posed))
        {
            // No finger opposes the thumb, or a tip is where the object has no surface.
            residual_m2 += self.config.balance_weight.powi(2) * UNBALANCED;
        }
        Ok((placed, residual_m2))
    }

    /// Searches a step near where it was drawn, from a posture; `moved` is where the displacement of the step
    /// after would take it. Returns the cost too.
    fn search(
        &mut self,
        drawn: &Placed,
        moved: Option<&Placed>,
        start: Posture,
        max_iterations: usize,
        terms: &mut StepTerms<'_>,
    ) -> Result<(Placed, f64), RefineError> {
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
                    at: *at,
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
        let options = SearchOptions {
            tolerance: TOLERANCE,
            least_decrease: LEAST_DECREASE_M2,
            max_iterations,
            wrist: Wrist::Moves,
        };
        let mut posture = start;
        let outcome = self.solver.minimize(&task, &mut posture, &options, terms)?;
        Ok((self.placed(posture)?, outcome.cost))
    }

    /// Places the hand.
    fn placed(&mut self, posture: Posture) -> Result<Placed, SolverError> {
        let nothing = task(&[], None, None);
        self.solver
            .place(&nothing, &posture, &mut posture::NoTerms)?;
        let posed = self.solver.posed();
        let points = (0..self.hand.points.len()).filter_map(|point| posed.point(point));
        Ok(Placed {
            points: points.collect(),
            posture,
        })
    }

    fn terms<'t>(
        &self,
        environment: &'t Environment,
        clearance_m: f64,
        firmness: f64,
        contacts: Vec<Contact>,
    ) -> StepTerms<'t>
    where
        'a: 't,
    {
        StepTerms {
            surroundings: Surroundings {
                hand: self.hand,
                environment,
                keep_out: KeepOut {
                    object_weight: firmness * self.config.object_weight,
                    clearance_m,
                    table_weight: self.config.table_weight,
                    table_margin_m: self.config.table_margin_m,
                },
                contacts,
            },
            balance: None,
        }
    }

    /// Returns which tips of a drawn grasp should touch.
    fn contacts(&self, environment: &Environment, grasp: &Placed) -> Vec<Contact> {
        let config = self.config;
        let contact = |(point, (of_hand, at)): (usize, (&posture::HandPoint, &Point3<f64>))| {
            let radius_m = of_hand.tip_radius_m?;
            let off_m = environment.signed_distance(at).distance_m - radius_m;
            let beyond = off_m / config.contact_distance_m - 1.0;
            let share = (1.0 - beyond / (CONTACT_FADE - 1.0)).clamp(0.0, 1.0);
            (share > 0.0 && config.contact_weight > 0.0).then_some(Contact {
                point,
                distance_m: radius_m - config.press_m,
                weight: share * config.contact_weight,
            })
        };
        let points = self.hand.points.iter().zip(&grasp.points);
        points.enumerate().filter_map(contact).collect()
    }

    /// Returns the term of forces of the tips that should touch, if the thumb and a finger do.
    fn balance<'t>(
        &self,
        environment: &'t Environment,
        contacts: &[Contact],
        grasp: &Placed,
    ) -> Option<Balance<'t>> {
        if self.config.balance_weight <= 0.0 {
            return None;
        }
        let near =
            |contact: &&Contact| contact.weight >= MIN_CONTACT_SHARE * self.config.contact_weight;
        let tips = contacts.iter().filter(near).map(|contact| {
            let of_hand = &self.hand.points[contact.point];
            Fingertip {
                point: contact.point,
                radius_m: of_hand.tip_radius_m.unwrap_or(0.0),
                is_thumb: of_hand.keypoint == THUMB_TIP,
                drawn_in_object: grasp.points[contact.point],
            }
        });
        Balance::new(
            environment,
            self.center_in_object,
            tips.collect(),
            self.config.balance_friction,
            self.config.balance_weight,
        )
    }
}

fn task<'t>(
    targets: &'t [Target],
    smoothness: Option<Smoothness<'t>>,
    rest: Option<PosturePrior<'t>>,
) -> Task<'t> {
    Task {
        targets,
        loss: Loss::Squared,
        smoothness,
        rest,
    }
}

/// Returns a drawn step moved as its neighbor was: by as much along the axes, about the palm's origin, and in each
/// joint as far as its limits let it.
fn moved(hand: &Hand, drawn: &Placed, neighbor: &Placed, refined: &Placed) -> Placed {
    let [here, drawn_there, there] =
        [drawn, neighbor, refined].map(|placed| placed.posture.root.pose());
    let turn: UnitQuaternion<f64> = there.rotation * drawn_there.rotation.inverse();
    let along: Vector3<f64> = there.translation.vector - drawn_there.translation.vector;
    let pose = Pose::from_parts(here.translation.vector + along, turn * here.rotation);
    let joints = hand.model.joints().iter();
    let of_joints = drawn.posture.q.iter().zip(&neighbor.posture.q);
    let q = of_joints.zip(&refined.posture.q).zip(joints);
    let q = q.map(|(((q, drawn), refined), joint)| {
        (q + refined - drawn).max(joint.lower).min(joint.upper)
    });
    let points = drawn.points.iter().zip(&neighbor.points);
    let points = points
        .zip(&refined.points)
        .map(|((point, drawn), refined)| point + (refined - drawn));
    Placed {
        posture: Posture::new(&pose, q.collect()),
        points: points.collect(),
    }
}

/// Returns how open the hand is, from 0 at the grasp to 1 where it begins to close, without a kink.
fn openness(remaining: f64, closing_share: f64) -> f64 {
    if closing_share <= 0.0 {
        return if remaining > 0.0 { 1.0 } else { 0.0 };
    }
    let x = (remaining / closing_share).clamp(0.0, 1.0);
    x * x * (3.0 - 2.0 * x)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fixture::{self, reach};

    fn refine(hand: &Hand, config: &RefineConfig, motion: &Motion<Object>) -> Refined {
        let mut refiner = Refiner::new(hand, config, Point3::origin());
        refiner.refine(&fixture::environment(), motion).unwrap()
    }

    /// Greatest depth of the hand in the object and in the table, in meters.
    fn depths_m(hand: &Hand, motion: &Motion<Object>) -> [f64; 2] {
        let (config, environment) = (fixture::config(), fixture::environment());
        let mut refiner = Refiner::new(hand, &config, Point3::origin());
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
        let refined = refine(&hand, &fixture::config(), &drawn).motion;
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
    fn a_motion_far_from_things_stays_as_it_is() {
        let hand = fixture::hand();
        let above = nalgebra::Translation3::new(0.0, 0.0, 0.3);
        let drawn = reach(&hand, -0.1, 0.3).shifted(&above);
        let refined = refine(&hand, &fixture::config(), &drawn).motion;
        for (drawn, refined) in drawn.steps().iter().zip(refined.steps()) {
            let off = drawn.frame_from_palm.inv_mul(&refined.frame_from_palm);
            assert!(off.translation.vector.norm() < 1e-4, "{}", off.translation);
        }
    }

    #[test]
    fn fingertips_near_the_surface_end_on_it() {
        let hand = fixture::hand();
        let drawn = reach(&hand, 0.0, 0.55);
        let gaps_m = |motion: &Motion<Object>| -> Vec<f64> {
            let (config, environment) = (fixture::config(), fixture::environment());
            let mut refiner = Refiner::new(&hand, &config, Point3::origin());
            let [drawn, grasp] = [drawn.grasp(), motion.grasp()].map(|step| {
                let posture = Posture::new(&step.frame_from_palm, step.q_rad.clone());
                refiner.placed(posture).unwrap()
            });
            let contacts = refiner.contacts(&environment, &drawn);
            let gap = |contact: &Contact| {
                let at = &grasp.points[contact.point];
                (environment.signed_distance(at).distance_m - contact.distance_m).abs()
            };
            contacts.iter().map(gap).collect()
        };
        let config = fixture::config();
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
        let without = RefineConfig {
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
        let config = RefineConfig {
            balance_weight: 1.0,
            balance_friction: 0.0,
            ..fixture::config()
        };
        let environment = fixture::environment();
        let drawn = refine(&hand, &config, &reach(&hand, 0.0, 0.55)).motion;
        let mut refiner = Refiner::new(&hand, &config, Point3::origin());
        let grasp = drawn.grasp();
        let grasp = Posture::new(&grasp.frame_from_palm, grasp.q_rad.clone());
        let grasp = refiner.placed(grasp).unwrap();
        let contacts = refiner.contacts(&environment, &grasp);
        let mut terms = refiner.terms(&environment, 0.0, 0.0, Vec::new());
        terms.surroundings.keep_out.table_weight = 0.0;
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

    /// What was refined before leaves nothing behind, so that threads may share the motions as they like.
    #[test]
    fn motions_are_refined_alike_after_others() {
        let hand = fixture::hand();
        let config = fixture::config();
        let environment = fixture::environment();
        let motions = [reach(&hand, 0.1, 0.5), reach(&hand, 0.0, 0.4)];
        let mut refiner = Refiner::new(&hand, &config, Point3::origin());
        for motion in motions.iter().chain(&motions) {
            let found = refiner.refine(&environment, motion).unwrap().motion;
            assert_eq!(found, refine(&hand, &config, motion).motion);
        }
    }
}
