//! The stage: one unit per object.

use std::sync::Arc;

use dataflow::{
    BoxedDiagnostic, Context, Line, Max, Mean, OptionsUsed, Outcome, Output, Outputs, Scope, Stage,
    Sum, Unit,
};
use geometry::DistanceField;
use hand_files::HandFiles;
use lake::{ReadArtifact, WriteArtifact};
use posture::{Environment, Hand};
use rayon::prelude::*;
use schemas::{
    Table,
    candidates::{Candidate, Candidates, Refusal, RefusedDraw},
    distance_fields::{self, FieldInfo},
    objects::Object,
};
use spatial::RestingPose;

use crate::{
    RefineConfig, RefineError,
    refiner::{Payload, Refined, Refiner},
};

/// Refines candidate motions against object and table before physics.
pub struct Refine;

/// The refinement of a draw, and the processor time that it took in seconds.
type TimedRefinement = (Result<Refined, RefineError>, f64);

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
    /// What a unit reads: an object's motions, its distances, the object and the hand.
    pub struct RefineInputs {
        /// The motions.
        each candidates: Candidates [lake::table::FILE], "to refine";
        /// The distances from the object.
        own field: DistanceField = FieldInfo,
            |field| field.parsed(distance_fields::FIELD, DistanceField::from_bytes),
            or "object has no distance field";
        /// The object.
        own object: Object, or "object missing";
    }
    files {
        /// The hand.
        hand: Hand = hand_files::hand;
    }
}

impl Stage for Refine {
    type Config = RefineConfig;

    const KIND: &'static str = "refine";
    const ABOUT: &'static str = "Refines candidate motions against object and table before physics";
    const INPUTS: &'static [&'static str] = RefineInputs::INPUTS;
    const OUTPUTS: Outputs<Self> = &[&Self];

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
            candidates: given,
            field,
            object,
            hand,
        } = inputs;
        let field = Arc::new(field);
        let payload = Payload {
            center_of_mass_in_object: object.center_of_mass_m.into(),
            mass_kg: object.mass_kg,
        };
        let tried: Vec<(Candidate, TimedRefinement)> = given
            .candidates
            .into_par_iter()
            .map_init(
                || Refiner::new(&hand, config, payload),
                |refiner, candidate| {
                    let rest = RestingPose::of(&candidate.table_from_object);
                    let environment = Environment::new(Arc::clone(&field), rest);
                    let refine = || refiner.refine(&environment, &candidate.motion);
                    let refined = cpu_time::measured(refine);
                    (candidate, refined)
                },
            )
            .collect();
        let mut refined: Vec<(Candidate, Refined)> = Vec::new();
        let mut cpu_s = 0.0;
        for (candidate, (tried, took_s)) in tried {
            cpu_s += took_s;
            match tried {
                Ok(moved) => refined.push((candidate, moved)),
                Err(RefineError::Motion(err)) => {
                    let id = candidate.candidate_id;
                    return Ok(Outcome::skipped(format!("candidate `{id}`: {err}")));
                }
                Err(err) => return Err(err.into()),
            }
        }
        let drawn_n = refined.len() as f64;
        let candidates = best_of(refined, config.draws);
        let n = candidates.len() as f64;
        let mean = |of: fn(&Refined) -> f64| {
            candidates.iter().map(|(_, one)| of(one)).sum::<f64>() / n.max(1.0)
        };
        let depths_m = candidates.iter().map(|(_, one)| one.approach_penetration_m);
        let metrics = RefineMetrics {
            candidates: n,
            draws: drawn_n,
            palm_moved_m: mean(|one| one.palm_moved_m),
            approach_penetration_m: depths_m.fold(0.0, f64::max),
            cpu_s,
        };
        let joints = hand.model.joint_names();
        cx.write(&Candidates {
            object: given.object,
            joints: joints.as_slice().into(),
            candidates: candidates
                .into_iter()
                .map(|(candidate, refined)| Candidate {
                    generator: GENERATOR.to_owned(),
                    motion: refined.motion,
                    ..candidate
                })
                .collect(),
        })?;
        Ok(Outcome::Made(metrics))
    }
}

/// Makes of `draws` motions in a row, of an object that lies alike, draws of one motion: the candidate is the one with
/// the smallest residual. Which way the object lies is not chosen.
fn best_of(refined: Vec<(Candidate, Refined)>, draws: usize) -> Vec<(Candidate, Refined)> {
    let mut by_rest: Vec<Vec<(usize, Candidate, Refined)>> = Vec::new();
    for (number, (candidate, one)) in refined.into_iter().enumerate() {
        let rest = &candidate.table_from_object;
        let alike = by_rest.iter_mut().find(|group| {
            let first = group.first();
            first.is_some_and(|(_, other, _)| other.table_from_object == *rest)
        });
        match alike {
            Some(group) => group.push((number, candidate, one)),
            None => by_rest.push(vec![(number, candidate, one)]),
        }
    }
    let mut chosen: Vec<(usize, Candidate, Refined)> = Vec::new();
    for group in by_rest {
        let mut group = group.into_iter().peekable();
        while group.peek().is_some() {
            chosen.extend(best(group.by_ref().take(draws)));
        }
    }
    chosen.sort_by_key(|(number, ..)| *number);
    let chosen = chosen.into_iter();
    chosen.map(|(_, candidate, one)| (candidate, one)).collect()
}

