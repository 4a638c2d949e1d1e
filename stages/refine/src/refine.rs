//! The stage: one unit per object.

use std::{collections::BTreeMap, path::PathBuf, sync::Arc};

use dataflow::{
    BoxedDiagnostic, Context, Inputs, Line, Max, Mean, OptionsUsed, Outcome, Output, Outputs,
    Scope, Stage, Sum, Unit,
};
use geometry::DistanceField;
use hand_files::HandFiles;
use lake::{LakeError, ReadArtifact, ReadInputs, SiblingTable, WriteArtifact};
use motion::MotionError;
use posture::{Environment, Hand};
use rayon::prelude::*;
use refinement::{Choice, Payload, Refined, RefinementError, Refiner};
use robot_meshes::HandMismatch;
use schemas::{
    Table,
    candidates::{Candidate, Candidates},
    distance_fields::{self, FieldInfo},
    draws::{Draw, Draws, Refusal},
    objects::Object,
};
use spatial::RestingPose;

use crate::{ChooseBy, RefineConfig};

/// Refines candidate motions against object and table before physics.
pub struct Refine;

/// The refinement of a draw, and the processor time that it took in seconds.
type TimedRefinement = (Result<Refined, RefinementError>, f64);

/// Generator name of refined motions.
const GENERATOR: &str = "refine";

dataflow::metrics! {
    /// Metrics of an object's refined motions.
    pub struct RefineMetrics {
        /// Number of candidates.
        candidates: Sum,
        /// Number of draws of which they are the best.
        draws: Sum,
        /// Displacement of the palm at the grasp, in meters.
        palm_moved_m: Mean,
        /// Deepest that a refined hand is in the object before it closes, in meters.
        approach_penetration_m: Max,
        /// Processor time of all draws, in seconds.
        cpu_s: Sum,
    }
}

lake::inputs! {
    /// What a unit reads: an object's motions, the draws refused for them, its distances, the object and the hand.
    pub struct RefineInputs {
        /// The motions.
        each candidates: Candidates [lake::table::FILE, Draws::FILE], "to refine";
        /// The distances from the object.
        own field: DistanceField = FieldInfo,
            |field| field.parsed(distance_fields::FIELD, DistanceField::from_bytes),
            or "object has no distance field";
        /// The object.
        own object: Object, or "object missing";
    }
    files {
        /// The draws that were refused before.
        refused: RefusedDraws = RefusedDraws::read;
        /// The hand's URDF.
        urdf: PathBuf = hand_files::urdf;
        /// The hand.
        hand: Hand = hand_files::hand;
    }
}

impl Stage for Refine {
    type Config = RefineConfig;

    const KIND: &'static str = "refine";
    const ABOUT: &'static str = "Refines candidate motions against object and table before physics";
    const INPUTS: &'static [&'static str] = RefineInputs::INPUTS;
    const OUTPUTS: Outputs<Self> = &[&Self, &SiblingTable::<Self, Draws>::OUTPUT];

    /// Checks the hand and its table.
    fn prepare(config: &RefineConfig) -> Result<(), BoxedDiagnostic> {
        hand_files::load(&config.hand, &config.hand_table)?;
        Ok(())
    }
}

impl Output for Refine {
    type Stage = Self;
    type Metrics = RefineMetrics;
    type Inputs<'a> = RefineInputs;

    const ARTIFACT: &'static str = Candidates::NAME;
    const SCHEMA: &'static str = Candidates::VERSION;
    const PARTITION: &'static str = Candidates::PARTITION;
    const OPTIONS: OptionsUsed = OptionsUsed::All;
    const LINE: Option<Line<RefineMetrics>> = Some(|summary| {
        let metrics = &summary.metrics;
        let [n, drawn_n] = [metrics.candidates, metrics.draws];
        let best = if drawn_n > n {
            format!("{drawn_n} motions refined → {n} candidates")
        } else {
            format!("{n} motions refined")
        };
        format!("{best}, palm moved {:.0} mm", 1000.0 * metrics.palm_moved_m)
    });

    fn units(config: &RefineConfig, scope: &Scope) -> Result<Vec<Unit>, BoxedDiagnostic> {
        let units = RefineInputs::units(scope, &[])?;
        Ok(HandFiles::of(&config.hand, &config.hand_table)?.added_to_each(units))
    }

