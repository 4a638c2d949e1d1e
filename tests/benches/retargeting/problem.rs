//! The peer's three problems: its recorded targets, start values and answers, and our model of the
//! same hand.

use std::{
    collections::BTreeMap,
    env, fs,
    io::Read,
    path::{Path, PathBuf},
};

use nalgebra::{Point3, Vector3};
use posture::{CompiledHand, Loss, Posture, Root, RootPose, Target};
use robot::RobotModel;

/// The peer's loss turns from a parabola to a line here, in meters.
pub(crate) const BETA_M: f64 = 0.02;
/// The peer's factor of the squared motion of all coordinates, in m/rad² or 1/m.
pub(crate) const MOTION_WEIGHT: f64 = 4e-3;

/// A hand and 621 frames to follow.
pub(crate) struct Problem {
    pub(crate) name: &'static str,
    pub(crate) urdf: PathBuf,
    pub(crate) model: RobotModel,
    pub(crate) hand: CompiledHand,
    /// The links that follow.
    pub(crate) links: Vec<String>,
    /// Targets of these links, frame by frame.
    pub(crate) targets: Vec<Vec<Target>>,
    /// The peer's recorded answers, and the postures that each was to stay near.
    pub(crate) peer: Vec<Posture>,
    pub(crate) peer_before: Vec<Posture>,
    /// The peer's objective at each answer, as recorded.
    pub(crate) peer_objective: Vec<f64>,
    /// Our joint of each of the peer's coordinates after the root's six.
    pub(crate) joints: Vec<usize>,
}

/// The hands: name, URDF, and how many times faster than the peer's the solver has to be.
pub(crate) const HANDS: [(&str, &str, f64); 3] = [
    ("allegro", "allegro_hand_right.urdf", 250.0),
    ("leap", "leap_hand_right.urdf", 250.0),
    ("shadow", "shadow_hand_right.urdf", 150.0),
];

impl Problem {
    /// Reads a problem; an error says what is missing.
    pub(crate) fn read(name: &'static str, urdf: &str) -> Result<Self, String> {
        let data = folder("PIPELINE_PEER_DATA")?.join(format!("{name}_position.npz"));
        let urdf = folder("PIPELINE_REAL_DATA")?.join("urdf").join(urdf);
        let unread = |err| format!("cannot read the hand's URDF `{}`: {err}", urdf.display());
        let xml = fs::read_to_string(&urdf).map_err(unread)?;
        let model = RobotModel::from_urdf(&xml).map_err(|err| format!("{name}: {err}"))?;
        let arrays = arrays(&data)?;
        let links = arrays["link_names"].text();
        let points: Vec<(usize, Point3<f64>)> = links
            .iter()
            .map(|link| (model.require_link(link).unwrap(), Point3::origin()))
            .collect();
        let hand = CompiledHand::new(&model, Root::Angles, &points).unwrap();
        let names = arrays["joint_names"].text();
        let joints = model.require_joints(&names[6..]).unwrap();
        // The peer works on single precision.
        let targets = arrays["target"]
            .numbers()
            .chunks(3 * links.len())
            .map(|frame| {
                let points = frame.chunks(3).enumerate();
                points
                    .map(|(point, at)| Target {
                        point,
                        point_in_object: Point3::new(single(at[0]), single(at[1]), single(at[2])),
                        weight: 1.0 / (3 * links.len()) as f64,
                    })
                    .collect()
            })
            .collect();
        let postures = |key: &str| -> Vec<Posture> {
            let numbers = arrays[key].numbers();
            let frames = numbers.chunks(6 + joints.len());
            frames.map(|frame| posture(frame, &joints)).collect()
        };
        Ok(Self {
            name,
            links,
            targets,
            peer: postures("qpos"),
            peer_before: postures("last_qpos"),
            peer_objective: arrays["full_obj"].numbers(),
            urdf,
            model,
            hand,
            joints,
        })
    }

    /// Returns a posture in the peer's coordinates: the root's six, then the joints in its order.
    pub(crate) fn coordinates(&self, posture: &Posture) -> Vec<f64> {
        let root = posture.root.translation();
        let angles = posture.root.angles();
        let joints = self.joints.iter().map(|&joint| posture.q[joint]);
        root.iter()
            .chain(angles.iter())
            .copied()
            .chain(joints)
            .collect()
    }

    /// Returns the largest excess of a joint over its URDF limits, in radians.
    pub(crate) fn excess_rad(&self, posture: &Posture) -> f64 {
        let joints = self.model.joints().iter().zip(&posture.q);
        joints
            .map(|(joint, &q)| (joint.lower - q).max(q - joint.upper))
            .fold(0.0, f64::max)
    }

    pub(crate) fn loss() -> Loss {
        Loss::SmoothL1 { beta_m: BETA_M }
    }
}

