//! Links and joints as a URDF writes them, before they are a tree.

use nalgebra::{Matrix3, Point3, Unit, Vector3};
use spatial::Pose;

use super::xml::Element;
use crate::{
    Collision, Finding, Inertial, JointKind, Link, Mesh, RobotError, Shape,
    findings::{Part, Severity},
};

/// Shortest axis that still has a direction.
const MIN_AXIS_LENGTH: f64 = 1e-6;

/// A link alone.
pub(super) struct RawLink {
    pub(super) name: String,
    pub(super) inertial: Option<Inertial>,
    pub(super) collisions: Vec<Collision>,
    pub(super) meshes: Vec<Mesh>,
}

/// A joint alone.
pub(super) struct RawJoint {
    pub(super) name: String,
    pub(super) parent: String,
    pub(super) child: String,
    /// `None` if it cannot move.
    pub(super) kind: Option<JointKind>,
    pub(super) parent_from_joint: Pose<Link, Link>,
    pub(super) axis: Unit<Vector3<f64>>,
    /// Least and greatest position; infinite if there is none.
    pub(super) range: (f64, f64),
    pub(super) effort: f64,
    pub(super) velocity: f64,
    pub(super) mimic: Option<RawMimic>,
}

/// Whose position a joint follows.
pub(super) struct RawMimic {
    pub(super) joint: String,
    pub(super) multiplier: f64,
    pub(super) offset: f64,
}

/// Reads a `<link>`.
pub(super) fn link(element: &Element, findings: &mut Vec<Finding>) -> Result<RawLink, RobotError> {
    let name = element.needed("name")?.to_owned();
    let mut inertial = None;
    let n_inertials = element.all("inertial").count();
    if let Some(first) = element.first("inertial") {
        inertial = self::inertial(first, &name, findings)?;
    }
    if n_inertials > 1 {
        findings.push(Finding {
            severity: Severity::Doubtful,
            part: Part::Link(name.clone()),
            problem: format!("has {n_inertials} `<inertial>` elements; the first one counts"),
            advice: "remove the others, after looking which one is meant".to_owned(),
        });
    }
    let mut collisions = Vec::new();
    let mut meshes = Vec::new();
    for role in ["collision", "visual"] {
        for drawn in element.all(role) {
            let is_collision = role == "collision";
            let Some(geometry) = drawn.first("geometry") else {
                continue;
            };
            if let Some(mesh) = geometry.first("mesh") {
                meshes.push(Mesh {
                    file: mesh.attribute("filename").unwrap_or_default().to_owned(),
                    is_collision,
                    link_from_mesh: drawn.origin()?,
                    scale: Vector3::from(mesh.triple("scale")?.unwrap_or([1.0; 3])),
                });
            } else if is_collision && let Some(written) = geometry.children.first() {
                match shape(written)? {
                    Some(shape) => collisions.push(Collision {
                        link_from_shape: drawn.origin()?,
                        shape,
                    }),
                    None => findings.push(Finding {
                        severity: Severity::Doubtful,
                        part: Part::Link(name.clone()),
                        problem: format!(
                            "has a `<{}>` on line {} that is not a shape with a volume; it is passed \
                             over",
                            written.name, written.line
                        ),
                        advice:
                            "write shapes as `<box>`, `<sphere>`, `<cylinder>`, `<capsule>` or \
                                 `<mesh>`, and lengths greater than 0"
                                .to_owned(),
                    }),
                }
            }
        }
    }
    Ok(RawLink {
        name,
        inertial,
        collisions,
        meshes,
    })
}

/// Reads an `<inertial>`; `None` if it weighs nothing.
fn inertial(
    element: &Element,
    link: &str,
    findings: &mut Vec<Finding>,
) -> Result<Option<Inertial>, RobotError> {
    let mass_kg = match element.first("mass") {
        Some(mass) => mass.needed_number("value")?,
        None => 0.0,
    };
    if mass_kg < 0.0 {
        return Err(RobotError::NegativeMass {
            link: link.to_owned(),
            mass_kg,
        });
    }
    let [mut ixx, mut ixy, mut ixz, mut iyy, mut iyz, mut izz] = [0.0; 6];
    if let Some(inertia) = element.first("inertia") {
        for (number, name) in [
            (&mut ixx, "ixx"),
            (&mut ixy, "ixy"),
            (&mut ixz, "ixz"),
            (&mut iyy, "iyy"),
            (&mut iyz, "iyz"),
            (&mut izz, "izz"),
        ] {
            *number = inertia.number(name)?.unwrap_or(0.0);
        }
    }
    let link_from_inertial: Pose<Link, Inertial> = element.origin()?;
    if mass_kg == 0.0 {
        findings.push(Finding {
            severity: Severity::Doubtful,
            part: Part::Link(link.to_owned()),
            problem: "has an `<inertial>` without mass; it is passed over".to_owned(),
            advice: "give it its mass, or remove the `<inertial>` if it is only a frame".to_owned(),
        });
        return Ok(None);
    }
    let inertia = Matrix3::new(ixx, ixy, ixz, ixy, iyy, iyz, ixz, iyz, izz);
    let rotation = link_from_inertial.rotation.to_rotation_matrix();
    Ok(Some(Inertial {
        mass_kg,
        center_of_mass_m: Point3::from(link_from_inertial.translation.vector),
        inertia_kg_m2: rotation.matrix() * inertia * rotation.matrix().transpose(),
    }))
}

