//! Grasps as `DexGraspBench` reads them: one `.npy` a grasp, and a folder for each object.
//!
//! The layout and the conventions are those of its evaluator,
//! <https://github.com/JYChen18/DexGraspBench>, `src/task/eval_func` and `src/util/hand_util.py`: lengths in
//! meters, quaternions `w x y z`, and the frame of its Allegro's root, in which the palm is turned.

mod object;
mod pickle;

use std::collections::BTreeMap;

use nalgebra::{Quaternion, UnitQuaternion};
use spatial::{Palm, Pose, Table};

use crate::{
    Episode, EpisodeStep, Export, FormatError,
    dexgraspbench::pickle::{Value, npy},
    episode::check_together,
};

pub use object::BenchObject;

/// The hand's joints in the evaluator's order: first, middle and ring finger and thumb, four each.
const JOINTS_N: usize = 16;

/// The times of a motion that are its pregrasp and its grasp, as fractions of its duration; its squeeze is the
/// end.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GraspTimes {
    /// Pregrasp, where the evaluator begins: the hand must be at most 10 mm in the object.
    pub pregrasp: f64,
    /// Grasp, where the fingers touch, before they squeeze.
    pub grasp: f64,
}

/// Writes the last part of each motion as a grasp, `graspdata/OBJECT/MOTION.npy`, and each object's folder,
/// `objects/OBJECT`; `objects_at` is the folder of objects that the grasps name, as the evaluator will find it, and
/// `hand` the robot's name in its URDF.
///
/// # Errors
///
/// Fails without motions, if the hand is not a right Allegro, if a shape is missing, or if the times are out of
/// order.
pub fn to_dexgraspbench(
    episodes: &[Episode],
    objects: &BTreeMap<String, BenchObject>,
    times: GraspTimes,
    objects_at: &str,
    hand: &str,
) -> Result<Export, FormatError> {
    // Joints of the left hand have the same names.
    if hand.contains("left") {
        return Err(FormatError::NotRight {
            hand: hand.to_owned(),
        });
    }
    let GraspTimes { pregrasp, grasp } = times;
    if !(0.0 <= pregrasp && pregrasp <= grasp && grasp <= 1.0) {
        return Err(FormatError::GraspTimes { pregrasp, grasp });
    }
    let order = allegro_order(check_together(episodes)?)?;
    let mut export = Export::default();
    let mut masses = Vec::new();
    for episode in episodes {
        let name = episode.object();
        let object = objects.get(name).ok_or_else(|| FormatError::Shape {
            object: name.to_owned(),
        })?;
        if !export
            .files
            .contains_key(&format!("objects/{name}/info/simplified.json"))
        {
            for (file, bytes) in object.files(name)? {
                export.put(format!("objects/{name}/{file}"), bytes);
            }
            masses.push(object.mass_kg);
        }
        let qpos = |fraction| Value::Array(qpos(&episode.at_fraction(fraction), &order));
        let start = episode.at_fraction(pregrasp);
        let grasp = Value::Dictionary(vec![
            ("obj_path", Value::Text(format!("{objects_at}/{name}"))),
            ("obj_scale", Value::Number(1.0)),
            ("obj_pose", Value::Array(wxyz(&start.table_from_object))),
            ("pregrasp_qpos", qpos(pregrasp)),
            ("grasp_qpos", qpos(times.grasp)),
            ("squeeze_qpos", qpos(1.0)),
        ]);
        export.put(
            format!("graspdata/{name}/{}.npy", episode.name()),
            npy(&grasp),
        );
    }
    export.lost = lost(&masses, times);
    Ok(export)
}

/// Lists the information that the grasps and folders do not hold.
fn lost(masses: &[f64], times: GraspTimes) -> Vec<String> {
    let (low, high) = masses
        .iter()
        .fold((f64::INFINITY, 0.0_f64), |(low, high), &mass| {
            (low.min(mass), high.max(mass))
        });
    vec![
        format!(
            "the reach: of each motion only its moments at {} and {} of its duration and its end are in it, \
             as pregrasp, grasp and squeeze",
            times.pregrasp, times.grasp
        ),
        format!(
            "masses: the evaluator gives every object `task.obj_mass`, 0.1 kg; these have {low:.3} to {high:.3} kg"
        ),
        "times, velocities, accelerations, commands, contacts, latent codes, metrics and outcomes".to_owned(),
        "joint limits, torque limits and shapes of the hand: the evaluator has its own Allegro".to_owned(),
        "textures and details of the objects: their convex parts collide, and their center of mass is that of the parts"
            .to_owned(),
    ]
}

/// Returns the index of each of the evaluator's joints among those of a motion.
fn allegro_order(episode: &Episode) -> Result<Vec<usize>, FormatError> {
    let joints = episode.joints();
    let expected: Vec<String> = (0..JOINTS_N).map(|idx| format!("joint_{idx}.0")).collect();
    if let Some(other) = joints.iter().find(|joint| !expected.contains(&joint.name)) {
        return Err(FormatError::NotAllegro {
            joint: other.name.clone(),
        });
    }
    let places = expected.into_iter().map(|name| {
        let place = joints.iter().position(|joint| joint.name == name);
        place.ok_or(FormatError::NotAllegro { joint: name })
    });
    places.collect()
}