/// Returns the motion with the smallest residual, the others among its refused draws, in their order.
fn best(
    draws: impl Iterator<Item = (usize, Candidate, Refined)>,
) -> Option<(usize, Candidate, Refined)> {
    let mut best: Option<(usize, Candidate, Refined)> = None;
    let mut refused: Vec<RefusedDraw> = Vec::new();
    let mut before_n = 0;
    for (number, mut candidate, one) in draws {
        // Each may have draws of its own that were refused when it was drawn.
        let draws_n = candidate.refused.iter().map(|draw| draw.source.draw_n);
        let draws_n = draws_n.fold(candidate.source.draw_n, u32::max);
        candidate.source.draw_n += before_n;
        for mut draw in std::mem::take(&mut candidate.refused) {
            draw.source.draw_n += before_n;
            refused.push(draw);
        }
        before_n += draws_n;
        candidate.residual_m2 = Some(one.residual_m2);
        let worse = match best.take() {
            Some(kept) if kept.2.residual_m2 <= one.residual_m2 => {
                best = Some(kept);
                Some(candidate)
            }
            before => {
                best = Some((number, candidate, one));
                before.map(|(_, candidate, _)| candidate)
            }
        };
        refused.extend(worse.map(|worse| RefusedDraw {
            source: worse.source,
            table_from_object: worse.table_from_object,
            limit_excess_rad: worse.limit_excess_rad,
            depth_m: worse.depth_m,
            residual_m2: worse.residual_m2,
            refusal: Refusal::Residual,
        }));
    }
    refused.sort_by_key(|draw| draw.source.draw_n);
    best.map(|(number, candidate, one)| {
        (
            number,
            Candidate {
                refused,
                ..candidate
            },
            one,
        )
    })
}

#[cfg(test)]
mod tests {
    use std::{collections::BTreeMap, fs, path::Path};

    use dataflow::{Artifact, Inputs, SourceFile};
    use schemas::candidates::{DrawSource, ObjectSplit, Origin};
    use spatial::Pose;

    use super::*;
    use crate::fixture;

    /// Inputs of the stage besides the motions.
    const BOTH: [&str; 2] = [FieldInfo::NAME, Object::NAME];

