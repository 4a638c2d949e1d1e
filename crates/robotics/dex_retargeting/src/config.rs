//! A configuration file.

mod keys;

use std::str::FromStr;

use self::keys::{File, Indices, Keys};
use crate::{ConfigError, LANDMARKS, LinkVector, Objective, ObjectiveKind, pinch};

/// The library's own distance up to which `dexpilot`'s loss is a parabola, in meters, and its factor of squared motion:
/// for this type it passes over the file's.
const DEXPILOT_HUBER_DELTA_M: f64 = 0.03;
const DEXPILOT_NORMAL_DELTA: f64 = 4e-3;

/// A configuration file of dex-retargeting.
#[derive(Debug, Clone, PartialEq)]
pub struct Config {
    /// The URDF's path, in a folder of robots.
    pub urdf_path: String,
    /// What is to be followed.
    pub objective: Objective,
    /// Whether the root link moves freely.
    pub add_dummy_free_joint: bool,
    /// The joints that are solved for; all where it is `None`.
    pub target_joint_names: Option<Vec<String>>,
    /// Whether joints have limits.
    pub has_joint_limits: bool,
    /// Whether joints that mimic others are independent of them.
    pub ignore_mimic_joint: bool,
    /// Share of the way to each new answer that the filter goes; `None` is no filter.
    pub low_pass_alpha: Option<f64>,
}

impl FromStr for Config {
    type Err = ConfigError;

    fn from_str(text: &str) -> Result<Self, ConfigError> {
        let File { retargeting: keys } = keys::parse(text)?;
        let alpha = keys.low_pass_alpha;
        Ok(Self {
            objective: objective(&keys)?,
            urdf_path: keys.urdf_path,
            add_dummy_free_joint: keys.add_dummy_free_joint,
            target_joint_names: keys.target_joint_names,
            has_joint_limits: keys.has_joint_limits,
            ignore_mimic_joint: keys.ignore_mimic_joint,
            low_pass_alpha: (0.0..=1.0).contains(&alpha).then_some(alpha),
        })
    }
}

fn objective(keys: &Keys) -> Result<Objective, ConfigError> {
    let positive = |key, value: f64| {
        if value.is_finite() && value > 0.0 {
            return Ok(value);
        }
        Err(ConfigError::BadNumber { key, value })
    };
    let scale = positive("scaling_factor", keys.scaling_factor)?;
    let (mut huber_delta_m, mut normal_delta) = (
        positive("huber_delta", keys.huber_delta)?,
        positive("normal_delta", keys.normal_delta)?,
    );
    let kind = match keys.kind.to_lowercase().as_str() {
        "position" => ObjectiveKind::Position {
            links: followed_links(keys)?,
        },
        "vector" => ObjectiveKind::Vector {
            vectors: followed_vectors(keys)?,
            scale,
        },
        "dexpilot" => {
            huber_delta_m = DEXPILOT_HUBER_DELTA_M;
            normal_delta = DEXPILOT_NORMAL_DELTA;
            let (vectors, fingers) = fingertip_vectors(keys)?;
            ObjectiveKind::DexPilot {
                vectors,
                fingers,
                scale,
                project_distance_m: positive("project_dist", keys.project_dist)?,
                escape_distance_m: positive("escape_dist", keys.escape_dist)?,
            }
        }
        _ => return Err(ConfigError::UnknownType(keys.kind.clone())),
    };
    Ok(Objective {
        kind,
        huber_delta_m,
        normal_delta,
    })
}

/// Returns the links of `position`, and the landmark that each follows.
fn followed_links(keys: &Keys) -> Result<Vec<(String, usize)>, ConfigError> {
    let kind = "position";
    let links = needed(kind, "target_link_names", keys.target_link_names.as_ref())?;
    let landmarks = match needed(kind, INDICES, keys.target_link_human_indices.as_ref())? {
        Indices::One(landmarks) => landmarks,
        Indices::Several(rows) if rows.len() == 1 => &rows[0],
        Indices::Several(rows) => {
            let shape = format!("{} lists", rows.len());
            return Err(lengths(INDICES, shape, "target_link_names", links.len()));
        }
    };
    if landmarks.len() != links.len() {
        let shape = format!("{} landmarks", landmarks.len());
        return Err(lengths(INDICES, shape, "target_link_names", links.len()));
    }
    let landmarks: Result<Vec<usize>, ConfigError> =
        landmarks.iter().copied().map(landmark).collect();
    Ok(links.iter().cloned().zip(landmarks?).collect())
}

