//! Penetration depth of two overlapping convex bodies, without allocation.
//!
//! Van den Bergen, *Proximity Queries and Penetration Depth Computation on 3D Game Objects*, 2001: a polytope inside
//! the differences of the bodies' points grows towards their boundary, always where it is nearest to the origin.

use arrayvec::ArrayVec;
use nalgebra::Vector3;

use crate::distance::{Corner, Simplex};

/// Maximum number of corners of the polytope, at most 256, as faces number them by a `u8`. Boxes need 8 to 26. It is too
/// low only if a round body's axis goes through the other body's center: then the depth is known within 1e-7 m.
const MAX_CORNERS: usize = 256;
/// Number of triangles of a closed surface with so many corners.
const MAX_FACES: usize = 2 * MAX_CORNERS - 4;
/// The depth is known this well, in meters, unless rounding or the number of corners keeps it from that; then it is
/// that of the shortest way out found.
const CLOSE_M: f64 = 1e-10;
/// Corners nearer than this to a plane are on it, in meters.
const FLAT_M: f64 = 1e-12;

/// The shortest way out of an overlap.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Separation {
    /// Its length in meters.
    pub(crate) depth_m: f64,
    /// Unit vector along which the second body leaves the first.
    pub(crate) along: Vector3<f64>,
    /// The first body's point that is deepest in the second.
    pub(crate) on_first: Vector3<f64>,
}

/// A triangle of the polytope.
#[derive(Debug, Clone, Copy)]
struct Face {
    /// Numbers of its corners, counterclockwise from outside.
    corners: [u8; 3],
    outward: Vector3<f64>,
    /// Distance of its plane from the origin, in meters.
    off_m: f64,
}

/// A growing polytope.
#[derive(Default)]
struct Polytope {
    corners: ArrayVec<Corner, MAX_CORNERS>,
    faces: ArrayVec<Face, MAX_FACES>,
}

/// Returns the shortest way out of an overlap; `None` if the differences of the bodies' points have no volume.
///
/// `farthest` gives the corner that is farthest along a direction, and the origin is in the hull of `within`.
pub(crate) fn way_out(
    farthest: impl Fn(&Vector3<f64>) -> Corner,
    within: &Simplex,
) -> Option<Separation> {
    let first = tetrahedron(&farthest, within)?;
    let mut polytope = Polytope::default();
    if !polytope.begin(&first) {
        return None;
    }
    // The shortest way found: a face and the boundary's corner farthest along its normal.
    let mut best: Option<(Face, Corner)> = None;
    let length_m = |(face, corner): &(Face, Corner)| corner.difference.dot(&face.outward);
    loop {
        let nearest = polytope.nearest()?;
        let found = (nearest, farthest(&nearest.outward));
        if length_m(&found) - nearest.off_m <= CLOSE_M {
            return Some(polytope.way_out(&found));
        }
        let best = match &mut best {
            Some(best) if length_m(best) <= length_m(&found) => best,
            best => best.insert(found),
        };
        if !polytope.grow(found.1) {
            return Some(polytope.way_out(best));
        }
    }
}

/// Adds corners to a simplex until it is a tetrahedron.
fn tetrahedron(
    farthest: &impl Fn(&Vector3<f64>) -> Corner,
    within: &Simplex,
) -> Option<[Corner; 4]> {
    let mut simplex = *within;
    loop {
        let along = match *simplex.corners() {
            [a] => {
                // Any direction serves.
                let ways = [Vector3::x(), Vector3::y(), Vector3::z()];
                let found = ways
                    .into_iter()
                    .flat_map(|way| [way, -way])
                    .find(|way| (farthest(way).difference - a.difference).norm() > FLAT_M);
                found?
            }
            [a, b] => {
                let side = b.difference - a.difference;
                let mut axis = Vector3::zeros();
                axis[side.iamin()] = 1.0;
                let across = side.cross(&axis).try_normalize(0.0)?;
                let ways = [across, side.cross(&across).normalize()];
                let found = ways
                    .into_iter()
                    .flat_map(|way| [way, -way])
                    .find(|way| (farthest(way).difference - a.difference).dot(way) > FLAT_M);
                found?
            }
            [a, b, c] => {
                let normal = (b.difference - a.difference).cross(&(c.difference - a.difference));
                let normal = normal.try_normalize(0.0)?;
                let found = [normal, -normal]
                    .into_iter()
                    .find(|way| (farthest(way).difference - a.difference).dot(way) > FLAT_M);
                found?
            }
            [a, b, c, d] => return Some([a, b, c, d]),
            _ => return None,
        };
        simplex.push(farthest(&along));
    }
}

