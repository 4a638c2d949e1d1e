//! The ROS 2 messages that recordings hold, with their definitions, type hashes and wire format.
//!
//! ```
//! use schemas::ros2::{JointState, Message};
//!
//! let state = JointState { name: vec!["joint_0.0".to_owned()], position: vec![0.1], ..JointState::default() };
//! assert_eq!(JointState::from_cdr(&state.to_cdr())?, state);
//! # Ok::<(), schemas::ros2::CdrError>(())
//! ```
//!
//! Field names, order and types are those of ROS 2 Jazzy, so that a recording made here plays in
//! ROS 2, Foxglove and Rerun; the bytes are golden-tested against an independent implementation.
//! [`motion`] fills the messages from joints, link poses and meshes.

mod cdr;
mod definitions;
mod messages;
pub mod motion;
mod sensors;

pub use cdr::{Cdr, CdrError, CdrReader, CdrWriter};
pub use messages::{
    ColorRgba, CompressedImage, Duration, Header, JointState, JointTrajectory,
    JointTrajectoryPoint, Marker, MarkerArray, MeshFile, Point, Pose, PoseStamped, Quaternion,
    Text, TfMessage, Time, Transform, TransformStamped, UvCoordinate, Vector3, json_of,
};
pub use sensors::{CameraInfo, Image, PointCloud2, PointField, RegionOfInterest};

/// A `.msg` definition: the full name of the type, e.g. `std_msgs/Header`, and its text.
pub type Part = (&'static str, &'static str);

/// A message that can be the root of a topic.
pub trait Message: Cdr {
    /// Full name of the type, e.g. `sensor_msgs/msg/JointState`.
    const TYPE: &'static str;
    /// Type hash of ROS 2 (REP 2011), `RIHS01_` and 64 hexadecimal digits.
    const HASH: &'static str;
    /// The root's definition, then those of the types it is made of.
    const PARTS: &'static [Part];

    /// Returns the definition as a recording's schema stores it: the root's text, then each
    /// dependency's after a line of 80 `=` and its name.
    fn definition() -> String {
        let mut text = String::new();
        for (idx, (name, part)) in Self::PARTS.iter().enumerate() {
            if idx > 0 {
                text.push_str(&"=".repeat(80));
                text.push_str("\nMSG: ");
                text.push_str(name);
                text.push('\n');
            }
            text.push_str(part);
        }
        text
    }

    /// Returns the message's bytes: encapsulation header, then XCDR1 little endian.
    fn to_cdr(&self) -> Vec<u8> {
        let mut writer = CdrWriter::new();
        self.encode(&mut writer);
        writer.into_bytes()
    }

    /// Reads what [`Message::to_cdr`] wrote, or another program in either order of bytes.
    ///
    /// # Errors
    ///
    /// Fails if the bytes end early, are not XCDR1, or hold a string that is not UTF-8.
    fn from_cdr(bytes: &[u8]) -> Result<Self, CdrError> {
        Self::decode(&mut CdrReader::new(bytes)?)
    }
}
