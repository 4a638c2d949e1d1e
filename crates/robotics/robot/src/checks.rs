//! Checks for unphysical or missing data in a robot that can be read.

use nalgebra::{Point3, Vector3};

use crate::{DynamicsModel, Finding, Inertial, Joint, JointKind, Link, Part, RobotModel, Severity};

/// Rounding that is forgiven where principal moments are compared, relative.
const ROUNDED: f64 = 1e-3;
/// Largest distance of a link's center of mass from its shapes, as a share of their diagonal.
const OUTSIDE: f64 = 0.1;
/// Largest radius of gyration of a link, relative to the reach of its shapes from the center of mass.
const SPREAD: f64 = 1.5;
/// Longest way from a joint to the next, or across a link, in meters: more is a file in millimeters.
const MAX_LENGTH_M: f64 = 10.0;
/// Largest limit of a joint that turns, in radians: more is a file in degrees.
const MAX_RAD: f64 = 30.0;

impl RobotModel {
    /// Returns all findings about the robot, the worst first: those from reading it, and properties
    /// that no real robot has.
    ///
    /// Meshes are not looked for: this crate opens no file. A caller that has read them gives their
    /// shapes to [`RobotModel::with_mesh_shapes`] first.
    pub fn examine(&self) -> Vec<Finding> {
        let mut findings = self.findings().to_vec();
        for link in self.links() {
            let about = |severity, problem: String, advice: &str| Finding {
                severity,
                part: Part::Link(link.name.clone()),
                problem,
                advice: advice.to_owned(),
            };
            if let Some(inertial) = &link.inertial {
                findings.extend(
                    inertia(link, inertial)
                        .map(|(severity, problem)| about(severity, problem, INERTIA)),
                );
                findings.extend(
                    center_of_mass(link, inertial)
                        .map(|problem| about(Severity::Doubtful, problem, CENTER)),
                );
                let has_mesh = link.meshes.iter().any(|mesh| mesh.is_collision);
                if link.collisions.is_empty() && !has_mesh {
                    let problem = "has mass and nothing to collide with: it touches nothing";
                    findings.push(about(Severity::Note, problem.to_owned(), SHAPES));
                }
            }
            let length = link.parent_from_joint.translation.vector.norm();
            if length > MAX_LENGTH_M {
                let problem = format!("is {length} m from its parent");
                findings.push(about(
                    Severity::Doubtful,
                    problem,
                    "write lengths in meters",
                ));
            }
        }
        findings.extend(self.links().iter().filter_map(oversized));
        for joint in self.joints() {
            findings.extend(self::joint(joint));
        }
        findings.extend(self.unread());
        findings.extend(self.without_inertia());
        findings.extend(self.followers());
        findings.sort_by_key(|finding| finding.severity);
        findings
    }

    /// Returns the finding about a mesh without a shape: callers that need contacts read the meshes first.
    fn unread(&self) -> Option<Finding> {
        let (link, mesh) = self.without_mesh_shape()?;
        Some(Finding {
            severity: Severity::Missing,
            part: Part::Link(link.name.clone()),
            problem: format!("collides with the mesh `{}`, which was not read", mesh.file),
            advice: SHAPES.to_owned(),
        })
    }

