//! The sections of the page, one file each.

pub(crate) mod compare;
pub(crate) mod cost;
pub(crate) mod failures;
pub(crate) mod objects;
pub(crate) mod pose_errors;
pub(crate) mod provenance;
pub(crate) mod result;
pub(crate) mod training;
pub(crate) mod views;
