//! The objects: our own meshes with the sizes, names and frames of the YCB objects in DexYCB.
//!
//! As in the dataset, z is up for what stands, drill and banana lie flat, and the origin is neither
//! the middle nor the base. Sizes are nominal ones (Calli et al., "Benchmarking in manipulation
//! research: the YCB object and model set", 2015), shapes are simplified.

use geometry::{
    TriMesh,
    solid::{
        Builder, Ring, ellipse, level_set, loft, oriented_ellipse, rounded_box, rounded_rectangle,
        smooth_min, tapered,
    },
};
use nalgebra::{Point3, Vector3};

/// Placement and grasp of objects of a kind.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum GraspPlacement {
    /// It may also lie on its side; it is taken across its body.
    Any,
    /// It always lies as in its own frame; it is taken across its body.
    Upright,
    /// It always stands open side up; it is taken at its rim.
    Rim,
}

/// One kind of object.
pub(crate) struct ObjectKind {
    /// Number in the dataset's `ycb_ids`, from one.
    pub(crate) id: i32,
    /// The dataset's name.
    pub(crate) name: &'static str,
    /// Its placement and grasp.
    pub(crate) handling: GraspPlacement,
    /// Makes its mesh.
    pub(crate) mesh: fn() -> TriMesh,
}

/// Every object, by number.
pub(crate) const OBJECT_KINDS: [ObjectKind; 15] = [
    ObjectKind {
        id: 1,
        name: "002_master_chef_can",
        handling: GraspPlacement::Any,
        mesh: || can(51.0, -73.7, 66.4),
    },
    ObjectKind {
        id: 2,
        name: "003_cracker_box",
        handling: GraspPlacement::Any,
        mesh: || carton(30.0, 79.0, -108.0, 102.0),
    },
    ObjectKind {
        id: 3,
        name: "004_sugar_box",
        handling: GraspPlacement::Any,
        mesh: || carton(19.5, 44.5, -92.0, 83.0),
    },
    ObjectKind {
        id: 4,
        name: "005_tomato_soup_can",
        handling: GraspPlacement::Any,
        mesh: || can(33.0, -59.3, 41.7),
    },
    ObjectKind {
        id: 5,
        name: "006_mustard_bottle",
        handling: GraspPlacement::Any,
        mesh: mustard_bottle,
    },
    ObjectKind {
        id: 7,
        name: "008_pudding_box",
        handling: GraspPlacement::Any,
        mesh: || carton(44.5, 55.0, -20.0, 15.0),
    },
    ObjectKind {
        id: 9,
        name: "010_potted_meat_can",
        handling: GraspPlacement::Any,
        mesh: potted_meat_can,
    },
    ObjectKind {
        id: 10,
        name: "011_banana",
        handling: GraspPlacement::Upright,
        mesh: banana,
    },
    ObjectKind {
        id: 12,
        name: "021_bleach_cleanser",
        handling: GraspPlacement::Any,
        mesh: bleach_cleanser,
    },
    ObjectKind {
        id: 13,
        name: "024_bowl",
        handling: GraspPlacement::Rim,
        mesh: bowl,
    },
    ObjectKind {
        id: 14,
        name: "025_mug",
        handling: GraspPlacement::Upright,
        mesh: mug,
    },
    ObjectKind {
        id: 15,
        name: "035_power_drill",
        handling: GraspPlacement::Upright,
        mesh: power_drill,
    },
    ObjectKind {
        id: 16,
        name: "036_wood_block",
        handling: GraspPlacement::Any,
        mesh: || carton(42.5, 42.5, -116.0, 84.0),
    },
    ObjectKind {
        id: 21,
        name: "061_foam_brick",
        handling: GraspPlacement::Any,
        mesh: || carton(25.0, 37.5, -17.0, 33.0),
    },
    ObjectKind {
        id: 22,
        name: "056_tennis_ball",
        handling: GraspPlacement::Upright,
        mesh: tennis_ball,
    },
];

/// Returns every object's name and its mesh in meters, by number.
pub fn object_meshes() -> impl Iterator<Item = (&'static str, TriMesh)> {
    OBJECT_KINDS.iter().map(|kind| (kind.name, (kind.mesh)()))
}

/// Millimeters in a meter: shapes below are written in millimeters.
const MM: f64 = 1e-3;
/// Corners of a round section.
const AROUND: u32 = 36;

