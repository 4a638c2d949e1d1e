//! Motions in the formats of other labs: LeRobot datasets, DexGraspBench grasps, CSV.
//!
//! ```
//! use formats::{Episode, Joint, EpisodeStep, Unit};
//! use nalgebra::UnitQuaternion;
//! use spatial::Pose;
//!
//! let step = |time_s: f64| EpisodeStep {
//!     time_s,
//!     table_from_palm: Pose::from_parts([0.0, 0.0, 0.3 - 0.1 * time_s], UnitQuaternion::identity()),
//!     table_from_object: Pose::identity(),
//!     q: vec![0.4 * time_s],
//!     q_command: None,
//! };
//! let joints = [Joint { name: "knuckle".to_owned(), unit: Unit::Radian }];
//! let episode = Episode::new("025_mug-00000", "025_mug", &joints, &[step(0.0), step(1.0)])?;
//! let export = formats::to_lerobot(&[episode], 30, "a_hand")?;
//! assert!(export.files.contains_key("meta/info.json"));
//! assert!(!export.lost.is_empty());
//! # Ok::<(), formats::FormatError>(())
//! ```
//!
//! An [`Episode`] is a motion of a hand and an object in the table's frame; its joints have names and
//! units. An [`Export`] is the files of a format by their paths, and what the format could not hold.
//! Equal episodes give equal bytes. Lengths are in meters, angles in radians, times in seconds;
//! quaternions are `x y z w` except where a format wants `w` first.
//!
//! This crate writes no file, and knows no lake: the command line reads motions and writes folders.

mod csv;
mod dexgraspbench;
mod episode;
mod error;
mod export;
mod lerobot;

pub use csv::to_csv;
pub use dexgraspbench::{BenchObject, GraspTimes, to_dexgraspbench};
pub use episode::{Episode, EpisodeStep, Joint, Unit};
pub use error::FormatError;
pub use export::Export;
pub use lerobot::to_lerobot;
