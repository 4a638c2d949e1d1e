//! Triangles of polygons.

use nalgebra::{Point3, Vector3};

/// Maximum number of corners of a polygon that is not convex: the time grows with their square.
pub(crate) const MAX_CONCAVE_CORNERS: usize = 5000;

/// A corner that turns back by less than this part of twice the polygon's area does not: 1e-9.
const STRAIGHT: f64 = 1e-9;

/// Returns triangles that fill a polygon and wind as it does, every corner in use: a fan if it is
/// convex, ears otherwise; `None` if it is not convex and has more than [`MAX_CONCAVE_CORNERS`].
///
/// Corners may lie a little off a plane; triangles that name a vertex twice are left out.
pub(crate) fn triangles(corners: &[u32], vertices_m: &[Point3<f64>]) -> Option<Vec<[u32; 3]>> {
    let mut places = Vec::with_capacity(corners.len());
    for &corner in corners {
        places.push(vertices_m.get(corner as usize).copied()?);
    }
    let flat = flattened(&places);
    let triangles = if is_convex(&flat) {
        (2..corners.len()).map(|last| [0, last - 1, last]).collect()
    } else if corners.len() > MAX_CONCAVE_CORNERS {
        return None;
    } else {
        ears(&flat)
    };
    let named = triangles.into_iter().map(|triangle| {
        // Every number is that of a corner.
        triangle.map(|corner: usize| corners.get(corner).copied().unwrap_or_default())
    });
    Some(
        named
            .filter(|[a, b, c]| a != b && b != c && c != a)
            .collect(),
    )
}

/// Looks at the polygon from the side of the axis nearest to its normal from which it is
/// counterclockwise (Newell's normal: Tampieri, "Newell's method for computing the plane equation of
/// a polygon", Graphics Gems III, 1992).
fn flattened(places: &[Point3<f64>]) -> Vec<[f64; 2]> {
    let next = places.iter().cycle().skip(1);
    let normal: Vector3<f64> = places.iter().zip(next).map(|(a, b)| newell(a, b)).sum();
    let along = normal.iamax();
    let [mut u, mut v] = [(along + 1) % 3, (along + 2) % 3];
    if normal[along] < 0.0 {
        (u, v) = (v, u);
    }
    places.iter().map(|place| [place[u], place[v]]).collect()
}

fn newell(a: &Point3<f64>, b: &Point3<f64>) -> Vector3<f64> {
    Vector3::new(
        (a.y - b.y) * (a.z + b.z),
        (a.z - b.z) * (a.x + b.x),
        (a.x - b.x) * (a.y + b.y),
    )
}

/// Says whether no corner turns back.
fn is_convex(flat: &[[f64; 2]]) -> bool {
    let after = |n: usize| flat.iter().cycle().skip(n);
    let area: f64 = flat
        .iter()
        .zip(after(1))
        .map(|(a, b)| a[0] * b[1] - a[1] * b[0])
        .sum();
    let mut turns = flat.iter().zip(after(1)).zip(after(2));
    flat.len() <= 3 || turns.all(|((a, b), c)| turn(*a, *b, *c) >= -STRAIGHT * area.abs())
}

/// Returns twice the area of a triangle, negative if it is clockwise.
fn turn(a: [f64; 2], b: [f64; 2], c: [f64; 2]) -> f64 {
    (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
}

/// Cuts ears off a counterclockwise polygon (Eberly, "Triangulation by ear clipping", 2002).
///
/// Two corners may have one place, as where a slit leads to a hole. What is left of a polygon that
/// crosses itself becomes a fan.
fn ears(flat: &[[f64; 2]]) -> Vec<[usize; 3]> {
    let mut ring = Ring::new(flat);
    let mut triangles = Vec::with_capacity(flat.len());
    let (mut at, mut passed) = (0, 0);
    while ring.left > 3 && passed <= ring.left {
        let corner @ [before, _, after] = ring.around(at);
        if ring.is_ear(corner) {
            triangles.push(corner);
            ring.remove(at);
            passed = 0;
            // The next but one: ears in a row make slivers.
            at = ring.around(after)[2];
            if ring.around(before)[2] == at {
                at = before;
            }
        } else {
            at = after;
            passed += 1;
        }
    }
    let mut last = ring.around(at)[2];
    for _ in 2..ring.left {
        let next = ring.around(last)[2];
        triangles.push([at, last, next]);
        last = next;
    }
    triangles
}

/// The corners that are not cut off yet.
struct Ring<'a> {
    flat: &'a [[f64; 2]],
    before: Vec<usize>,
    after: Vec<usize>,
    /// Corners that may lie in an ear: those that turn back or not at all.
    blocking: Vec<usize>,
    left: usize,
}

