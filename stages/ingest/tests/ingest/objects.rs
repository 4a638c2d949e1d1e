//! Results for objects.

use std::fs;

use dataflow::{Outcome, Stage};
use stage_ingest::{AddedMesh, Ingest};

use crate::{
    bench::{Bench, config},
    dataset, make,
    rig::{OBJECT, Rig, brick},
};

#[test]
fn the_object_has_its_mesh_mass_and_the_rest_in_which_it_lay() {
    let bench = make(&Rig::default());
    let unit = &bench.units["objects"][0];
    assert_eq!(bench.units["objects"].len(), 1);
    assert_eq!(unit.partition, OBJECT.0);
    let demonstration = &bench.units["demonstrations"][0].partition;
    let read = std::slice::from_ref(demonstration);
    assert_eq!(unit.reads["demonstrations"], read);
    let object = bench.object("objects", OBJECT.0);
    assert!((object.mass_kg - 0.187).abs() < 1e-12);
    assert!(object.watertight);
    assert_eq!(object.points_m.len(), 500);
    assert_eq!(object.parts_m.len(), 1);
    let rest = &object.rests[0];
    assert_eq!(rest.seen_n, 1);
    assert!(rest.rest.up_in_object.angle(&nalgebra::Vector3::y_axis()) < 1e-6);
    assert!((rest.rest.height_m - 0.04).abs() < 1e-9);
    let mesh = bench.artifact("objects", OBJECT.0);
    let mesh = fs::read_to_string(mesh.file("mesh.obj").unwrap()).unwrap();
    assert!(mesh.starts_with("v "));
    // Its shape is the same but for the demonstrations.
    let shape = bench.object("shapes", OBJECT.0);
    assert!(shape.rests.iter().all(|rest| rest.seen_n == 0));
    assert_eq!(shape.points_m, object.points_m);
}

#[test]
fn an_object_of_unknown_mass_is_refused_with_the_way_out() {
    let root = dataset(&Rig::default());
    let mesh = root.path().join("teapot.obj");
    fs::write(&mesh, brick([0.1, 0.1, 0.2])).unwrap();
    let mut config = config(root.path());
    config.masses_kg.insert("008_pudding_box".to_owned(), 0.0);
    let fault = Ingest::check(&config).remove(0).to_string();
    assert!(fault.starts_with("`masses_kg."), "{fault}");
    assert!(fault.contains("is 0.0, and must be more than 0"), "{fault}");
    config.masses_kg.insert("008_pudding_box".to_owned(), 0.2);
    config.masses_kg.insert("008_puding_box".to_owned(), 0.2);
    let err = Ingest::prepare(&config).unwrap_err();
    assert_eq!(err.hint().unwrap(), "did you mean `008_pudding_box`?");
    config.masses_kg.remove("008_puding_box");
    let bench = Bench::new(config);
    let object = bench.object("objects", OBJECT.0);
    assert!((object.mass_kg - 0.2).abs() < 1e-12);
}

#[test]
fn ungrasped_object_is_made_from_mesh_and_mass() {
    let root = dataset(&Rig::default());
    let mesh = root.path().join("teapot.obj");
    fs::write(&mesh, brick([0.1, 0.1, 0.3])).unwrap();
    let mut config = config(root.path());
    let added = AddedMesh {
        file: mesh,
        mass_kg: 0.6,
    };
    config.meshes.insert("teapot".to_owned(), added.clone());
    let bench = Bench::new(config.clone());
    let names: Vec<&str> = bench.units["objects"]
        .iter()
        .map(|unit| unit.partition.as_str())
        .collect();
    assert_eq!(names, [OBJECT.0, "teapot"]);
    let teapot = bench.object("objects", "teapot");
    assert!((teapot.mass_kg - 0.6).abs() < 1e-12);
    assert!(teapot.rests.iter().all(|rest| rest.seen_n == 0));
    assert!(
        (teapot
            .rests
            .iter()
            .map(|rest| rest.probability)
            .sum::<f64>()
            - 1.0)
            .abs()
            < 0.05
    );
    // It can also be the mesh of an object that the dataset has.
    config.meshes = [(OBJECT.0.to_owned(), added.clone())].into();
    let object = Bench::new(config.clone()).object("objects", OBJECT.0);
    let tallest_m = object.vertices_m.iter().map(|v| v[2]).fold(0.0, f64::max);
    assert!((tallest_m - 0.15).abs() < 1e-12 && (object.mass_kg - 0.6).abs() < 1e-12);
    config.meshes.insert(
        "kettle".to_owned(),
        AddedMesh {
            file: "no/kettle.obj".into(),
            mass_kg: 1.0,
        },
    );
    let err = Ingest::prepare(&config).unwrap_err();
    assert_eq!(err.to_string(), "no mesh of `kettle` at `no/kettle.obj`");
    assert!(
        err.hint()
            .unwrap()
            .contains("`[stages.ingest.meshes.kettle]`")
    );
}

#[test]
fn a_mesh_that_cannot_be_used_is_skipped_and_its_demonstrations_are_not() {
    let root = dataset(&Rig::default());
    let mesh = root.path().join("models").join(OBJECT.0);
    fs::write(mesh.join("textured_simple.obj"), "v 0 0 nan\n").unwrap();
    let bench = Bench::new(config(root.path()));
    let skipped = &bench.outcomes[&("shapes", OBJECT.0.to_owned())];
    let Outcome::Skipped { reason } = skipped else {
        panic!("{skipped:?}");
    };
    assert!(reason.contains("textured_simple.obj`: "), "{reason}");
    crate::assert_known_answer(&bench.only());
    assert!(bench.units["objects"].is_empty());
}
