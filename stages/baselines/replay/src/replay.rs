//! The stage: one unit per object.

use dataflow::{BoxedDiagnostic, Context, Line, Outcome, Output, Outputs, Scope, Stage, Sum, Unit};
use lake::{SiblingTable, WriteArtifact};
use motion::{HandRates, Motion, MotionError, palm_acceleration};
use schemas::{
    Table,
    candidates::{Candidate, Candidates, DrawSource},
    draws::{Draw, Draws, Refusal},
    trajectories::Trajectory,
};
use spatial::Object;

use crate::ReplayConfig;

/// Offers retargeted demonstrations as candidates.
pub struct Replay;

dataflow::metrics! {
    /// Metrics of an object's candidates.
    pub struct ReplayMetrics {
        /// Number of candidates.
        candidates: Sum,
    }
}

/// Generator name of the candidates.
const GENERATOR: &str = "demonstration";

lake::inputs! {
    /// What a unit reads: the demonstrations of an object.
    pub struct ReplayInputs {
        /// The demonstrations.
        group trajectories: Trajectory, by "object", "to replay";
    }
}

impl Stage for Replay {
    type Config = ReplayConfig;

    const KIND: &'static str = "replay";
    const ABOUT: &'static str = "Offers retargeted demonstrations as candidates";
    const INPUTS: &'static [&'static str] = ReplayInputs::INPUTS;
    const OUTPUTS: Outputs<Self> = &[&Self, &SiblingTable::<Self, Draws>::OUTPUT];
}

impl Output for Replay {
    type Stage = Self;
    type Metrics = ReplayMetrics;
    type Inputs<'a> = ReplayInputs;

    const ARTIFACT: &'static str = Candidates::NAME;
    const SCHEMA: &'static str = Candidates::VERSION;
    const PARTITION: &'static str = Candidates::PARTITION;
    const LINE: Option<Line<ReplayMetrics>> = Some(|summary| {
        let candidates = summary.metrics.candidates;
        format!("{} objects → {candidates} candidates", summary.n_made)
    });

    fn units(config: &ReplayConfig, scope: &Scope) -> Result<Vec<Unit>, BoxedDiagnostic> {
        Ok(ReplayInputs::units(scope, &config.objects)?)
    }

    fn make(
        _config: &ReplayConfig,
        ReplayInputs { trajectories }: ReplayInputs,
        cx: &Context,
    ) -> Result<Outcome<ReplayMetrics>, BoxedDiagnostic> {
        let joints = approach::joints_of(&trajectories)?.unwrap_or_default();
        let mut candidates = Vec::with_capacity(trajectories.len());
        let mut draws = Draws::with_capacity(trajectories.len());
        for trajectory in &trajectories {
            match motion(trajectory) {
                Ok(motion) => {
                    let candidate = candidate(trajectory, motion);
                    draws.push(Draw::kept(&candidate));
                    candidates.push(candidate);
                }
                Err(err) => draws.push(refused(trajectory, &err)),
            }
        }
        let metrics = ReplayMetrics {
            candidates: candidates.len() as f64,
        };
        cx.write(&Candidates {
            object: cx.partition().to_string(),
            joints,
            candidates,
        })?;
        cx.write(&draws)?;
        Ok(Outcome::Made(metrics))
    }
}

/// Returns the motion of a trajectory, with the palm's acceleration.
///
/// # Errors
///
/// Fails if the acceleration overflows.
fn motion(trajectory: &Trajectory) -> Result<Motion<Object>, MotionError> {
    let motion = &trajectory.motion;
    let velocity = |idx: usize| motion.steps()[idx].rates.palm_velocity.to_array();
    motion.with_rates(|idx| {
        let rates = &motion.steps()[idx].rates;
        HandRates {
            palm_velocity: rates.palm_velocity,
            palm_acceleration: palm_acceleration(motion.steps(), idx, velocity),
            joints: rates.joints.clone(),
        }
    })
}

