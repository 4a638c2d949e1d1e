//! The stage: one unit per object.

use dataflow::{
    BoxedDiagnostic, Context, Line, Mean, Outcome, Output, Outputs, Scope, Stage, Sum, Unit,
};
use lake::{LakeError, ReadInputs, SiblingTable, WriteArtifact};
use nalgebra::Vector3;
use schemas::{
    Table,
    candidates::{Candidate, Candidates},
    completions::CompletedObject,
    draws::Draws,
    views::{View, Views},
};
use spatial::{Object, Pose, RestingPose, Table as OnTable, World};

use crate::GroundTruthConfig;

/// Expresses motions in the frame of the true object.
pub struct GroundTruth;

dataflow::metrics! {
    /// Metrics of an object's motions.
    pub struct GroundTruthMetrics {
        /// Number of candidates.
        candidates: Sum,
        /// Angle between the estimated and the true vertical, in radians.
        tilt_rad: Mean,
        /// Distance between the estimated and the true table at the object, in meters.
        table_error_m: Mean,
    }
}

lake::inputs! {
    /// What a unit reads: an object's motions, its images and its estimate.
    pub struct GroundTruthInputs {
        /// The motions.
        each candidates: Candidates [lake::table::FILE, Draws::FILE], "to put before true objects";
        /// The images, with the object's true pose.
        own views: Views, or "object has no views";
        /// The estimate.
        own completion: CompletedObject, or "object was not estimated";
    }
    files {
        /// The draws of the motions.
        draws: Draws = draws;
    }
}

fn draws(inputs: &dataflow::Inputs) -> Result<Draws, LakeError> {
    lake::table::read_draws(inputs.artifact(Candidates::NAME)?)
}

impl Stage for GroundTruth {
    type Config = GroundTruthConfig;

    const KIND: &'static str = "ground_truth";
    const ABOUT: &'static str = "Puts motions planned on estimates before the true objects";
    const INPUTS: &'static [&'static str] = GroundTruthInputs::INPUTS;
    const OUTPUTS: Outputs<Self> = &[&Self, &SiblingTable::<Self, Draws>::OUTPUT];
}

impl Output for GroundTruth {
    type Stage = Self;
    type Metrics = GroundTruthMetrics;
    type Inputs<'a> = GroundTruthInputs;

    const ARTIFACT: &'static str = Candidates::NAME;
    const SCHEMA: &'static str = Candidates::VERSION;
    const PARTITION: &'static str = Candidates::PARTITION;
    const LINE: Option<Line<GroundTruthMetrics>> = Some(|summary| {
        let metrics = &summary.metrics;
        format!(
            "{} motions before {} true objects, table off by {:.1} mm and {:.1}°",
            metrics.candidates,
            summary.n_made,
            1000.0 * metrics.table_error_m,
            metrics.tilt_rad.to_degrees()
        )
    });

    fn units(_config: &GroundTruthConfig, scope: &Scope) -> Result<Vec<Unit>, BoxedDiagnostic> {
        Ok(GroundTruthInputs::units(scope, &[])?)
    }

    fn make(
        _config: &GroundTruthConfig,
        inputs: GroundTruthInputs,
        cx: &Context,
    ) -> Result<Outcome<GroundTruthMetrics>, BoxedDiagnostic> {
        let GroundTruthInputs {
            candidates: given,
            views,
            completion,
            draws,
        } = inputs;
        let Some(&world_from_true) = views
            .first()
            .and_then(|view: &View| view.world_from_object.first())
        else {
            return Ok(Outcome::skipped(
                "its views have no true pose: they are not simulated",
            ));
        };
        // Both are poses of the object's frame, the estimated and the true one.
        let true_from_estimated: Pose<Object, Object> =
            world_from_true.inv_mul(&completion.world_from_object);
        let world_from_true: Pose<OnTable, Object> = world_from_true.reinterpret();
        let table_from_object = RestingPose::of(&world_from_true).table_from_object();
        let placed = |candidate: Candidate| Candidate {
            motion: candidate.motion.moved(&true_from_estimated),
            table_from_object,
            ..candidate
        };
        let (tilt_rad, table_error_m) = table_errors(&completion.world_from_object, &given);
        let metrics = GroundTruthMetrics {
            candidates: given.candidates.len() as f64,
            tilt_rad,
            table_error_m,
        };
        let candidates = Candidates {
            candidates: given.candidates.into_iter().map(placed).collect(),
            ..given
        };
        cx.write(&candidates)?;
        cx.write(&draws)?;
        Ok(Outcome::Made(metrics))
    }
}

/// Returns the angle between the vertical that motions were planned for and the true one, in radians, and the distance
/// between the two tables below the object's origin, in meters. In the views' world the true table is z = 0.
fn table_errors(world_from_estimated: &Pose<World, Object>, planned: &Candidates) -> (f64, f64) {
    let Some(candidate) = planned.candidates.first() else {
        return (0.0, 0.0);
    };
    let rest = RestingPose::of(&candidate.table_from_object);
    let up = *world_from_estimated * rest.up_in_object.into_inner();
    let foot = world_from_estimated.translation.vector - up * rest.height_m;
    (up.angle(&Vector3::z()), foot.z.abs())
}

