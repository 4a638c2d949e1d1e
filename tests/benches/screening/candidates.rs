//! The candidates of a lake.

use std::{collections::BTreeMap, fs, path::Path};

use dataflow::Artifact;
use lake::Lake;
use nalgebra::Vector3;
use schemas::candidates::Candidate;
use simulation::Motion;
use spatial::{Object, Pose, Rest, Table};

/// Returns how an object lies, without its yaw and its place.
pub(crate) fn rest(table_from_object: &Pose<Table, Object>) -> Rest {
    let isometry = table_from_object.isometry();
    Rest {
        up_in_object: isometry
            .rotation
            .inverse_transform_unit_vector(&Vector3::z_axis()),
        height_m: isometry.translation.z,
    }
}

/// Returns a candidate's motion; its joints are the hand's.
pub(crate) fn motion(candidate: &Candidate) -> Motion {
    let steps = candidate.steps.iter();
    Motion {
        time_s: steps.clone().map(|step| step.time_s).collect(),
        object_from_palm: steps
            .clone()
            .map(|step| *step.object_from_palm.isometry())
            .collect(),
        q: steps.map(|step| step.q_rad.clone()).collect(),
        rates: None,
    }
}

/// The newest partitions of a lake's table by object, in order.
pub(crate) fn partitions(lake: &Lake, table: &str) -> BTreeMap<String, Artifact> {
    let tables = lake.newest_tables().unwrap();
    let mut found = BTreeMap::new();
    for newest in tables.iter().filter(|newest| newest.table == table) {
        look(&newest.folder, &mut found);
    }
    found
}

/// Looks for folders `object=NAME` with a table.
fn look(folder: &Path, found: &mut BTreeMap<String, Artifact>) {
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        let name = path.file_name().unwrap().to_string_lossy().into_owned();
        if let Some(object) = name.strip_prefix("object=") {
            let artifact = Artifact {
                key: object.to_owned(),
                labels: BTreeMap::new(),
                files: BTreeMap::from([("part.parquet".to_owned(), path.join("part.parquet"))]),
            };
            found.insert(object.to_owned(), artifact);
        } else if path.is_dir() {
            look(&path, found);
        }
    }
}
