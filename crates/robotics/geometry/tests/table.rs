//! The table below still objects: made-up scenes with measured noise, and real scenes against the
//! tag that was on the table.

use std::{
    collections::BTreeMap,
    f64::consts::TAU,
    fs,
    path::{Path, PathBuf},
};

use geometry::{
    StablePose, StillObject, TablePlane, TriMesh, mass_properties, stable_rests, table_plane,
};
use nalgebra::{
    Isometry3, Matrix3, Point3, Rotation3, Translation3, Unit, UnitQuaternion, Vector3,
};
use npyz::npz::NpzArchive;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use spatial::{Object, Pose, World};

/// A shape and how it can lie.
struct Shape {
    vertices_m: Vec<Point3<f64>>,
    rests: Vec<StablePose>,
}

impl Shape {
    fn new(mesh: &TriMesh) -> Self {
        let center = mass_properties(mesh, 1.0).center_of_mass_m;
        Self {
            vertices_m: mesh.convex_hull().unwrap().vertices_m,
            rests: stable_rests(mesh, &center),
        }
    }

    /// The hull of a polygon of `n` corners at the bottom and a smaller one at the top.
    fn tapered(n: u32, [x, y, height]: [f64; 3], top: f64) -> Self {
        let layer = |z: f64, scale: f64| {
            (0..n).map(move |k| {
                let (sin, cos) = (TAU * (f64::from(k) + 0.5) / f64::from(n)).sin_cos();
                Point3::new(x * cos * scale, y * sin * scale, z)
            })
        };
        let points = TriMesh {
            vertices_m: layer(0.0, 1.0).chain(layer(height, top)).collect(),
            triangles: Vec::new(),
        };
        Self::new(&points.convex_hull().unwrap())
    }

    fn standing(&self, world_from_object: Pose<World, Object>) -> StillObject<'_> {
        StillObject {
            world_from_object,
            rests: &self.rests,
            vertices_m: &self.vertices_m,
        }
    }
}

/// A box, a can, a block and a cup.
fn shapes() -> Vec<Shape> {
    vec![
        Shape::tapered(4, [0.12, 0.05, 0.16], 1.0),
        Shape::tapered(24, [0.034, 0.034, 0.1], 1.0),
        Shape::tapered(4, [0.05, 0.05, 0.2], 0.9),
        Shape::tapered(16, [0.03, 0.03, 0.09], 1.4),
    ]
}

/// Gaussian noise of three coordinates, by the central limit.
fn noise(rng: &mut ChaCha8Rng, deviation: f64) -> Vector3<f64> {
    Vector3::from_fn(|_, _| {
        let sum: f64 = (0..12).map(|_| rng.random::<f64>()).sum();
        (sum - 6.0) * deviation
    })
}

/// A made-up table: which way is up, how high it is, and the world in which it is measured.
struct Scene {
    world_from_table: Isometry3<f64>,
    poses: Vec<Pose<World, Object>>,
}

/// Drops each shape, in the pose of probability, somewhere on a table that lies anyhow in the
/// world; measures the poses with 2 mm and 2 degrees of noise.
fn scene(shapes: &[Shape], rng: &mut ChaCha8Rng) -> Scene {
    let turn = Rotation3::new(noise(rng, 1.5));
    let place = Translation3::from(noise(rng, 0.5));
    let world_from_table = Isometry3::from_parts(place, turn.into());
    let poses = shapes
        .iter()
        .map(|shape| {
            let mut left = rng.random::<f64>();
            let stable = shape
                .rests
                .iter()
                .find(|stable| {
                    left -= stable.probability;
                    left <= 0.0
                })
                .unwrap_or(&shape.rests[0]);
            let yaw =
                UnitQuaternion::from_axis_angle(&Vector3::z_axis(), TAU * rng.random::<f64>());
            let on_table =
                Translation3::new(0.5 * rng.random::<f64>(), 0.5 * rng.random::<f64>(), 0.0);
            let table_from_object = on_table * yaw * *stable.rest.table_from_object();
            let exact = world_from_table * table_from_object;
            Pose::from_parts(
                exact.translation.vector + noise(rng, 0.002),
                // 2 degrees in all.
                UnitQuaternion::new(noise(rng, 2_f64.to_radians() / 3_f64.sqrt())) * exact.rotation,
            )
        })
        .collect();
    Scene {
        world_from_table,
        poses,
    }
}

