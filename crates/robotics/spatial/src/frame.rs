//! The coordinate frames of the project, as types without values.

/// A frame that rests. A recording's is that of its master camera: x right, y down, z forward.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum World {}
/// A camera: x right, y down, z forward.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Camera {}
/// The table on which an object lies: z up against gravity, z = 0 the table's surface, the origin
/// below the object's origin, yaw fixed by [`crate::RestingPose::table_from_object`].
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Table {}
/// The object's mesh frame, as published with its model.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Object {}
/// The robot hand's palm frame: the root link of its URDF.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Palm {}
/// The frame of a robot's base: the root link of its URDF.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Base {}
