//! Seven bodies that a hand can take from the side.

use nalgebra::{Matrix3, Point3, Vector3};
use simulation::ObjectShape;
use spatial::RestingPose;

/// Name, sides (0: a box), half extents in meters, mass in kilograms.
const BODIES: [(&str, u32, [f64; 3], f64); 7] = [
    ("can", 16, [0.034, 0.034, 0.051], 0.349),
    ("thin can", 16, [0.025, 0.025, 0.06], 0.15),
    ("wide can", 16, [0.042, 0.042, 0.045], 0.5),
    ("box", 0, [0.03, 0.03, 0.06], 0.2),
    ("block", 0, [0.036, 0.03, 0.06], 0.25),
    ("brick", 0, [0.045, 0.025, 0.05], 0.4),
    ("hexagonal prism", 6, [0.036, 0.036, 0.055], 0.3),
];

/// The bodies, each standing, about its center.
pub(crate) fn bodies() -> Vec<(&'static str, ObjectShape, RestingPose)> {
    BODIES.map(body).to_vec()
}

/// A body that stands, about its center.
pub(crate) fn body(
    (name, sides, half, mass_kg): (&'static str, u32, [f64; 3], f64),
) -> (&'static str, ObjectShape, RestingPose) {
    let outline: Vec<[f64; 2]> = if sides == 0 {
        let corners = [[1.0, 1.0], [-1.0, 1.0], [-1.0, -1.0], [1.0, -1.0]];
        corners.map(|[x, y]| [x * half[0], y * half[1]]).to_vec()
    } else {
        let turns = (0..sides).map(|idx| std::f64::consts::TAU * f64::from(idx) / f64::from(sides));
        turns
            .map(|turn| [half[0] * turn.cos(), half[1] * turn.sin()])
            .collect()
    };
    let points = outline
        .iter()
        .flat_map(|[x, y]| [-half[2], half[2]].map(|z| Point3::new(*x, *y, z)))
        .collect();
    // Mean squares of the coordinates: of a box a third, of a disk a quarter of the half extents'.
    let flat = if sides == 0 { 3.0 } else { 4.0 };
    let [x, y, z] = [
        half[0].powi(2) / flat,
        half[1].powi(2) / flat,
        half[2].powi(2) / 3.0,
    ];
    let object = ObjectShape {
        surface: None,
        parts_m: vec![points],
        mass_kg,
        center_of_mass_m: Point3::origin(),
        inertia_kg_m2: Matrix3::from_diagonal(&Vector3::new(y + z, x + z, x + y)) * mass_kg,
    };
    let rest = RestingPose {
        up_in_object: Vector3::z_axis(),
        height_m: half[2],
    };
    (name, object, rest)
}
