//! Columns of an object's resting pose.

use spatial::RestingPose;

use super::{Flatten, columns};
use crate::SchemaError;

columns! {
    /// The columns of a [`RestingPose`].
    pub(crate) struct Flat {
        rest_up: [f64; 3] ["1"] => "unit vector against gravity, object frame",
        rest_height_m: f64 ["m"] => "height of the object's origin above the table",
    }
}

impl Flatten for RestingPose {
    type Flat = Flat;

    fn flat(&self) -> Flat {
        Flat {
            rest_up: self.up_in_object.into_inner().into(),
            rest_height_m: self.height_m,
        }
    }

    fn from_flat(flat: Flat) -> Result<Self, SchemaError> {
        Ok(Self {
            up_in_object: SchemaError::check_direction("rest_up", flat.rest_up)?,
            height_m: flat.rest_height_m,
        })
    }
}
