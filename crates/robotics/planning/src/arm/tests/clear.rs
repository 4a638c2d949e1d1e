//! Check that shapes keep apart, by points on their surfaces and distances in closed form, independent
//! of the planner's computations.

use nalgebra::{Point3, Vector3};
use robot::{Link, RobotModel, Shape};
use spatial::{Base, Pose, Table};

/// The robot's shapes with points on them.
pub(super) struct Clear {
    bodies: Vec<Body>,
    /// Pairs of bodies that must keep apart, and their minimum distances in meters.
    pairs: Vec<([usize; 2], f64)>,
    least_m: f64,
}

struct Body {
    link: usize,
    name: String,
    is_arm: bool,
    link_from_shape: Pose<Link, Shape>,
    shape: Shape,
    points: Vec<Point3<f64>>,
}

impl Clear {
    /// Takes the shapes of the arm with its hand; links two joints apart and more must keep apart.
    pub(super) fn of(robot: &RobotModel, least_m: f64) -> Self {
        let mut bodies = Vec::new();
        for (link, body) in robot.links().iter().enumerate() {
            for collision in &body.collisions {
                bodies.push(Body {
                    link,
                    name: body.name.clone(),
                    is_arm: body.name.starts_with("link") && !body.name.contains('.'),
                    link_from_shape: collision.link_from_shape,
                    shape: collision.shape.clone(),
                    points: points(&collision.shape),
                });
            }
        }
        // Moving joints from the root.
        let depth = |mut link: usize| {
            let mut joints = 0;
            loop {
                let body = &robot.links()[link];
                joints += usize::from(body.joint.is_some());
                match body.parent {
                    Some(parent) => link = parent,
                    None => return joints,
                }
            }
        };
        let mut pairs = Vec::new();
        for (i, a) in bodies.iter().enumerate() {
            for (j, b) in bodies.iter().enumerate() {
                // The arm's links form a chain: a difference of depths is a distance in joints.
                let between = depth(a.link).abs_diff(depth(b.link));
                if i != j && (a.is_arm || b.is_arm) && between > 1 {
                    // With one link between them they only must not meet.
                    pairs.push(([i, j], if between == 2 { 1e-4 } else { least_m }));
                }
            }
        }
        Self {
            bodies,
            pairs,
            least_m,
        }
    }

    /// Panics where two links or a link and the table are nearer than requested.
    ///
    /// Poses are in the frame of the arm's base.
    pub(super) fn check(&self, links: &[Pose<Base, Link>], base_from_table: &Pose<Base, Table>) {
        let pose = |body: &Body| links[body.link] * body.link_from_shape;
        let poses: Vec<Pose<Base, Shape>> = self.bodies.iter().map(pose).collect();
        for &([i, j], least_m) in &self.pairs {
            let (a, b) = (&self.bodies[i], &self.bodies[j]);
            let far = (poses[i].translation.vector - poses[j].translation.vector).norm();
            if far > a.shape.radius_m() + b.shape.radius_m() + least_m {
                continue;
            }
            let b_from_a = poses[j].inverse() * poses[i];
            for point in &a.points {
                let off = outside(&b.shape, &(b_from_a * *point).coords);
                assert!(off >= least_m, "{} {} {off} m", a.name, b.name);
            }
        }
        for (body, pose) in self.bodies.iter().zip(&poses) {
            if !body.is_arm || body.name == "link_base" {
                continue;
            }
            for point in &body.points {
                let height = base_from_table.inverse_transform_point(&(*pose * *point)).z;
                assert!(height >= self.least_m, "{} {height} m", body.name);
            }
        }
    }
}

/// Returns the distance of a point from a shape, 0 inside.
fn outside(shape: &Shape, at: &Vector3<f64>) -> f64 {
    match *shape {
        Shape::Sphere { radius_m } => (at.norm() - radius_m).max(0.0),
        Shape::Box { half_extents_m } => (at.abs() - half_extents_m).map(|off| off.max(0.0)).norm(),
        Shape::Cylinder {
            radius_m,
            half_length_m,
        } => {
            let across = (at.xy().norm() - radius_m).max(0.0);
            across.hypot((at.z.abs() - half_length_m).max(0.0))
        }
        Shape::Capsule {
            radius_m,
            half_length_m,
        } => {
            let z = at.z - at.z.clamp(-half_length_m, half_length_m);
            (Vector3::new(at.x, at.y, z).norm() - radius_m).max(0.0)
        }
        Shape::Convex(_) => panic!("the arm is in primitives"),
    }
}

/// Points on a shape: on a grid over a box about it, put back to it.
fn points(shape: &Shape) -> Vec<Point3<f64>> {
    const N: i32 = 4;
    let half = match *shape {
        Shape::Sphere { radius_m } => Vector3::repeat(radius_m),
        Shape::Box { half_extents_m } => half_extents_m,
        Shape::Cylinder {
            radius_m,
            half_length_m,
        } => Vector3::new(radius_m, radius_m, half_length_m),
        Shape::Capsule {
            radius_m,
            half_length_m,
        } => Vector3::new(radius_m, radius_m, half_length_m + radius_m),
        Shape::Convex(_) => panic!("the arm is in primitives"),
    };
    let mut all = Vec::new();
    for x in -N..=N {
        for y in -N..=N {
            for z in -N..=N {
                if x.abs().max(y.abs()).max(z.abs()) < N {
                    continue;
                }
                let cell = Vector3::new(x, y, z).map(|at| f64::from(at) / f64::from(N));
                let at = half.component_mul(&cell);
                all.push(Point3::from(match *shape {
                    Shape::Box { .. } => at,
                    Shape::Sphere { radius_m } => at * (radius_m / at.norm()),
                    Shape::Cylinder { radius_m, .. } => {
                        let inward = (radius_m / at.xy().norm()).min(1.0);
                        Vector3::new(at.x * inward, at.y * inward, at.z)
                    }
                    Shape::Capsule {
                        radius_m,
                        half_length_m,
                    } => {
                        let middle = Vector3::z() * at.z.clamp(-half_length_m, half_length_m);
                        let off = at - middle;
                        middle + off * (radius_m / off.norm()).min(1.0)
                    }
                    Shape::Convex(_) => panic!("the arm is in primitives"),
                }));
            }
        }
    }
    all
}
