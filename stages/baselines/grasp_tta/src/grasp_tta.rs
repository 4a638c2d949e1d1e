//! The stage and its outputs: the networks, and candidates from them.

use approach::HandBody;
use dataflow::{BoxedDiagnostic, Outputs, Stage};
use schemas::{Table, distance_fields::FieldInfo, objects::Object, trajectories::Trajectory};

use crate::{AdaptedCandidates, GraspTtaConfig, LearnedNetworks, surface::hand_surface};

/// Learns to draw grasps, and adapts each to its object.
pub struct GraspTta;

impl Stage for GraspTta {
    type Config = GraspTtaConfig;

    const KIND: &'static str = "grasp_tta";
    const ABOUT: &'static str = "Samples grasps from learned networks, adapts each to its object";
    const INPUTS: &'static [&'static str] = &[Object::NAME, FieldInfo::NAME, Trajectory::NAME];
    const OUTPUTS: Outputs<Self> = &[&LearnedNetworks, &AdaptedCandidates];

    /// Checks the hand.
    fn prepare(config: &GraspTtaConfig) -> Result<(), BoxedDiagnostic> {
        let model = robot_meshes::load(&config.hand)?.model;
        let middle = model.mid_range();
        let body = HandBody::new(model, &config.flexion_joints, middle)?;
        hand_surface(&body, config.hand_points)?;
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use std::{
        collections::BTreeMap,
        fs,
        path::{Path, PathBuf},
    };

    use dataflow::{Artifact, Context, Outcome, Output, Partition, Scope};
    use motion::HandState;
    use schemas::{
        candidates::{Candidates, ObjectSplit, Origin},
        grasp_networks,
    };

    use super::*;
    use crate::{Finish, GraspTtaMetrics, fixture};

    /// Runs a unit into a folder of its own.
    fn made<O: Output<Stage = GraspTta>>(
        root: &Path,
        config: &GraspTtaConfig,
        artifacts: &BTreeMap<String, Vec<Artifact>>,
        (key, seed): (&str, u64),
    ) -> (PathBuf, Result<Outcome<O::Metrics>, BoxedDiagnostic>) {
        let out = root.join(format!("{}-{key}", O::ARTIFACT));
        fs::create_dir(&out).unwrap();
        let cx = Context::detached(&key.parse().unwrap(), seed, &out);
        let outcome = O::read_and_make(config, &grasp_fixture::inputs(artifacts), &cx);
        (out, outcome)
    }

    /// Learns networks and draws grasps of the box; returns what was written and measured.
    fn run(config: &GraspTtaConfig, seed: u64) -> (Vec<u8>, Candidates, GraspTtaMetrics) {
        let root = tempfile::tempdir().unwrap();
        let mut artifacts = fixture::artifacts(root.path(), true);
        let (model, outcome) =
            made::<LearnedNetworks>(root.path(), config, &artifacts, ("grasp_tta", seed));
        assert!(matches!(outcome.unwrap(), Outcome::Made(_)));
        let weights = fs::read(model.join(grasp_networks::WEIGHTS)).unwrap();
        let networks = grasp_fixture::artifact("grasp_tta", &model);
        artifacts.insert(grasp_networks::NAME.to_owned(), vec![networks]);
        let (out, outcome) =
            made::<AdaptedCandidates>(root.path(), config, &artifacts, ("box", seed));
        let Outcome::Made(metrics) = outcome.unwrap() else {
            panic!("not made");
        };
        let candidates = lake::table::read(&grasp_fixture::artifact("box", &out)).unwrap();
        (weights, candidates, metrics)
    }

    #[test]
    fn each_drawn_grasp_is_a_motion_with_its_code_and_adapted_ones_penetrate_less() {
        let (_, made, metrics) = run(&fixture::config(), 3);
        let names: Vec<&str> = made
            .candidates
            .iter()
            .map(|one| one.candidate_id.as_str())
            .collect();
        assert_eq!(names, ["box-00000", "box-00001", "box-00002", "box-00003"]);
        for one in &made.candidates {
            assert_eq!(one.generator, "grasp_tta");
            assert_eq!(one.source.origin, Origin::Grasp);
            assert_eq!(one.source.object_split, Some(ObjectSplit::Seen));
            assert_eq!((one.latent.len(), one.motion.steps().len()), (4, 40));
        }
        assert_ne!(made.candidates[0].latent, made.candidates[1].latent);
        let weighted = |contact: f64, penetration: f64| contact + 7.0 * penetration;
        let drawn = weighted(metrics.contact_drawn, metrics.penetration_drawn);
        let adapted = weighted(metrics.contact, metrics.penetration);
        assert!(adapted < 0.8 * drawn, "{metrics:?}");
    }

    #[test]
    fn closed_fingers_bend_from_the_adapted_grasp_until_they_touch_or_stop() {
        let adapted = fixture::config();
        let closed = GraspTtaConfig {
            finish: Finish::Closed,
            ..adapted.clone()
        };
        let [(weights, adapted, _), (same_weights, closed, _)] =
            [adapted, closed].map(|config| run(&config, 3));
        assert!(weights == same_weights, "other weights");
        let body = fixture::body();
        let environment = fixture::BOX.environment();
        for (before, after) in adapted.candidates.iter().zip(&closed.candidates) {
            let [before, after] = [before, after].map(|one| one.motion.grasp());
            assert_eq!(before.frame_from_palm, after.frame_from_palm);
            let joints = before.q_rad.iter().zip(&after.q_rad).enumerate();
            for (joint, (before, after)) in joints {
                let bends = body.flexion().contains(&joint);
                assert!(after >= before, "{joint}: {before} {after}");
                assert!(bends || after == before, "{joint}: {before} {after}");
            }
            assert_ne!(before.q_rad, after.q_rad);
            let hand = HandState::from(after);
            assert_eq!(body.closed(&environment, &hand).unwrap(), hand);
        }
    }

    #[test]
    fn networks_and_grasps_are_those_of_the_seed_on_any_number_of_threads() {
        let config = fixture::config();
        let on_one = rayon::ThreadPoolBuilder::new().num_threads(1);
        let one = on_one.build().unwrap().install(|| run(&config, 3));
        let other = run(&config, 3);
        assert!(one.0 == other.0, "other weights");
        assert_eq!(one.1, other.1);
        assert_ne!(one.1, run(&config, 4).1);
    }

    #[test]
    fn an_object_without_distances_is_skipped_with_the_reason() {
        let root = tempfile::tempdir().unwrap();
        let artifacts = fixture::artifacts(root.path(), false);
        let config = fixture::config();
        let (_, outcome) = made::<AdaptedCandidates>(root.path(), &config, &artifacts, ("box", 3));
        let Outcome::Skipped { reason } = outcome.unwrap() else {
            panic!("not skipped");
        };
        assert!(reason.contains("distance field"), "{reason}");
    }

    #[test]
    fn networks_of_another_hand_are_refused_with_its_joints() {
        let root = tempfile::tempdir().unwrap();
        let mut artifacts = fixture::artifacts(root.path(), true);
        let config = fixture::config();
        let (model, _) =
            made::<LearnedNetworks>(root.path(), &config, &artifacts, ("grasp_tta", 3));
        let path = model.join(grasp_networks::DESCRIPTION);
        let text = fs::read_to_string(&path).unwrap();
        fs::write(&path, text.replace("joint_3.0", "thumb")).unwrap();
        let networks = grasp_fixture::artifact("grasp_tta", &model);
        artifacts.insert(grasp_networks::NAME.to_owned(), vec![networks]);
        let (_, outcome) = made::<AdaptedCandidates>(root.path(), &config, &artifacts, ("box", 3));
        let err = outcome.err().unwrap();
        assert!(err.to_string().contains("thumb"), "{err}");
    }

    fn scope() -> Scope {
        scope_with(&[("a", Some("box")), ("b", Some("can")), ("c", Some("can"))])
    }

    /// Returns a scope of box and can, with trajectories of these names and labels.
    fn scope_with(trajectories: &[(&str, Option<&str>)]) -> Scope {
        let partition = |key: &str, object: Option<&str>| {
            let object = object.map(|name| ("object".to_owned(), name.to_owned()));
            Partition::new(key.parse().unwrap(), object.into_iter().collect())
        };
        Scope::new(BTreeMap::from([
            (
                Object::NAME.to_owned(),
                ["box", "can"].map(|key| partition(key, None)).into(),
            ),
            (
                Trajectory::NAME.to_owned(),
                trajectories
                    .iter()
                    .map(|&(key, object)| partition(key, object))
                    .collect(),
            ),
            (
                grasp_networks::NAME.to_owned(),
                vec![partition("grasp_tta", None)],
            ),
        ]))
    }

    #[test]
    fn demonstrations_of_unseen_objects_are_not_read_but_start_motions() {
        let of = |unseen: &[&str]| GraspTtaConfig {
            unseen_objects: unseen.iter().map(|&name| name.to_owned()).collect(),
            objects: vec!["box".to_owned()],
            ..fixture::config()
        };
        let learned = |unseen: &[&str]| LearnedNetworks::units(&of(unseen), &scope());
        let unit = &learned(&["box"]).unwrap()[0];
        assert_eq!(unit.reads[Trajectory::NAME], ["b", "c"]);
        assert_eq!(unit.reads[Object::NAME], ["can"]);
        let nothing = learned(&["box", "can"]).unwrap_err();
        assert_eq!(nothing.missing_input(), Some("trajectories"));
        assert!(nothing.hint().unwrap().contains("`unseen_objects`"));
        let unknown = learned(&["cup"]).unwrap_err();
        assert!(unknown.hint().unwrap().contains("box, can"));
        let units = AdaptedCandidates::units(&of(&["box"]), &scope()).unwrap();
        assert_eq!((units.len(), units[0].partition.as_str()), (1, "box"));
        assert_eq!(units[0].reads[Trajectory::NAME], ["a", "b", "c"]);
        assert_eq!(units[0].reads[grasp_networks::NAME], ["grasp_tta"]);
        let nothing = AdaptedCandidates::units(&of(&[]), &Scope::default()).unwrap_err();
        assert_eq!(nothing.missing_input(), Some("objects"));
    }

    #[test]
    fn a_trajectory_without_an_object_is_refused_by_name() {
        let scope = scope_with(&[("a", Some("box")), ("b", None)]);
        let refused = LearnedNetworks::units(&fixture::config(), &scope).unwrap_err();
        assert!(refused.to_string().contains("`b`"), "{refused}");
        assert!(refused.hint().unwrap().contains("--fresh"));
    }

    #[test]
    fn options_out_of_bounds_are_named() {
        assert!(GraspTta::check(&fixture::config()).is_empty());
        let mut bad = fixture::config();
        bad.per_object = 0;
        bad.flexion_joints = Vec::new();
        bad.network.contact_widths = vec![8];
        bad.training.epochs = 0;
        bad.terms.contact = f64::NAN;
        bad.adaptation.map_steps = 0;
        bad.approach.steps = 1;
        let faults = GraspTta::check(&bad).into_iter();
        let keys: Vec<String> = faults.map(|fault| fault.key).collect();
        assert_eq!(
            keys,
            [
                "per_object",
                "network.contact_widths",
                "training.epochs",
                "terms.contact",
                "adaptation.map_steps",
                "approach.steps",
                "flexion_joints"
            ]
        );
    }
}
