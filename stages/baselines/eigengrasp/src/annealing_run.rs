//! One run: annealing from a random state, its best states finished.

use approach::{ApproachError, HandBody};
use motion::HandState;
use nalgebra::Point3;
use posture::Environment;
use rand_chacha::ChaCha8Rng;
use robot::SurfacePoint;
use spatial::Object;

use crate::{
    EigengraspConfig,
    annealing::{DEFAULT, happens},
    basis::Basis,
    energy::contact_energy,
    quality::epsilon,
    variables::Variables,
};

/// Draws of a neighbor until one collides with nothing, `GraspIt`'s number.
const MAX_DRAWS: usize = 10;
/// Draws of a first state until one collides with nothing.
const MAX_STARTS: usize = 10_000;
/// Greatest depth of a legal hand in object or table, in meters: the accuracy of the grid of distances.
const LEGAL_DEPTH_M: f64 = 2e-4;
/// Greatest distance between the palms of two states that count as one grasp, in meters and radians.
const SAME_M: f64 = 0.015;
const SAME_RAD: f64 = 0.3;
/// Greatest advance of a kept hand until it touches, in meters.
const MAX_ADVANCE_M: f64 = 0.06;
/// Step by which fingers open, in radians, and number of steps: a quarter turn in all.
const OPENING_RAD: f64 = 0.1;
const OPENINGS: usize = 16;
/// Gap up to which a link touches, in meters: the one that the last step of a closing finger leaves.
const TOUCH_M: f64 = 1e-3;

/// Anneals grasps of an object that lies in one way.
pub(crate) struct Run<'a> {
    pub(crate) config: &'a EigengraspConfig,
    pub(crate) body: &'a HandBody,
    pub(crate) basis: &'a Basis,
    pub(crate) contacts: &'a [SurfacePoint],
    pub(crate) environment: &'a Environment,
    pub(crate) center_in_object: Point3<f64>,
    /// Length by which torques are divided, in meters.
    pub(crate) length_m: f64,
}

/// A state that is kept.
#[derive(Debug, Clone)]
struct KeptState {
    hand: HandState<Object>,
    energy_mm: f64,
}

/// A finished grasp.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct FinishedGrasp {
    pub(crate) hand: HandState<Object>,
    /// Contact energy before it was finished, in millimeters.
    pub(crate) energy_mm: f64,
    /// The wrench that it withstands in the worst direction; 0 without force closure.
    pub(crate) epsilon: f64,
    /// Greatest depth of a link in object or table, in meters.
    pub(crate) depth_m: f64,
}

/// Grasps of a run, and the work spent on them.
#[derive(Debug, Clone, Default, PartialEq)]
pub(crate) struct RunResult {
    pub(crate) grasps: Vec<FinishedGrasp>,
    /// Steps made.
    pub(crate) steps: u64,
    /// States checked for collisions.
    pub(crate) checks: u64,
    /// Energies evaluated.
    pub(crate) evaluations: u64,
    /// Processor time in seconds, where it was measured.
    pub(crate) cpu_s: f64,
}

impl Run<'_> {
    /// Anneals from a random state and finishes the best; nothing is made if no state is free of collisions.
    pub(crate) fn grasps(&self, rng: &mut ChaCha8Rng) -> Result<RunResult, ApproachError> {
        let mut made = RunResult::default();
        let variables = Variables::new(self.config.eigengrasps, self.config.max_amplitude);
        let mut here = None;
        for _ in 0..MAX_STARTS {
            let state = variables.draw(rng);
            if let Some(kept) = self.legal(&state, &mut made)? {
                here = Some((state, kept));
                break;
            }
        }
        let Some((mut state, mut at)) = here else {
            return Ok(made);
        };
        let mut best: Vec<KeptState> = Vec::new();
        keep(&mut best, &at, self.config.kept);
        for step in 0..self.config.steps {
            made.steps += 1;
            let temperature = DEFAULT.temperature(step);
            let mut next = None;
            for _ in 0..MAX_DRAWS {
                let neighbor = variables.neighbor(&state, temperature, rng);
                if let Some(kept) = self.legal(&neighbor, &mut made)? {
                    next = Some((neighbor, kept));
                    break;
                }
            }
            let Some((neighbor, kept)) = next else {
                continue;
            };
            let acceptance = DEFAULT.acceptance(temperature, at.energy_mm, kept.energy_mm);
            if happens(acceptance, rng) {
                (state, at) = (neighbor, kept);
                keep(&mut best, &at, self.config.kept);
            }
        }
        for kept in best {
            made.grasps.push(self.finished(kept)?);
        }
        Ok(made)
    }

    /// Returns the hand of a state with its energy, if it collides with nothing.
    fn legal(
        &self,
        state: &[f64],
        made: &mut RunResult,
    ) -> Result<Option<KeptState>, ApproachError> {
        let model = self.body.model();
        let hand = Variables::hand(state, &self.center_in_object, self.basis, model);
        let placed = self.body.placed(&hand)?;
        made.checks += 1;
        if !self.body.is_clear(self.environment, &placed, LEGAL_DEPTH_M) {
            return Ok(None);
        }
        made.evaluations += 1;
        let energy_mm = contact_energy(self.environment, &placed, self.contacts);
        Ok(Some(KeptState { hand, energy_mm }))
    }

    /// Finishes a grasp: the palm backs off, its fingers open as far as they must for that, and advances until it
    /// touches; the fingers close joint by joint. A palm that cannot back off, an object in its way, stays.
    fn finished(&self, kept: KeptState) -> Result<FinishedGrasp, ApproachError> {
        let there = match self.opened(&self.body.backed_off(&kept.hand, self.config.back_off_m))? {
            Some(back) => self.body.advanced(self.environment, &back, MAX_ADVANCE_M)?,
            None => kept.hand,
        };
        let hand = self.body.closed(self.environment, &there)?;
        let touches = self.body.touches(self.environment, &hand, TOUCH_M)?;
        let (center, friction) = (&self.center_in_object, self.config.friction);
        Ok(FinishedGrasp {
            epsilon: epsilon(&touches, center, self.length_m, friction),
            depth_m: self.body.clearance(self.environment, &hand)?.depth_m(),
            energy_mm: kept.energy_mm,
            hand,
        })
    }
}

