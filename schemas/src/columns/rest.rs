//! How an object lies, as columns.

use nalgebra::{Unit, Vector3};
use spatial::Rest;

use super::{Reader, Row, Writer, columns};
use crate::SchemaError;

columns! {
    /// A [`Rest`] in numbers.
    struct RestRow {
        rest_up: [f64; 3] ["1"] => "unit vector against gravity, object frame",
        rest_height_m: f64 ["m"] => "height of the object's origin above the table",
    }
}

impl Row for Rest {
    fn write(rows: &[&Self], to: &mut Writer) {
        let rows = rows.iter().map(|rest| RestRow {
            rest_up: rest.up_in_object.into_inner().into(),
            rest_height_m: rest.height_m,
        });
        to.rows(&rows.collect::<Vec<_>>());
    }

    fn read(from: &Reader<'_>, row: usize) -> Result<Self, SchemaError> {
        let RestRow {
            rest_up,
            rest_height_m,
        } = Row::read(from, row)?;
        Ok(Self {
            up_in_object: Unit::new_normalize(Vector3::from(rest_up)),
            height_m: rest_height_m,
        })
    }
}