#[cfg(test)]
mod tests {
    use std::{collections::BTreeMap, path::Path};

    use dataflow::{Artifact, Inputs};
    use motion::{HandRates, Motion, Step};
    use nalgebra::{Isometry3, Point3};
    use schemas::candidates::DrawSource;

    use super::*;

    fn artifact(folder: &Path, file: &str) -> Artifact {
        Artifact {
            key: "can".parse().unwrap(),
            labels: BTreeMap::new(),
            files: [(file.to_owned(), folder.join(file))].into(),
        }
    }

    fn given<T: Table>(folder: &Path, table: &T) -> (String, Vec<Artifact>) {
        let folder = folder.join(T::NAME);
        std::fs::create_dir(&folder).unwrap();
        lake::table::write(&folder, table).unwrap();
        (T::NAME.to_owned(), vec![artifact(&folder, T::FILE)])
    }

    fn pose<To, From>(x: f64, y: f64, z: f64, turn: f64) -> Pose<To, From> {
        Pose::new(Isometry3::new(Vector3::new(x, y, z), Vector3::z() * turn))
    }

    fn candidates() -> Candidates {
        let steps = (0..2).map(|number| Step {
            time_s: f64::from(number),
            frame_from_palm: pose(0.1, 0.0, 0.05, 0.3),
            q_rad: vec![0.5],
            rates: HandRates::zero(1),
        });
        let candidate = Candidate {
            candidate_id: "can-0".to_owned(),
            generator: "cgf".to_owned(),
            source: DrawSource::replayed("a"),
            latent: Vec::new(),
            table_from_object: Pose::identity(),
            limit_excess_rad: 0.0,
            depth_m: None,
            residual_m2: None,
            motion: Motion::new(&["j"], steps.collect()).unwrap(),
        };
        Candidates {
            object: "can".to_owned(),
            joints: ["j".to_owned()].into(),
            candidates: vec![candidate],
        }
    }

    /// Puts the motion before an object of which images say this; the reason if it is skipped.
    fn run(world_from_object: Vec<Pose<World, Object>>) -> Result<Candidates, String> {
        let folder = tempfile::tempdir().unwrap();
        let view = View {
            view: "can-0".to_owned(),
            width: 1,
            height: 1,
            focal_px: [1.0; 2],
            center_px: [0.0; 2],
            world_from_camera: Pose::identity(),
            table: Vec::new(),
            depth_step_m: 1e-4,
            depth: vec![0],
            mask: vec![1],
            world_from_object,
        };
        let completion = CompletedObject {
            world_from_object: pose(0.02, 0.01, 0.001, 1.0),
            views_n: 1,
            seen_m: Vec::new(),
            seen_normals: Vec::new(),
            unseen_m: Vec::new(),
            symmetric: false,
            free_share: 0.0,
        };
        let inputs = BTreeMap::from([
            given(folder.path(), &candidates()),
            given(folder.path(), &vec![view]),
            given(folder.path(), &completion),
        ]);
        let out = folder.path().join("out");
        std::fs::create_dir(&out).unwrap();
        let cx = Context::detached(&"can".parse().unwrap(), 0, &out);
        let inputs = Inputs::new(inputs, Vec::new());
        let config = GroundTruthConfig::default();
        match GroundTruth::read_and_make(&config, &inputs, &cx).unwrap() {
            Outcome::Made(made) => {
                // The estimated table is a millimeter above the true one, and level.
                assert!((made.table_error_m - 0.001).abs() < 1e-12 && made.tilt_rad < 1e-9);
                let made = artifact(&out, lake::table::FILE);
                Ok(lake::table::read(&made).unwrap())
            }
            Outcome::Skipped { reason } => Err(reason),
            _ => panic!("neither made nor skipped"),
        }
    }

    #[test]
    fn the_hand_goes_where_the_estimate_says_in_the_world() {
        // The true mesh lies on its side: its own x is up.
        let lying = nalgebra::UnitQuaternion::from_axis_angle(&Vector3::y_axis(), -1.5);
        let world_from_true = Pose::from_parts([0.05, -0.03, 0.04], lying);
        let made = run(vec![world_from_true]).unwrap();
        let motion = &made.candidates[0].motion;
        let palm_in_world = world_from_true * motion.grasp().frame_from_palm * Point3::origin();
        let estimated: Pose<World, Object> = pose(0.02, 0.01, 0.001, 1.0);
        let expected = estimated * Point3::new(0.1, 0.0, 0.05);
        assert!((palm_in_world - expected).norm() < 1e-12);
        // It lies on the table as it lies in the world.
        let lies = RestingPose::of(&made.candidates[0].table_from_object);
        assert!((lies.height_m - 0.04).abs() < 1e-12);
        let up = lying.inverse() * Vector3::z();
        assert!((lies.up_in_object.into_inner() - up).norm() < 1e-12);
    }

    #[test]
    fn motions_of_real_views_are_skipped() {
        let reason = run(Vec::new()).unwrap_err();
        assert!(reason.contains("not simulated"), "{reason}");
    }
}
