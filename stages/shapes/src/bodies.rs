//! Bodies of the families, in meters, about their origin.
//!
//! Sizes are those of household things that one hand takes: closed bodies are 10 to 100 mm across at their narrowest,
//! vessels up to 170 mm, and none is longer than 300 mm, as the objects of the YCB set (Calli et al., "Benchmarking in
//! manipulation research: the YCB object and model set", 2015).

use std::f64::consts::{FRAC_PI_2, TAU};

use geometry::{
    TriMesh,
    solid::{Ring, ellipse, level_set, loft, rounded_box, rounded_rectangle, smooth_min, tapered},
};
use nalgebra::{Point3, Rotation3, Vector3};
use rand::Rng;

/// Corners of a round section.
const AROUND: u32 = 32;
/// Sections of a body of revolution or a prism.
const SECTIONS: u32 = 12;
/// Widest that a hand takes a thing across, in meters.
const WIDEST_M: f64 = 0.10;

/// Makes a closed body of a family drawn at random.
pub(crate) fn body(random: &mut impl Rng) -> TriMesh {
    let mut drawn = of_family(random);
    // Where two surfaces of a blend pass through one cell, its mesh may have an edge of four triangles.
    while !drawn.is_watertight() {
        drawn = of_family(random);
    }
    drawn
}

fn of_family(random: &mut impl Rng) -> TriMesh {
    match random.random_range(0..100) {
        0..22 => carton(random),
        22..42 => turned(random),
        42..56 => prism(random),
        56..68 => vessel(random),
        68..78 => handled(random),
        78..92 => blend(random),
        92..96 => plate(random),
        _ => pen(random),
    }
}

/// Scales and stretches an object along its own axes, so that a hand still spans it.
pub(crate) fn stretched(object: &TriMesh, random: &mut impl Rng) -> TriMesh {
    let scale = log_uniform(random, 0.75, 1.33);
    let factors = Vector3::from_fn(|_, _| scale * log_uniform(random, 0.8, 1.25));
    let mut mesh = object.clone();
    for vertex in &mut mesh.vertices_m {
        vertex.coords.component_mul_assign(&factors);
    }
    let (low, high) = mesh.bounds();
    let sides = high - low;
    // What was spanned before stays so.
    let narrowest = sides.min();
    let factor = (WIDEST_M / narrowest).min(1.0) * (0.30 / sides.max()).min(1.0);
    for vertex in &mut mesh.vertices_m {
        *vertex *= factor;
    }
    mesh
}

/// Draws a number whose logarithm is uniform.
fn log_uniform(random: &mut impl Rng, least: f64, most: f64) -> f64 {
    random.random_range(least.ln()..=most.ln()).exp()
}

/// A box with rounded edges, across at most as wide as a hand.
fn carton(random: &mut impl Rng) -> TriMesh {
    let across = log_uniform(random, 0.016, WIDEST_M);
    let wide = log_uniform(random, 0.03, 0.18);
    let high = log_uniform(random, 0.025, 0.26);
    let least = across.min(wide).min(high);
    let edge = least * random.random_range(0.05..0.3);
    let (a, b, c) = (across / 2.0, wide / 2.0, high / 2.0);
    let rings: Vec<Ring> = profile(c, edge)
        .map(|(inset, z)| rounded_rectangle(a - inset, b - inset, edge + 1e-3 - inset * 0.9, z))
        .collect();
    loft(&rings)
}

/// Heights of a body of this half height with rounded ends, each with its inset.
fn profile(half: f64, edge: f64) -> impl Iterator<Item = (f64, f64)> {
    let arc = move |k: u32| {
        let angle = FRAC_PI_2 * f64::from(k) / 3.0;
        (edge * (1.0 - angle.sin()), edge * (1.0 - angle.cos()))
    };
    let low = (0..=3).map(move |k| {
        let (inset, above) = arc(k);
        (inset, above - half)
    });
    let middle = (1..SECTIONS).map(move |k| {
        let share = f64::from(k) / f64::from(SECTIONS);
        (0.0, (2.0 * share - 1.0) * (half - edge))
    });
    let high = (0..=3).rev().map(move |k| {
        let (inset, below) = arc(k);
        (inset, half - below)
    });
    low.chain(middle).chain(high)
}

/// A smooth curve through as many numbers, from 0 to 1.
fn curve(numbers: &[f64], at: f64) -> f64 {
    let place = at.clamp(0.0, 1.0) * (numbers.len() - 1) as f64;
    let last = numbers.len() - 2;
    let idx = (0..last)
        .take_while(|&idx| place >= (idx + 1) as f64)
        .count();
    let share = place - idx as f64;
    let smooth = share * share * (3.0 - 2.0 * share);
    numbers[idx] + (numbers[idx + 1] - numbers[idx]) * smooth
}

