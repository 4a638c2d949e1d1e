//! What is estimated of an object from one noisy depth image, and the processor time from the image to its convex parts.
//!
//! `cargo bench --bench completion` looks at each mesh of the measured data from four sides, by the simulated stereo camera
//! with its default errors. It prints, for each way to complete the unseen side, the mean distance of the true surface from
//! the estimate, where the camera sees it and where not, that of the estimate from the true surface, the ratio of the
//! volumes, and the time.

#![expect(clippy::print_stdout, reason = "a bench prints what it measured")]
#![expect(clippy::unwrap_used, reason = "a bench may break off")]

mod limits;

use std::{fs, hint::black_box, path::Path, process::ExitCode};

use completion::{CompletedShape, Completion, Observation, complete};
use depth_view::{DepthView, Intrinsics, RenderedObject, StereoNoise, looking_at, render};
use geometry::{MeshFormat, SurfaceDistance, TriMesh};
use limits::Limits;
use nalgebra::{Isometry3, Point3, UnitQuaternion, Vector3};
use spatial::{Object, Pose, World};

/// Most processor time from a depth image to parts, in milliseconds, by the default completion.
const MOST_MS: f64 = 150.0;
/// Relative difference of the time from run to run.
const NOISE: f64 = 0.2;
/// Views of each object.
const VIEWS: u32 = 4;
/// Points at which surfaces are compared.
const POINTS: usize = 1000;
/// Convex parts of an estimate, as the stage has them.
const PARTS: usize = 12;

/// Mean distances in millimeters, the ratio of the volumes, and the time in milliseconds.
type Row = [f64; 5];

fn main() -> ExitCode {
    let Some(dataset) = measured_data::folder("dexycb-right") else {
        return ExitCode::SUCCESS;
    };
    let ways = [
        Completion::Hull,
        Completion::Carved,
        Completion::Superquadric,
        Completion::Symmetry,
    ];
    let mut rows: Vec<Vec<Row>> = vec![Vec::new(); ways.len()];
    let mut folders: Vec<_> = fs::read_dir(dataset.join("models"))
        .unwrap()
        .map(|entry| entry.unwrap().path())
        .collect();
    folders.sort();
    for folder in folders {
        let mesh = read(&folder);
        for number in 0..VIEWS {
            let (world_from_object, view) = look(&mesh, number);
            for (way, rows) in ways.iter().zip(&mut rows) {
                let (shape, cpu_s) = cpu_time::measured(|| {
                    let observation = Observation::new(std::slice::from_ref(&view), None).unwrap();
                    let shape = complete(&observation, *way).unwrap();
                    black_box(geometry::coarse_parts(&shape.mesh, PARTS).unwrap());
                    shape
                });
                rows.push(row(&shape, &mesh, &world_from_object, &view, 1e3 * cpu_s));
            }
        }
    }
    println!("completion   seen side, mm   unseen side, mm   estimate, mm   volume   ms");
    let mut limits = Limits::with_noise(NOISE);
    for (way, rows) in ways.iter().zip(&rows) {
        let mean =
            |column: usize| rows.iter().map(|row| row[column]).sum::<f64>() / rows.len() as f64;
        let [seen, unseen, over, volume, ms] = [0, 1, 2, 3, 4].map(mean);
        let name = format!("{way:?}").to_lowercase();
        println!("{name:<12} {seen:13.1} {unseen:17.1} {over:14.1} {volume:8.2} {ms:4.0}");
        if *way == Completion::default() {
            limits.keep("CPU ms from a depth image to convex parts", ms, ..=MOST_MS);
        }
    }
    limits.end()
}

fn read(folder: &Path) -> TriMesh {
    let bytes = fs::read(folder.join("textured_simple.obj")).unwrap();
    TriMesh::read(&bytes, MeshFormat::Obj).unwrap().0
}

/// Looks at an object in its most stable rest, with an elevation of 30 to 60 degrees.
fn look(mesh: &TriMesh, number: u32) -> (Pose<World, Object>, DepthView) {
    let mass = geometry::mass_properties(mesh, 1.0);
    let rests = geometry::stable_rests(mesh, &mass.center_of_mass_m);
    let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), 0.3 + 1.7 * f64::from(number));
    let at_origin = Isometry3::from_parts(Vector3::zeros().into(), turn);
    let world_from_object = Pose::new(at_origin * *rests[0].rest.table_from_object());
    let (low, high) = mesh.bounds();
    let target = world_from_object * nalgebra::center(&low, &high);
    let elevation = (30.0 + 10.0 * f64::from(number)).to_radians();
    let toward = Vector3::new(elevation.cos(), 0.0, elevation.sin());
    let camera = looking_at(target + toward * 0.6, target);
    let object = RenderedObject {
        mesh,
        world_from_object,
    };
    let rendered = render(&object, &Intrinsics::of_field(640, 480, 1.2), &camera);
    let view = StereoNoise::default().measured(&rendered, number.into());
    (world_from_object, view)
}

fn row(
    shape: &CompletedShape,
    mesh: &TriMesh,
    world_from_object: &Pose<World, Object>,
    view: &DepthView,
    ms: f64,
) -> Row {
    let estimated_from_world = shape.observation.world_from_object.inverse();
    let estimated_from_true = estimated_from_world * *world_from_object;
    let truth = TriMesh {
        vertices_m: mesh
            .vertices_m
            .iter()
            .map(|&vertex| estimated_from_true * vertex)
            .collect(),
        triangles: mesh.triangles.clone(),
    };
    let camera = estimated_from_world * Point3::from(view.world_from_camera.translation.vector);
    let off_mm = |surface: &SurfaceDistance, point: &Point3<f64>| {
        1e3 * surface.signed_distance(point).distance_m.abs()
    };
    let mean =
        |distances: Vec<f64>| distances.iter().sum::<f64>() / (distances.len() as f64).max(1.0);
    let estimate = SurfaceDistance::new(&shape.mesh);
    let (points, normals) = truth.sample_surface(POINTS, 1);
    let of_side = |seen: bool| {
        let pairs = points.iter().zip(&normals);
        let side = pairs.filter(|(point, normal)| (normal.dot(&(camera - **point)) > 0.0) == seen);
        mean(side.map(|(point, _)| off_mm(&estimate, point)).collect())
    };
    let surface = SurfaceDistance::new(&truth);
    let (own, _) = shape.mesh.sample_surface(POINTS, 2);
    let over = mean(own.iter().map(|point| off_mm(&surface, point)).collect());
    let volume = shape.mesh.volume_m3() / truth.volume_m3();
    [of_side(true), of_side(false), over, volume, ms]
}
