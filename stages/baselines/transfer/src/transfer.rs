//! The stage: one unit per object.

use std::collections::BTreeSet;

use dataflow::{
    BoxedDiagnostic, Context, InputError, Line, OptionsUsed, Outcome, Output, Outputs, Partition,
    Scope, Stage, Sum, Unit,
};
use lake::WriteArtifact;
use motion::Motion;
use rand::{SeedableRng, seq::SliceRandom};
use rand_chacha::ChaCha8Rng;
use schemas::{
    Table,
    candidates::{Candidate, Candidates, DrawSource},
    objects::Object,
    trajectories::Trajectory,
};
use spatial::{Object as InObject, RestingPose};

use crate::{
    TransferConfig, TransferError, TransferSource,
    footprint::{object_from_footprint, sides},
    mean::mean,
};

/// Carries demonstrations to other objects.
pub struct Transfer;

dataflow::metrics! {
    /// Metrics of an object's candidates.
    pub struct TransferMetrics {
        /// Number of candidates.
        candidates: Sum,
    }
}

/// Generator name of the candidates.
const GENERATOR: &str = "transfer";

/// The label of a trajectory that names its object.
const OBJECT: &str = "object";

lake::inputs! {
    /// What a unit reads: an object, and the demonstrations that are carried to it with their objects.
    pub struct TransferInputs {
        /// The object.
        each object: Object;
        /// The other objects.
        others objects: Object;
        /// The demonstrations.
        added trajectories: Trajectory;
    }
}

impl Stage for Transfer {
    type Config = TransferConfig;

    const KIND: &'static str = "transfer";
    const ABOUT: &'static str = "Applies demonstrations to other objects, without learning";
    const INPUTS: &'static [&'static str] = &[Trajectory::NAME, Object::NAME];
    const OUTPUTS: Outputs<Self> = &[&Self];
}

impl Output for Transfer {
    type Stage = Self;
    type Metrics = TransferMetrics;
    type Inputs<'a> = TransferInputs;

    const ARTIFACT: &'static str = Candidates::NAME;
    const SCHEMA: &'static str = Candidates::VERSION;
    const PARTITION: &'static str = Candidates::PARTITION;
    const LINE: Option<Line<TransferMetrics>> = Some(|summary| {
        let candidates = summary.metrics.candidates;
        format!("{} objects → {candidates} candidates", summary.n_made)
    });
    /// These choose units, or what they read.
    const OPTIONS: OptionsUsed = OptionsUsed::Except(&["objects", "unseen_objects", "unseen_fold"]);

    fn units(config: &TransferConfig, scope: &Scope) -> Result<Vec<Unit>, BoxedDiagnostic> {
        let objects_of = scope.partitions(Trajectory::NAME).iter();
        let demonstrated: BTreeSet<&str> = objects_of.filter_map(|one| one.label(OBJECT)).collect();
        let unseen = config.unseen.of(&demonstrated);
        let added = |unit: Unit| {
            let object = unit.partition.clone();
            let is_own = |one: &&Partition| one.label(OBJECT) == Some(object.as_str());
            let is_seen =
                |one: &&Partition| !one.label(OBJECT).is_some_and(|of| unseen.contains(of));
            let trajectories = scope.partitions(Trajectory::NAME).iter().filter(is_seen);
            if config.from == TransferSource::Mean {
                let own = trajectories.filter(is_own);
                return unit.reading(Trajectory::NAME, own.map(|one| &one.key));
            }
            let others = scope.partitions(Object::NAME).iter();
            let others = others.filter(|other| {
                let name = other.key.as_str();
                name != object && demonstrated.contains(name) && !unseen.contains(name)
            });
            let shown = trajectories.filter(|one| !is_own(one));
            unit.reading(Object::NAME, others.map(|one| &one.key))
                .reading(Trajectory::NAME, shown.map(|one| &one.key))
        };
        let units = TransferInputs::units(scope, &config.objects)?.into_iter();
        Ok(units.map(added).collect())
    }