/// Returns how far a found plane is from the true one: in radians, and in meters below the middle
/// of the table.
fn errors(plane: &TablePlane, world_from_table: &Isometry3<f64>) -> (f64, f64) {
    let up = world_from_table * Vector3::z();
    let middle = world_from_table * Point3::new(0.25, 0.25, 0.0);
    let height_m = plane.up.dot(&middle.coords);
    (plane.up.angle(&up), (plane.height_m - height_m).abs())
}

/// Returns the value that so many percent of all are within.
fn percentile(values: &[f64], percent: usize) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    sorted[(sorted.len() - 1) * percent / 100]
}

const SCENES: usize = 400;

#[test]
fn several_objects_find_their_table() {
    let shapes = shapes();
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let (mut angles, mut heights) = (Vec::new(), Vec::new());
    for _ in 0..SCENES {
        let scene = scene(&shapes, &mut rng);
        let objects: Vec<_> = shapes
            .iter()
            .zip(&scene.poses)
            .map(|(s, p)| s.standing(*p))
            .collect();
        // A camera somewhere above.
        let toward = scene.world_from_table * Vector3::new(0.8, -0.3, 0.6);
        let plane = table_plane(&objects, Some(toward)).unwrap();
        let (angle, height_m) = errors(&plane, &scene.world_from_table);
        angles.push(angle.to_degrees());
        heights.push(height_m * 1e3);
    }
    let wrong = angles.iter().filter(|angle| **angle > 5.0).count();
    println!(
        "median {:.2} deg, {:.2} mm; 95 % {:.2} deg, {:.2} mm; {wrong} wrong",
        percentile(&angles, 50),
        percentile(&heights, 50),
        percentile(&angles, 95),
        percentile(&heights, 95),
    );
    assert!(wrong * 100 <= SCENES, "{wrong}");
    assert!(percentile(&angles, 95) < 2.5);
    assert!(percentile(&heights, 95) < 12.0);
}

#[test]
fn without_noise_the_plane_is_exact() {
    let shapes = shapes();
    let world_from_table =
        Isometry3::new(Vector3::new(0.1, 0.2, 0.3), Vector3::new(1.0, 0.4, -0.2));
    let poses: Vec<Pose<World, Object>> = (0..)
        .zip(&shapes)
        .map(|(k, shape)| {
            let at = Isometry3::new(
                Vector3::new(0.2 * f64::from(k), 0.1, 0.0),
                Vector3::z() * f64::from(k),
            );
            Pose::new(world_from_table * at * *shape.rests[0].rest.table_from_object())
        })
        .collect();
    let objects: Vec<_> = shapes
        .iter()
        .zip(&poses)
        .map(|(s, p)| s.standing(*p))
        .collect();
    let plane = table_plane(&objects, Some(world_from_table * Vector3::z())).unwrap();
    let (angle, height_m) = errors(&plane, &world_from_table);
    assert!(angle < 1e-6 && height_m < 1e-6, "{plane:?}");
    assert_eq!(plane.agreeing_n, 4);
    assert!(
        plane.spread_rad < 1e-6 && plane.spread_m < 1e-6,
        "{plane:?}"
    );
}

#[test]
fn an_object_in_the_air_moves_nothing() {
    let shapes = shapes();
    let mut rng = ChaCha8Rng::seed_from_u64(2);
    let mut n_scenes = 0;
    for _ in 0..SCENES {
        let scene = scene(&shapes, &mut rng);
        let toward = Some(scene.world_from_table * Vector3::z());
        let standing: Vec<_> = shapes
            .iter()
            .zip(&scene.poses)
            .map(|(s, p)| s.standing(*p))
            .collect();
        let without = table_plane(&standing[1..], toward).unwrap();
        if without.agreeing_n < 3 {
            continue;
        }
        n_scenes += 1;
        // Upright in the air, turned in the air, and so with two objects left on the table.
        let lift = scene.world_from_table * Vector3::new(0.0, 0.0, 0.15);
        let turned = UnitQuaternion::new(scene.world_from_table * Vector3::new(0.6, 0.0, 0.0));
        let hanging = scene.poses[0];
        for pose in [
            Translation3::from(lift) * *hanging,
            Isometry3::from_parts(
                Translation3::from(hanging.translation.vector + lift),
                turned * hanging.rotation,
            ),
        ] {
            let mut objects = standing.clone();
            objects[0] = shapes[0].standing(Pose::new(pose));
            assert_eq!(table_plane(&objects, toward).unwrap(), without);
        }
    }
    assert!(n_scenes > SCENES / 2, "{n_scenes}");
}

