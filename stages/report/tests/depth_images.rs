//! Pages of objects that were estimated from depth images.

use std::{collections::BTreeMap, path::Path};

use base64::{Engine as _, engine::general_purpose::STANDARD};
use dataflow::{Artifact, Inputs, RunFacts};
use depth_view::{Intrinsics, RenderedObject, cloud, looking_at, render};
use geometry::TriMesh;
use lake::table;
use nalgebra::{Point3, UnitQuaternion, Vector3};
use schemas::{
    Table,
    candidates::DrawSource,
    completions::CompletedObject,
    objects::{Object, RestingOrientation},
    rollouts::{Measures, Rollout, Rollouts, Verdict},
    views::Views,
};
use spatial::{Pose, RestingPose};
use stage_report::{Facts, PageData, Rendered, ReportConfig, render as rendered};

/// A standing carton of 6 by 6 by 12 cm, seen once, whose estimate is right.
fn carton() -> (Views, CompletedObject, Object) {
    let mesh = TriMesh::cuboid(
        Point3::new(-0.03, -0.03, 0.0),
        Point3::new(0.03, 0.03, 0.12),
    );
    let world_from_object = Pose::from_parts([0.3, 0.1, 0.0], UnitQuaternion::identity());
    let object = RenderedObject {
        mesh: &mesh,
        world_from_object,
    };
    let camera = looking_at(Point3::new(0.8, 0.2, 0.3), Point3::new(0.3, 0.1, 0.06));
    let seen = render(&object, &Intrinsics::of_field(320, 240, 0.8), &camera).view;
    let in_object = |point: &Point3<f64>| world_from_object.inverse_transform_point(point);
    let seen_m: Vec<[f64; 3]> = cloud(&seen)
        .iter()
        .map(|seen| in_object(&seen.point_in_world).into())
        .collect();
    let (points, normals) = mesh.sample_surface(400, 1);
    let unseen_m = points.iter().map(|point| {
        let distances = seen_m
            .iter()
            .map(|&seen| (Point3::from(seen) - point).norm());
        distances.fold(f64::INFINITY, f64::min)
    });
    let completion = CompletedObject {
        world_from_object,
        views_n: 1,
        seen_normals: vec![[0.0, 0.0, 1.0]; seen_m.len()],
        unseen_m: unseen_m.collect(),
        seen_m,
        symmetric: true,
        free_share: 0.125,
    };
    let arrays = |points: &[Point3<f64>]| points.iter().map(|&point| point.into()).collect();
    let object = Object {
        name: "carton".to_owned(),
        mass_kg: 0.1,
        center_of_mass_m: [0.0, 0.0, 0.06],
        inertia_kg_m2: [1e-4, 1e-4, 1e-4, 0.0, 0.0, 0.0],
        points_m: arrays(&points),
        normals: normals.into_iter().map(Into::into).collect(),
        watertight: true,
        mirror: None,
        vertices_m: arrays(&mesh.vertices_m),
        parts_m: Vec::new(),
        triangles: mesh.triangles,
        rests: vec![RestingOrientation {
            rest: RestingPose {
                up_in_object: Vector3::z_axis(),
                height_m: 0.0,
            },
            seen_n: 1,
            probability: 1.0,
        }],
    };
    let view = stored_views::stored("carton-0".to_owned(), &seen, stored_views::DEPTH_STEP_M);
    (vec![view], completion, object)
}

fn rollouts(object: &str) -> Rollouts {
    let rollout = |n: usize, verdict: Verdict| Rollout {
        candidate_id: format!("{object}-{n:05}"),
        generator: "cgf".to_owned(),
        source: DrawSource::replayed("a"),
        protocol: None,
        verdict,
        measures: Measures {
            control_steps_n: 100,
            ..Measures::default()
        },
    };
    vec![rollout(0, Verdict::Held), rollout(1, Verdict::Slipped)]
}

/// A page of so many cartons, from the tables of a run; `without` is an input that is not wired.
fn page(cartons_n: usize, kinds: &[&str], without: &str) -> Rendered {
    let folder = tempfile::tempdir().unwrap();
    let (views, completion, object) = carton();
    let mut artifacts: BTreeMap<String, Vec<Artifact>> = BTreeMap::new();
    for n in 0..cartons_n {
        let name = format!("carton_{n:02}");
        let mut add = |input: &str, file: &str, write: &dyn Fn(&Path)| {
            let own = folder.path().join(format!("{name}-{input}"));
            std::fs::create_dir(&own).unwrap();
            write(&own);
            artifacts
                .entry(input.to_owned())
                .or_default()
                .push(Artifact {
                    key: name.parse().unwrap(),
                    labels: BTreeMap::new(),
                    files: [(file.to_owned(), own.join(file))].into(),
                });
        };
        add(Views::NAME, Views::FILE, &|own| {
            table::write(own, &views).unwrap();
        });
        add(CompletedObject::NAME, CompletedObject::FILE, &|own| {
            table::write(own, &completion).unwrap();
        });
        add(Object::NAME, Object::FILE, &|own| {
            table::write(own, &object).unwrap();
        });
        add(Rollouts::NAME, Rollouts::FILE, &|own| {
            table::write(own, &rollouts(&name)).unwrap();
        });
    }
    artifacts.remove(without);
    let stage = |input: &str| match input {
        Views::NAME => "camera",
        Rollouts::NAME => "screen",
        _ if kinds.contains(&"register") => "register",
        _ => "complete",
    };
    let wired = artifacts.keys();
    let wired = wired.map(|input| (input.clone(), format!("{}.{input}", stage(input))));
    let facts = Facts {
        run: RunFacts {
            pipeline: "camera".to_owned(),
            wired: wired.collect(),
            kinds: kinds
                .iter()
                .map(|kind| ((*kind).to_owned(), (*kind).to_owned()))
                .collect(),
            ..RunFacts::default()
        },
        ..Facts::default()
    };
    let config = ReportConfig {
        hand: "hand.urdf".into(),
        motions: 4,
        object_triangles: 100,
    };
    let inputs = Inputs::new(artifacts, Vec::new());
    let gathered = PageData::read(&config, facts, &inputs, None).unwrap();
    rendered(&[("camera".to_owned(), gathered)]).unwrap()
}