    fn make(
        config: &RefineConfig,
        inputs: RefineInputs,
        cx: &Context,
    ) -> Result<Outcome<RefineMetrics>, BoxedDiagnostic> {
        let RefineInputs {
            candidates,
            field,
            object,
            refused,
            urdf,
            hand,
        } = inputs;
        let of_object = (candidates.object.as_str(), &candidates.joints[..]);
        HandMismatch::check(Self::KIND, of_object, (&urdf, &hand.model))?;
        let refinement = Refinement {
            config,
            hand: &hand,
            object: &object,
            field: &Arc::new(field),
            is_canceled: &|| false,
        };
        let refined = refinement.refine(candidates, refused);
        let refined = refined.map_err(BoxedDiagnostic::without_hint)?;
        cx.write(&refined.candidates)?;
        cx.write(&refined.draws)?;
        Ok(Outcome::Made(refined.metrics))
    }
}

/// What the motions of one object are refined against.
pub struct Refinement<'a> {
    /// The options.
    pub config: &'a RefineConfig,
    /// The hand.
    pub hand: &'a Hand,
    /// The object.
    pub object: &'a Object,
    /// The distances from it.
    pub field: &'a Arc<DistanceField>,
    /// Whether the rest of the motions is to be left.
    pub is_canceled: &'a (dyn Fn() -> bool + Sync),
}

/// The refined motions of one object.
pub struct RefinedCandidates {
    /// The motions that were kept, with the joints of the hand.
    pub candidates: Candidates,
    /// All draws of them.
    pub draws: Draws,
    /// What is counted of them.
    pub metrics: RefineMetrics,
}

impl Refinement<'_> {
    /// Refines the candidates of the object, of the hand's joints in any order, in all threads; `refused` are draws that
    /// were refused before.
    ///
    /// # Errors
    ///
    /// Fails if the hand cannot be used, or if it is canceled; a motion that cannot be refined becomes a refused draw.
    pub fn refine(
        &self,
        given: Candidates,
        mut refused: RefusedDraws,
    ) -> Result<RefinedCandidates, RefinementError> {
        let payload = Payload {
            center_of_mass_in_object: self.object.center_of_mass_m.into(),
            mass_kg: self.object.mass_kg,
        };
        let tried: Vec<(Candidate, TimedRefinement)> = given
            .candidates
            .into_par_iter()
            .map_init(
                || Refiner::new(self.hand, &self.config.refinement, payload),
                |refiner, candidate| {
                    let rest = RestingPose::of(&candidate.table_from_object);
                    let environment = Environment::new(Arc::clone(self.field), rest);
                    let refine = || {
                        if (self.is_canceled)() {
                            return Err(RefinementError::Canceled);
                        }
                        refiner.refine(&environment, &candidate.motion)
                    };
                    let refined = cpu_time::measured(refine);
                    (candidate, refined)
                },
            )
            .collect();
        let mut attempts: Vec<Attempt> = Vec::with_capacity(tried.len());
        let mut cpu_s = 0.0;
        for (candidate, (tried, took_s)) in tried {
            cpu_s += took_s;
            let refined = match tried {
                Ok(moved) => Ok(moved),
                Err(RefinementError::Motion(err)) => Err(err),
                Err(err) => return Err(err),
            };
            attempts.push(Attempt {
                refused: refused.take(&candidate.candidate_id),
                refined,
                candidate: Candidate {
                    generator: GENERATOR.to_owned(),
                    ..candidate
                },
            });
        }
        let drawn_n = attempts.len() as f64;
        let mut candidates: Vec<(Candidate, Refined)> = Vec::new();
        let mut draws = Draws::new();
        for rows in rows_of_motions(attempts, self.config) {
            draws.extend(rows.draws);
            candidates.extend(rows.kept);
        }
        draws.extend(refused.rest());
        let metrics = RefineMetrics::of(&candidates, drawn_n, cpu_s);
        let joints = self.hand.model.joint_names();
        let candidates = candidates
            .into_iter()
            .map(|(candidate, refined)| Candidate {
                motion: refined.motion,
                ..candidate
            });
        Ok(RefinedCandidates {
            candidates: Candidates {
                object: given.object,
                joints: joints.as_slice().into(),
                candidates: candidates.collect(),
            },
            draws,
            metrics,
        })
    }
}

