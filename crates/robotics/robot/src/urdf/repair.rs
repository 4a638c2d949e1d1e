//! What is read of a URDF, each value checked with its line, and repaired where `urdf-rs` refuses what is
//! common in published robots or cannot tell what is missing.

use super::xml::Element;
use crate::{
    Finding, RobotError,
    findings::{Part, Severity},
};

/// Greatest number of which a robot makes sense, in any unit: a million kilometers. Below it no
/// product of the numbers of a tree overflows.
const MAX_NUMBER: f64 = 1e9;

/// Kind of an attribute's value.
#[derive(Clone, Copy)]
enum Value {
    Text,
    Number,
    Triple,
    /// At least 0; infinity is a number here.
    Bound,
}

/// Returns the attributes that are read of an element, and what one that is missing is, as `urdfdom` has it;
/// `None` where it cannot be left out.
fn attributes(element: &str) -> &'static [(&'static str, Value, Option<&'static str>)] {
    use Value::{Bound, Number, Text, Triple};
    const ZERO: Option<&str> = Some("0");
    match element {
        "robot" => &[("name", Text, Some(""))],
        "link" => &[("name", Text, None)],
        "joint" => &[("name", Text, None), ("type", Text, None)],
        "parent" | "child" => &[("link", Text, None)],
        "origin" => &[
            ("xyz", Triple, Some("0 0 0")),
            ("rpy", Triple, Some("0 0 0")),
        ],
        "mass" => &[("value", Number, None)],
        "inertia" => &[
            ("ixx", Number, ZERO),
            ("ixy", Number, ZERO),
            ("ixz", Number, ZERO),
            ("iyy", Number, ZERO),
            ("iyz", Number, ZERO),
            ("izz", Number, ZERO),
        ],
        "box" => &[("size", Triple, Some("0 0 0"))],
        "sphere" => &[("radius", Number, None)],
        "cylinder" | "capsule" => &[("radius", Number, None), ("length", Number, None)],
        "mesh" => &[
            ("filename", Text, Some("")),
            ("scale", Triple, Some("1 1 1")),
        ],
        "axis" => &[("xyz", Triple, Some("1 0 0"))],
        "limit" => &[
            ("lower", Number, ZERO),
            ("upper", Number, ZERO),
            ("effort", Bound, ZERO),
            ("velocity", Bound, ZERO),
        ],
        "mimic" => &[
            ("joint", Text, None),
            ("multiplier", Number, Some("1")),
            ("offset", Number, ZERO),
        ],
        _ => &[],
    }
}

/// Returns a robot of the links and joints of another, with nothing that `urdf-rs` refuses; of elements of
/// which there should be one the first counts, as for `urdfdom`.
pub(super) fn repaired(
    robot: &Element,
    findings: &mut Vec<Finding>,
) -> Result<Element, RobotError> {
    let mut whole = checked(robot)?;
    for element in robot.all("link") {
        whole.children.push(link(element, findings)?);
    }
    for element in robot.all("joint") {
        whole.children.push(joint(element, findings)?);
    }
    Ok(whole)
}

fn link(element: &Element, findings: &mut Vec<Finding>) -> Result<Element, RobotError> {
    let mut link = checked(element)?;
    let part = Part::Link(link.attribute("name").unwrap_or_default().to_owned());
    if let Some(first) = element.first("inertial") {
        let mut inertial = checked(first)?;
        copy(first, "mass", &mut inertial)?;
        let weighs = inertial
            .first("mass")
            .is_some_and(|mass| numbers(mass).any(|kg| kg != 0.0));
        let empty = Element::new("inertia", first.line);
        let inertia = first.first("inertia").unwrap_or(&empty);
        inertial.children.push(checked(inertia)?);
        copy(first, "origin", &mut inertial)?;
        if weighs {
            link.children.push(inertial);
        } else {
            findings.push(Finding {
                severity: Severity::Doubtful,
                part: part.clone(),
                problem: "has an `<inertial>` without mass; it is passed over".to_owned(),
                advice: "give it its mass, or remove the `<inertial>` if it is only a frame"
                    .to_owned(),
            });
        }
    }
    let n_inertials = element.all("inertial").count();
    if n_inertials > 1 {
        findings.push(Finding {
            severity: Severity::Doubtful,
            part: part.clone(),
            problem: format!("has {n_inertials} `<inertial>` elements; the first one counts"),
            advice: "remove the others, after looking which one is meant".to_owned(),
        });
    }
    for role in ["collision", "visual"] {
        for drawn in element.all(role) {
            let Some(geometry) = drawn.first("geometry") else {
                continue;
            };
            let shape = if let Some(mesh) = geometry.first("mesh") {
                checked(mesh)?
            } else if role == "collision"
                && let Some(written) = geometry.children.first()
            {
                let Some(shape) = solid(written)? else {
                    findings.push(no_volume(part.clone(), written));
                    continue;
                };
                shape
            } else {
                continue;
            };
            let mut kept = checked(drawn)?;
            copy(drawn, "origin", &mut kept)?;
            let mut around = checked(geometry)?;
            around.children.push(shape);
            kept.children.push(around);
            link.children.push(kept);
        }
    }
    Ok(link)
}

