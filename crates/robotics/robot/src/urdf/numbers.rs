//! Numbers of a URDF: finite, and as many as they should be.

use nalgebra::UnitQuaternion;
use spatial::Pose;

use super::xml::Element;
use crate::RobotError;

/// Greatest number of which a robot makes sense, in any unit: a million kilometers. Below it no
/// product of the numbers of a tree overflows.
const MAX_NUMBER: f64 = 1e9;

impl Element {
    /// Returns the number in an attribute, `None` if there is no such attribute.
    pub(super) fn number(&self, attribute: &'static str) -> Result<Option<f64>, RobotError> {
        let Some(text) = self.attribute(attribute) else {
            return Ok(None);
        };
        match finite(text) {
            Some(number) => Ok(Some(number)),
            None => Err(self.bad_number(attribute, text)),
        }
    }

    /// Returns the number in an attribute; 0 if there is none; infinity is a number here.
    pub(super) fn bound(&self, attribute: &'static str) -> Result<f64, RobotError> {
        let text = self.attribute(attribute).unwrap_or("0").trim();
        match text.parse::<f64>() {
            Ok(number) if number >= 0.0 => Ok(number),
            Ok(_) | Err(_) => Err(self.bad_number(attribute, text)),
        }
    }

    /// Returns the number in an attribute that must be there.
    pub(super) fn needed_number(&self, attribute: &'static str) -> Result<f64, RobotError> {
        self.number(attribute)?
            .ok_or_else(|| self.missing(attribute))
    }

    /// Returns the three numbers in an attribute, `None` if there is no such attribute.
    pub(super) fn triple(&self, attribute: &'static str) -> Result<Option<[f64; 3]>, RobotError> {
        let Some(text) = self.attribute(attribute) else {
            return Ok(None);
        };
        let numbers: Option<Vec<f64>> = text.split_whitespace().map(finite).collect();
        match numbers.and_then(|numbers| numbers.try_into().ok()) {
            Some(numbers) => Ok(Some(numbers)),
            None => Err(RobotError::BadTriple {
                element: self.name.clone(),
                attribute,
                text: shortened(text),
                line: self.line,
            }),
        }
    }

    /// Reads the element's `<origin>`: roll about x, then pitch about y, then yaw about z, all
    /// fixed axes. Without one it is the identity.
    pub(super) fn origin<To, From>(&self) -> Result<Pose<To, From>, RobotError> {
        let Some(origin) = self.first("origin") else {
            return Ok(Pose::identity());
        };
        let position = origin.triple("xyz")?.unwrap_or_default();
        let [roll, pitch, yaw] = origin.triple("rpy")?.unwrap_or_default();
        let rotation = UnitQuaternion::from_euler_angles(roll, pitch, yaw);
        Ok(Pose::from_parts(position, rotation))
    }

    /// Returns the text of an attribute that must be there.
    pub(super) fn needed(&self, attribute: &'static str) -> Result<&str, RobotError> {
        self.attribute(attribute)
            .ok_or_else(|| self.missing(attribute))
    }

    fn missing(&self, attribute: &'static str) -> RobotError {
        RobotError::MissingAttribute {
            element: self.name.clone(),
            attribute,
            line: self.line,
        }
    }

    fn bad_number(&self, attribute: &'static str, text: &str) -> RobotError {
        RobotError::BadNumber {
            element: self.name.clone(),
            attribute,
            text: shortened(text),
            line: self.line,
        }
    }
}

fn finite(text: &str) -> Option<f64> {
    let number: f64 = text.trim().parse().ok()?;
    (number.abs() <= MAX_NUMBER).then_some(number)
}

/// Returns the beginning of a text for a message.
fn shortened(text: &str) -> String {
    const MAX_CHARS: usize = 60;
    match text.char_indices().nth(MAX_CHARS) {
        Some((end, _)) => format!("{}…", text.get(..end).unwrap_or_default()),
        None => text.to_owned(),
    }
}