/// Returns the posture of the peer's coordinates.
pub(crate) fn posture(coordinates: &[f64], joints: &[usize]) -> Posture {
    let part = |at: usize| Vector3::from_column_slice(&coordinates[at..at + 3]);
    let mut q = vec![0.0; joints.len()];
    for (&joint, &position) in joints.iter().zip(&coordinates[6..]) {
        q[joint] = position;
    }
    Posture {
        root: RootPose::from_angles(part(0), part(3)),
        q,
    }
}

#[expect(clippy::cast_possible_truncation, reason = "the peer rounds so")]
fn single(number: f64) -> f64 {
    f64::from(number as f32)
}

/// Names the peer's recording of a person's hand.
pub(crate) fn landmarks_file() -> Result<PathBuf, String> {
    Ok(folder("PIPELINE_PEER_DATA")?.join("human_joint_right_621x21x3.npy"))
}

/// Reads such a recording: 21 landmarks a frame, in meters.
pub(crate) fn landmarks(path: &Path) -> Result<Vec<[[f64; 3]; 21]>, String> {
    let bytes = fs::read(path);
    let bytes = bytes.map_err(|err| format!("cannot read `{}`: {err}", path.display()))?;
    let numbers = Array::of(bytes).numbers();
    let (points, _) = numbers.as_chunks::<3>();
    Ok(points.as_chunks::<21>().0.to_vec())
}

/// Returns the folder that a variable names; an error says what belongs into it.
pub(crate) fn folder(variable: &str) -> Result<PathBuf, String> {
    let holds = match variable {
        "PIPELINE_PEER_DATA" => "the recorded problems, `HAND_position.npz`",
        _ => "the hands' URDFs in `urdf`",
    };
    let folder = env::var_os(variable)
        .map(PathBuf::from)
        .ok_or_else(|| format!("`{variable}` is not set: name the folder that holds {holds}"))?;
    if !folder.is_dir() {
        let folder = folder.display();
        return Err(format!(
            "`{variable}` names `{folder}`, where there is no folder: name the one that holds {holds}"
        ));
    }
    Ok(folder)
}

/// An array of an archive: its kind of number and its bytes.
struct Array {
    kind: String,
    bytes: Vec<u8>,
}

impl Array {
    /// Reads the bytes of a `.npy` file, with a header of version 1.
    fn of(mut bytes: Vec<u8>) -> Self {
        let header_len = usize::from(u16::from_le_bytes([bytes[8], bytes[9]]));
        let header = String::from_utf8_lossy(&bytes[10..10 + header_len]).into_owned();
        let kind = header.split('\'').nth(3).unwrap_or_default().to_owned();
        bytes.drain(..10 + header_len);
        Self { kind, bytes }
    }

    fn numbers(&self) -> Vec<f64> {
        let eight = || self.bytes.chunks_exact(8).map(|b| b.try_into().unwrap());
        match self.kind.as_str() {
            "<f8" => eight().map(f64::from_le_bytes).collect(),
            "<i8" => eight().map(|b| i64::from_le_bytes(b) as f64).collect(),
            "<f4" => {
                let four = self.bytes.chunks_exact(4);
                four.map(|b| f64::from(f32::from_le_bytes(b.try_into().unwrap())))
                    .collect()
            }
            other => unreachable!("an array of `{other}`"),
        }
    }

    fn text(&self) -> Vec<String> {
        let len: usize = self.kind.trim_start_matches("<U").parse().unwrap();
        let letter = |b: &[u8]| char::from_u32(u32::from_le_bytes(b.try_into().unwrap()));
        self.bytes
            .chunks_exact(4 * len)
            .map(|text| {
                text.chunks_exact(4)
                    .filter_map(letter)
                    .filter(|&c| c != '\0')
                    .collect()
            })
            .collect()
    }
}

/// Reads the arrays of an `npz` file.
fn arrays(path: &Path) -> Result<BTreeMap<String, Array>, String> {
    let said = |err: &dyn std::fmt::Display| {
        format!(
            "cannot read the recorded problem `{}`: {err}",
            path.display()
        )
    };
    let file = fs::File::open(path).map_err(|err| said(&err))?;
    let mut archive = zip::ZipArchive::new(file).map_err(|err| said(&err))?;
    let mut arrays = BTreeMap::new();
    for idx in 0..archive.len() {
        let mut entry = archive.by_index(idx).map_err(|err| said(&err))?;
        let name = entry.name().map_err(|err| said(&err))?;
        let name = name.trim_end_matches(".npy").to_owned();
        let mut bytes = Vec::new();
        entry.read_to_end(&mut bytes).map_err(|err| said(&err))?;
        arrays.insert(name, Array::of(bytes));
    }
    Ok(arrays)
}