fn text(files: &Rendered, name: &str) -> String {
    String::from_utf8(files[name].clone()).unwrap()
}

/// Returns the part of a page about depth images.
fn section(html: &str) -> Option<&str> {
    let (_, rest) = html.split_once("<section id=\"views\"")?;
    rest.split("</section>").next()
}

/// The pictures of a page.
fn pictures(html: &str) -> Vec<Vec<u8>> {
    let all = html.split("data:image/png;base64,").skip(1);
    all.map(|rest| STANDARD.decode(rest.split('"').next().unwrap()).unwrap())
        .collect()
}

/// `PIPELINE_PAGES` names a folder in which it is left to be opened.
#[test]
fn an_object_has_three_pictures_its_figures_and_a_row() {
    let files = page(1, &["screen", "ground_truth"], "");
    let html = text(&files, "index.html");
    let shown = section(&html).unwrap();
    let pictures = pictures(shown);
    assert_eq!(pictures.len(), 3);
    assert_eq!(shown.matches(" alt=\"").count(), 3);
    let bytes: usize = pictures.iter().map(Vec::len).sum();
    assert!(bytes < 10_000, "{bytes} bytes");
    for said in [
        "<h3>carton_00</h3>",
        "1 view · symmetric · ",
        "12.5\u{a0}% of its hull free",
        "50.0\u{a0}% of 2 candidates hold",
        "with the true objects",
    ] {
        assert!(shown.contains(said), "{said}");
    }
    let csv = text(&files, "completions.csv");
    let mut rows = csv.lines();
    let head = "object,views_n,symmetric,free_share,seen_n,unseen_share";
    assert_eq!(rows.next(), Some(head));
    let row = rows.next().unwrap();
    assert!(row.starts_with("carton_00,1,yes,0.125,"), "{row}");
    let markdown = text(&files, "report.md");
    assert!(markdown.contains("## Depth images") && !markdown.contains("base64"));
    if let Ok(folder) = std::env::var("PIPELINE_PAGES") {
        let file = Path::new(&folder).join("depth_images.html");
        lake::write_atomic(&file, html.as_bytes()).unwrap();
    }
}

#[test]
fn what_is_not_wired_is_left_out_or_told() {
    let shown = |without: &str| {
        let html = text(&page(1, &["screen"], without), "index.html");
        section(&html).unwrap().to_owned()
    };
    let all = shown("");
    assert!(all.contains("verdicts are on the estimated shapes"));
    assert_eq!(pictures(&shown(Object::NAME)).len(), 1);
    assert_eq!(pictures(&shown(Views::NAME)).len(), 0);
    assert!(shown(Views::NAME).contains("table-completions"));
    assert!(shown(CompletedObject::NAME).contains("No completions are wired"));
    assert!(!shown(Rollouts::NAME).contains("verdicts"));
    // A page of a run without images has no word of them, and no style for them.
    let nothing = text(&rendered(&[]).unwrap(), "index.html");
    assert_eq!(section(&nothing), None);
    assert!(!nothing.contains("tiles") && !nothing.contains("Depth images"));
}

#[test]
fn a_mesh_that_was_found_is_no_estimate() {
    let files = page(1, &["screen", "register"], "");
    let html = text(&files, "index.html");
    let shown = section(&html).unwrap();
    assert_eq!(pictures(shown).len(), 3);
    assert!(shown.contains("verdicts are on the poses that were found"));
    for estimated in ["estimate", "symmetric ·", "hull"] {
        assert!(!shown.contains(estimated), "{estimated}");
    }
    let csv = text(&files, "completions.csv");
    assert!(csv.contains("carton_00,1,,,"), "{csv}");
}

#[test]
fn forty_objects_have_pictures_and_the_others_a_row() {
    let files = page(42, &["screen"], "");
    let html = text(&files, "index.html");
    let shown = section(&html).unwrap();
    assert_eq!(pictures(shown).len(), 120);
    assert!(shown.contains("2 more are in the table alone."));
    assert_eq!(text(&files, "completions.csv").lines().count(), 43);
    assert!(html.len() < 42 * 15_000, "{} bytes", html.len());
}