    fn make(
        config: &TransferConfig,
        TransferInputs {
            object,
            objects,
            trajectories,
        }: TransferInputs,
        cx: &Context,
    ) -> Result<Outcome<TransferMetrics>, BoxedDiagnostic> {
        let Some(joints) = approach::joints_of(&trajectories)? else {
            return Ok(Outcome::skipped("no demonstration to carry over"));
        };
        let motions = match config.from {
            TransferSource::Mean => means(&object, &trajectories)?,
            TransferSource::Nearest => {
                let nearest = nearest(&object, &objects, &trajectories)?;
                let of_nearest = trajectories
                    .iter()
                    .filter(|trajectory| trajectory.object == nearest);
                carried(&object, &objects, of_nearest.take(config.per_object))?
            }
            TransferSource::Other => {
                let mut order: Vec<&Trajectory> = trajectories.iter().collect();
                order.shuffle(&mut ChaCha8Rng::seed_from_u64(cx.seed()));
                carried(&object, &objects, order.into_iter().take(config.per_object))?
            }
        };
        let candidates: Vec<Candidate> = motions
            .into_iter()
            .enumerate()
            .map(|(idx, carried)| carried.candidate(format!("{}-{idx:05}", object.name)))
            .collect();
        let metrics = TransferMetrics {
            candidates: candidates.len() as f64,
        };
        cx.write(&Candidates {
            object: object.name,
            joints,
            candidates,
        })?;
        Ok(Outcome::Made(metrics))
    }
}

/// A motion for an object that lies so.
struct TransferredMotion {
    rest: RestingPose,
    /// The sequence that it was carried from; empty for a mean.
    sequence: String,
    motion: Motion<InObject>,
}

impl TransferredMotion {
    fn candidate(self, candidate_id: String) -> Candidate {
        Candidate {
            candidate_id,
            generator: GENERATOR.to_owned(),
            source: DrawSource::replayed(&self.sequence),
            latent: Vec::new(),
            table_from_object: self.rest.table_from_object(),
            limit_excess_rad: 0.0,
            depth_m: None,
            residual_m2: None,
            motion: self.motion,
        }
    }
}

/// Returns the mean of an object's demonstrations for each of its resting orientations that has any.
fn means(
    object: &Object,
    trajectories: &[Trajectory],
) -> Result<Vec<TransferredMotion>, TransferError> {
    let angle =
        |rest: &RestingPose, other: &RestingPose| rest.up_in_object.angle(&other.up_in_object);
    let mut carried = Vec::new();
    for (idx, orientation) in object.rests.iter().enumerate() {
        let lies_so = |trajectory: &&Trajectory| {
            let angles = object
                .rests
                .iter()
                .map(|other| angle(&other.rest, &trajectory.rest));
            let least = angles.enumerate().min_by(|(_, a), (_, b)| a.total_cmp(b));
            least.is_some_and(|(nearest, _)| nearest == idx)
        };
        let motions: Vec<_> = trajectories
            .iter()
            .filter(lies_so)
            .map(|trajectory| &trajectory.motion)
            .collect();
        if let Some(motion) = mean(&motions)? {
            carried.push(TransferredMotion {
                rest: orientation.rest,
                sequence: String::new(),
                motion,
            });
        }
    }
    if carried.is_empty() {
        return Err(TransferError::Incomplete {
            object: object.name.clone(),
            missing: "resting orientation",
        });
    }
    Ok(carried)
}

/// Returns the other object with demonstrations whose box has the most similar sides, by the sum of the squares of
/// their differences; of equally similar ones the first by name.
fn nearest<'a>(
    object: &Object,
    objects: &'a [Object],
    trajectories: &[Trajectory],
) -> Result<&'a str, BoxedDiagnostic> {
    let sides_of = |object: &Object| {
        let missing = || TransferError::Incomplete {
            object: object.name.clone(),
            missing: "points",
        };
        sides(&object.points_m).ok_or_else(missing)
    };
    let own = sides_of(object)?;
    let mut best: Option<(f64, &str)> = None;
    for other in objects {
        if !trajectories.iter().any(|known| known.object == other.name) {
            continue;
        }
        let pairs = own.into_iter().zip(sides_of(other)?);
        let distance: f64 = pairs.map(|(a, b)| (a - b).powi(2)).sum();
        if best.is_none_or(|(least, _)| distance < least) {
            best = Some((distance, &other.name));
        }
    }
    let none = InputError::Empty {
        input: Trajectory::NAME,
        to_do: "of other objects to carry over",
    };
    Ok(best.map(|(_, name)| name).ok_or(none)?)
}

