//! The inputs of a generator of grasps: an object, the distances from it, and the demonstrations.
//!
//! A stage that generates grasps adds its own, such as the hand:
//!
//! ```
//! use grasp_inputs::GraspInputs;
//!
//! lake::inputs! {
//!     /// What a unit reads.
//!     struct GeneratorInputs {
//!         /// The object, its distances and the demonstrations.
//!         with given: GraspInputs;
//!     }
//!     files {
//!         /// How many files of the hand there are.
//!         files_n: usize = |inputs: &dataflow::Inputs| Ok::<_, lake::LakeError>(inputs.files().len());
//!     }
//! }
//!
//! assert_eq!(GeneratorInputs::INPUTS, ["objects", "distance_fields", "trajectories"]);
//! let nothing = GeneratorInputs::units(&dataflow::Scope::default(), &[]).unwrap_err();
//! assert_eq!(nothing.to_string(), "there are no objects to grasp");
//! ```

use geometry::DistanceField;
use lake::ReadArtifact;
use schemas::{
    distance_fields::{self, FieldInfo},
    objects::Object,
    trajectories::Trajectory,
};

lake::inputs! {
    /// What a unit reads: an object, its distances and every demonstration. An object without distances is skipped.
    pub struct GraspInputs {
        /// The object.
        each object: Object, "to grasp";
        /// The distances from the object.
        own field: DistanceField = FieldInfo,
            |field| field.parsed(distance_fields::FIELD, DistanceField::from_bytes),
            or "object has no distance field";
        /// The demonstrations of all objects.
        all trajectories: Trajectory [lake::table::FILE];
    }
}
