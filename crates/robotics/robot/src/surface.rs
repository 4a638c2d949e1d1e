//! Points spread over the surface of a robot's collision shapes.

use std::f64::consts::{PI, TAU};

use nalgebra::{Point3, Vector3};

use crate::{RobotModel, Shape};

/// Steps of an additive sequence that fills the unit square evenly (Roberts, "The unreasonable effectiveness of
/// quasirandom sequences", 2018): inverse powers of the root of x³ = x + 1.
const STEPS: [f64; 2] = [0.754_877_666_246_692_8, 0.569_840_290_998_053_2];

/// A point on the surface of a link's collision shape.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SurfacePoint {
    /// The link, by its number among the model's.
    pub link: usize,
    /// In the link's frame, in meters.
    pub point_in_link: Point3<f64>,
    /// Outward unit normal, in the link's frame.
    pub normal_in_link: Vector3<f64>,
}

/// A part of a shape's surface that a square is spread over, about the shape's center, in meters.
enum Patch {
    /// A parallelogram, or half of it.
    Flat {
        corner: Vector3<f64>,
        sides: [Vector3<f64>; 2],
        is_triangle: bool,
    },
    /// A ball whose halves are moved apart along z.
    Ball { radius_m: f64, apart_m: f64 },
    /// The side of a cylinder along z.
    Side { radius_m: f64, half_length_m: f64 },
    /// An end of a cylinder along z.
    Disc { radius_m: f64, z_m: f64 },
}

/// Spreads `n` points over the surfaces of all collision shapes, as many on each part as its area asks for; none if
/// there is no shape. Equal robots have equal points, link after link.
///
/// Where shapes overlap, points of one may be inside another.
pub fn surface_points(robot: &RobotModel, n: usize) -> Vec<SurfacePoint> {
    let mut patches = Vec::new();
    let mut area = 0.0;
    for (link, body) in robot.links().iter().enumerate() {
        for collision in &body.collisions {
            for patch in Patch::of(&collision.shape) {
                area += patch.area_m2();
                patches.push((area, link, collision.link_from_shape, patch));
            }
        }
    }
    if !(area > 0.0 && area.is_finite()) {
        return Vec::new();
    }
    let point = |number: usize| {
        let target = (number as f64 + 0.5) / n as f64 * area;
        let idx = patches.partition_point(|(up_to, ..)| *up_to <= target);
        let (_, link, link_from_shape, patch) = &patches[idx.min(patches.len() - 1)];
        let [u, v] = STEPS.map(|step| (0.5 + number as f64 * step).fract());
        let (at, normal) = patch.at(u, v);
        SurfacePoint {
            link: *link,
            point_in_link: *link_from_shape * Point3::from(at),
            normal_in_link: link_from_shape.rotation * normal,
        }
    };
    (0..n).map(point).collect()
}

impl Patch {
    fn of(shape: &Shape) -> Vec<Self> {
        match shape {
            Shape::Box { half_extents_m } => box_sides(half_extents_m),
            Shape::Sphere { radius_m } => vec![Self::Ball {
                radius_m: *radius_m,
                apart_m: 0.0,
            }],
            Shape::Cylinder {
                radius_m,
                half_length_m,
            } => {
                let disc = |z_m: f64| Self::Disc {
                    radius_m: *radius_m,
                    z_m,
                };
                let side = Self::Side {
                    radius_m: *radius_m,
                    half_length_m: *half_length_m,
                };
                vec![side, disc(*half_length_m), disc(-half_length_m)]
            }
            Shape::Capsule {
                radius_m,
                half_length_m,
            } => vec![
                Self::Side {
                    radius_m: *radius_m,
                    half_length_m: *half_length_m,
                },
                Self::Ball {
                    radius_m: *radius_m,
                    apart_m: *half_length_m,
                },
            ],
            Shape::Convex(body) => body
                .surface()
                .map(|[a, b, c]| Self::Flat {
                    corner: a,
                    sides: [b - a, c - a],
                    is_triangle: true,
                })
                .collect(),
        }
    }

    fn area_m2(&self) -> f64 {
        match self {
            Self::Flat {
                sides: [a, b],
                is_triangle,
                ..
            } => a.cross(b).norm() * if *is_triangle { 0.5 } else { 1.0 },
            Self::Ball { radius_m, .. } => 4.0 * PI * radius_m.powi(2),
            Self::Side {
                radius_m,
                half_length_m,
            } => 2.0 * TAU * radius_m * half_length_m,
            Self::Disc { radius_m, .. } => PI * radius_m.powi(2),
        }
    }