/// Carries demonstrations to an object, box to box; its resting orientations take turns, each as often as it was
/// demonstrated or, of an object without demonstrations, as it is probable.
fn carried<'a>(
    object: &Object,
    objects: &[Object],
    trajectories: impl Iterator<Item = &'a Trajectory>,
) -> Result<Vec<TransferredMotion>, TransferError> {
    let missing = |name: &str, missing| TransferError::Incomplete {
        object: name.to_owned(),
        missing,
    };
    let trajectories: Vec<&Trajectory> = trajectories.collect();
    let n = trajectories.len() as f64;
    let mut all = Vec::with_capacity(trajectories.len());
    for (idx, trajectory) in trajectories.into_iter().enumerate() {
        let source = objects.iter().find(|known| known.name == trajectory.object);
        let source = source.ok_or_else(|| missing(&trajectory.object, "row among the objects"))?;
        let rest = rest_at(object, (idx as f64 + 0.5) / n)
            .ok_or_else(|| missing(&object.name, "resting orientation"))?;
        let from = object_from_footprint(&source.points_m, &trajectory.rest);
        let from = from.ok_or_else(|| missing(&source.name, "points"))?;
        let to = object_from_footprint(&object.points_m, &rest)
            .ok_or_else(|| missing(&object.name, "points"))?;
        let object_from_source = to * from.inverse();
        let motion = trajectory.motion.with_rates(|_| ())?;
        all.push(TransferredMotion {
            rest,
            sequence: trajectory.sequence.clone(),
            motion: motion.expressed_in(&object_from_source).differentiated()?,
        });
    }
    Ok(all)
}

/// Returns the resting orientation at a share, 0 to 1, of all of an object's by their weights.
fn rest_at(object: &Object, share: f64) -> Option<RestingPose> {
    let is_seen = object.rests.iter().any(|rest| rest.seen_n > 0);
    let weights = object.rests.iter().map(|rest| {
        let weight = if is_seen {
            f64::from(rest.seen_n)
        } else {
            rest.probability
        };
        (weight, rest.rest)
    });
    let total: f64 = weights.clone().map(|(weight, _)| weight).sum();
    let mut sum = 0.0;
    for (weight, rest) in weights.clone() {
        sum += weight;
        if sum >= share * total {
            return Some(rest);
        }
    }
    object.rests.last().map(|last| last.rest)
}

#[cfg(test)]
mod tests {
    use std::{collections::BTreeMap, path::Path};

    use dataflow::{Artifact, Inputs, Partition};
    use folds::UnseenObjects;
    use motion::Step;
    use nalgebra::{Isometry3, UnitQuaternion, Vector3};
    use schemas::{
        objects::RestingOrientation,
        trajectories::{Tracking, TrajectoryRates},
    };
    use spatial::Pose;

    use super::*;

    fn unseen(names: &[&str]) -> UnseenObjects {
        UnseenObjects {
            unseen_objects: names.iter().map(|&name| name.to_owned()).collect(),
            unseen_fold: None,
        }
    }

    /// A box that stands on its own -z: these sides, its center at its origin.
    fn object(name: &str, sides: [f64; 3]) -> Object {
        let corner = |bits: usize| [0, 1, 2].map(|k| sides[k] * (((bits >> k) & 1) as f64 - 0.5));
        Object {
            name: name.to_owned(),
            mass_kg: 0.1,
            center_of_mass_m: [0.0; 3],
            inertia_kg_m2: [1e-4, 1e-4, 1e-4, 0.0, 0.0, 0.0],
            points_m: (0..8).map(corner).collect(),
            normals: vec![[0.0, 0.0, 1.0]; 8],
            watertight: true,
            mirror: None,
            vertices_m: Vec::new(),
            triangles: Vec::new(),
            parts_m: Vec::new(),
            rests: vec![RestingOrientation {
                rest: RestingPose {
                    up_in_object: Vector3::z_axis(),
                    height_m: sides[2] / 2.0,
                },
                seen_n: 1,
                probability: 1.0,
            }],
        }
    }