/// A body of revolution: a can, a bottle, a cone, a ball, a vase.
fn turned(random: &mut impl Rng) -> TriMesh {
    let radius = log_uniform(random, 0.012, 0.05);
    let high = log_uniform(random, 0.03, 0.25);
    let waist = match random.random_range(0..4) {
        // A can.
        0 => vec![1.0, 1.0],
        // A ball, or an egg.
        1 => return egg(radius.max(0.02), random),
        // A bottle.
        2 => {
            let neck = random.random_range(0.25..0.6);
            vec![1.0, 1.0, random.random_range(0.85..1.0), neck, neck]
        }
        _ => (0..4).map(|_| random.random_range(0.5..1.0)).collect(),
    };
    let edge = 0.1 * radius.min(high / 2.0);
    let rings: Vec<Ring> = profile(high / 2.0, edge)
        .map(|(inset, z)| {
            let r = radius * curve(&waist, z / high + 0.5) - inset;
            ellipse(r, r, 2.0, z, AROUND)
        })
        .collect();
    loft(&rings)
}

/// A ball or an egg with a flat on which it comes to rest.
fn egg(radius: f64, random: &mut impl Rng) -> TriMesh {
    let long = radius * log_uniform(random, 0.8, 1.6);
    let wide = radius * log_uniform(random, 0.8, 1.2);
    let rings: Vec<Ring> = (0..=16_u32)
        .map(|k| {
            let angle = std::f64::consts::PI * (f64::from(k) + 1.0) / 18.0;
            let section = angle.sin();
            ellipse(
                radius * section,
                wide * section,
                2.0,
                -long * angle.cos(),
                AROUND,
            )
        })
        .collect();
    loft(&rings)
}

/// A prism with a section between an ellipse and a rectangle, tapered.
fn prism(random: &mut impl Rng) -> TriMesh {
    let across = log_uniform(random, 0.015, WIDEST_M) / 2.0;
    let wide = (across * log_uniform(random, 0.6, 2.5)).min(0.09);
    let high = log_uniform(random, 0.03, 0.25);
    let squareness = random.random_range(2.0..5.0);
    let ends: Vec<f64> = (0..3).map(|_| random.random_range(0.65..1.0)).collect();
    let edge = 0.12 * across.min(wide).min(high / 2.0);
    let rings: Vec<Ring> = profile(high / 2.0, edge)
        .map(|(inset, z)| {
            let factor = curve(&ends, z / high + 0.5);
            ellipse(
                across * factor - inset,
                wide * factor - inset,
                squareness,
                z,
                AROUND,
            )
        })
        .collect();
    loft(&rings)
}

/// A bowl, a cup or a pot: open above.
fn vessel(random: &mut impl Rng) -> TriMesh {
    let radius = log_uniform(random, 0.025, 0.085);
    let high = log_uniform(random, 0.03, 0.14);
    let base: f64 = random.random_range(0.4..1.0);
    let bulge = random.random_range(0.9..1.1);
    let wall = random.random_range(0.0025..0.006_f64).min(0.2 * radius);
    let outline = [base, base.midpoint(1.0) * bulge, 1.0];
    let mut rings: Vec<Ring> = Vec::new();
    let steps = 8_u32;
    let round = |r: f64, z: f64| ellipse(r, r, 2.0, z, AROUND);
    rings.push(round(0.5 * base * radius, -high / 2.0));
    for k in 0..=steps {
        let share = f64::from(k) / f64::from(steps);
        rings.push(round(radius * curve(&outline, share), high * (share - 0.5)));
    }
    for k in (0..=steps).rev() {
        let share = f64::from(k) / f64::from(steps);
        let z = high * (share - 0.5);
        let inside = radius * curve(&outline, share) - wall;
        rings.push(round(
            inside,
            z.max(-high / 2.0 + wall) + 0.1 * wall * share,
        ));
    }
    rings.push(round(0.5 * (base * radius - wall), -high / 2.0 + wall));
    loft(&rings)
}

/// Turns distances into a mesh within a box.
fn solid(distance_m: impl Fn(&Point3<f64>) -> f64, reach: Vector3<f64>) -> TriMesh {
    let reach = reach.add_scalar(0.012);
    let cell_m = (reach.max() / 18.0).clamp(0.004, 0.008);
    level_set(distance_m, (-reach).into(), reach.into(), cell_m)
}

/// A body with a handle beside it or across it: a mug, a jug, a pan.
fn handled(random: &mut impl Rng) -> TriMesh {
    let radius = log_uniform(random, 0.025, 0.05);
    let half = log_uniform(random, 0.025, 0.08);
    let thick = random.random_range(0.005..0.009);
    if random.random_range(0..3) == 0 {
        // A pan, or a ladle.
        let long = log_uniform(random, 0.09, 0.16);
        let body = half.min(0.03);
        return solid(
            |p| {
                let cup = disk(p, radius, body, 0.005);
                let from = Point3::new(radius * 0.8, 0.0, 0.3 * body);
                let to = Point3::new(radius + long, 0.0, 0.5 * body);
                smooth_min(cup, tapered(p, from, to, thick * 1.3, thick * 1.3), 0.006)
            },
            Vector3::new(radius + long + 0.01, radius, body + 0.01),
        );
    }
    let reach = random.random_range(0.022..0.035);
    let tall = half * random.random_range(0.5..0.8);
    solid(
        |p| {
            let cup = disk(p, radius, half, 0.004);
            // Half an ellipse in the plane of x and z.
            let (x, z) = ((p.x - radius) / reach, p.z / tall);
            let off = ((x * x + z * z).sqrt() - 1.0) * reach.min(tall);
            let ring = (off * off + p.y * p.y).sqrt() - thick;
            smooth_min(cup, ring, 0.004)
        },
        Vector3::new(radius + reach + thick, radius, half),
    )
}