/// Stacks sections given as (half x, half y, squareness, height) in millimeters.
fn stack(sections: &[(f64, f64, f64, f64)]) -> TriMesh {
    let rings: Vec<Ring> = sections
        .iter()
        .map(|&(a, b, squareness, z)| ellipse(a * MM, b * MM, squareness, z * MM, AROUND))
        .collect();
    moved(loft(&rings), Vector3::new(-1.0, 0.8, 0.0))
}

/// Moves a mesh by millimeters: the dataset's origins are never quite in the middle.
fn moved(mut mesh: TriMesh, by_mm: Vector3<f64>) -> TriMesh {
    for vertex in &mut mesh.vertices_m {
        *vertex += by_mm * MM;
    }
    mesh
}

/// Returns heights between two ends, in equal steps, without the ends.
fn between(low: f64, high: f64, steps: u32) -> impl Iterator<Item = f64> {
    (1..steps).map(move |k| low + (high - low) * f64::from(k) / f64::from(steps))
}

fn can(radius: f64, low: f64, high: f64) -> TriMesh {
    let round = |r: f64, z: f64| (r, r, 2.0, z);
    let mut sections = vec![round(radius - 1.5, low), round(radius, low + 1.5)];
    sections.extend(between(low, high, 10).map(|z| round(radius, z)));
    sections.extend([round(radius, high - 1.5), round(radius - 1.5, high)]);
    stack(&sections)
}

fn carton(half_x: f64, half_y: f64, low: f64, high: f64) -> TriMesh {
    let edge = 2.0;
    let section = |inset: f64, z: f64| {
        let (a, b) = ((half_x - inset) * MM, (half_y - inset) * MM);
        rounded_rectangle(a, b, (edge + 1.0 - inset) * MM, z * MM)
    };
    let mut rings = vec![section(edge, low), section(0.0, low + edge)];
    rings.extend(between(low, high, 8).map(|z| section(0.0, z)));
    rings.extend([section(0.0, high - edge), section(edge, high)]);
    moved(loft(&rings), Vector3::new(0.7, -1.2, 0.0))
}

fn mustard_bottle() -> TriMesh {
    let mut sections = vec![(43.0, 26.0, 3.0, -83.9), (47.5, 29.5, 3.0, -80.0)];
    sections.extend(between(-80.0, 45.0, 8).map(|z| (47.5, 29.5, 3.0, z)));
    sections.extend([
        (47.0, 29.5, 3.0, 45.0),
        (43.0, 28.0, 2.7, 58.0),
        (34.0, 24.0, 2.4, 70.0),
        (22.0, 19.0, 2.0, 79.0),
        (16.0, 16.0, 2.0, 84.0),
        (14.5, 14.5, 2.0, 94.0),
        (8.0, 8.0, 2.0, 98.0),
        (5.0, 5.0, 2.0, 107.5),
    ]);
    stack(&sections)
}

fn potted_meat_can() -> TriMesh {
    let mut sections = vec![(48.5, 27.0, 4.0, -49.8), (50.0, 28.5, 4.0, -48.0)];
    sections.extend(between(-48.0, 32.0, 9).map(|z| (50.0, 28.5, 4.0, z)));
    sections.extend([(50.0, 28.5, 4.0, 32.0), (48.5, 27.0, 4.0, 33.8)]);
    stack(&sections)
}

fn bleach_cleanser() -> TriMesh {
    let mut sections = vec![(46.0, 29.0, 3.0, -112.0), (50.0, 33.0, 3.0, -108.0)];
    sections.extend(between(-108.0, 50.0, 10).map(|z| (50.0, 33.0, 3.0, z)));
    sections.extend([
        (49.0, 32.5, 2.8, 50.0),
        (43.0, 30.0, 2.5, 68.0),
        (33.0, 25.0, 2.2, 85.0),
        (22.0, 19.0, 2.0, 98.0),
        (18.0, 17.0, 2.0, 106.0),
        (17.0, 16.0, 2.0, 128.0),
        (12.0, 11.0, 2.0, 138.6),
    ]);
    stack(&sections)
}

/// Half the banana's height, in millimeters.
const FLAT_MM: f64 = 18.0;