    /// A reach along x, in the object's frame, that ends 1 cm beside its center.
    fn trajectory(sequence: &str, object: &Object) -> Trajectory {
        let step = |time_s: f64| Step {
            time_s,
            frame_from_palm: Pose::new(Isometry3::translation(
                0.2 * (1.0 - time_s) + 0.01,
                0.0,
                0.02,
            )),
            q_rad: vec![time_s],
            rates: TrajectoryRates::zero(1),
        };
        Trajectory {
            sequence: sequence.to_owned(),
            object: object.name.clone(),
            keypoints: Vec::new(),
            tips: Vec::new(),
            rest: object.rests[0].rest,
            motion: Motion::new(&["j"], vec![step(0.0), step(0.5), step(1.0)]).unwrap(),
            tracking: vec![Tracking::default(); 3],
        }
    }

    fn artifact<T: Table>(folder: &Path, key: &str, table: &T) -> Artifact {
        let folder = folder.join(key);
        std::fs::create_dir_all(&folder).unwrap();
        lake::table::write(&folder, table).unwrap();
        let file = lake::table::FILE;
        Artifact {
            key: key.parse().unwrap(),
            labels: BTreeMap::new(),
            files: BTreeMap::from([(file.to_owned(), folder.join(file))]),
        }
    }

    /// The candidates for `can`.
    fn made(
        from: TransferSource,
        objects: &[Object],
        trajectories: &[Trajectory],
    ) -> Vec<Candidate> {
        let folder = tempfile::tempdir().unwrap();
        let objects = objects
            .iter()
            .map(|object| artifact(folder.path(), &object.name, object));
        let shown = trajectories
            .iter()
            .map(|shown| artifact(folder.path(), &shown.sequence, shown));
        let inputs = BTreeMap::from([
            (Object::NAME.to_owned(), objects.collect()),
            (Trajectory::NAME.to_owned(), shown.collect()),
        ]);
        let config = TransferConfig {
            from,
            unseen: unseen(&[]),
            objects: Vec::new(),
            per_object: 10,
        };
        let out = folder.path().join("out");
        std::fs::create_dir(&out).unwrap();
        let cx = Context::detached(&"can".parse().unwrap(), 3, &out);
        let outcome =
            Transfer::read_and_make(&config, &Inputs::new(inputs, Vec::new()), &cx).unwrap();
        assert!(matches!(outcome, Outcome::Made(_)), "{outcome:?}");
        let file = lake::table::FILE;
        let made = Artifact {
            key: "can".parse().unwrap(),
            labels: BTreeMap::new(),
            files: BTreeMap::from([(file.to_owned(), out.join(file))]),
        };
        let read: Candidates = lake::table::read(&made).unwrap();
        read.candidates
    }