impl RefineMetrics {
    /// Returns the metrics of candidates that are the best of so many draws, and took this time in seconds.
    fn of(candidates: &[(Candidate, Refined)], drawn_n: f64, cpu_s: f64) -> Self {
        let n = candidates.len() as f64;
        let mean = |of: fn(&Refined) -> f64| {
            candidates.iter().map(|(_, one)| of(one)).sum::<f64>() / n.max(1.0)
        };
        let depths_m = candidates.iter().map(|(_, one)| one.approach_penetration_m);
        Self {
            candidates: n,
            draws: drawn_n,
            palm_moved_m: mean(|one| one.palm_moved_m),
            approach_penetration_m: depths_m.fold(0.0, f64::max),
            cpu_s,
        }
    }
}

/// The draws that were refused before this stage, by the motion's name.
#[derive(Default)]
pub struct RefusedDraws(BTreeMap<String, Draws>);

impl RefusedDraws {
    fn read(inputs: &Inputs) -> Result<Self, LakeError> {
        let mut refused: BTreeMap<String, Draws> = BTreeMap::new();
        for draw in lake::table::read_draws(inputs.artifact(Candidates::NAME)?)? {
            if draw.refused.is_some() {
                let of_motion = refused.entry(draw.candidate_id.clone());
                of_motion.or_default().push(draw);
            }
        }
        Ok(Self(refused))
    }

    /// Takes those of a motion, in their order.
    fn take(&mut self, candidate_id: &str) -> Draws {
        self.0.remove(candidate_id).unwrap_or_default()
    }

    /// Returns those of motions that have no candidate.
    fn rest(self) -> impl Iterator<Item = Draw> {
        self.0.into_values().flatten()
    }
}

/// A motion that was to be refined.
struct Attempt {
    candidate: Candidate,
    /// Draws of it that were refused before.
    refused: Draws,
    /// The refined motion, or why none of the hand could be formed.
    refined: Result<Refined, MotionError>,
}

/// The rows of one motion.
struct MotionRows {
    /// The chosen draw; nothing if no motion could be formed of any.
    kept: Option<(Candidate, Refined)>,
    /// All draws, in their order.
    draws: Draws,
}

/// Makes of at least as many consecutive attempts with the same resting pose as the options say the rows of one motion.
fn rows_of_motions(attempts: Vec<Attempt>, config: &RefineConfig) -> Vec<MotionRows> {
    let rest = |attempt: &Attempt| attempt.candidate.table_from_object;
    let score = |attempt: &Attempt| {
        let refined = attempt.refined.as_ref().ok()?;
        Some(match config.choose_by {
            ChooseBy::Residual => (false, refined.residual_m2),
            ChooseBy::Change => (!refined.is_opposed, refined.joints_moved_rad),
        })
    };
    let choices = refinement::choose(attempts, config.draws, rest, score);
    let refusal = match config.choose_by {
        ChooseBy::Residual => Refusal::Residual,
        ChooseBy::Change => Refusal::Change,
    };
    let rows = choices
        .into_iter()
        .map(|choice| MotionRows::of(choice, refusal));
    rows.collect()
}

impl MotionRows {
    /// Names all draws of a motion by the chosen one, and counts them through; the others are refused for this reason.
    fn of(choice: Choice<Attempt>, refusal: Refusal) -> Self {
        let chosen = choice.draws.get(choice.chosen);
        let chosen_id = chosen.map(|attempt| attempt.candidate.candidate_id.clone());
        let candidate_id = chosen_id.unwrap_or_default();
        let (mut kept, mut rows) = (None, Draws::new());
        let mut before_n = 0;
        for (idx, attempt) in choice.draws.into_iter().enumerate() {
            let mut candidate = attempt.candidate;
            // Each may have draws of its own that were refused when it was drawn.
            let draws_n = attempt.refused.iter().map(|draw| draw.source.draw_n);
            let draws_n = draws_n.fold(candidate.source.draw_n, u32::max);
            let mut draws = attempt.refused;
            match attempt.refined {
                Ok(refined) => {
                    candidate.residual_m2 = Some(refined.residual_m2);
                    if idx == choice.chosen {
                        draws.push(Draw::kept(&candidate));
                        candidate.source.draw_n += before_n;
                        kept = Some((candidate, refined));
                    } else {
                        draws.push(Draw::refused(&candidate, refusal));
                    }
                }
                Err(fault) => {
                    draws.push(Draw::without_motion(&candidate, fault.to_string()));
                }
            }
            for mut draw in draws {
                draw.source.draw_n += before_n;
                draw.candidate_id.clone_from(&candidate_id);
                GENERATOR.clone_into(&mut draw.generator);
                rows.push(draw);
            }
            before_n += draws_n;
        }
        rows.sort_by_key(|draw| draw.source.draw_n);
        Self { kept, draws: rows }
    }
}

