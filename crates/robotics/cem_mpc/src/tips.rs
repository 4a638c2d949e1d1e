//! Positions of the fingertips.

use nalgebra::Point3;
use posture::HandTable;
use robot::{RobotError, RobotModel};
use spatial::{Palm, Pose, Table};

/// The fingertips of a hand.
#[derive(Debug, Clone)]
pub struct Fingertips {
    /// Each with its link and its place in the link's frame, in meters.
    tips: Vec<(usize, Point3<f64>)>,
}

impl Fingertips {
    /// Takes the points that a hand's table marks as fingertips.
    ///
    /// # Errors
    ///
    /// Fails if the hand lacks a link that the table names.
    pub fn new(hand: &RobotModel, table: &HandTable) -> Result<Self, RobotError> {
        let marked = table.points.iter();
        let marked = marked.filter(|point| point.tip_radius_m.is_some());
        let tips = marked.map(|point| {
            let link = hand.require_link(&point.link)?;
            Ok((link, Point3::from(point.offset_m)))
        });
        Ok(Self {
            tips: tips.collect::<Result<_, RobotError>>()?,
        })
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.tips.is_empty()
    }

    /// Returns the positions of a hand's tips, in the frame of the table, in meters; `q` has one position per joint.
    pub(crate) fn places(
        &self,
        hand: &RobotModel,
        table_from_palm: &Pose<Table, Palm>,
        q: &[f64],
    ) -> Vec<Point3<f64>> {
        let palm_from_links = hand.link_poses::<Palm>(|joint| q[joint]);
        let tips = self.tips.iter();
        tips.map(|(link, place)| *table_from_palm * (palm_from_links[*link] * *place))
            .collect()
    }
}

/// Returns the root of the sum of the squared distances of tips, in meters.
pub(crate) fn distance_m(from: &[Point3<f64>], to: &[Point3<f64>]) -> f64 {
    let squares = from.iter().zip(to).map(|(a, b)| (b - a).norm_squared());
    squares.sum::<f64>().sqrt()
}

/// Returns the mean distance of tips, in meters.
pub(crate) fn mean_distance_m(from: &[Point3<f64>], to: &[Point3<f64>]) -> f64 {
    let distances = from.iter().zip(to).map(|(a, b)| (b - a).norm());
    distances.sum::<f64>() / from.len().max(1) as f64
}