impl<'a> Ring<'a> {
    fn new(flat: &'a [[f64; 2]]) -> Self {
        let n = flat.len();
        let mut ring = Self {
            flat,
            before: (0..n).map(|at| (at + n - 1) % n).collect(),
            after: (0..n).map(|at| (at + 1) % n).collect(),
            blocking: Vec::new(),
            left: n,
        };
        ring.blocking = (0..n)
            .filter(|&at| ring.area(ring.around(at)) <= 0.0)
            .collect();
        ring
    }

    /// Returns a corner between its neighbors.
    fn around(&self, at: usize) -> [usize; 3] {
        let of = |list: &[usize]| list.get(at).copied().unwrap_or(at);
        [of(&self.before), at, of(&self.after)]
    }

    fn place(&self, at: usize) -> [f64; 2] {
        self.flat.get(at).copied().unwrap_or_default()
    }

    fn area(&self, corner: [usize; 3]) -> f64 {
        let [a, b, c] = corner.map(|at| self.place(at));
        turn(a, b, c)
    }

    #[expect(
        clippy::float_cmp,
        reason = "a corner is at the place of another or not"
    )]
    fn is_ear(&self, corner: [usize; 3]) -> bool {
        let [a, b, c] = corner.map(|at| self.place(at));
        let blocks = |&at: &usize| {
            let p = self.place(at);
            p != a
                && p != b
                && p != c
                && turn(a, b, p) >= 0.0
                && turn(b, c, p) >= 0.0
                && turn(c, a, p) >= 0.0
        };
        turn(a, b, c) > 0.0 && !self.blocking.iter().any(blocks)
    }

    fn remove(&mut self, at: usize) {
        let [before, _, after] = self.around(at);
        if let Some(next) = self.after.get_mut(before) {
            *next = after;
        }
        if let Some(last) = self.before.get_mut(after) {
            *last = before;
        }
        self.left -= 1;
        let turned = [before, after].map(|at| (at, self.area(self.around(at)) > 0.0));
        self.blocking
            .retain(|&other| other != at && !turned.contains(&(other, true)));
    }
}

#[cfg(test)]
mod tests {
    use nalgebra::{Rotation3, Vector3};

    use super::*;

    fn area(triangle: [u32; 3], places: &[Point3<f64>]) -> Vector3<f64> {
        let [a, b, c] = triangle.map(|idx| places[idx as usize]);
        (b - a).cross(&(c - a)) / 2.0
    }

    /// Checks that a polygon is filled once, in every plane, from every corner, both ways around.
    fn check(what: &str, flat: &[[f64; 2]]) {
        let turns = [
            Rotation3::identity(),
            Rotation3::from_euler_angles(0.3, 1.1, -2.0),
            Rotation3::from_euler_angles(-1.5, 0.2, 0.9),
        ];
        let n = u32::try_from(flat.len()).unwrap();
        for turn in turns {
            let places: Vec<Point3<f64>> = flat
                .iter()
                .map(|&[x, y]| turn * Point3::new(x, y, 0.3))
                .collect();
            for first in 0..n {
                let corners: Vec<u32> = (0..n).map(|k| (first + k) % n).collect();
                let back: Vec<u32> = corners.iter().rev().copied().collect();
                for corners in [corners, back] {
                    let next = corners.iter().cycle().skip(1);
                    let whole: Vector3<f64> = corners
                        .iter()
                        .zip(next)
                        .map(|(&a, &b)| {
                            places[a as usize].coords.cross(&places[b as usize].coords) / 2.0
                        })
                        .sum();
                    let triangles = triangles(&corners, &places).unwrap();
                    assert_eq!(triangles.len(), flat.len() - 2, "{what}");
                    let normal = whole.normalize();
                    let areas: Vec<f64> = triangles
                        .iter()
                        .map(|&triangle| area(triangle, &places).dot(&normal))
                        .collect();
                    assert!(areas.iter().all(|&area| area > -1e-9), "{what}: {areas:?}");
                    assert!(
                        (areas.iter().sum::<f64>() - whole.norm()).abs() < 1e-9,
                        "{what}"
                    );
                }
            }
        }
    }