/// The hand as the evaluator has it: position and quaternion of its root, then joint positions.
fn qpos(step: &EpisodeStep, order: &[usize]) -> Vec<f64> {
    let mut numbers = wxyz(&root(&step.table_from_palm));
    numbers.extend(order.iter().map(|&place| step.q[place]));
    numbers
}

/// The pose of the evaluator's root link, in which the palm is turned by the quaternion (w 0, x 1, y 0, z 1), which
/// is half a turn about the axis between x and z.
fn root(table_from_palm: &Pose<Table, Palm>) -> Pose<Table, Palm> {
    let root_from_palm = UnitQuaternion::from_quaternion(Quaternion::from([1.0, 0.0, 1.0, 0.0]));
    let turn = Pose::<Palm, Palm>::from_parts([0.0; 3], root_from_palm.inverse());
    *table_from_palm * turn
}

/// A pose with its quaternion's w first.
fn wxyz<A, B>(pose: &Pose<A, B>) -> Vec<f64> {
    let [px, py, pz, x, y, z, w] = pose.to_array();
    vec![px, py, pz, w, x, y, z]
}

#[cfg(test)]
mod tests {
    use nalgebra::{Point3, Vector3};

    use super::*;
    use crate::Joint;

    fn allegro(names: impl Iterator<Item = usize>) -> Vec<Joint> {
        let joint = |idx| Joint {
            name: format!("joint_{idx}.0"),
            unit: crate::Unit::Radian,
        };
        names.map(joint).collect()
    }

    fn step(time_s: f64, q: Vec<f64>) -> EpisodeStep {
        EpisodeStep {
            time_s,
            table_from_palm: Pose::from_parts(
                [0.1, 0.2, 0.3 - 0.1 * time_s],
                UnitQuaternion::from_euler_angles(0.3, -0.2, 0.9),
            ),
            table_from_object: Pose::from_parts(
                [0.0, 0.0, 0.05],
                UnitQuaternion::from_axis_angle(&Vector3::x_axis(), 1.0),
            ),
            q,
            q_command: None,
        }
    }

    #[test]
    fn joints_are_found_by_name() {
        let joints = allegro((0..16).rev());
        let q: Vec<f64> = (0..16).rev().map(f64::from).collect();
        let episode = Episode::new("a", "o", &joints, &[step(0.0, q.clone())]).unwrap();
        let order = allegro_order(&episode).unwrap();
        let numbers = qpos(&episode.at(0.0), &order);
        let expected: Vec<f64> = (0..16).map(f64::from).collect();
        assert_eq!(numbers[7..], expected);
        for joints in [allegro(0..15), allegro(1..17)] {
            let q = vec![0.0; joints.len()];
            let other = Episode::new("a", "o", &joints, &[step(0.0, q)]).unwrap();
            assert!(matches!(
                allegro_order(&other),
                Err(FormatError::NotAllegro { .. })
            ));
        }
    }

    #[test]
    fn the_palm_stands_where_it_stood_once_the_evaluator_has_turned_it() {
        let palm = step(0.0, Vec::new()).table_from_palm;
        let turn = UnitQuaternion::from_quaternion(Quaternion::from([1.0, 0.0, 1.0, 0.0]));
        let again = *root(&palm) * nalgebra::Isometry3::from_parts([0.0; 3].into(), turn);
        let point = Point3::new(0.01, -0.02, 0.03);
        assert!((again * point - *palm * point).norm() < 1e-12);
    }

    #[test]
    fn times_out_of_order_and_objects_without_shape_are_refused() {
        let joints = allegro(0..16);
        let steps = vec![step(0.0, vec![0.0; 16]), step(1.0, vec![0.1; 16])];
        let episode = [Episode::new("a", "o", &joints, &steps).unwrap()];
        let of_hand = |pregrasp, grasp, hand| {
            let times = GraspTimes { pregrasp, grasp };
            to_dexgraspbench(&episode, &BTreeMap::new(), times, "objects", hand)
        };
        let export = |pregrasp, grasp| of_hand(pregrasp, grasp, "allegro_right");
        // The joints of a left hand have the same names.
        let refused = of_hand(0.7, 0.9, "allegro_left").unwrap_err();
        assert!(matches!(refused, FormatError::NotRight { .. }));
        for (pregrasp, grasp) in [(0.9, 0.8), (-0.1, 0.5), (0.5, 1.1), (f64::NAN, 0.5)] {
            let refused = export(pregrasp, grasp).unwrap_err();
            assert!(matches!(refused, FormatError::GraspTimes { .. }));
        }
        assert!(matches!(
            export(0.7, 0.9).unwrap_err(),
            FormatError::Shape { .. }
        ));
    }
}