    /// Returns the point at a place of the unit square, and the outward unit normal there.
    fn at(&self, u: f64, v: f64) -> (Vector3<f64>, Vector3<f64>) {
        let (sine, cosine) = (TAU * u).sin_cos();
        match self {
            Self::Flat {
                corner,
                sides: [a, b],
                is_triangle,
            } => {
                // The far half of the parallelogram is folded onto the near one.
                let (u, v) = if *is_triangle && u + v > 1.0 {
                    (1.0 - u, 1.0 - v)
                } else {
                    (u, v)
                };
                let normal = a.cross(b);
                (corner + a * u + b * v, normal.normalize())
            }
            Self::Ball { radius_m, apart_m } => {
                // Equal heights have equal areas (Archimedes).
                let z = 2.0 * v - 1.0;
                let around = (1.0 - z * z).sqrt();
                let normal = Vector3::new(around * cosine, around * sine, z);
                let center = Vector3::z() * *apart_m * z.signum();
                (center + normal * *radius_m, normal)
            }
            Self::Side {
                radius_m,
                half_length_m,
            } => {
                let normal = Vector3::new(cosine, sine, 0.0);
                let height = Vector3::z() * *half_length_m * (2.0 * v - 1.0);
                (normal * *radius_m + height, normal)
            }
            Self::Disc { radius_m, z_m } => {
                let r = radius_m * v.sqrt();
                let at = Vector3::new(r * cosine, r * sine, *z_m);
                (at, Vector3::z() * z_m.signum())
            }
        }
    }
}

fn box_sides(half_m: &Vector3<f64>) -> Vec<Patch> {
    let side = |axis: usize, sign: f64| {
        let along = |axis: usize| Vector3::ith(axis % 3, half_m[axis % 3]);
        // Turned so that the normal, the cross product of the sides, points outward.
        let (a, b) = (along(axis + 1), along(axis + 2) * sign);
        Patch::Flat {
            corner: along(axis) * sign - a - b,
            sides: [a * 2.0, b * 2.0],
            is_triangle: false,
        }
    };
    let axes = 0..3;
    axes.flat_map(|axis| [side(axis, 1.0), side(axis, -1.0)])
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn hand(geometry: &str) -> RobotModel {
        let urdf = format!(
            r#"<robot name="h"><link name="palm"><collision><origin xyz="0.1 0 0" rpy="0 0 0.5"/>
            <geometry>{geometry}</geometry></collision></link></robot>"#
        );
        RobotModel::from_urdf(&urdf).unwrap()
    }

    /// Of a closed surface the normals add up to nothing, and a third of their products with the places is its volume.
    fn check(geometry: &str, area_m2: f64, volume_m3: f64) {
        const N: usize = 4000;
        let robot = hand(geometry);
        let points = surface_points(&robot, N);
        assert_eq!(points.len(), N);
        let share = area_m2 / N as f64;
        let (mut sum, mut volume) = (Vector3::zeros(), 0.0);
        for point in &points {
            assert!((point.normal_in_link.norm() - 1.0).abs() < 1e-9);
            let from_middle = point.point_in_link - Point3::new(0.1, 0.0, 0.0);
            sum += point.normal_in_link * share;
            volume += point.normal_in_link.dot(&from_middle) * share / 3.0;
        }
        assert!(sum.norm() < 0.01 * area_m2, "{geometry}: {sum}");
        assert!(
            (volume - volume_m3).abs() < 0.01 * volume_m3,
            "{geometry}: {volume} {volume_m3}"
        );
    }

    #[test]
    fn points_cover_each_shape_evenly_with_normals_outward() {
        check(r#"<box size="0.1 0.2 0.3"/>"#, 0.22, 0.006);
        let (r, l): (f64, f64) = (0.05, 0.2);
        let ball = 4.0 * PI * r * r;
        check(r#"<sphere radius="0.05"/>"#, ball, ball * r / 3.0);
        check(
            r#"<cylinder radius="0.05" length="0.2"/>"#,
            TAU * r * l + TAU * r * r,
            PI * r * r * l,
        );
    }

    #[test]
    fn a_robot_without_shapes_has_no_surface() {
        let robot = RobotModel::from_urdf(r#"<robot name="h"><link name="palm"/></robot>"#);
        assert!(surface_points(&robot.unwrap(), 10).is_empty());
    }
}
