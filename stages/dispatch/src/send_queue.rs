//! The order in which an object's accepted motions are sent.

use std::collections::BTreeMap;

use diversity::distance;
use schemas::{
    candidates::{Candidate, Candidates},
    robustness::Robustness,
    rollouts::{Rollout, Verdict},
    sampling::GraspDistance,
};

use crate::{DispatchError, config::SendOrder};

/// Difference of shares up to which motions count as equally robust: one of 16 trials, about the standard
/// error of a share near 1.
const EQUALLY_ROBUST: f64 = 0.0625;
/// Distance of a fingertip from the palm and from its joints, about, in meters: it turns angles into lengths.
const FINGER_M: f64 = 0.1;

/// The accepted motions that are left to send.
pub(crate) struct SendQueue<'a> {
    order: SendOrder,
    left: Vec<Accepted<'a>>,
    /// Those that can be executed, and are sent.
    sent: Vec<&'a Candidate>,
}

/// An accepted motion.
struct Accepted<'a> {
    candidate: &'a Candidate,
    /// Share of its trials under drawn errors that held; nothing of one that was not tried.
    robustness: Option<f64>,
}

impl<'a> SendQueue<'a> {
    /// Takes the accepted motions, as they were screened.
    ///
    /// # Errors
    ///
    /// Fails if one of them is not among the candidates.
    pub(crate) fn new(
        order: SendOrder,
        rollouts: &[Rollout],
        robustness: &[Robustness],
        candidates: &'a Candidates,
    ) -> Result<Self, DispatchError> {
        let shares: BTreeMap<&str, f64> = robustness
            .iter()
            .filter_map(|row| Some((row.candidate_id.as_str(), row.trials.rate()?)))
            .collect();
        let held = rollouts
            .iter()
            .filter(|rollout| rollout.verdict == Verdict::Held);
        let left = held.map(|rollout| {
            let id = rollout.candidate_id.as_str();
            let candidate = candidates
                .candidates
                .iter()
                .find(|of| of.candidate_id == id);
            let candidate = candidate.ok_or_else(|| DispatchError::NoCandidate {
                object: candidates.object.clone(),
                candidate_id: id.to_owned(),
            })?;
            Ok(Accepted {
                candidate,
                robustness: shares.get(id).copied(),
            })
        });
        Ok(Self {
            order,
            left: left.collect::<Result<_, DispatchError>>()?,
            sent: Vec::new(),
        })
    }

    /// Whether no motion is left.
    pub(crate) fn is_empty(&self) -> bool {
        self.left.is_empty()
    }

    /// Takes the next motion.
    pub(crate) fn next(&mut self) -> Option<&'a Candidate> {
        let idx = match self.order {
            SendOrder::Accepted => 0,
            SendOrder::Robust => self.most_robust()?,
        };
        (idx < self.left.len()).then(|| self.left.remove(idx).candidate)
    }

    /// Notes that a motion is sent: the next ones should differ from it.
    pub(crate) fn mark_chosen(&mut self, candidate: &'a Candidate) {
        self.sent.push(candidate);
    }

    /// Returns the motion whose grasp differs most from those sent, among those that are about as robust as
    /// the most robust one; of equal ones the first. Motions that were not tried come last, as they
    /// were screened.
    fn most_robust(&self) -> Option<usize> {
        let best = self.left.iter().map(|motion| motion.robustness);
        let Some(best) = best.max_by(|a, b| order_of(*a).total_cmp(&order_of(*b)))? else {
            // Nothing is known of those that were not tried.
            return Some(0);
        };
        let bar = if self.sent.is_empty() {
            best
        } else {
            best - EQUALLY_ROBUST
        };
        let mut chosen: Option<(usize, f64)> = None;
        for (idx, motion) in self.left.iter().enumerate() {
            let distance_m = self.distance_m(motion.candidate);
            let is_farther = chosen.is_none_or(|(_, most_m)| distance_m > most_m);
            if order_of(motion.robustness) >= bar && is_farther {
                chosen = Some((idx, distance_m));
            }
        }
        chosen.map(|(idx, _)| idx)
    }

    /// Returns how far a grasp is from the nearest one sent.
    fn distance_m(&self, candidate: &Candidate) -> f64 {
        let distances = self.sent.iter().map(|sent| {
            let GraspDistance {
                palm_m,
                palm_rad,
                q_rad,
            } = distance(sent.motion.grasp(), candidate.motion.grasp());
            let turned_m = [FINGER_M * palm_rad, FINGER_M * q_rad];
            turned_m.into_iter().fold(palm_m, f64::hypot)
        });
        distances.fold(f64::INFINITY, f64::min)
    }
}

