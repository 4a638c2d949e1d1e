//! Where frames were at the times of images, as ROS 2's tf tells it.

use std::collections::BTreeMap;

use nalgebra::{Isometry3, Translation3};
use schemas::ros2::{TfMessage, Time, Transform};
use spatial::quaternion_xyzw;

use crate::error::Fault;

/// Most frames of a recording: a robot with hands has a hundred.
const MAX_FRAMES: usize = 4096;
/// Longest time between two transforms between which a frame's motion is a straight one: tf has 10 and more a second.
const MAX_GAP_NS: i64 = 250_000_000;
/// Longest time from an image to the nearest transform, if it is not between two.
const MAX_OFF_NS: u64 = 50_000_000;

/// Transforms between frames about the times of some images.
pub(crate) struct Transforms {
    stamps_ns: Vec<i64>,
    /// By name.
    frames: BTreeMap<String, Frame>,
}

/// The transforms of a frame in its parent.
struct Frame {
    parent: String,
    /// One for all times.
    fixed: Option<Transform>,
    /// For each image the newest that is not after it, and the oldest after it.
    about: Vec<[Option<(i64, Transform)>; 2]>,
}

/// Where a frame was at the time of an image.
pub(crate) enum Place {
    /// In the frame that is the root of all others.
    In {
        /// The root.
        root: String,
        /// Pose of the frame in it.
        root_from_frame: Isometry3<f64>,
        /// Whether tf says of every time anew where it is.
        is_tracked: bool,
    },
    /// Nothing says where.
    Unknown(Fault),
}

impl Transforms {
    /// Without transforms, for images of these times.
    pub(crate) fn new(stamps_ns: Vec<i64>) -> Self {
        let frames = BTreeMap::new();
        Self { stamps_ns, frames }
    }

    /// Adds the transforms of a message, which hold for all times if it is static.
    ///
    /// # Errors
    ///
    /// Fails if there are more frames than a robot can have.
    pub(crate) fn add(&mut self, message: &TfMessage, is_static: bool) -> Result<(), Fault> {
        for stamped in &message.transforms {
            let [parent, child] =
                [&stamped.header.frame_id, &stamped.child_frame_id].map(|frame| plain(frame));
            if self.frames.len() >= MAX_FRAMES && !self.frames.contains_key(child) {
                let problem = format!("has transforms of more than {MAX_FRAMES} frames");
                return Err(Fault::new(problem, "record without `/tf`"));
            }
            let frame = self.frames.entry(child.to_owned());
            let new = || Frame {
                parent: parent.to_owned(),
                fixed: None,
                about: vec![[None; 2]; self.stamps_ns.len()],
            };
            let frame = frame.or_insert_with(new);
            if frame.parent != parent {
                *frame = new();
            }
            if is_static {
                frame.fixed = Some(stamped.transform);
            } else {
                frame.keep_nearest(&self.stamps_ns, stamped.header.stamp, stamped.transform);
            }
        }
        Ok(())
    }

    /// Returns where a frame was at the time of an image, by its place among the times.
    ///
    /// # Errors
    ///
    /// Fails if a transform on the way to the root is none.
    pub(crate) fn place(&self, frame: &str, image_idx: usize) -> Result<Place, Fault> {
        let mut root = plain(frame);
        let mut root_from_frame = Isometry3::identity();
        let mut is_tracked = false;
        let record = "record `/tf` and `/tf_static` from the start to have its pose";
        if !self.frames.contains_key(root) {
            let problem =
                format!("tf has no parent of the frame `{root}`, so that its world is its own");
            return Ok(Place::Unknown(Fault::new(problem, record)));
        }
        let mut steps_n = 0;
        while let Some(step) = self.frames.get(root) {
            let Some(transform) = step.at(self.stamps_ns[image_idx], image_idx) else {
                let problem = format!(
                    "tf does not say where `{root}` was at its time, so that its world is its own"
                );
                return Ok(Place::Unknown(Fault::new(problem, record)));
            };
            let parent_from_root = transform.map_err(|problem| {
                let parent = &step.parent;
                Fault::new(
                    format!("the transform of `{root}` in `{parent}` is none: {problem}"),
                    "correct what publishes it",
                )
            })?;
            root_from_frame = parent_from_root * root_from_frame;
            is_tracked |= step.about[image_idx] != [None; 2];
            root = &step.parent;
            steps_n += 1;
            if steps_n > MAX_FRAMES {
                let problem = format!("the frames of tf are in a circle, at `{root}`");
                return Err(Fault::new(problem, "correct what publishes them"));
            }
        }
        Ok(Place::In {
            root: root.to_owned(),
            root_from_frame,
            is_tracked,
        })
    }
}