    #[test]
    fn every_simple_polygon_is_filled_once() {
        check("square", &[[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]]);
        check("arrow", &[[0.0, 0.0], [2.0, 1.0], [0.0, 2.0], [0.5, 1.0]]);
        let angle_bar = [
            [0.0, 0.0],
            [3.0, 0.0],
            [3.0, 1.0],
            [1.0, 1.0],
            [1.0, 3.0],
            [0.0, 3.0],
        ];
        check("angle bar", &angle_bar);
        let mut halved = Vec::new();
        for (a, b) in angle_bar.iter().zip(angle_bar.iter().cycle().skip(1)) {
            halved.extend([*a, [f64::midpoint(a[0], b[0]), f64::midpoint(a[1], b[1])]]);
        }
        check("angle bar with corners along its edges", &halved);
        check(
            "channel",
            &[
                [0.0, 0.0],
                [5.0, 0.0],
                [5.0, 3.0],
                [4.0, 3.0],
                [4.0, 1.0],
                [1.0, 1.0],
                [1.0, 3.0],
                [0.0, 3.0],
            ],
        );
        check(
            "plate with a slit to its square hole",
            &[
                [0.0, 0.0],
                [4.0, 0.0],
                [4.0, 4.0],
                [0.0, 4.0],
                [0.0, 0.0],
                [1.0, 1.0],
                [1.0, 3.0],
                [3.0, 3.0],
                [3.0, 1.0],
                [1.0, 1.0],
            ],
        );
        let star = |n: usize, inner: f64| -> Vec<[f64; 2]> {
            let angle = |k: usize| k as f64 / n as f64 * std::f64::consts::TAU;
            let radius = |k: usize| if k.is_multiple_of(2) { 1.0 } else { inner };
            (0..n)
                .map(|k| [radius(k) * angle(k).cos(), radius(k) * angle(k).sin()])
                .collect()
        };
        check("star", &star(10, 0.4));
        check("gear", &star(60, 0.9));
        let spiral: Vec<[f64; 2]> = (0..30)
            .map(|k| (f64::from(k) * 0.4, 1.0 + 0.3 * f64::from(k)))
            .map(|(angle, radius)| [radius * angle.cos(), radius * angle.sin()])
            .collect();
        let back = spiral.iter().rev().map(|[x, y]| [0.9 * x, 0.9 * y]);
        check(
            "spiral",
            &spiral.iter().copied().chain(back).collect::<Vec<_>>(),
        );
    }

    #[test]
    fn a_large_polygon_is_filled_in_time_or_refused() {
        let comb = |n: u32| -> Vec<Point3<f64>> {
            let teeth = (0..n).map(|k| Point3::new(f64::from(k), f64::from(k % 2) - 3.0, 0.0));
            teeth
                .chain([
                    Point3::new(f64::from(n), 9.0, 0.0),
                    Point3::new(-1.0, 9.0, 0.0),
                ])
                .collect()
        };
        let named =
            |places: &[Point3<f64>]| (0..u32::try_from(places.len()).unwrap()).collect::<Vec<_>>();
        let places = comb(4000);
        assert_eq!(triangles(&named(&places), &places).unwrap().len(), 4000);
        let places = comb(5000);
        assert_eq!(triangles(&named(&places), &places), None);
    }
}