/// An arc in the horizontal plane, thick in the middle.
fn banana() -> TriMesh {
    let steps = 22_u32;
    let arc_radius = 112.0;
    let span = 1.72_f64;
    let rings: Vec<Ring> = (0..=steps)
        .map(|k| {
            let along = f64::from(k) / f64::from(steps);
            let angle = span * (along - 0.5);
            let thick = 20.5
                * (1.0 - (2.0 * along - 1.0).abs().powf(4.0))
                    .max(0.0)
                    .sqrt()
                    .max(0.3);
            let outward = Vector3::new(angle.cos(), angle.sin(), 0.0);
            let center = Point3::from(outward * (arc_radius * MM));
            // Outward × down is the direction in which the angle grows.
            let mut ring = oriented_ellipse(
                center,
                outward * (thick * 0.88 * MM),
                Vector3::z() * (-thick * MM),
                24,
            );
            for point in &mut ring {
                // Flat sides: it lies firmly.
                point.z = point.z.clamp(-FLAT_MM * MM, FLAT_MM * MM);
            }
            ring
        })
        .collect();
    moved(loft(&rings), Vector3::new(-95.0, -6.0, 1.4))
}

/// A ball with a flat 1 cm wide, on which it comes to rest instead of rolling away.
fn tennis_ball() -> TriMesh {
    let radius: f64 = 32.5;
    let rings = 18;
    let sections: Vec<_> = (0..=rings)
        .map(|k| {
            let angle = std::f64::consts::PI * (f64::from(k) + 1.0) / (f64::from(rings) + 2.0);
            let r = radius * angle.sin();
            (r, r, 2.0, -radius * angle.cos())
        })
        .collect();
    stack(&sections)
}

fn bowl() -> TriMesh {
    let profile: [(f64, f64); 15] = [
        (20.0, -24.5),
        (34.0, -24.2),
        (40.0, -21.0),
        (55.0, -13.0),
        (67.0, -1.0),
        (75.5, 14.0),
        (79.0, 24.0),
        (80.5, 30.5),
        (77.5, 30.5),
        (76.0, 24.0),
        (72.5, 14.5),
        (64.5, 1.0),
        (53.0, -10.5),
        (38.0, -18.5),
        (20.0, -20.5),
    ];
    let sections: Vec<_> = profile.iter().map(|&(r, z)| (r, r, 2.0, z)).collect();
    stack(&sections)
}

/// A cup whose wall has two openings that its handle joins.
fn mug() -> TriMesh {
    let radius = 40.0;
    let outer_levels: Vec<f64> = std::iter::once(-37.0)
        .chain(between(-37.0, 41.0, 12))
        .chain([41.0])
        .collect();
    let mut profile: Vec<(f64, f64)> = vec![(38.0, -39.0)];
    profile.extend(outer_levels.iter().map(|&z| (radius, z)));
    profile.extend([
        (39.2, 42.4),
        (36.8, 42.4),
        (36.0, 41.0),
        (36.0, 20.0),
        (36.0, -5.0),
        (36.0, -31.0),
        (33.0, -34.0),
    ]);
    let mut builder = Builder::default();
    let rings: Vec<Vec<u32>> = profile
        .iter()
        .map(|&(r, z)| builder.ring(&ellipse(r * MM, r * MM, 2.0, z * MM, AROUND)))
        .collect();
    for (row, pair) in rings.windows(2).enumerate() {
        let open = OPENINGS
            .iter()
            .any(|&first| row == first || row == first + 1);
        let leave_out: &[usize] = if open { &[0, LAST_COLUMN] } else { &[] };
        if let [low, high] = pair {
            builder.strip(low, high, leave_out);
        }
    }
    if let (Some(first), Some(inner)) = (rings.first(), rings.last()) {
        let mut backwards = first.clone();
        backwards.reverse();
        builder.cap(&backwards);
        builder.cap(inner);
    }
    add_handle(&mut builder, &rings, &profile);
    moved(builder.build(), Vector3::new(-1.5, 0.7, 0.0))
}

/// Openings of 2 × 2 quads about the column of +x in a mug's wall, the lower one first: rows counted from
/// the first ring.
const OPENINGS: [usize; 2] = [3, 9];
/// The last column of quads around a mug, beside that of +x.
const LAST_COLUMN: usize = AROUND as usize - 1;