impl Frame {
    /// Keeps a transform where it is nearer to an image than the one before.
    fn keep_nearest(&mut self, stamps_ns: &[i64], stamp: Time, transform: Transform) {
        let time_ns = nanoseconds(stamp);
        for (&stamp_ns, [before, after]) in stamps_ns.iter().zip(&mut self.about) {
            if time_ns <= stamp_ns {
                if before.is_none_or(|(kept_ns, _)| kept_ns <= time_ns) {
                    *before = Some((time_ns, transform));
                }
            } else if after.is_none_or(|(kept_ns, _)| time_ns < kept_ns) {
                *after = Some((time_ns, transform));
            }
        }
    }

    /// Returns its pose in its parent at the time of an image; `None` if no transform is near enough.
    fn at(&self, stamp_ns: i64, image_idx: usize) -> Option<Result<Isometry3<f64>, String>> {
        let is_near = |time_ns: i64| time_ns.abs_diff(stamp_ns) <= MAX_OFF_NS;
        let nearest = match self.about[image_idx] {
            [Some((before_ns, before)), Some((after_ns, after))]
                if after_ns.saturating_sub(before_ns) <= MAX_GAP_NS =>
            {
                let share = (stamp_ns - before_ns) as f64 / (after_ns - before_ns) as f64;
                let ends = isometry(&before).and_then(|it| Ok((it, isometry(&after)?)));
                return Some(ends.map(|(before, after)| between(&before, &after, share)));
            }
            [Some((time_ns, transform)), _] if is_near(time_ns) => Some(transform),
            [_, Some((time_ns, transform))] if is_near(time_ns) => Some(transform),
            _ => self.fixed,
        };
        nearest.map(|transform| isometry(&transform))
    }
}

/// Returns the pose at a share of the way from one to another.
fn between(from: &Isometry3<f64>, to: &Isometry3<f64>, share: f64) -> Isometry3<f64> {
    // Of a half turn nothing says which way it goes.
    from.try_lerp_slerp(to, share, 1e-9).unwrap_or(*from)
}

fn isometry(transform: &Transform) -> Result<Isometry3<f64>, String> {
    let (at, turn) = (transform.translation, transform.rotation);
    if ![at.x, at.y, at.z].iter().all(|number| number.is_finite()) {
        let problem = format!("its offset is [{}, {}, {}]", at.x, at.y, at.z);
        return Err(problem);
    }
    let rotation = quaternion_xyzw([turn.x, turn.y, turn.z, turn.w]);
    let rotation = rotation.map_err(|err| err.to_string())?;
    let translation = Translation3::new(at.x, at.y, at.z);
    Ok(Isometry3::from_parts(translation, rotation))
}

/// Returns a frame's name without the slash that older programs begin it with.
pub(crate) fn plain(frame: &str) -> &str {
    frame.strip_prefix('/').unwrap_or(frame)
}

/// Returns a time in nanoseconds.
pub(crate) fn nanoseconds(time: Time) -> i64 {
    1_000_000_000 * i64::from(time.sec) + i64::from(time.nanosec)
}

#[cfg(test)]
mod tests {
    use nalgebra::{UnitQuaternion, Vector3};
    use schemas::ros2::{Header, Quaternion, TransformStamped, Vector3 as Offset};

    use super::*;

    const IMAGE_NS: i64 = 5_000_000_000;

    /// A frame in another, turned about z and shifted along x, at a time after the image.
    fn message(parent: &str, child: &str, off_ms: i64, x: f64, turn_rad: f64) -> TfMessage {
        let time_ns = IMAGE_NS + off_ms * 1_000_000;
        let (sin, cos) = (0.5 * turn_rad).sin_cos();
        let stamp = Time {
            sec: i32::try_from(time_ns / 1_000_000_000).unwrap(),
            nanosec: u32::try_from(time_ns % 1_000_000_000).unwrap(),
        };
        let frame_id = parent.to_owned();
        TfMessage {
            transforms: vec![TransformStamped {
                header: Header { stamp, frame_id },
                child_frame_id: child.to_owned(),
                transform: Transform {
                    translation: Offset { x, y: 0.0, z: 0.0 },
                    rotation: Quaternion {
                        x: 0.0,
                        y: 0.0,
                        z: sin,
                        w: cos,
                    },
                },
            }],
        }
    }