impl Run<'_> {
    /// Returns a hand with its flexion joints opened until it is clear of object and table; `None` if it never is.
    fn opened(&self, hand: &HandState<Object>) -> Result<Option<HandState<Object>>, ApproachError> {
        let mut hand = hand.clone();
        let joints = self.body.model().joints();
        for _ in 0..OPENINGS {
            let placed = self.body.placed(&hand)?;
            if self.body.is_clear(self.environment, &placed, 0.0) {
                return Ok(Some(hand));
            }
            for &joint in self.body.flexion() {
                let opened = hand.q_rad[joint] - OPENING_RAD;
                hand.q_rad[joint] = opened.max(joints[joint].nearest_zero().min(hand.q_rad[joint]));
            }
        }
        Ok(None)
    }
}

/// Keeps a state among the best that differ; of two that are one grasp the better.
fn keep(best: &mut Vec<KeptState>, state: &KeptState, most: usize) {
    let is_full = best.len() >= most;
    if is_full
        && best
            .last()
            .is_some_and(|worst| worst.energy_mm <= state.energy_mm)
    {
        return;
    }
    let is_same = |kept: &KeptState| {
        let off = kept
            .hand
            .frame_from_palm
            .inv_mul(&state.hand.frame_from_palm);
        off.translation.vector.norm() < SAME_M && off.rotation.angle() < SAME_RAD
    };
    if best
        .iter()
        .any(|kept| is_same(kept) && kept.energy_mm <= state.energy_mm)
    {
        return;
    }
    best.retain(|kept| !is_same(kept));
    let place = best.partition_point(|kept| kept.energy_mm <= state.energy_mm);
    best.insert(place, state.clone());
    best.truncate(most);
}

#[cfg(test)]
mod tests {
    use approach::virtual_contacts;
    use nalgebra::UnitQuaternion;
    use rand::SeedableRng;
    use spatial::Pose;

    use super::*;
    use crate::fixture;

    fn at(x: f64, energy_mm: f64) -> KeptState {
        KeptState {
            hand: HandState {
                frame_from_palm: Pose::from_parts([x, 0.0, 0.0], UnitQuaternion::identity()),
                q_rad: Vec::new(),
            },
            energy_mm,
        }
    }

    #[test]
    fn the_best_states_that_differ_are_kept_in_their_order() {
        let mut best = Vec::new();
        for (x, energy) in [
            (0.0, 5.0),
            (0.1, 3.0),
            (0.11, 4.0),
            (0.2, 9.0),
            (0.005, 4.5),
            (0.3, 8.0),
        ] {
            keep(&mut best, &at(x, energy), 3);
        }
        let found: Vec<f64> = best.iter().map(|kept| kept.energy_mm).collect();
        // 4 is the grasp of 3, 4.5 replaced that of 5, and 8 that of 9.
        assert_eq!(found, [3.0, 4.5, 8.0]);
    }

    fn run(steps: usize) -> RunResult {
        let config = EigengraspConfig {
            steps,
            ..fixture::config()
        };
        let body = fixture::body();
        let environment = fixture::BOX.environment();
        let run = Run {
            config: &config,
            contacts: &virtual_contacts(&body),
            body: &body,
            basis: &fixture::basis(),
            environment: &environment,
            center_in_object: Point3::origin(),
            length_m: 0.05,
        };
        run.grasps(&mut ChaCha8Rng::seed_from_u64(2)).unwrap()
    }

    #[test]
    fn annealing_lowers_the_energy_and_its_grasps_touch_without_entering() {
        let [short, long] = [run(20), run(4000)];
        let least = |made: &RunResult| {
            let energies = made.grasps.iter().map(|grasp| grasp.energy_mm);
            energies.fold(f64::INFINITY, f64::min)
        };
        assert!(
            least(&long) < 0.7 * least(&short),
            "{} {}",
            least(&short),
            least(&long)
        );
        assert_eq!(long.steps, 4000);
        assert!(long.checks >= long.evaluations && long.evaluations > 1000);
        assert!(long.grasps.len() > 5);
        assert!(long.grasps.iter().all(|grasp| grasp.depth_m < 1e-3));
        assert!(long.grasps.iter().any(|grasp| grasp.epsilon > 0.0));
    }

    #[test]
    fn a_run_is_repeated_by_its_seed() {
        assert_eq!(run(100), run(100));
    }
}