    #[test]
    fn a_demonstration_of_the_most_similar_object_is_carried_from_box_to_box() {
        // `can` has its long side along y, `tin` along x; `wall` is larger.
        let can = object("can", [0.05, 0.1, 0.2]);
        let tin = object("tin", [0.11, 0.05, 0.22]);
        let wall = object("wall", [0.5, 0.5, 0.5]);
        let shown = [trajectory("a", &wall), trajectory("b", &tin)];
        let made = made(TransferSource::Nearest, &[can, tin, wall], &shown);
        assert_eq!(made.len(), 1);
        assert_eq!(made[0].source, DrawSource::replayed("b"));
        // A quarter turn takes the one's long side to the other's; heights are about the boxes' centers.
        let palm = &made[0].motion.grasp().frame_from_palm;
        assert!(
            (palm.translation.vector - Vector3::new(0.0, 0.01, 0.02)).norm() < 1e-9,
            "{palm:?}"
        );
        let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), std::f64::consts::FRAC_PI_2);
        assert!(palm.rotation.angle_to(&turn) < 1e-7);
        let velocity = made[0].motion.steps()[1].rates.palm_velocity.linear;
        assert!(
            (velocity - Vector3::new(0.0, -0.2, 0.0)).norm() < 1e-9,
            "{velocity}"
        );
    }

    #[test]
    fn demonstrations_of_any_other_object_are_drawn_once_each() {
        let objects = [
            object("can", [0.1; 3]),
            object("tin", [0.1; 3]),
            object("wall", [0.5; 3]),
        ];
        let shown =
            ["a", "b", "c"].map(|name| trajectory(name, &objects[1 + usize::from(name == "c")]));
        let made = made(TransferSource::Other, &objects, &shown);
        let mut from: Vec<&str> = made
            .iter()
            .map(|one| one.source.demonstration.as_str())
            .collect();
        from.sort_unstable();
        assert_eq!(from, ["a", "b", "c"]);
        assert_eq!(made[0].candidate_id, "can-00000");
    }

    #[test]
    fn the_mean_is_of_the_demonstrations_with_one_resting_orientation() {
        let mut can = object("can", [0.1; 3]);
        let lying = RestingPose {
            up_in_object: Vector3::x_axis(),
            height_m: 0.05,
        };
        can.rests.push(RestingOrientation {
            rest: lying,
            seen_n: 1,
            probability: 0.5,
        });
        let mut shown = ["a", "b", "c"].map(|name| trajectory(name, &can));
        shown[2].rest = lying;
        shown[1].motion = shown[1]
            .motion
            .moved(&Pose::new(Isometry3::translation(0.0, 0.04, 0.0)));
        let made = made(TransferSource::Mean, std::slice::from_ref(&can), &shown);
        assert_eq!(made.len(), 2);
        let at = |idx: usize| made[idx].motion.grasp().frame_from_palm.translation.vector;
        assert!((at(0) - Vector3::new(0.01, 0.02, 0.02)).norm() < 1e-9);
        assert!((at(1) - Vector3::new(0.01, 0.0, 0.02)).norm() < 1e-9);
        assert_eq!(made[1].table_from_object, lying.table_from_object());
    }

    #[test]
    fn a_unit_reads_the_others_demonstrations_or_its_own() {
        let labeled = |key: &str, object: &str| {
            Partition::new(
                key.parse().unwrap(),
                BTreeMap::from([(OBJECT.to_owned(), object.to_owned())]),
            )
        };
        let scope = Scope::new(BTreeMap::from([
            (
                Object::NAME.to_owned(),
                vec![labeled("box", "box"), labeled("can", "can")],
            ),
            (
                Trajectory::NAME.to_owned(),
                vec![
                    labeled("a", "can"),
                    labeled("b", "box"),
                    labeled("c", "can"),
                ],
            ),
        ]));
        let units = |from: TransferSource, object: &str| {
            let config = TransferConfig {
                from,
                unseen: unseen(&[]),
                objects: vec![object.to_owned()],
                per_object: 1,
            };
            Transfer::units(&config, &scope)
        };
        let read = |from| units(from, "can").unwrap()[0].reads["trajectories"].clone();
        assert_eq!(read(TransferSource::Mean), ["a", "c"]);
        assert_eq!(read(TransferSource::Other), ["b"]);
        assert!(
            units(TransferSource::Other, "cup")
                .unwrap_err()
                .to_string()
                .contains("`cup`")
        );
    }

    #[test]
    fn demonstrations_of_unseen_objects_are_not_read() {
        let partition = |key: &str, object: &str| {
            let labels = BTreeMap::from([(OBJECT.to_owned(), object.to_owned())]);
            Partition::new(key.parse().unwrap(), labels)
        };
        let objects = ["can", "shape", "tin", "wall"].map(|name| partition(name, name));
        let shown = [("a", "can"), ("b", "tin"), ("c", "wall")];
        let scope = Scope::new(BTreeMap::from([
            (Object::NAME.to_owned(), objects.to_vec()),
            (
                Trajectory::NAME.to_owned(),
                shown.map(|(key, of)| partition(key, of)).to_vec(),
            ),
        ]));
        let config = TransferConfig {
            from: TransferSource::Other,
            unseen: unseen(&["tin"]),
            objects: Vec::new(),
            per_object: 10,
        };
        let units = Transfer::units(&config, &scope).unwrap();
        let of = |object: &str| units.iter().find(|unit| unit.partition == object).unwrap();
        assert_eq!(of("shape").reads[Trajectory::NAME], ["a", "c"]);
        // It reads itself first.
        assert_eq!(of("shape").reads[Object::NAME], ["shape", "can", "wall"]);
        assert_eq!(of("can").reads[Trajectory::NAME], ["c"]);
    }
}