/// Returns a share as a number that puts motions without one last.
fn order_of(robustness: Option<f64>) -> f64 {
    robustness.unwrap_or(-1.0)
}

#[cfg(test)]
mod tests {
    use motion::{HandRates, Motion, Step};
    use nalgebra::Isometry3;
    use schemas::{candidates::DrawSource, robustness::TrialVerdict};
    use spatial::Pose;

    use super::*;

    /// Motions `0`, `1`, … whose palms end at these places along x.
    fn candidates(x_m: &[f64]) -> Candidates {
        let candidate = |(idx, x_m): (usize, &f64)| Candidate {
            candidate_id: idx.to_string(),
            generator: String::new(),
            source: DrawSource::replayed("a"),
            latent: Vec::new(),
            table_from_object: Pose::identity(),
            limit_excess_rad: 0.0,
            depth_m: None,
            residual_m2: None,
            motion: Motion::new(
                &["j"],
                vec![Step {
                    time_s: 0.0,
                    frame_from_palm: Pose::new(Isometry3::translation(*x_m, 0.0, 0.1)),
                    q_rad: vec![0.0],
                    rates: HandRates::zero(1),
                }],
            )
            .unwrap(),
        };
        Candidates {
            object: "can".to_owned(),
            joints: ["j".to_owned()].into(),
            candidates: x_m.iter().enumerate().map(candidate).collect(),
        }
    }

    /// Sends up to `n` motions; `held` of 16 trials, or not tried.
    fn sent(order: SendOrder, motions: &[(f64, Option<i64>)], n: usize) -> Vec<String> {
        let x_m: Vec<f64> = motions.iter().map(|(x_m, _)| *x_m).collect();
        let candidates = candidates(&x_m);
        let rollouts: Vec<Rollout> = candidates
            .candidates
            .iter()
            .map(|candidate| Rollout::unsimulated(candidate, Verdict::Held))
            .collect();
        let tried = motions.iter().enumerate();
        let robustness: Vec<Robustness> = tried
            .filter_map(|(idx, (_, held_n))| {
                let held_n = (*held_n)?;
                let trials = [(Verdict::Held, held_n), (Verdict::Dropped, 16 - held_n)];
                Some(Robustness {
                    candidate_id: idx.to_string(),
                    trials: trials
                        .map(|(verdict, n)| (TrialVerdict(verdict), n))
                        .into_iter()
                        .collect(),
                    control_steps_n: 0,
                })
            })
            .collect();
        let mut queue = SendQueue::new(order, &rollouts, &robustness, &candidates).unwrap();
        let mut names = Vec::new();
        while let Some(next) = queue.next().filter(|_| names.len() < n) {
            names.push(next.candidate_id.clone());
            queue.mark_chosen(next);
        }
        names
    }

    #[test]
    fn most_robust_motion_is_first_and_untried_ones_are_last() {
        let motions = [
            (0.01, None),
            (0.0, Some(2)),
            (0.0, Some(16)),
            // It differs most, and was not tried.
            (0.50, None),
            (0.0, Some(9)),
            (0.02, None),
        ];
        let robust = sent(SendOrder::Robust, &motions, 9);
        assert_eq!(robust, ["2", "4", "1", "0", "3", "5"]);
        assert_eq!(sent(SendOrder::Accepted, &motions, 3), ["0", "1", "2"]);
    }

    #[test]
    fn of_equally_robust_motions_the_most_different_grasp_is_next() {
        let motions = [
            (0.00, Some(16)),
            (0.01, Some(16)),
            (0.02, Some(15)),
            (0.05, Some(15)),
            // It differs most, and holds too seldom.
            (0.50, Some(14)),
        ];
        assert_eq!(sent(SendOrder::Robust, &motions, 3), ["0", "3", "2"]);
    }

    #[test]
    fn only_accepted_motions_are_sent_and_each_has_a_candidate() {
        let mut candidates = candidates(&[0.0, 0.0]);
        let rollouts = [
            Rollout::unsimulated(&candidates.candidates[0], Verdict::Slipped),
            Rollout::unsimulated(&candidates.candidates[1], Verdict::Held),
        ];
        let mut queue = SendQueue::new(SendOrder::Robust, &rollouts, &[], &candidates).unwrap();
        assert_eq!(queue.next().unwrap().candidate_id, "1");
        assert!(queue.is_empty() && queue.next().is_none());
        candidates.candidates.pop();
        let err = SendQueue::new(SendOrder::Robust, &rollouts, &[], &candidates).err();
        assert!(
            matches!(err, Some(DispatchError::NoCandidate { candidate_id, .. }) if candidate_id == "1")
        );
    }
}