/// Reads what stands in a `<geometry>` other than a mesh; `None` if it is not a shape or has no volume.
fn shape(element: &Element) -> Result<Option<Shape>, RobotError> {
    let (shape, has_volume) = match element.name.as_str() {
        "box" => {
            let half_extents_m = Vector3::from(element.triple("size")?.unwrap_or_default()) / 2.0;
            (Shape::Box { half_extents_m }, half_extents_m.min() > 0.0)
        }
        "sphere" => {
            let radius_m = element.needed_number("radius")?;
            (Shape::Sphere { radius_m }, radius_m > 0.0)
        }
        "cylinder" => {
            let radius_m = element.needed_number("radius")?;
            let half_length_m = element.needed_number("length")? / 2.0;
            let shape = Shape::Cylinder {
                radius_m,
                half_length_m,
            };
            (shape, radius_m > 0.0 && half_length_m > 0.0)
        }
        "capsule" => {
            let radius_m = element.needed_number("radius")?;
            let half_length_m = element.needed_number("length")? / 2.0;
            let shape = Shape::Capsule {
                radius_m,
                half_length_m,
            };
            // A capsule without a cylinder is a ball.
            (shape, radius_m > 0.0 && half_length_m >= 0.0)
        }
        _ => return Ok(None),
    };
    Ok(has_volume.then_some(shape))
}

/// Reads a `<joint>`.
pub(super) fn joint(
    element: &Element,
    findings: &mut Vec<Finding>,
) -> Result<RawJoint, RobotError> {
    let name = element.needed("name")?.to_owned();
    let linked = |role: &'static str| {
        let named = element.first(role).and_then(|role| role.attribute("link"));
        named.map(str::to_owned).ok_or(RobotError::Unlinked {
            joint: name.clone(),
            role,
            line: element.line,
        })
    };
    let mut kind = match element.needed("type")? {
        "revolute" => Some(JointKind::Revolute),
        "continuous" => Some(JointKind::Continuous),
        "prismatic" => Some(JointKind::Prismatic),
        "fixed" => None,
        other => {
            return Err(RobotError::UnsupportedJoint {
                joint: name,
                kind: other.to_owned(),
                line: element.line,
            });
        }
    };
    let (parent, child) = (linked("parent")?, linked("child")?);
    let limit = element.first("limit");
    let has_range = matches!(kind, Some(JointKind::Revolute | JointKind::Prismatic));
    let range = match limit.filter(|_| has_range) {
        Some(limit) => match (limit.number("lower")?, limit.number("upper")?) {
            (None, None) => None,
            (lower, upper) => Some((lower.unwrap_or(0.0), upper.unwrap_or(0.0))),
        },
        None => None,
    };
    if let Some((lower, upper)) = range
        && lower > upper
    {
        return Err(RobotError::BadLimits {
            joint: name,
            lower,
            upper,
        });
    }
    match (kind, range) {
        (Some(JointKind::Prismatic), None) => {
            return Err(RobotError::NoLimits {
                joint: name,
                line: element.line,
            });
        }
        (Some(JointKind::Revolute), None) => {
            kind = Some(JointKind::Continuous);
            findings.push(Finding {
                severity: Severity::Doubtful,
                part: Part::Joint(name.clone()),
                problem: "is revolute without limits; it is taken to turn without end".to_owned(),
                advice: "give it `<limit lower=… upper=… effort=… velocity=…/>`, or make its type \
                         `continuous`"
                    .to_owned(),
            });
        }
        (Some(_) | None, _) => {}
    }
    let mut axis = Vector3::x_axis();
    if kind.is_some()
        && let Some(written) = element.first("axis")
    {
        let along = Vector3::from(written.triple("xyz")?.unwrap_or([1.0, 0.0, 0.0]));
        axis = Unit::try_new(along, MIN_AXIS_LENGTH).ok_or_else(|| RobotError::ZeroAxis {
            joint: name.clone(),
        })?;
    }
    let mimic = match element.first("mimic") {
        Some(mimic) => Some(RawMimic {
            joint: mimic.needed("joint")?.to_owned(),
            multiplier: mimic.number("multiplier")?.unwrap_or(1.0),
            offset: mimic.number("offset")?.unwrap_or(0.0),
        }),
        None => None,
    };
    let bound = |attribute| limit.map_or(Ok(0.0), |limit| limit.bound(attribute));
    Ok(RawJoint {
        parent,
        child,
        kind,
        parent_from_joint: element.origin()?,
        axis,
        range: range.unwrap_or((f64::NEG_INFINITY, f64::INFINITY)),
        effort: bound("effort")?,
        velocity: bound("velocity")?,
        mimic,
        name,
    })
}
