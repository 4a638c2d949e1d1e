//! Test fixture: the Allegro hand and a box on a table.

use grasp_fixture::{FLEXION, StandingBox};
use posture::Environment;
use schemas::objects::Object;

use crate::HandBody;

pub(crate) use grasp_fixture::{GRASP_Q, hand};

/// Half of the box's sides, in meters.
pub(crate) const BOX_HALF_M: [f64; 3] = [0.025, 0.08, 0.05];

pub(crate) const BOX: StandingBox = StandingBox { half_m: BOX_HALF_M };

pub(crate) fn body() -> HandBody {
    HandBody::new(hand(), &FLEXION, GRASP_Q.to_vec()).unwrap()
}

/// The box on its table.
pub(crate) fn environment() -> Environment {
    BOX.environment()
}

/// The box as an object without resting poses.
pub(crate) fn object() -> Object {
    Object {
        rests: Vec::new(),
        ..BOX.object()
    }
}