/// Distance to an upright disk or cylinder with rounded edges, about the origin.
fn disk(p: &Point3<f64>, radius: f64, half: f64, edge: f64) -> f64 {
    let beyond =
        nalgebra::Vector2::new(p.x.hypot(p.y) - (radius - edge), p.z.abs() - (half - edge));
    beyond.map(|x| x.max(0.0)).norm() + beyond.max().min(0.0) - edge
}

/// Rods and boxes that grow into each other: a tool, a toy, a spray.
fn blend(random: &mut impl Rng) -> TriMesh {
    let n = random.random_range(2..=4_usize);
    let mut rods = Vec::new();
    let mut boxes = Vec::new();
    let mut from = Point3::origin();
    let mut most = Vector3::repeat(0.03);
    for _ in 0..n {
        let turn = Rotation3::from_axis_angle(&Vector3::z_axis(), random.random_range(0.0..TAU));
        let lift = random.random_range(-0.5..0.5);
        let direction = (turn * Vector3::new(1.0, 0.0, lift)).normalize();
        let long = log_uniform(random, 0.03, 0.1);
        let to = from + direction * long;
        let radii = [0, 1].map(|_| log_uniform(random, 0.009, 0.03));
        let thickest = radii[0].max(radii[1]);
        if random.random_range(0..3) == 0 {
            let half = Vector3::from_fn(|_, _| log_uniform(random, 0.012, 0.04));
            boxes.push((to, half));
            most = most.sup(&(to.coords.abs() + half));
        }
        most = most.sup(&to.coords.abs().add_scalar(thickest));
        rods.push((from, to, radii));
        if random.random_range(0..2) == 0 {
            from = to;
        }
    }
    // No larger than a hand takes up.
    let factor = (0.12 / most.max()).min(1.0);
    let reach = most * factor;
    solid(
        |p| {
            let p = p / factor;
            let rods = rods
                .iter()
                .map(|(from, to, [a, b])| tapered(&p, *from, *to, *a, *b));
            let boxes = boxes
                .iter()
                .map(|(middle, half)| rounded_box(&(p - middle.coords), *half, 0.006));
            let joined = rods.chain(boxes).reduce(|a, b| smooth_min(a, b, 0.012));
            joined.unwrap_or(f64::INFINITY) * factor
        },
        reach,
    )
}

/// A plate, a book or a slab: thin and flat.
fn plate(random: &mut impl Rng) -> TriMesh {
    let thick = log_uniform(random, 0.012, 0.03);
    let (a, b) = (
        log_uniform(random, 0.05, 0.12),
        log_uniform(random, 0.06, 0.2),
    );
    let edge = 0.3 * thick;
    let rings: Vec<Ring> = profile(thick / 2.0, edge)
        .map(|(inset, z)| rounded_rectangle(a / 2.0 - inset, b / 2.0 - inset, 0.008, z))
        .collect();
    loft(&rings)
}

/// A pen, a brush or a handle: thin and long.
fn pen(random: &mut impl Rng) -> TriMesh {
    let radius = log_uniform(random, 0.008, 0.016);
    let long = log_uniform(random, 0.1, 0.24);
    let corners = random.random_range(2.0..6.0);
    let ends: Vec<f64> = (0..3).map(|_| random.random_range(0.7..1.0)).collect();
    let rings: Vec<Ring> = profile(long / 2.0, 0.2 * radius)
        .map(|(inset, z)| {
            let r = radius * curve(&ends, z / long + 0.5) - inset;
            ellipse(r, r, corners, z, AROUND)
        })
        .collect();
    loft(&rings)
}

#[cfg(test)]
mod tests {
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;

    use super::*;

    #[test]
    fn bodies_are_closed_wind_outward_and_fit_a_hand() {
        let mut random = ChaCha8Rng::seed_from_u64(3);
        for number in 0..300 {
            let mesh = body(&mut random);
            let (low, high) = mesh.bounds();
            let sides = high - low;
            assert!(mesh.is_watertight(), "{number}: {sides:?}");
            let hull = mesh.convex_hull().unwrap().volume_m3();
            let share = mesh.volume_m3() / hull;
            assert!(
                (0.04..1.001).contains(&share),
                "{number}: {share}, {sides:?}"
            );
            assert!(
                sides.min() > 0.009 && sides.min() < 0.17,
                "{number}: {sides:?}"
            );
            assert!(sides.max() < 0.30, "{number}: {sides:?}");
        }
    }

    #[test]
    fn a_stretched_can_is_a_closed_body_of_another_size() {
        let mut random = ChaCha8Rng::seed_from_u64(5);
        let can = turned(&mut random);
        let other = stretched(&can, &mut random);
        assert!(other.is_watertight() && other.triangles == can.triangles);
        assert_ne!(other.bounds(), can.bounds());
    }
}
