//! The stage and its outputs: the networks, and candidates from them.

use approach::HandBody;
use dataflow::{Code, OptionFault, Outputs, SourceFile, Stage, Unit};
use schemas::{Table, distance_fields::FieldInfo, objects::Object, trajectories::Trajectory};

use crate::{
    AdaptedCandidates, GraspTtaConfig, GraspTtaError, LearnedNetworks, surface::hand_surface,
};

/// Learns to draw grasps, and adapts each to its object.
pub struct GraspTta;

impl Stage for GraspTta {
    type Config = GraspTtaConfig;
    type Error = GraspTtaError;

    const KIND: &'static str = "grasp_tta";
    const ABOUT: &'static str = "Draws grasps from learned networks and adapts each to its object";
    const CODE: Code = dataflow::code!();
    const INPUTS: &'static [&'static str] = &[Object::NAME, FieldInfo::NAME, Trajectory::NAME];
    const OUTPUTS: Outputs<Self> = &[&LearnedNetworks, &AdaptedCandidates];

    fn check(config: &GraspTtaConfig) -> Vec<OptionFault> {
        config.faults()
    }

    /// Checks the hand.
    fn prepare(config: &GraspTtaConfig) -> Result<(), GraspTtaError> {
        let model = robot_meshes::load(&config.hand)?.model;
        let middle = model.mid_range();
        let body = HandBody::new(model, &config.flexion_joints, middle)?;
        hand_surface(&body, config.hand_points).map(drop)
    }
}

/// Adds the hand's files to a unit.
pub(crate) fn with_hand(unit: Unit, config: &GraspTtaConfig) -> Result<Unit, GraspTtaError> {
    let unit = unit.with_file_of_form(
        SourceFile::named("hand", &config.hand),
        robot_meshes::MODEL_FORM,
    );
    let meshes = robot_meshes::sources(&config.hand)?;
    Ok(meshes.into_iter().fold(unit, Unit::with_file))
}
