//! A grasp as a candidate motion.

use std::sync::Arc;

use motion::HandState;
use posture::Environment;
use schemas::candidates::{Candidate, Candidates, DrawSource, Origin};
use spatial::Object;

use crate::{
    ApproachConfig, ApproachError, ApproachPath, HandBody, Start, approach_path::is_clear, pregrasp,
};

/// A grasp of an object.
#[derive(Debug, Clone, PartialEq)]
pub struct Grasp {
    /// The hand.
    pub hand: HandState<Object>,
    /// Penetration depth of the hand in object or table, in meters.
    pub depth_m: f64,
    /// Residual of the search's conditions, in m²; none if nothing was searched.
    pub residual_m2: Option<f64>,
}

/// Makes candidates of one object from grasps.
#[derive(Debug)]
pub struct Reach<'a> {
    body: &'a HandBody,
    config: &'a ApproachConfig,
    generator: &'a str,
    object: &'a str,
    joints: Arc<[String]>,
}

impl<'a> Reach<'a> {
    /// `generator` and `object` are names.
    pub fn new(
        body: &'a HandBody,
        config: &'a ApproachConfig,
        generator: &'a str,
        object: &'a str,
    ) -> Self {
        Self {
            body,
            config,
            generator,
            object,
            joints: body.model().joint_names().into(),
        }
    }

    /// Returns the names of the candidates' joints.
    pub fn joints(&self) -> &Arc<[String]> {
        &self.joints
    }

    /// Returns the table of these candidates of the object.
    pub fn table(&self, candidates: Vec<Candidate>) -> Candidates {
        Candidates {
            object: self.object.to_owned(),
            joints: Arc::clone(&self.joints),
            candidates,
        }
    }

    /// Returns the motion from a start to a grasp as the candidate of this number: from the nearest side from which the
    /// straight way to the pregrasp is clear of object and table, from the nearest of all if none is.
    ///
    /// # Errors
    ///
    /// Fails if start or grasp do not fit the hand.
    pub fn candidate(
        &self,
        number: usize,
        environment: &Environment,
        grasp: &Grasp,
        start: &Start,
    ) -> Result<Candidate, ApproachError> {
        let table_from_object = environment.rest().table_from_object();
        let before = pregrasp(self.body, environment, &grasp.hand, self.config)?;
        let starts = start.carried(&table_from_object, &before);
        let mut first = starts.first().ok_or(ApproachError::NoStart)?;
        for other in &starts {
            if is_clear(self.body, environment, other, &before)? {
                first = other;
                break;
            }
        }
        let path = ApproachPath::new(self.config);
        Ok(Candidate {
            candidate_id: format!("{}-{number:05}", self.object),
            generator: self.generator.to_owned(),
            source: DrawSource {
                draw_n: 1,
                origin: Origin::Grasp,
                demonstration: start.sequence.clone(),
                object_split: None,
            },
            latent: Vec::new(),
            table_from_object,
            limit_excess_rad: 0.0,
            depth_m: Some(grasp.depth_m),
            residual_m2: grasp.residual_m2,
            motion: path.motion(&self.joints, first, &before, &grasp.hand)?,
        })
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::UnitQuaternion;
    use spatial::Pose;

    use super::*;
    use crate::fixture;

    #[test]
    fn a_candidate_ends_in_its_grasp_and_starts_as_its_demonstration() {
        let body = fixture::body();
        let config = ApproachConfig::default();
        let grasp = Grasp {
            hand: HandState {
                frame_from_palm: Pose::from_parts([-0.1, 0.0, 0.05], UnitQuaternion::identity()),
                q_rad: body.open(),
            },
            depth_m: 1e-3,
            residual_m2: Some(2e-6),
        };
        let start = Start {
            sequence: "reach".to_owned(),
            hand_in_table: HandState {
                frame_from_palm: Pose::from_parts([-0.5, 0.0, 0.2], UnitQuaternion::identity()),
                q_rad: vec![0.3; body.model().dof()],
            },
        };
        let reach = Reach::new(&body, &config, "force_closure", "box");
        let made = reach
            .candidate(7, &fixture::environment(), &grasp, &start)
            .unwrap();
        assert_eq!(made.candidate_id, "box-00007");
        assert_eq!(
            (made.source.origin, made.source.demonstration.as_str()),
            (Origin::Grasp, "reach")
        );
        assert_eq!((made.depth_m, made.residual_m2), (Some(1e-3), Some(2e-6)));
        let (first, last) = (made.motion.first(), made.motion.grasp());
        assert_eq!(last.frame_from_palm, grasp.hand.frame_from_palm);
        assert_eq!(last.q_rad, grasp.hand.q_rad);
        assert_eq!(first.q_rad, start.hand_in_table.q_rad);
        let height_m = (made.table_from_object * first.frame_from_palm)
            .translation
            .z;
        assert!((height_m - 0.2).abs() < 1e-12);
        assert_eq!(made.motion.steps().len(), 40);
    }
}