#[cfg(test)]
mod tests {
    use std::{fs, path::Path};

    use grasp_fixture::{HAND_TABLE, StandingBox, URDF, artifact};
    use motion::{Motion, Step};
    use nalgebra::{Isometry3, UnitQuaternion, Vector3};
    use schemas::candidates::{DrawSource, ObjectSplit, Origin};
    use spatial::Pose;

    use super::*;

    const BOX: StandingBox = StandingBox {
        half_m: [0.03, 0.04, 0.05],
    };

    /// Inputs of the stage besides the motions.
    const BOTH: [&str; 2] = [FieldInfo::NAME, Object::NAME];

    /// Returns options with their defaults.
    fn config() -> RefineConfig {
        let options = serde_json::json!({ "hand": URDF, "hand_table": HAND_TABLE });
        serde_json::from_value(options).unwrap()
    }

    /// The palm moves along x to the side of the box, and the fingers bend to a share of their ranges.
    fn reach(bend: f64) -> Motion<spatial::Object> {
        let hand = grasp_fixture::hand();
        let step = |number: i32| {
            let share = f64::from(number) / 20.0;
            let from_m = Vector3::new(0.25 * share - 0.3, 0.0, 0.05);
            let joints = hand.joints().iter();
            let q_rad =
                joints.map(|joint| joint.lower + share * bend * (joint.upper - joint.lower));
            Step {
                time_s: share,
                frame_from_palm: Pose::new(Isometry3::new(from_m, Vector3::new(0.1, 0.2, 0.0))),
                q_rad: q_rad.collect(),
                rates: (),
            }
        };
        let motion = Motion::new(&hand.joint_names(), (0..=20).map(step).collect()).unwrap();
        motion.differentiated().unwrap()
    }

    /// A motion of the Allegro to the box, drawn as the `draw_n`th.
    fn candidate(name: &str, draw_n: u32, bend: f64) -> Candidate {
        Candidate {
            candidate_id: name.to_owned(),
            generator: "cgf".to_owned(),
            source: DrawSource {
                draw_n,
                origin: Origin::Prior,
                demonstration: String::new(),
                object_split: Some(ObjectSplit::Seen),
            },
            latent: vec![bend],
            table_from_object: Pose::from_parts(
                Vector3::new(0.0, 0.0, BOX.half_m[2]),
                UnitQuaternion::identity(),
            ),
            limit_excess_rad: 0.1,
            depth_m: Some(0.02),
            residual_m2: None,
            motion: reach(bend),
        }
    }

    /// A draw of a motion that was refused when it was drawn.
    fn refused(name: &str, draw_n: u32) -> Draw {
        Draw::refused(&candidate(name, draw_n, 0.5), Refusal::Table)
    }

    /// Runs the stage on these motions and refused draws, with these of the box's artifacts; returns what it wrote.
    fn run(
        config: &RefineConfig,
        candidates: Vec<Candidate>,
        refused: Draws,
        with: &[&str],
    ) -> (Outcome<RefineMetrics>, Option<(Candidates, Draws)>) {
        let folder = tempfile::tempdir().unwrap();
        let outcome = try_run(config, candidates, refused, with, folder.path()).unwrap();
        let made = matches!(outcome, Outcome::Made(_));
        let read = made.then(|| {
            let out = artifact("box", &folder.path().join("out"));
            (
                lake::table::read(&out).unwrap(),
                lake::table::read(&out).unwrap(),
            )
        });
        (outcome, read)
    }

    /// As [`run`], in a folder, where it may fail.
    fn try_run(
        config: &RefineConfig,
        candidates: Vec<Candidate>,
        refused: Draws,
        with: &[&str],
        folder: &Path,
    ) -> Result<Outcome<RefineMetrics>, BoxedDiagnostic> {
        let [given, out] = ["given", "out"].map(|name| {
            let path = folder.join(name);
            fs::create_dir(&path).unwrap();
            path
        });
        let kept = candidates.iter().map(Draw::kept);
        lake::table::write(&given, &refused.into_iter().chain(kept).collect::<Draws>()).unwrap();
        let given_candidates = Candidates {
            object: "box".to_owned(),
            joints: Arc::clone(candidates[0].motion.joints()),
            candidates,
        };
        lake::table::write(&given, &given_candidates).unwrap();
        let mut artifacts = BOX.artifacts(folder, &[], with.contains(&FieldInfo::NAME));
        if !with.contains(&Object::NAME) {
            artifacts.remove(Object::NAME);
        }
        let given = vec![artifact("box", &given)];
        artifacts.insert(Candidates::NAME.to_owned(), given);
        let inputs = grasp_fixture::inputs(&artifacts);
        let cx = Context::detached(&"box".parse().unwrap(), 0, &out);
        Refine::read_and_make(config, &inputs, &cx)
    }