#[test]
fn one_object_is_enough_where_its_likeliest_rest_is_the_true_one() {
    let world_from_table = Isometry3::new(Vector3::new(0.0, 0.1, 0.4), Vector3::new(0.2, 0.1, 0.0));
    let camera = Some(Vector3::new(0.1, 0.3, 0.9));
    for shape in &shapes() {
        let likeliest = &shape.rests[0].rest;
        let pose = world_from_table * *likeliest.table_from_object();
        let plane = table_plane(&[shape.standing(Pose::new(pose))], camera).unwrap();
        let (angle, height_m) = errors(&plane, &world_from_table);
        assert!(angle < 1e-9 && height_m < 1e-9, "{plane:?}");
        assert_eq!(plane.agreeing_n, 1);
    }
}

#[test]
fn missing_support_gives_no_table() {
    assert!(table_plane(&[], None).is_none());
    let shape = &shapes()[0];
    let pose = Pose::new(Isometry3::identity());
    let no_rests = StillObject {
        rests: &[],
        ..shape.standing(pose)
    };
    assert!(table_plane(&[no_rests], None).is_none());
    // Only rests whose up is along the hint count.
    let cone = Shape {
        rests: shape.rests[..1].to_vec(),
        vertices_m: shape.vertices_m.clone(),
    };
    let down = -cone.rests[0].rest.up_in_object.into_inner();
    assert!(table_plane(&[cone.standing(pose)], Some(down)).is_none());
}

// --- real scenes ---

/// Names by DexYCB's numbers, from 1.
const NAMES: [&str; 21] = [
    "002_master_chef_can",
    "003_cracker_box",
    "004_sugar_box",
    "005_tomato_soup_can",
    "006_mustard_bottle",
    "007_tuna_fish_can",
    "008_pudding_box",
    "009_gelatin_box",
    "010_potted_meat_can",
    "011_banana",
    "019_pitcher_base",
    "021_bleach_cleanser",
    "024_bowl",
    "025_mug",
    "035_power_drill",
    "036_wood_block",
    "037_scissors",
    "040_large_marker",
    "051_large_clamp",
    "052_extra_large_clamp",
    "061_foam_brick",
];

fn folders(parent: &Path) -> Vec<PathBuf> {
    let mut all: Vec<PathBuf> = fs::read_dir(parent)
        .unwrap()
        .map(|entry| entry.unwrap().path())
        .filter(|path| path.is_dir())
        .collect();
    all.sort();
    all
}

/// Returns the items of a list of YAML.
fn list(text: &str, key: &str) -> Vec<String> {
    text.lines()
        .skip_while(|line| line.trim() != key)
        .skip(1)
        .map_while(|line| line.trim_start().strip_prefix("- "))
        .map(|item| item.trim_matches(['\'', '"']).to_owned())
        .collect()
}

/// Returns where the tag is.
fn world_from_tag(root: &Path, meta: &str) -> Isometry3<f64> {
    let id = meta
        .lines()
        .find_map(|line| line.strip_prefix("extrinsics: "))
        .unwrap();
    let id = id.trim_matches(['\'', '"']);
    let path = root.join(format!("calibration/extrinsics_{id}/extrinsics.yml"));
    let rows: Vec<f64> = list(&fs::read_to_string(path).unwrap(), "apriltag:")
        .iter()
        .map(|number| number.parse().unwrap())
        .collect();
    let turn = Matrix3::from_fn(|row, column| rows[4 * row + column]);
    Isometry3::from_parts(
        Translation3::new(rows[3], rows[7], rows[11]),
        UnitQuaternion::from_matrix(&turn),
    )
}