impl Polytope {
    /// Makes it a tetrahedron; `false` if the corners are in one plane.
    fn begin(&mut self, tetrahedron: &[Corner; 4]) -> bool {
        let [a, b, c, d] = tetrahedron.map(|corner| corner.difference);
        let volume = (b - a).dot(&(c - a).cross(&(d - a)));
        // From outside each side is counterclockwise.
        let sides = if volume > 0.0 {
            [[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]
        } else {
            [[0, 1, 2], [0, 3, 1], [0, 2, 3], [1, 3, 2]]
        };
        self.corners.extend(tetrahedron.iter().copied());
        sides.into_iter().all(|side| self.add(side))
    }

    fn corners(&self, face: &Face) -> [Corner; 3] {
        face.corners.map(|number| self.corners[usize::from(number)])
    }

    /// Adds a face; `false` if it has no area or there is no room.
    fn add(&mut self, corners: [u8; 3]) -> bool {
        let mut face = Face {
            corners,
            outward: Vector3::zeros(),
            off_m: 0.0,
        };
        let [a, b, c] = self.corners(&face).map(|corner| corner.difference);
        let Some(outward) = (b - a).cross(&(c - a)).try_normalize(0.0) else {
            return false;
        };
        face.outward = outward;
        face.off_m = outward.dot(&a);
        self.faces.try_push(face).is_ok()
    }

    fn nearest(&self) -> Option<Face> {
        let faces = self.faces.iter();
        faces.min_by(|a, b| a.off_m.total_cmp(&b.off_m)).copied()
    }

    /// Takes in a corner outside; `false` if rounding makes the surface leak, or there is no room.
    fn grow(&mut self, corner: Corner) -> bool {
        let Ok(number) = u8::try_from(self.corners.len()) else {
            return false;
        };
        if self.corners.try_push(corner).is_err() {
            return false;
        }
        // The sides of the faces that see it which are no other's: its horizon.
        let mut horizon = ArrayVec::<[u8; 2], MAX_FACES>::new();
        let mut has_room = true;
        self.faces.retain(|face| {
            let is_kept = face.outward.dot(&corner.difference) - face.off_m <= FLAT_M;
            if !is_kept {
                let [a, b, c] = face.corners;
                for [from, to] in [[a, b], [b, c], [c, a]] {
                    if let Some(shared) = horizon.iter().position(|side| *side == [to, from]) {
                        horizon.swap_remove(shared);
                    } else {
                        has_room &= horizon.try_push([from, to]).is_ok();
                    }
                }
            }
            is_kept
        });
        has_room
            && !horizon.is_empty()
            && horizon
                .iter()
                .all(|&[from, to]| self.add([from, to, number]))
    }

    /// Returns the way out along a face's normal to the boundary, whose corner is the farthest along it: where the bodies
    /// are curved the face itself lies inside. It is through the face's point nearest to the origin.
    fn way_out(&self, (face, corner): &(Face, Corner)) -> Separation {
        let [a, b, c] = self.corners(face);
        let [p, q, r] = [a, b, c].map(|corner| corner.difference);
        let foot = face.outward * face.off_m;
        let share = |one: Vector3<f64>, two: Vector3<f64>| {
            (one - foot).cross(&(two - foot)).dot(&face.outward)
        };
        let shares = [share(q, r), share(r, p), share(p, q)];
        let sum = shares[0] + shares[1] + shares[2];
        let on_face =
            (a.on_first * shares[0] + b.on_first * shares[1] + c.on_first * shares[2]) / sum;
        let to_boundary_m = (corner.on_first - on_face).dot(&face.outward);
        Separation {
            depth_m: corner.difference.dot(&face.outward).max(0.0),
            along: face.outward,
            on_first: on_face + face.outward * to_boundary_m,
        }
    }
}