    #[test]
    fn of_at_least_two_draws_the_one_with_the_smallest_residual_is_the_candidate() {
        let mut drawn = Vec::new();
        for (name, bend) in [("box-0", 0.55), ("box-1", 0.05), ("box-2", 0.05)] {
            drawn.push(candidate(name, 1, bend));
        }
        // The second had been drawn before.
        drawn[1].source.draw_n = 2;
        let before = vec![refused("box-1", 1)];
        let single = RefineConfig {
            draws: 1,
            ..config()
        };
        let (_, each) = run(&single, drawn.clone(), before.clone(), &BOTH);
        let each = each.unwrap().0.candidates;
        assert_eq!(each.len(), 3);
        assert!(each[0].residual_m2 < each[1].residual_m2);
        let best = RefineConfig { draws: 2, ..single };
        let (outcome, found) = run(&best, drawn, before, &BOTH);
        let Outcome::Made(metrics) = outcome else {
            panic!("not made");
        };
        assert_eq!([metrics.draws, metrics.candidates], [3.0, 1.0]);
        let (found, rows) = found.unwrap();
        let found = found.candidates;
        let names: Vec<&str> = found.iter().map(|one| one.candidate_id.as_str()).collect();
        assert_eq!(names, ["box-0"]);
        let first = &found[0];
        assert_eq!(first.motion, each[0].motion);
        assert_eq!(first.residual_m2, each[0].residual_m2);
        assert_eq!((first.limit_excess_rad, first.depth_m), (0.1, Some(0.02)));
        assert!(rows.iter().all(|draw| draw.generator == "refine"));
        let rows: Vec<(&str, u32, Option<Refusal>, Option<f64>)> = rows
            .iter()
            .map(|draw| {
                let name = draw.candidate_id.as_str();
                (name, draw.source.draw_n, draw.refused, draw.residual_m2)
            })
            .collect();
        let residual_m2: Vec<Option<f64>> = each.iter().map(|one| one.residual_m2).collect();
        let expected = [
            ("box-0", 1, None, residual_m2[0]),
            ("box-0", 2, Some(Refusal::Table), None),
            ("box-0", 3, Some(Refusal::Residual), residual_m2[1]),
            ("box-0", 4, Some(Refusal::Residual), residual_m2[2]),
        ];
        assert_eq!(rows, expected);
        assert_eq!(first.source.draw_n, 1);
        assert!(found.iter().all(|one| one.generator == "refine"));
    }

    #[test]
    fn draws_compete_only_with_the_same_resting_pose_and_whichever_comes_first() {
        let config = RefineConfig {
            draws: 2,
            ..config()
        };
        let [weak, strong] = [0.05, 0.55];
        let mut drawn = vec![
            candidate("box-0", 1, weak),
            candidate("box-1", 1, weak),
            candidate("box-2", 1, strong),
            candidate("box-3", 1, strong),
        ];
        // The second and the last lie turned: each competes with the other alone.
        for idx in [1, 3] {
            drawn[idx].table_from_object = Pose::from_parts(
                Vector3::new(0.0, 0.0, BOX.half_m[2]),
                UnitQuaternion::from_euler_angles(0.0, 0.0, 0.3),
            );
        }
        let (_, found) = run(&config, drawn, Draws::new(), &BOTH);
        let (found, rows) = found.unwrap();
        let kept: Vec<(&str, u32)> = found
            .candidates
            .iter()
            .map(|one| (one.candidate_id.as_str(), one.source.draw_n))
            .collect();
        assert_eq!(kept, [("box-2", 2), ("box-3", 2)]);
        let names = rows.iter().map(|draw| draw.candidate_id.as_str());
        assert!(names.eq(["box-2", "box-2", "box-3", "box-3"]));
    }