    /// Returns the findings about moving parts without inertia: no force is needed to move them, however
    /// fast.
    fn without_inertia(&self) -> Vec<Finding> {
        let bodies = DynamicsModel::new(self);
        if bodies.mass_kg() == 0.0 {
            return vec![Finding {
                severity: Severity::Doubtful,
                part: Part::Robot,
                problem: "weighs nothing: no link has a mass".to_owned(),
                advice: "give its links an `<inertial>` before dynamics or physics use it"
                    .to_owned(),
            }];
        }
        let lacking = self.bodies_without_inertia();
        let mut findings: Vec<Finding> = lacking
            .iter()
            .filter_map(|&idx| self.links().get(idx))
            // An invalid `<inertial>` has a finding of its own.
            .filter(|link| link.inertial.is_none())
            .map(|link| Finding {
                severity: Severity::Doubtful,
                part: Part::Link(link.name.clone()),
                problem:
                    "moves and has no inertia, nor has what is fixed to it: `screen` refuses it"
                        .to_owned(),
                advice: format!("give it an `<inertial>` with mass and inertia; {INERTIA}"),
            })
            .collect();
        if let Some(root) = self.links().first()
            && bodies.root_mass_kg() == 0.0
        {
            findings.push(Finding {
                severity: Severity::Note,
                part: Part::Link(root.name.clone()),
                problem:
                    "has no inertia, nor has what is fixed to it: in physics it has that of all \
                          that it carries"
                        .to_owned(),
                advice: String::new(),
            });
        }
        let mass = match bodies.mass_matrix(&self.open()) {
            Ok(mass) => mass,
            Err(err) => unreachable!("the bodies are those of this robot: {err}"),
        };
        let moved = mass.diagonal();
        let weightless = self.joints().iter().zip(moved.iter());
        findings.extend(
            weightless
                .filter(|(joint, moved)| **moved <= 0.0 && !lacking.contains(&joint.link))
                .map(|(joint, _)| Finding {
                    severity: Severity::Doubtful,
                    part: Part::Joint(joint.name.clone()),
                    problem: "moves nothing that has inertia".to_owned(),
                    advice: "give what it moves an `<inertial>` before dynamics or physics use it"
                        .to_owned(),
                }),
        );
        findings
    }

    /// Returns the findings about mimic joints.
    fn followers(&self) -> Vec<Finding> {
        self.links()
            .iter()
            .filter_map(|link| {
                let master = &self.joints()[link.joint?];
                let name = link.joint_name.clone()?;
                (name != master.name).then(|| Finding {
                    severity: Severity::Note,
                    part: Part::Joint(name),
                    problem: format!(
                        "is at {} times `{}`{}",
                        short(link.multiplier),
                        master.name,
                        if link.offset == 0.0 {
                            String::new()
                        } else {
                            format!(", plus {}", short(link.offset))
                        }
                    ),
                    advice: String::new(),
                })
            })
            .collect()
    }
}

const INERTIA: &str = "take its inertia from its drawing, or that of a solid box of its size and \
                       mass: m/12 (a² + b²)";
const CENTER: &str =
    "check the `<origin>` of its `<inertial>`: it may be that of another link or another frame";
const SHAPES: &str = "give it a `<collision>` of boxes, spheres, cylinders, capsules or a mesh if it \
                      may touch anything";

/// Rounds a number to six decimal places.
fn short(number: f64) -> f64 {
    (number * 1e6).round() / 1e6
}

/// Returns the problem with a link's inertia, if there is one.
fn inertia(link: &Link, inertial: &Inertial) -> Option<(Severity, String)> {
    let mut moments: Vec<f64> = inertial
        .inertia_kg_m2
        .symmetric_eigenvalues()
        .iter()
        .copied()
        .collect();
    moments.sort_by(f64::total_cmp);
    let &[small, middle, large] = moments.as_slice() else {
        return None;
    };
    let principal = format!("principal moments {small:.3e}, {middle:.3e}, {large:.3e} kg m²");
    if large == 0.0 && small == 0.0 {
        // One that is fixed to another may well be a point; it cannot turn alone.
        let severity = match link.kind {
            Some(_) => Severity::Wrong,
            None => Severity::Note,
        };
        let problem = format!("weighs {} kg and has no inertia", inertial.mass_kg);
        return Some((severity, problem));
    }
    if small <= 0.0 {
        let problem = format!("has an inertia that is not positive: {principal}");
        return Some((Severity::Wrong, problem));
    }
    if large > (small + middle) * (1.0 + ROUNDED) {
        let problem = format!(
            "has an inertia that violates the triangle inequality: {principal}, the largest \
             exceeds the sum of the others"
        );
        return Some((Severity::Wrong, problem));
    }
    // No part of the mass is farther away than the shapes reach, so neither is their mean.
    let reach = farthest(link, &inertial.center_of_mass_m)?;
    let radius = (large / inertial.mass_kg).sqrt();
    (radius > SPREAD * reach).then(|| {
        let problem = format!(
            "has a radius of gyration of {:.1} mm, and its shapes end {:.1} mm from its center of \
             mass",
            radius * 1000.0,
            reach * 1000.0
        );
        (Severity::Doubtful, problem)
    })
}

