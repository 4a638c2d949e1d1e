//! The object as the palm sees it: vectors from fixed points about the palm to the nearest points of the surface
//! (Prokudin et al., *Efficient Learning on Point Clouds with Basis Point Sets*, 2019, section 3), with the direction
//! against gravity, the height above the table and the joint positions.
//!
//! The second decoder starts from it: its motion is relative to the palm of the first one's grasp, so that a surface
//! that is two centimeters before a finger looks the same wherever the object lies and whatever it is.

use motion::HandState;
use nalgebra::{Point3, UnitQuaternion, Vector3};
use rayon::prelude::*;
use robot::RobotModel;
use spatial::{Palm, Pose, Table};

use crate::{
    CgfError,
    data::{NetworkFrame, TrainingMotion},
    hand_numbers::{self, PALM_WIDTH, to_hand},
    precision::narrow,
    weights::Weights,
};

/// The palm of the first decoder's grasp, relative to which the second one moves.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum GraspFrame {}

/// The array of the points in the palm frame, `(points, 3)` in meters.
pub(crate) const NAME: &str = "local.points";
/// Distance that is 1 in the network's units, in meters.
const UNIT_M: f64 = 0.05;
/// Greatest length of a vector in these units: what is farther than 0.2 m is far, however far, so that a palm far off
/// cannot throw the network out of the range of its training.
const MAX_LENGTH: f64 = 4.0;
/// Numbers of the palm: the direction against gravity and its height.
const OF_PALM: usize = 4;
/// Distance from the palm at which a turn moves as much as the noise on the position, in meters.
const REACH_M: f64 = 0.1;
/// Postures of which the fixed points are chosen.
const MAX_POSTURES: usize = 2000;
/// Points of the surface that are searched: some millimeters apart on things that a hand spans.
const MAX_SURFACE: usize = 2048;

/// Numbers of one motion's code.
pub(crate) fn width(points: usize, dof: usize) -> usize {
    3 * points + OF_PALM + dof
}

/// An object's surface above a table, both in the network's frame.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct NearSurface {
    /// Coordinates of the points: all x, all y, all z.
    axes: [Vec<f32>; 3],
    table_from_network: Pose<Table, NetworkFrame>,
}

impl NearSurface {
    pub(crate) fn new(
        surface: &[Point3<f64>],
        table_from_network: Pose<Table, NetworkFrame>,
    ) -> Self {
        let surface = &surface[..surface.len().min(MAX_SURFACE)];
        Self {
            axes: [0, 1, 2].map(|axis| surface.iter().map(|point| narrow(point[axis])).collect()),
            table_from_network,
        }
    }

    /// Returns the vector from a point to the nearest one of the surface, in meters.
    fn to_nearest(&self, from: &Point3<f64>) -> Vector3<f64> {
        const LANES: usize = 16;
        let from = <[f64; 3]>::from(from.coords).map(narrow);
        let square = |x: f32, y: f32, z: f32| {
            let (x, y, z) = (x - from[0], y - from[1], z - from[2]);
            x * x + y * y + z * z
        };
        let [xs, ys, zs] = &self.axes;
        let (mut least, mut block) = (f32::INFINITY, 0);
        let chunks = xs.chunks(LANES).zip(ys.chunks(LANES).zip(zs.chunks(LANES)));
        for (number, (xs, (ys, zs))) in chunks.enumerate() {
            let mut squares = [f32::INFINITY; LANES];
            for (s, (x, (y, z))) in squares.iter_mut().zip(xs.iter().zip(ys.iter().zip(zs))) {
                *s = square(*x, *y, *z);
            }
            let of_block = squares.into_iter().fold(f32::INFINITY, f32::min);
            if of_block < least {
                (least, block) = (of_block, number);
            }
        }
        let of_block = block * LANES..((block + 1) * LANES).min(xs.len());
        let nearest = of_block
            .min_by(|&a, &b| square(xs[a], ys[a], zs[a]).total_cmp(&square(xs[b], ys[b], zs[b])));
        nearest.map_or_else(Vector3::zeros, |at| {
            Vector3::new(xs[at] - from[0], ys[at] - from[1], zs[at] - from[2]).cast()
        })
    }

