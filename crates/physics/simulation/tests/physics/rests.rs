//! Objects stay on the table as they were put, where their mesh is stable.

use std::{f64::consts::TAU, fs};

use geometry::{StablePose, TriMesh, mass_properties, parts_within, stable_rests};
use motion::HandState;
use nalgebra::{Point3, Rotation3, Vector3};
use simulation::{ObjectShape, SettledScene};
use spatial::{Object, Pose, RestingPose};

use crate::scene::{hand, scene};

/// Most convex parts, as in `ingest`.
const MAX_PARTS: usize = 64;
/// Recommended tolerance of the parts, in meters.
const TOLERANCE_M: f64 = 1e-4;
/// Simulated time after which an object lies as it will, in seconds.
const TIME_S: f64 = 2.0;
/// Largest tilt from how it was put, in radians: 2 degrees.
const MAX_TILT_RAD: f64 = 0.035;
/// Least rise of the center of mass by that tilt, to every side, of an object that lies firmly, in meters: a
/// narrower facet does not hold it when it falls by half a millimeter, not even with every corner of its hull.
const FIRM_M: f64 = 1e-4;
/// Rarer rests are left out: the small ends of scanned boxes rock on bumps with every corner of their hull.
const MIN_PROBABILITY: f64 = 0.05;

/// Says whether a tilt by [`MAX_TILT_RAD`] to any side lifts the center of mass of a hull.
fn lies_firmly(hull: &TriMesh, center: &Point3<f64>, rest: &RestingPose) -> bool {
    let height_m = |up: &Vector3<f64>| {
        let above = hull
            .vertices_m
            .iter()
            .map(|corner| up.dot(&(center - corner)));
        above.fold(f64::NEG_INFINITY, f64::max)
    };
    let up = rest.up_in_object;
    let flat_m = height_m(&up);
    let aside = up.cross(&Vector3::ith(up.iamin(), 1.0)).normalize();
    (0..36).all(|turn| {
        let turn = Rotation3::from_axis_angle(&up, TAU * f64::from(turn) / 36.0);
        let tilted = *up * MAX_TILT_RAD.cos() + turn * aside * MAX_TILT_RAD.sin();
        height_m(&tilted) - flat_m > FIRM_M
    })
}

/// Returns the tilt of an object that has lain alone on the table for a while, in radians.
fn tilt_rad(object: &ObjectShape, rest: &RestingPose) -> f64 {
    let (scene, model) = (scene(), hand());
    let settled = SettledScene::new(&scene, &model, object, rest).unwrap();
    // The hand waits far above.
    let above = Pose::identity().translated(&Vector3::new(0.0, 0.0, 0.8));
    let waiting = HandState::<Object> {
        frame_from_palm: settled.table_from_estimate().inverse() * above,
        q_rad: vec![0.0; model.dof()],
    };
    let mut episode = settled.begin(&waiting).unwrap();
    let mut time_s = 0.0;
    while time_s < TIME_S {
        settled.advance(&mut episode, &waiting).unwrap();
        time_s += scene.control_step_s();
    }
    let table_from_object = settled.observe(&episode).table_from_object;
    (table_from_object.rotation * *rest.up_in_object).angle(&Vector3::z())
}

/// Checks every firm rest of a mesh; returns how many there are.
fn check(name: &str, mesh: &TriMesh) -> usize {
    let mass = mass_properties(mesh, 0.4);
    let center = mass.center_of_mass_m;
    let rests = stable_rests(mesh, &center);
    let hull = mesh.convex_hull().unwrap();
    let is_firm = |stable: &&StablePose| {
        stable.probability >= MIN_PROBABILITY && lies_firmly(&hull, &center, &stable.rest)
    };
    let firm: Vec<&StablePose> = rests.iter().filter(is_firm).collect();
    if firm.is_empty() {
        return 0;
    }
    let object = ObjectShape {
        parts_m: parts_within(mesh, MAX_PARTS, TOLERANCE_M, &rests).unwrap(),
        surface: None,
        mass_kg: mass.mass_kg,
        center_of_mass_m: center,
        inertia_kg_m2: mass.inertia_kg_m2,
    };
    for stable in &firm {
        let tilt_rad = tilt_rad(&object, &stable.rest);
        assert!(
            tilt_rad < MAX_TILT_RAD,
            "{name} tilts by {tilt_rad:.3} rad from {:?}",
            stable.rest
        );
    }
    firm.len()
}

#[test]
fn shipped_objects_stay_as_their_mesh_is_stable() {
    let firm_n: usize = demonstrator::object_meshes()
        .map(|(name, mesh)| check(name, &mesh))
        .sum();
    assert!(firm_n >= 40, "{firm_n} firm rests");
}

#[test]
fn scanned_objects_stay_as_their_mesh_is_stable() {
    let Some(root) = measured_data::folder("dexycb-right") else {
        return;
    };
    for name in [
        "006_mustard_bottle",
        "021_bleach_cleanser",
        "010_potted_meat_can",
    ] {
        let file = root.join("models").join(name).join("textured_simple.obj");
        let mesh = TriMesh::from_obj(&fs::read_to_string(file).unwrap()).unwrap();
        assert!(check(name, &mesh) >= 2, "{name} has no firm rest");
    }
}