/// Returns the distance from a point to the farthest corner of the box about a link's shapes.
fn farthest(link: &Link, from: &Point3<f64>) -> Option<f64> {
    let (lower, upper) = bounds(link)?;
    let reach = (from.coords - lower)
        .abs()
        .sup(&(upper - from.coords).abs());
    Some(reach.norm())
}

/// Returns the corners of the box about a link's shapes, along its axes.
fn bounds(link: &Link) -> Option<(Vector3<f64>, Vector3<f64>)> {
    let reach = |direction: Vector3<f64>| {
        let reaches = link.collisions.iter().map(|shape| shape.reach(&direction));
        reaches.reduce(f64::max)
    };
    let along = |sign: f64| {
        Some(Vector3::new(
            sign * reach(Vector3::x() * sign)?,
            sign * reach(Vector3::y() * sign)?,
            sign * reach(Vector3::z() * sign)?,
        ))
    };
    Some((along(-1.0)?, along(1.0)?))
}

/// Returns the finding about implausibly large shapes of a link.
fn oversized(link: &Link) -> Option<Finding> {
    let (lower, upper) = bounds(link)?;
    let across = (upper - lower).norm();
    (across > MAX_LENGTH_M).then(|| Finding {
        severity: Severity::Doubtful,
        part: Part::Link(link.name.clone()),
        problem: format!("has shapes that are {across:.1} m across"),
        advice: "write lengths in meters".to_owned(),
    })
}

/// Returns the problem with the place of a link's center of mass, if there is one.
fn center_of_mass(link: &Link, inertial: &Inertial) -> Option<String> {
    let (lower, upper) = bounds(link)?;
    let center = inertial.center_of_mass_m.coords;
    let outside = (center - center.sup(&lower).inf(&upper)).norm();
    (outside > OUTSIDE * (upper - lower).norm()).then(|| {
        format!(
            "has its center of mass {:.1} mm outside the box about its shapes",
            outside * 1000.0
        )
    })
}

/// Returns the findings about an independent joint.
fn joint(joint: &Joint) -> Vec<Finding> {
    let mut findings = Vec::new();
    let mut find = |severity, problem: String, advice: &str| {
        findings.push(Finding {
            severity,
            part: Part::Joint(joint.name.clone()),
            problem,
            advice: advice.to_owned(),
        });
    };
    let is_turning = joint.kind != JointKind::Prismatic;
    if joint.upper - joint.lower <= 0.0 {
        find(
            Severity::Doubtful,
            format!("is locked: its limits are both {}", joint.lower),
            "give it its range, or make its type `fixed`",
        );
    } else if joint.lower > 0.0 || joint.upper < 0.0 {
        find(
            Severity::Note,
            format!(
                "cannot be at 0: its limits are {} and {}",
                short(joint.lower),
                short(joint.upper)
            ),
            "",
        );
    }
    let most = joint.lower.abs().max(joint.upper.abs());
    if is_turning && most.is_finite() && most > MAX_RAD {
        find(
            Severity::Doubtful,
            format!("turns by up to {most} rad"),
            "write angles in radians",
        );
    }
    for (limit, what, unit) in [
        (joint.effort, "effort", if is_turning { "Nm" } else { "N" }),
        (
            joint.velocity,
            "velocity",
            if is_turning { "rad/s" } else { "m/s" },
        ),
    ] {
        if limit == 0.0 {
            find(
                Severity::Doubtful,
                format!("has no {what} limit: 0 {unit}"),
                "take effort and velocity from the hardware's data sheet; many published files have \
                 placeholders",
            );
        }
    }
    findings
}