/// Returns a shape other than a mesh; `None` if it is not one or has no volume.
fn solid(written: &Element) -> Result<Option<Element>, RobotError> {
    if !["box", "sphere", "cylinder", "capsule"].contains(&written.name.as_str()) {
        return Ok(None);
    }
    let shape = checked(written)?;
    // A capsule without a cylinder is a ball.
    let has_volume = match (
        shape.name.as_str(),
        numbers(&shape).collect::<Vec<_>>().as_slice(),
    ) {
        ("capsule", &[radius, length]) => radius > 0.0 && length >= 0.0,
        (_, sizes) => sizes.iter().all(|&size| size > 0.0),
    };
    Ok(has_volume.then_some(shape))
}

fn no_volume(part: Part, written: &Element) -> Finding {
    Finding {
        severity: Severity::Doubtful,
        part,
        problem: format!(
            "has a `<{}>` on line {} that is not a shape with a volume; it is passed over",
            written.name, written.line
        ),
        advice: "write shapes as `<box>`, `<sphere>`, `<cylinder>`, `<capsule>` or `<mesh>`, and lengths \
                 greater than 0"
            .to_owned(),
    }
}

fn joint(element: &Element, findings: &mut Vec<Finding>) -> Result<Element, RobotError> {
    let mut joint = checked(element)?;
    let [name, kind] =
        ["name", "type"].map(|attribute| joint.attribute(attribute).unwrap_or_default().to_owned());
    if !["revolute", "continuous", "prismatic", "fixed"].contains(&kind.as_str()) {
        return Err(RobotError::UnsupportedJoint {
            joint: name,
            kind,
            line: element.line,
        });
    }
    for role in ["parent", "child"] {
        let named = element.first(role).and_then(|role| role.attribute("link"));
        if named.is_none() {
            return Err(RobotError::Unlinked {
                joint: name,
                role,
                line: element.line,
            });
        }
        copy(element, role, &mut joint)?;
    }
    let has_range = kind == "revolute" || kind == "prismatic";
    let is_end = |key: &str| key == "lower" || key == "upper";
    let mut is_limited = false;
    if let Some(limit) = element.first("limit") {
        let mut limit = limit.clone();
        limit
            .attributes
            .retain(|(key, _)| has_range || !is_end(key));
        is_limited = limit.attributes.iter().any(|(key, _)| is_end(key));
        joint.children.push(checked(&limit)?);
    }
    if kind == "prismatic" && !is_limited {
        return Err(RobotError::NoLimits {
            joint: name,
            line: element.line,
        });
    }
    if kind == "revolute" && !is_limited {
        // `urdf-rs` takes limits that are missing to be 0, as if it were locked.
        joint.attributes = vec![
            ("name".to_owned(), name.clone()),
            ("type".to_owned(), "continuous".to_owned()),
        ];
        findings.push(Finding {
            severity: Severity::Doubtful,
            part: Part::Joint(name),
            problem: "is revolute without limits; it is taken to turn without end".to_owned(),
            advice: "give it `<limit lower=… upper=… effort=… velocity=…/>`, or make its type \
                     `continuous`"
                .to_owned(),
        });
    }
    // Fixed joints have axes that mean nothing.
    if kind != "fixed" {
        copy(element, "axis", &mut joint)?;
    }
    copy(element, "mimic", &mut joint)?;
    copy(element, "origin", &mut joint)?;
    Ok(joint)
}

/// Puts the first child of this name into another element, if there is one.
fn copy(from: &Element, name: &str, to: &mut Element) -> Result<(), RobotError> {
    if let Some(first) = from.first(name) {
        to.children.push(checked(first)?);
    }
    Ok(())
}

/// Returns an element without its children, with the attributes that are read and usable.
fn checked(element: &Element) -> Result<Element, RobotError> {
    let mut checked = Element::new(&element.name, element.line);
    let (name, line) = (|| element.name.clone(), element.line);
    for &(attribute, value, default) in attributes(&element.name) {
        let Some(text) = element.attribute(attribute).or(default) else {
            return Err(RobotError::MissingAttribute {
                element: name(),
                attribute,
                line,
            });
        };
        let is_usable = match value {
            Value::Text => true,
            Value::Number => is_finite(text),
            Value::Triple => {
                text.split_whitespace().count() == 3 && text.split_whitespace().all(is_finite)
            }
            Value::Bound => text.trim().parse::<f64>().is_ok_and(|number| number >= 0.0),
        };
        if !is_usable {
            let (element, text) = (name(), shortened(text));
            return Err(match value {
                Value::Triple => RobotError::BadTriple {
                    element,
                    attribute,
                    text,
                    line,
                },
                Value::Text | Value::Number | Value::Bound => RobotError::BadNumber {
                    element,
                    attribute,
                    text,
                    line,
                },
            });
        }
        checked
            .attributes
            .push((attribute.to_owned(), text.to_owned()));
    }
    Ok(checked)
}

/// Returns the numbers in the attributes of an element that has no other.
fn numbers(checked: &Element) -> impl Iterator<Item = f64> {
    let texts = checked.attributes.iter();
    let texts = texts.flat_map(|(_, text)| text.split_whitespace());
    texts.filter_map(|text| text.parse().ok())
}

fn is_finite(text: &str) -> bool {
    let number = text.trim().parse::<f64>();
    number.is_ok_and(|number| number.abs() <= MAX_NUMBER)
}

/// Returns the beginning of a text for a message.
fn shortened(text: &str) -> String {
    const MAX_CHARS: usize = 60;
    match text.char_indices().nth(MAX_CHARS) {
        Some((end, _)) => format!("{}…", text.get(..end).unwrap_or_default()),
        None => text.to_owned(),
    }
}