    /// The place of the camera at the image, after these messages, of which the first `static_n` are static.
    fn place(messages: &[TfMessage], static_n: usize) -> Result<Place, Fault> {
        let mut transforms = Transforms::new(vec![0, IMAGE_NS]);
        for (idx, message) in messages.iter().enumerate() {
            transforms.add(message, idx < static_n)?;
        }
        transforms.place("/camera", 1)
    }

    fn known(messages: &[TfMessage], static_n: usize) -> (String, Isometry3<f64>, bool) {
        match place(messages, static_n).unwrap() {
            Place::In {
                root,
                root_from_frame,
                is_tracked,
            } => (root, root_from_frame, is_tracked),
            Place::Unknown(fault) => panic!("{fault}"),
        }
    }

    fn check_place(messages: &[TfMessage], static_n: usize, x: f64, turn_rad: f64) {
        let (root, found, _) = known(messages, static_n);
        assert_eq!(root, "map");
        let off_m = (found.translation.vector - Vector3::new(x, 0.0, 0.0)).norm();
        let turn = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), turn_rad);
        assert!(off_m < 1e-12, "{found}");
        assert!(found.rotation.angle_to(&turn) < 1e-7, "{found}");
    }

    #[test]
    fn transforms_are_chained_to_the_root() {
        let messages = [
            message("link", "/camera", 0, 0.5, 0.0),
            message("/map", "link", 0, 2.0, 1.0),
        ];
        let (root, found, is_tracked) = known(&messages, 2);
        assert_eq!((root.as_str(), is_tracked), ("map", false));
        let expected = Vector3::new(2.0 + 0.5 * 1_f64.cos(), 0.5 * 1_f64.sin(), 0.0);
        assert!((found.translation.vector - expected).norm() < 1e-12);
        assert!(known(&messages, 1).2);
    }

    #[test]
    fn a_moving_frame_is_where_the_transforms_about_the_image_say() {
        let at = |off_ms, x| message("map", "camera", off_ms, x, x);
        check_place(&[at(-100, 1.0), at(100, 2.0)], 0, 1.5, 1.5);
        check_place(&[at(-150, 1.0), at(50, 2.0), at(150, 9.0)], 0, 1.75, 1.75);
        // In any order.
        check_place(&[at(50, 2.0), at(-900, 8.0), at(-150, 1.0)], 0, 1.75, 1.75);
        check_place(&[at(-30, 1.0), at(300, 2.0)], 0, 1.0, 1.0);
        check_place(&[at(-300, 1.0), at(40, 2.0)], 0, 2.0, 2.0);
        check_place(&[at(0, 3.0)], 0, 3.0, 3.0);
        let off = place(&[at(-80, 1.0)], 0).unwrap();
        assert!(matches!(off, Place::Unknown(fault) if fault.to_string().contains("at its time")));
        // A frame that was hung up elsewhere.
        let moved = [message("hand", "camera", -10, 7.0, 0.0), at(-5, 1.0)];
        check_place(&moved, 0, 1.0, 1.0);
    }

    #[test]
    fn says_what_is_wrong_with_transforms() {
        let other = place(&[message("map", "lidar", 0, 1.0, 0.0)], 1).unwrap();
        let Place::Unknown(fault) = other else {
            panic!("is known");
        };
        assert!(
            fault
                .to_string()
                .contains("no parent of the frame `camera`")
        );
        let check = |messages: &[TfMessage], expected: &str| {
            let said = place(messages, 1).err().unwrap().to_string();
            assert!(said.contains(expected), "{said}");
        };
        let mut zero = message("map", "camera", 0, 1.0, 0.0);
        zero.transforms[0].transform.rotation.w = 0.0;
        check(&[zero], "`camera` in `map` is none: quaternion");
        check(
            &[message("map", "camera", 0, f64::NAN, 0.0)],
            "offset is [NaN",
        );
        let circle = [
            message("map", "camera", 0, 1.0, 0.0),
            message("camera", "map", 0, 1.0, 0.0),
        ];
        check(&circle, "in a circle");
        check(&[message("camera", "camera", 0, 1.0, 0.0)], "in a circle");
        let mut transforms = Transforms::new(vec![0]);
        let many = (0..=MAX_FRAMES)
            .map(|n| message("map", &n.to_string(), 0, 0.0, 0.0))
            .try_for_each(|message| transforms.add(&message, true));
        assert!(many.is_err());
    }
}