    #[test]
    fn an_object_without_distances_or_mass_is_skipped_and_motions_of_another_hand_are_an_error() {
        let config = config();
        let skipped = |candidates: Vec<Candidate>, with: &[&str]| {
            let (outcome, made) = run(&config, candidates, Draws::new(), with);
            assert!(made.is_none());
            match outcome {
                Outcome::Skipped { reason } => reason,
                _ => panic!("not skipped"),
            }
        };
        let whole = candidate("box-0", 1, 0.5);
        let reason = skipped(vec![whole.clone()], &[Object::NAME]);
        assert!(reason.contains("distance field"), "{reason}");
        let reason = skipped(vec![whole.clone()], &[FieldInfo::NAME]);
        assert!(reason.contains("object missing"), "{reason}");
        let mut other = candidate("box-1", 1, 0.5);
        let names: Vec<String> = (0..whole.motion.joints().len())
            .map(|joint| format!("of_another_hand_{joint}"))
            .collect();
        other.motion =
            motion::Motion::of_joints(names.as_slice().into(), whole.motion.steps().to_vec())
                .unwrap();
        let folder = tempfile::tempdir().unwrap();
        let err = try_run(&config, vec![other], Draws::new(), &BOTH, folder.path()).unwrap_err();
        let said = err.to_string();
        assert!(said.contains("`box`") && said.contains(URDF), "{said}");
        assert!(err.hint().unwrap().contains("in `refine`"));
    }

    /// The draw that was changed least is chosen whatever its residual is, but not one whose thumb nothing opposes.
    #[test]
    fn the_draw_that_was_changed_least_is_chosen_if_a_finger_opposes_its_thumb() {
        let attempt = |name: &str, residual_m2, joints_moved_rad, is_opposed| Attempt {
            candidate: candidate(name, 1, 0.5),
            refused: Draws::new(),
            refined: Ok(Refined {
                motion: candidate("", 1, 0.5).motion,
                residual_m2,
                joints_moved_rad,
                is_opposed,
                palm_moved_m: 0.0,
                approach_penetration_m: 0.0,
            }),
        };
        let config = RefineConfig {
            draws: 3,
            choose_by: ChooseBy::Change,
            ..config()
        };
        let attempts = vec![
            attempt("box-0", 1e-6, 0.9, true),
            attempt("box-1", 1e-4, 0.3, true),
            attempt("box-2", 2e-2, 0.1, false),
        ];
        let motions = rows_of_motions(attempts, &config);
        let [only] = &motions[..] else {
            panic!("one motion");
        };
        assert_eq!(only.kept.as_ref().unwrap().0.candidate_id, "box-1");
        let refusals: Vec<Option<Refusal>> = only.draws.iter().map(|draw| draw.refused).collect();
        assert_eq!(
            refusals,
            [Some(Refusal::Change), None, Some(Refusal::Change)]
        );
    }

    #[test]
    fn a_motion_that_cannot_be_formed_is_a_refused_draw_and_the_others_go_on() {
        let refined = |residual_m2| Refined {
            motion: candidate("", 1, 0.5).motion,
            residual_m2,
            joints_moved_rad: 0.0,
            is_opposed: true,
            palm_moved_m: 0.0,
            approach_penetration_m: 0.0,
        };
        let attempt = |name: &str, refined: Result<Refined, MotionError>| Attempt {
            candidate: candidate(name, 1, 0.5),
            refused: Draws::new(),
            refined,
        };
        let unformed = || Err(MotionError::Number { step: 1 });
        let attempts = vec![
            attempt("box-0", unformed()),
            attempt("box-1", Ok(refined(0.5))),
            attempt("box-2", unformed()),
            attempt("box-3", unformed()),
        ];
        let pairs = RefineConfig {
            draws: 2,
            ..config()
        };
        let motions = rows_of_motions(attempts, &pairs);
        let [some, none] = &motions[..] else {
            panic!("two pairs of draws");
        };
        assert_eq!(some.kept.as_ref().unwrap().0.candidate_id, "box-1");
        assert!(none.kept.is_none());
        let refusals = |rows: &MotionRows| -> Vec<(Option<Refusal>, String)> {
            let draws = rows.draws.iter();
            draws
                .map(|draw| (draw.refused, draw.fault.clone()))
                .collect()
        };
        let refused = (
            Some(Refusal::Motion),
            "step 1 has a number that is missing or not finite".to_owned(),
        );
        assert_eq!(refusals(some), [refused.clone(), (None, String::new())]);
        assert_eq!(refusals(none), [refused.clone(), refused]);
    }
}