    /// Returns a hand's code, in the network's units.
    pub(crate) fn code(&self, points: &[f32], hand: &HandState<NetworkFrame>) -> Vec<f32> {
        let palm = &hand.frame_from_palm;
        let back = palm.rotation.inverse();
        let (points, _) = points.as_chunks::<3>();
        let vectors = points.iter().flat_map(|point| {
            let point = Point3::from(point.map(f64::from));
            let vector = back * self.to_nearest(&(*palm * point)) / UNIT_M;
            <[f64; 3]>::from(vector.cap_magnitude(MAX_LENGTH))
        });
        let up = back * (self.table_from_network.rotation.inverse() * Vector3::z());
        let height_m = (self.table_from_network * Point3::from(palm.translation.vector)).z;
        let height = (height_m / UNIT_M).clamp(-MAX_LENGTH, MAX_LENGTH);
        let of_palm = up.iter().copied().chain([height]);
        let code = vectors.chain(of_palm).chain(hand.q_rad.iter().copied());
        code.map(narrow).collect()
    }
}

/// Reads decoded grasps, rows of physical numbers; each moved by its numbers of the standard normal distribution, if
/// there are any, so that in training the second decoder sees misses as large as those of new codes.
///
/// # Errors
///
/// Fails if a row is not a hand.
pub(crate) fn grasps(
    rows: &[f32],
    outputs: usize,
    noise: &[f32],
    noise_m: f64,
) -> Result<Vec<HandState<NetworkFrame>>, CgfError> {
    let width = noise_width(outputs - PALM_WIDTH);
    rows.chunks_exact(outputs)
        .enumerate()
        .map(|(idx, row)| {
            let numbers: Vec<f64> = row.iter().copied().map(f64::from).collect();
            let mut hand = to_hand(&numbers).ok_or_else(|| CgfError::NotFinite {
                name: "decoder".to_owned(),
                what: "a decoded rotation",
            })?;
            if let Some(noise) = noise.get(idx * width..(idx + 1) * width) {
                let noise: Vec<f64> = noise.iter().map(|&x| noise_m * f64::from(x)).collect();
                let turn = Vector3::from_column_slice(&noise[3..6]) / REACH_M;
                let mut pose = *hand.frame_from_palm;
                pose.translation.vector += Vector3::from_column_slice(&noise[..3]);
                pose.rotation *= UnitQuaternion::from_scaled_axis(turn);
                hand.frame_from_palm = Pose::new(pose);
                for (q, x) in hand.q_rad.iter_mut().zip(&noise[6..]) {
                    *q += x / REACH_M;
                }
            }
            Ok(hand)
        })
        .collect()
}

/// Numbers of noise of one motion.
pub(crate) fn noise_width(dof: usize) -> usize {
    6 + dof
}

/// Chooses the fixed points among the links of a hand at the grasps of motions, farthest first (Gonzalez, *Clustering
/// to Minimize the Maximum Intercluster Distance*, 1985), and stores them.
pub(crate) fn choose<'m>(
    weights: &mut Weights,
    n: usize,
    hand: &RobotModel,
    motions: impl ExactSizeIterator<Item = &'m TrainingMotion<NetworkFrame>>,
) {
    let every = motions.len().div_ceil(MAX_POSTURES).max(1);
    let grasps = motions.step_by(every).map(|motion| motion.at(0.0));
    let links = grasps.flat_map(|grasp| {
        hand.link_poses(|joint| grasp.q_rad[joint])
            .into_iter()
            .map(|link: Pose<Palm, _>| Point3::from(link.translation.vector))
            .collect::<Vec<_>>()
    });
    let links: Vec<Point3<f64>> = links.collect();
    let mut chosen = vec![Point3::origin()];
    let mut squares: Vec<f64> = links
        .iter()
        .map(|link| link.coords.norm_squared())
        .collect();
    while chosen.len() < n {
        let far = squares.iter().enumerate().max_by(|a, b| a.1.total_cmp(b.1));
        let far = far.map_or_else(Point3::origin, |(idx, _)| links[idx]);
        squares
            .par_iter_mut()
            .zip(&links)
            .for_each(|(square, link)| *square = square.min((link - far).norm_squared()));
        chosen.push(far);
    }
    let numbers = chosen
        .iter()
        .flat_map(|point| <[f64; 3]>::from(point.coords));
    weights.set(NAME, &[n, 3], numbers.map(narrow).collect());
}

/// Returns hands of motions relative to the palms of their grasps, as the network's numbers in physical units.
pub(crate) fn samples<'m>(
    motions: impl Iterator<Item = &'m TrainingMotion<NetworkFrame>>,
) -> Vec<Vec<f64>> {
    let of_motion = |motion: &'m TrainingMotion<NetworkFrame>| {
        let grasp_from_frame =
            Pose::<GraspFrame, _>::new(*motion.at(0.0).frame_from_palm.inverse());
        let times = (0..=20).map(|k| f64::from(k) / 20.0);
        times.map(move |t| hand_numbers::of(&motion.at(t).expressed_in(&grasp_from_frame)))
    };
    motions.flat_map(of_motion).collect()
}