/// Returns the vectors of `vector`.
fn followed_vectors(keys: &Keys) -> Result<Vec<LinkVector>, ConfigError> {
    let kind = "vector";
    let origins = "target_origin_link_names";
    let from = needed(kind, origins, keys.target_origin_link_names.as_ref())?;
    let to = needed(
        kind,
        "target_task_link_names",
        keys.target_task_link_names.as_ref(),
    )?;
    if from.len() != to.len() {
        let shape = format!("{} links", to.len());
        return Err(lengths(
            "target_task_link_names",
            shape,
            origins,
            from.len(),
        ));
    }
    let landmarks = needed(kind, INDICES, keys.target_link_human_indices.as_ref())?;
    let landmarks = pairs(landmarks, from.len(), origins)?;
    let links = from.iter().zip(to);
    Ok(links
        .zip(landmarks)
        .map(|((from, to), landmarks)| LinkVector {
            links: [from.clone(), to.clone()],
            landmarks,
        })
        .collect())
}

/// Returns the vectors of `dexpilot`, and the number of fingers.
fn fingertip_vectors(keys: &Keys) -> Result<(Vec<LinkVector>, usize), ConfigError> {
    let kind = "dexpilot";
    let tips = "finger_tip_link_names";
    let names = needed(kind, tips, keys.finger_tip_link_names.as_ref())?;
    let wrist = needed(kind, "wrist_link_name", keys.wrist_link_name.as_ref())?;
    if !(2..=5).contains(&names.len()) {
        return Err(ConfigError::Fingers(names.len()));
    }
    let ends = pinch::vectors(names.len());
    let landmarks = match &keys.target_link_human_indices {
        Some(landmarks) => pairs(landmarks, ends.len(), "vectors of so many fingers")?,
        // The wrist is landmark 0, and fingertips are every fourth.
        None => ends.iter().map(|ends| ends.map(|end| 4 * end)).collect(),
    };
    let link = |end: usize| match end.checked_sub(1) {
        None => wrist.clone(),
        Some(finger) => names[finger].clone(),
    };
    let vectors = ends.into_iter().zip(landmarks);
    let vectors = vectors.map(|(ends, landmarks)| LinkVector {
        links: ends.map(link),
        landmarks,
    });
    Ok((vectors.collect(), names.len()))
}

const INDICES: &str = "target_link_human_indices";

/// Returns the landmarks of vectors, two lists of so many numbers.
fn pairs(indices: &Indices, n: usize, other: &'static str) -> Result<Vec<[usize; 2]>, ConfigError> {
    let rows = match indices {
        Indices::Several(rows) => rows.as_slice(),
        Indices::One(one) => {
            let shape = format!("one list of {}", one.len());
            return Err(lengths(INDICES, shape, other, n));
        }
    };
    match rows {
        [from, to] if from.len() == n && to.len() == n => {
            let both = from.iter().zip(to);
            both.map(|(from, to)| Ok([landmark(*from)?, landmark(*to)?]))
                .collect()
        }
        rows => {
            let counts: Vec<String> = rows.iter().map(|row| row.len().to_string()).collect();
            let shape = format!("lists of {}", counts.join(", "));
            Err(lengths(INDICES, shape, other, n))
        }
    }
}

fn landmark(index: i64) -> Result<usize, ConfigError> {
    let landmark = usize::try_from(index).ok();
    landmark
        .filter(|&landmark| landmark < LANDMARKS)
        .ok_or(ConfigError::NoLandmark(index))
}

fn needed<'a, T>(
    kind: &'static str,
    key: &'static str,
    value: Option<&'a T>,
) -> Result<&'a T, ConfigError> {
    value.ok_or(ConfigError::MissingKey { kind, key })
}

fn lengths(key: &'static str, found: String, other: &'static str, n: usize) -> ConfigError {
    ConfigError::Lengths {
        key,
        found,
        other,
        expected: n.to_string(),
    }
}

#[cfg(test)]
mod tests;