    /// A motion of the Allegro to the box, drawn as the `draw_n`th.
    fn candidate(name: &str, draw_n: u32, bend: f64) -> Candidate {
        let hand = fixture::hand();
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
                nalgebra::Vector3::new(0.0, 0.0, fixture::BOX_HALF_M[2]),
                nalgebra::UnitQuaternion::identity(),
            ),
            limit_excess_rad: 0.1,
            depth_m: Some(0.02),
            residual_m2: None,
            motion: fixture::reach(&hand, 0.0, bend),
            refused: Vec::new(),
        }
    }

    fn refused(draw_n: u32) -> RefusedDraw {
        let of = candidate("", draw_n, 0.5);
        RefusedDraw {
            source: of.source,
            table_from_object: of.table_from_object,
            limit_excess_rad: 0.0,
            depth_m: Some(0.03),
            residual_m2: None,
            refusal: Refusal::Table,
        }
    }

    fn artifact(folder: &Path) -> Artifact {
        let files = [lake::table::FILE, distance_fields::FIELD];
        let files = files.map(|file| (file.to_owned(), folder.join(file)));
        Artifact {
            key: "box".parse().unwrap(),
            labels: BTreeMap::new(),
            files: files
                .into_iter()
                .filter(|(_, path)| path.exists())
                .collect(),
        }
    }

    /// The box among the objects; only its mass counts here.
    fn object() -> Object {
        Object {
            name: "box".to_owned(),
            mass_kg: fixture::payload().mass_kg,
            center_of_mass_m: [0.0; 3],
            inertia_kg_m2: [0.0; 6],
            points_m: Vec::new(),
            normals: Vec::new(),
            watertight: true,
            mirror: None,
            vertices_m: Vec::new(),
            triangles: Vec::new(),
            parts_m: Vec::new(),
            rests: Vec::new(),
        }
    }

    /// Runs the stage on these motions, with these of the box's artifacts; returns what it wrote.
    fn run(
        config: &RefineConfig,
        candidates: Vec<Candidate>,
        with: &[&str],
    ) -> (Outcome<RefineMetrics>, Option<Candidates>) {
        let folder = tempfile::tempdir().unwrap();
        let [given, fields, objects, out] = ["given", "fields", "objects", "out"].map(|name| {
            let path = folder.path().join(name);
            fs::create_dir(&path).unwrap();
            path
        });
        let given_candidates = Candidates {
            object: "box".to_owned(),
            joints: Arc::clone(candidates[0].motion.joints()),
            candidates,
        };
        lake::table::write(&given, &given_candidates).unwrap();
        let mut artifacts = BTreeMap::from([(Candidates::NAME.to_owned(), vec![artifact(&given)])]);
        if with.contains(&Object::NAME) {
            lake::table::write(&objects, &object()).unwrap();
            artifacts.insert(Object::NAME.to_owned(), vec![artifact(&objects)]);
        }
        if with.contains(&FieldInfo::NAME) {
            let info = FieldInfo {
                spacing_m: 0.0025,
                margin_m: 0.025,
                center_of_mass_m: [0.0; 3],
                hull_m: vec![[0.0; 3]],
            };
            lake::table::write(&fields, &info).unwrap();
            fs::write(
                fields.join(distance_fields::FIELD),
                fixture::field().to_bytes(),
            )
            .unwrap();
            artifacts.insert(FieldInfo::NAME.to_owned(), vec![artifact(&fields)]);
        }
        let files = [
            SourceFile::named("hand", Path::new(fixture::URDF)),
            SourceFile::named("hand_table", Path::new(fixture::TABLE)),
        ];
        let inputs = Inputs::new(artifacts, files.to_vec());
        let cx = Context::detached(&"box".parse().unwrap(), 0, &out);
        let outcome = Refine::read_and_make(config, &inputs, &cx).unwrap();
        let made = matches!(outcome, Outcome::Made(_));
        let read = made.then(|| lake::table::read(&artifact(&out)).unwrap());
        (outcome, read)
    }

    #[test]
    fn of_every_two_draws_the_one_with_the_smaller_residual_is_the_candidate() {
        let mut drawn = Vec::new();
        for (name, bend) in [("box-0", 0.55), ("box-1", 0.05), ("box-2", 0.05)] {
            drawn.push(candidate(name, 1, bend));
        }
        // The second had been drawn before.
        drawn[1].source.draw_n = 2;
        drawn[1].refused = vec![refused(1)];
        let single = RefineConfig {
            draws: 1,
            ..fixture::config()
        };
        let (_, each) = run(&single, drawn.clone(), &BOTH);
        let each = each.unwrap().candidates;
        assert_eq!(each.len(), 3);
        assert!(each[0].residual_m2 < each[1].residual_m2);
        let best = RefineConfig { draws: 2, ..single };
        let (outcome, found) = run(&best, drawn, &BOTH);
        let Outcome::Made(metrics) = outcome else {
            panic!("not made");
        };
        assert_eq!([metrics.draws, metrics.candidates], [3.0, 2.0]);
        let found = found.unwrap().candidates;
        let names: Vec<&str> = found.iter().map(|one| one.candidate_id.as_str()).collect();
        assert_eq!(names, ["box-0", "box-2"]);
        let first = &found[0];
        assert_eq!(first.motion, each[0].motion);
        assert_eq!(first.residual_m2, each[0].residual_m2);
        assert_eq!((first.limit_excess_rad, first.depth_m), (0.1, Some(0.02)));
        let others: Vec<(u32, Refusal, Option<f64>)> = first
            .refused
            .iter()
            .map(|draw| (draw.source.draw_n, draw.refusal, draw.residual_m2))
            .collect();
        let second = each[1].residual_m2;
        assert_eq!(
            others,
            [(2, Refusal::Table, None), (3, Refusal::Residual, second)]
        );
        assert_eq!(first.source.draw_n, 1);
        assert!(found[1].refused.is_empty());
        assert!(found.iter().all(|one| one.generator == "refine"));
    }

    #[test]
    fn draws_compete_only_with_the_same_resting_pose_and_whichever_comes_first() {
        let config = RefineConfig {
            draws: 2,
            ..fixture::config()
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
                nalgebra::Vector3::new(0.0, 0.0, fixture::BOX_HALF_M[2]),
                nalgebra::UnitQuaternion::from_euler_angles(0.0, 0.0, 0.3),
            );
        }
        let (_, found) = run(&config, drawn, &BOTH);
        let found = found.unwrap().candidates;
        let kept: Vec<(&str, u32, usize)> = found
            .iter()
            .map(|one| {
                let name = one.candidate_id.as_str();
                (name, one.source.draw_n, one.refused.len())
            })
            .collect();
        assert_eq!(kept, [("box-2", 2, 1), ("box-3", 2, 1)]);
    }

    #[test]
    fn an_object_without_distances_or_mass_and_a_motion_of_another_hand_are_skipped_with_the_reason()
     {
        let config = fixture::config();
        let skipped = |candidates: Vec<Candidate>, with: &[&str]| {
            let (outcome, made) = run(&config, candidates, with);
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
        let reason = skipped(vec![other], &BOTH);
        assert!(reason.contains("`box-1`"), "{reason}");
    }
}