/// Adds the handle that joins the two openings of a mug's wall, given the vertices of its rings and their
/// radii and heights in millimeters.
fn add_handle(builder: &mut Builder, rings: &[Vec<u32>], profile: &[(f64, f64)]) {
    // Eight vertices around an opening, by angle from +y towards +z.
    let around = |row: usize, up: [usize; 3]| {
        let column = |side: i32| match side {
            1 => 1,
            0 => 0,
            _ => LAST_COLUMN,
        };
        [
            (1, 1),
            (1, 2),
            (0, 2),
            (-1, 2),
            (-1, 1),
            (-1, 0),
            (0, 0),
            (1, 0),
        ]
        .map(|(side, height): (i32, usize)| rings[row + up[height]][column(side)])
        .to_vec()
    };
    let [bottom, top] = OPENINGS;
    let mut tube = vec![around(top, [0, 1, 2])];
    let height_of = |row: usize| profile[row + 1].1;
    let (high, low) = (height_of(top), height_of(bottom));
    let (middle, reach) = (high.midpoint(low), (high - low) / 2.0);
    let steps = 10_u32;
    for k in 0..=steps {
        let angle = std::f64::consts::PI * (0.5 - f64::from(k) / f64::from(steps));
        let (sin, cos) = angle.sin_cos();
        let center = Point3::new(44.0 + 21.0 * cos, 0.0, middle + reach * sin) * MM;
        let inward = Vector3::new(cos, 0.0, sin);
        tube.push(builder.ring(&oriented_ellipse(
            center,
            Vector3::y() * (5.5 * MM),
            inward * (4.5 * MM),
            8,
        )));
    }
    tube.push(around(bottom, [2, 1, 0]));
    for (from, to) in tube.iter().zip(tube.iter().skip(1)) {
        builder.strip(from, to, &[]);
    }
}

/// A motor with its chuck, a handle and a foot, lying on its side.
fn power_drill() -> TriMesh {
    let shape = |p: &Point3<f64>| {
        let p = p / MM;
        let motor = tapered(
            &p,
            Point3::new(-18.0, 42.0, 0.0),
            Point3::new(52.0, 42.0, 0.0),
            27.5,
            27.5,
        );
        let chuck = tapered(
            &p,
            Point3::new(-88.0, 42.0, 0.0),
            Point3::new(-18.0, 42.0, 0.0),
            12.0,
            22.0,
        );
        let handle = tapered(
            &p,
            Point3::new(30.0, 30.0, 0.0),
            Point3::new(38.0, -80.0, 0.0),
            20.0,
            19.0,
        );
        let foot = rounded_box(
            &(p - Vector3::new(30.0, -96.0, 0.0)),
            Vector3::new(40.0, 17.0, 27.0),
            8.0,
        );
        let upper = smooth_min(motor, chuck, 8.0);
        smooth_min(smooth_min(upper, handle, 12.0), foot, 10.0) * MM
    };
    let mesh = level_set(
        shape,
        Point3::new(-0.115, -0.13, -0.045),
        Point3::new(0.1, 0.09, 0.045),
        8.0 * MM,
    );
    moved(mesh, Vector3::new(1.0, 0.5, 1.9))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn meshes_are_closed_of_moderate_size_and_wind_outward() {
        for kind in &OBJECT_KINDS {
            let mesh = (kind.mesh)();
            let (low, high) = mesh.bounds();
            println!(
                "{}: {} faces, {:.1} cm3, {:.1?} to {:.1?}",
                kind.name,
                mesh.triangles.len(),
                mesh.volume_m3() * 1e6,
                (low.coords * 1e3).as_slice(),
                (high.coords * 1e3).as_slice()
            );
            assert!(mesh.is_watertight(), "{}", kind.name);
            assert!(mesh.volume_m3() > 1e-5, "{}", kind.name);
            assert!(
                (500..=2600).contains(&mesh.triangles.len()),
                "{}: {}",
                kind.name,
                mesh.triangles.len()
            );
            let hull = mesh.convex_hull().unwrap().volume_m3();
            assert!(mesh.volume_m3() < hull * 1.001, "{}", kind.name);
        }
    }

    #[test]
    fn numbers_and_names_are_those_of_the_dataset() {
        for pair in OBJECT_KINDS.windows(2) {
            assert!(pair[0].id < pair[1].id);
            // The ball is YCB's but none of the dataset's 21, so it comes behind them.
            assert!(pair[0].name < pair[1].name || pair[1].id == 22);
        }
        assert!(OBJECT_KINDS.iter().all(|kind| (1..=22).contains(&kind.id)));
    }
}