fn candidate(trajectory: &Trajectory, motion: Motion<Object>) -> Candidate {
    Candidate {
        candidate_id: candidate_id(trajectory),
        generator: GENERATOR.to_owned(),
        source: DrawSource::replayed(&trajectory.sequence),
        latent: Vec::new(),
        table_from_object: trajectory.rest.table_from_object(),
        limit_excess_rad: 0.0,
        depth_m: None,
        residual_m2: None,
        motion,
    }
}

fn refused(trajectory: &Trajectory, err: &MotionError) -> Draw {
    Draw {
        candidate_id: candidate_id(trajectory),
        generator: GENERATOR.to_owned(),
        source: DrawSource::replayed(&trajectory.sequence),
        refused: Some(Refusal::Motion),
        fault: err.to_string(),
        depth_m: None,
        residual_m2: None,
        table_from_object: trajectory.rest.table_from_object(),
        limit_excess_rad: 0.0,
    }
}

fn candidate_id(trajectory: &Trajectory) -> String {
    format!("{}-{}", trajectory.object, trajectory.sequence)
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use dataflow::{Artifact, Inputs, Partition};
    use motion::Step;
    use nalgebra::{Isometry3, Unit as UnitVector, Vector3};
    use schemas::trajectories::{Tracking, TrajectoryRates};
    use spatial::{Pose, RestingPose, Twist};

    use super::*;

    fn trajectory(sequence: &str, joints: &[&str]) -> Trajectory {
        let step = |time_s: f64| Step {
            time_s,
            frame_from_palm: Pose::new(Isometry3::translation(time_s, 0.0, 0.1)),
            q_rad: joints.iter().map(|_| time_s).collect(),
            rates: TrajectoryRates {
                palm_velocity: Twist::from_array([time_s, 0.0, 0.0, 0.0, 0.0, -3.0 * time_s]),
                ..TrajectoryRates::zero(joints.len())
            },
        };
        Trajectory {
            sequence: sequence.to_owned(),
            object: "can".to_owned(),
            keypoints: Vec::new(),
            tips: Vec::new(),
            rest: RestingPose {
                up_in_object: UnitVector::new_normalize(Vector3::x()),
                height_m: 0.03,
            },
            motion: Motion::new(joints, vec![step(0.0), step(0.1)]).unwrap(),
            tracking: vec![Tracking::default(); 2],
        }
    }

    /// Runs the stage on these trajectories in `folder`.
    fn run(
        trajectories: &[Trajectory],
        folder: &std::path::Path,
    ) -> Result<Outcome<ReplayMetrics>, BoxedDiagnostic> {
        let artifacts = trajectories
            .iter()
            .map(|trajectory| {
                let folder = folder.join(&trajectory.sequence);
                std::fs::create_dir_all(&folder).unwrap();
                lake::table::write(&folder, trajectory).unwrap();
                let file = lake::table::FILE;
                Artifact {
                    key: trajectory.sequence.parse().unwrap(),
                    labels: BTreeMap::new(),
                    files: BTreeMap::from([(file.to_owned(), folder.join(file))]),
                }
            })
            .collect();
        let inputs = Inputs::new(
            BTreeMap::from([("trajectories".to_owned(), artifacts)]),
            Vec::new(),
        );
        let cx = Context::detached(&"can".parse().unwrap(), 0, folder);
        Replay::read_and_make(&ReplayConfig::default(), &inputs, &cx)
    }

    #[test]
    fn each_trajectory_is_one_candidate_as_it_is() {
        let folder = tempfile::tempdir().unwrap();
        let shown = [trajectory("a", &["j"]), trajectory("b", &["j"])];
        assert!(matches!(run(&shown, folder.path()), Ok(Outcome::Made(_))));
        let file = lake::table::FILE;
        let made = Artifact {
            key: "can".parse().unwrap(),
            labels: BTreeMap::new(),
            files: BTreeMap::from([(file.to_owned(), folder.path().join(file))]),
        };
        let read: Candidates = lake::table::read(&made).unwrap();
        assert_eq!(*read.joints, ["j"]);
        let ids: Vec<&str> = read
            .candidates
            .iter()
            .map(|c| c.candidate_id.as_str())
            .collect();
        assert_eq!(ids, ["can-a", "can-b"]);
        for (candidate, shown) in read.candidates.iter().zip(&shown) {
            assert_eq!(candidate.source, DrawSource::replayed(&shown.sequence));
            assert_eq!(candidate.table_from_object, shown.rest.table_from_object());
            let (found, expected) = (&candidate.motion, &shown.motion);
            for (found, expected) in found.steps().iter().zip(expected.steps()) {
                assert_eq!(found.time_s, expected.time_s);
                assert_eq!(found.frame_from_palm, expected.frame_from_palm);
                assert_eq!(found.q_rad, expected.q_rad);
                let (palm, shown) = (&found.rates.palm_velocity, &expected.rates.palm_velocity);
                assert_eq!(palm, shown);
                let [x, _, _, _, _, turning] = found.rates.palm_acceleration.to_array();
                assert!((x - 1.0).abs() < 1e-12 && (turning + 3.0).abs() < 1e-12);
            }
        }
    }

    #[test]
    fn a_trajectory_too_fast_for_numbers_is_a_draw_with_its_reason() {
        let folder = tempfile::tempdir().unwrap();
        let mut fast = trajectory("a", &["j"]);
        let rates = |idx: usize| TrajectoryRates {
            palm_velocity: Twist::from_array([1e308 * (1.0 - 2.0 * idx as f64); 6]),
            ..TrajectoryRates::zero(1)
        };
        fast.motion = fast.motion.with_rates(rates).unwrap();
        let outcome = run(&[fast, trajectory("b", &["j"])], folder.path());
        assert!(matches!(outcome, Ok(Outcome::Made(made)) if made.candidates == 1.0));
        let files = [lake::table::FILE, Draws::FILE];
        let made = Artifact {
            key: "can".parse().unwrap(),
            labels: BTreeMap::new(),
            files: files
                .map(|file| (file.to_owned(), folder.path().join(file)))
                .into(),
        };
        let read: Candidates = lake::table::read(&made).unwrap();
        let draws: Draws = lake::table::read(&made).unwrap();
        let [refused, kept] = &draws[..] else {
            panic!("{draws:?}");
        };
        assert_eq!(refused.candidate_id, "can-a");
        assert_eq!(refused.refused, Some(Refusal::Motion));
        assert!(refused.fault.contains("not finite"), "{}", refused.fault);
        assert_eq!(kept, &Draw::kept(&read.candidates[0]));
    }

    #[test]
    fn trajectories_of_two_hands_are_refused() {
        let folder = tempfile::tempdir().unwrap();
        let err = run(
            &[trajectory("a", &["j"]), trajectory("b", &["k"])],
            folder.path(),
        );
        let err = err.unwrap_err().to_string();
        assert_eq!(err, "trajectories `a` and `b` are of different hands");
    }

    #[test]
    fn one_unit_per_object_reads_its_trajectories() {
        let labeled = |key: &str, object: &str| {
            Partition::new(
                key.parse().unwrap(),
                BTreeMap::from([("object".to_owned(), object.to_owned())]),
            )
        };
        let scope = Scope::new(BTreeMap::from([(
            "trajectories".to_owned(),
            vec![
                labeled("a", "can"),
                labeled("b", "box"),
                labeled("c", "can"),
            ],
        )]));
        let units = |objects: &[&str]| {
            let objects = objects.iter().map(|&name| name.to_owned()).collect();
            Replay::units(&ReplayConfig { objects }, &scope)
        };
        let all = units(&[]).unwrap();
        assert_eq!(all.len(), 2);
        assert_eq!(all[1].partition, "can");
        assert_eq!(all[1].reads["trajectories"], ["a", "c"]);
        assert_eq!(units(&["box"]).unwrap().len(), 1);
        assert!(units(&["cup"]).unwrap_err().to_string().contains("`cup`"));
    }
}