/// Returns the poses of all objects in the first image.
fn first_poses(sequence: &Path, n: usize) -> Vec<Pose<World, Object>> {
    let mut npz = NpzArchive::open(sequence.join("pose.npz")).unwrap();
    let numbers: Vec<f32> = npz.by_name("pose_y").unwrap().unwrap().into_vec().unwrap();
    let (rows, _) = numbers.as_chunks::<7>();
    rows[..n]
        .iter()
        .map(|&[x, y, z, w, tx, ty, tz]| {
            let parts = nalgebra::Vector4::new(x, y, z, w).cast::<f64>();
            Pose::from_parts(
                Vector3::new(tx, ty, tz).cast::<f64>(),
                Unit::new_normalize(nalgebra::Quaternion::from(parts)),
            )
        })
        .collect()
}

#[test]
fn real_scenes_stand_on_the_plane_of_their_tag() {
    let Some(root) = measured_data::folder("dexycb-right") else {
        return;
    };
    let mut shapes: BTreeMap<usize, Shape> = BTreeMap::new();
    let mut found: Vec<(f64, f64, TablePlane, String)> = Vec::new();
    for sequence in folders(&root).iter().flat_map(|subject| folders(subject)) {
        let Ok(meta) = fs::read_to_string(sequence.join("meta.yml")) else {
            continue;
        };
        let ids: Vec<usize> = list(&meta, "ycb_ids:")
            .iter()
            .map(|id| id.parse().unwrap())
            .collect();
        for &id in &ids {
            shapes.entry(id).or_insert_with(|| {
                let path = root
                    .join("models")
                    .join(NAMES[id - 1])
                    .join("textured_simple.obj");
                Shape::new(&TriMesh::from_obj(&fs::read_to_string(path).unwrap()).unwrap())
            });
        }
        let poses = first_poses(&sequence, ids.len());
        let objects: Vec<_> = ids
            .iter()
            .zip(&poses)
            .map(|(id, pose)| shapes[id].standing(*pose))
            .collect();
        let world_from_tag = world_from_tag(&root, &meta);
        // The first camera is the world's origin.
        let middle: Vector3<f64> = poses.iter().map(|pose| pose.translation.vector).sum();
        let plane = table_plane(&objects, Some(-middle)).unwrap();
        let up = world_from_tag * Vector3::z();
        // The height below the objects, not below the tag, which is not among them.
        let below = middle / poses.len() as f64;
        let above_tag_m = up.dot(&(below - world_from_tag.translation.vector));
        let above_plane_m = plane.up.dot(&below) - plane.height_m;
        found.push((
            plane.up.angle(&up).to_degrees(),
            (above_plane_m - above_tag_m).abs() * 1e3,
            plane,
            format!("{} {ids:?}", sequence.display()),
        ));
    }
    assert_eq!(found.len(), 376);
    let report = |name: &str, of: &[&(f64, f64, TablePlane, String)]| {
        let angles: Vec<f64> = of.iter().map(|one| one.0).collect();
        let heights: Vec<f64> = of.iter().map(|one| one.1).collect();
        print!("{name}: {:3} scenes", of.len());
        for percent in [50, 90, 95, 99, 100] {
            let [angle, height_mm] = [&angles, &heights].map(|all| percentile(all, percent));
            print!("; {percent} % {angle:.2} deg, {height_mm:.2} mm");
        }
        println!();
        (percentile(&angles, 100), percentile(&heights, 100))
    };
    report("all", &found.iter().collect::<Vec<_>>());
    for agreeing_n in 1..=4 {
        let of: Vec<_> = found
            .iter()
            .filter(|(_, _, plane, _)| plane.agreeing_n == agreeing_n)
            .collect();
        let (angle, height_mm) = report(&format!("{agreeing_n} agree"), &of);
        if agreeing_n >= 3 {
            assert!(
                angle < 3.0 && height_mm < 5.0,
                "{angle} degrees, {height_mm} mm"
            );
        }
    }
    // Two objects may agree by chance, or lie as their shape does not tell.
    let wrong: Vec<_> = found.iter().filter(|(angle, ..)| *angle > 6.0).collect();
    for (angle, height_mm, plane, name) in &wrong {
        println!(
            "{name}: {angle:.1} degrees, {height_mm:.1} mm, {} agree",
            plane.agreeing_n
        );
    }
    assert!(wrong.len() <= 8, "{}", wrong.len());
}
