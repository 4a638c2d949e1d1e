//! A checked hand model: what of the licensed file decides the 21 landmarks.
//!
//! Of the 778 vertices only the five fingertips are kept; everything else acts through the
//! joints.

use nalgebra::Vector3;
use schemas::demonstrations::Side;

use super::{ManoError, arrays::Arrays, pickle::Pickle, skin::ShapedHand};

/// Vertices of the surface.
const VERTICES: usize = 778;
/// Joints: the wrist, then three each of index, middle, little, ring finger and thumb.
pub(super) const JOINTS: usize = 16;
/// Angles of the joints but the wrist, and principal components of them.
pub(super) const ANGLES: usize = 45;
/// Numbers that shape a hand.
pub(super) const BETAS: usize = 10;
/// Entries of the rotation matrices of the joints but the wrist.
pub(super) const POSE_FEATURES: usize = 135;
/// The joint before each.
pub(super) const PARENTS: [usize; JOINTS] = [0, 0, 1, 2, 0, 4, 5, 0, 7, 8, 0, 10, 11, 0, 13, 14];

/// Largest accepted difference of a sum of skinning weights from one; files of `f4` have 1e-6.
const WEIGHT_SUM_TOLERANCE: f64 = 1e-4;
/// The same for what a joint takes from the vertices, which was fitted and not normalized.
const REGRESSOR_SUM_TOLERANCE: f64 = 1e-2;
/// Largest accepted distance of the joints that a file states from those of its vertices, in
/// meters.
const JOINT_TOLERANCE_M: f64 = 1e-4;
/// No vertex of a hand is farther from the origin, in meters.
const MAX_VERTEX_DISTANCE_M: f64 = 1.0;
/// Least cosine, without its sign, between the palm's normal and where the mean pose bends the
/// fingers; it is 0.99 for the index finger of the right hand, by what is published of its joints.
const MIN_BEND: f64 = 0.5;

/// Returns the vertices at the tips of thumb, index, middle, ring and little finger.
///
/// These are the ones that `DexYCB`'s labels were made with: `manopth` (Hasson et al.,
/// *Learning Joint Reconstruction of Hands and Manipulated Objects*, 2019).
fn tip_vertices(side: Side) -> [usize; 5] {
    match side {
        Side::Left => [745, 317, 445, 556, 673],
        Side::Right => [745, 317, 444, 556, 673],
    }
}

/// A hand model of MANO's kind (Romero, Tzionas and Black, *Embodied Hands*, 2017), as much of it
/// as the 21 landmarks need.
///
/// Lengths are in meters, in the model's own frame.
#[derive(Debug, Clone)]
pub struct ManoModel {
    side: Side,
    /// Joints of the mean shape.
    pub(super) joints: [Shaped; JOINTS],
    /// Thumb, index, middle, ring, little finger.
    pub(super) tips: [Tip; 5],
    /// Mean angles about x, y, z of joints 1 to 15, in radians.
    pub(super) mean: [f64; ANGLES],
    /// Angles of each principal component, in radians: (component, angle).
    pub(super) components: Vec<[f64; ANGLES]>,
}

/// A point that moves with the shape.
#[derive(Debug, Clone, Copy)]
pub(super) struct Shaped {
    mean: Vector3<f64>,
    directions: [Vector3<f64>; BETAS],
}

impl Shaped {
    /// Returns the point of a hand of this shape.
    pub(super) fn at(&self, betas: &[f64; BETAS]) -> Vector3<f64> {
        let moved = self.directions.iter().zip(betas);
        moved.fold(self.mean, |point, (direction, beta)| {
            point + direction * *beta
        })
    }
}

/// A vertex at a finger's tip.
#[derive(Debug, Clone)]
pub(super) struct Tip {
    pub(super) rest: Shaped,
    /// Derivative of its position by each entry of the rotation matrices less the identity.
    pub(super) pose_directions: Vec<Vector3<f64>>,
    /// Skinning weight of each joint; they sum to one.
    pub(super) weights: [f64; JOINTS],
}

impl ManoModel {
    /// Reads a hand model from the bytes of the licensed `MANO_RIGHT.pkl` or `MANO_LEFT.pkl`, or
    /// of the same dictionary saved again by Python 3, with or without `chumpy`, as `f8` or `f4`.
    ///
    /// Needs memory of a small multiple of the file's size, whatever the bytes are; nothing in the
    /// file is ever executed.
    ///
    /// # Errors
    ///
    /// Fails if the bytes are no such pickle or end early, if an array is missing or has another
    /// shape or type, if a number is not finite, or if the numbers are not those of a hand: the
    /// tree of joints is another, weights do not sum to one, or the side cannot be told.
    pub fn from_pickle(bytes: &[u8]) -> Result<Self, ManoError> {
        let pickle = Pickle::read(bytes)?;
        let arrays = Arrays { pickle: &pickle };
        check_tree(&arrays.integers("kintree_table", &[2, JOINTS])?)?;

        let template = vectors(&arrays.numbers("v_template", &[VERTICES, 3])?);
        if template.iter().any(|at| at.norm() > MAX_VERTEX_DISTANCE_M) {
            return Err(ManoError::NotMano("a vertex is not within a meter"));
        }
        let directions = arrays.directions("shapedirs", [VERTICES, 3, BETAS])?;
        let shaped: Vec<Shaped> = template
            .iter()
            .zip(directions.chunks_exact(3 * BETAS))
            .map(|(&mean, directions)| Shaped {
                mean,
                directions: by_last_axis(directions),
            })
            .collect();

        let regressor = arrays.matrix("J_regressor", [JOINTS, VERTICES])?;
        let rows = regressor.chunks_exact(VERTICES);
        if !rows.clone().all(|row| is_one(row, REGRESSOR_SUM_TOLERANCE)) {
            return Err(ManoError::NotMano(
                "what a joint takes from the vertices does not sum to one",
            ));
        }
        let mut joints = [Shaped::default(); JOINTS];
        for (joint, row) in joints.iter_mut().zip(rows) {
            *joint = weighted(&shaped, row);
        }
        check_joints(&arrays, &joints)?;

        let weights = arrays.numbers("weights", &[VERTICES, JOINTS])?;
        let mut rows = weights.chunks_exact(JOINTS);
        if !rows.all(|row| is_one(row, WEIGHT_SUM_TOLERANCE)) {
            return Err(ManoError::NotMano("skinning weights do not sum to one"));
        }
        let mut mean = [0.0; ANGLES];
        mean.copy_from_slice(&arrays.numbers("hands_mean", &[ANGLES])?);
        let components = arrays.numbers("hands_components", &[ANGLES, ANGLES])?;
        let (components, _) = components.as_chunks::<ANGLES>();

        let side = side(&joints, &mean)?;
        let pose_directions = arrays.numbers("posedirs", &[VERTICES, 3, POSE_FEATURES])?;
        let tips = tip_vertices(side).map(|vertex| {
            let mut own_weights = [0.0; JOINTS];
            own_weights.copy_from_slice(&weights[vertex * JOINTS..][..JOINTS]);
            let own = &pose_directions[vertex * 3 * POSE_FEATURES..][..3 * POSE_FEATURES];
            Tip {
                rest: shaped[vertex],
                pose_directions: by_last_axis::<POSE_FEATURES>(own).to_vec(),
                weights: own_weights,
            }
        });
        Ok(Self {
            side,
            joints,
            tips,
            mean,
            components: components.to_vec(),
        })
    }

    /// Returns the side of the hand, as the model's own numbers tell: the mean pose bends the
    /// fingers toward the palm, which for a right hand is where index finger, wrist and little
    /// finger are counterclockwise.
    ///
    /// Compare it with the file's name before use: a right hand posed by the model of a left one
    /// is a hand too, but another.
    pub fn side(&self) -> Side {
        self.side
    }

    /// Returns the hand of a person: `betas` are the ten numbers of `mano.yml`.
    pub fn shaped(&self, betas: &[f64; BETAS]) -> ShapedHand<'_> {
        ShapedHand::new(self, betas)
    }
}

impl Default for Shaped {
    fn default() -> Self {
        Self {
            mean: Vector3::zeros(),
            directions: [Vector3::zeros(); BETAS],
        }
    }
}

/// Checks that every joint but the wrist has MANO's parent.
fn check_tree(tree: &[u64]) -> Result<(), ManoError> {
    let (parents, joints) = tree.split_at(JOINTS);
    let in_order = joints.iter().zip(0_u64..).all(|(&joint, idx)| joint == idx);
    let mut fingers = parents.iter().zip(PARENTS).skip(1);
    // The wrist's parent is not a joint, and different files write that differently.
    if in_order && fingers.all(|(&found, expected)| found == expected as u64) {
        Ok(())
    } else {
        Err(ManoError::NotMano("the tree of joints is another"))
    }
}

/// Checks the joints that the file states, if it does, against those of its vertices.
fn check_joints(arrays: &Arrays<'_, '_>, joints: &[Shaped]) -> Result<(), ManoError> {
    let stated = match arrays.numbers("J", &[JOINTS, 3]) {
        Ok(stated) => vectors(&stated),
        Err(ManoError::Missing(_)) => return Ok(()),
        Err(other) => return Err(other),
    };
    let mut pairs = stated.iter().zip(joints);
    if pairs.all(|(stated, joint)| (stated - joint.mean).norm() <= JOINT_TOLERANCE_M) {
        Ok(())
    } else {
        Err(ManoError::NotMano(
            "`J` is not where `J_regressor` puts the joints",
        ))
    }
}

/// Tells the side by the palm: `n` is the palm's normal if the hand is a right one, and the mean
/// pose bends the four fingers toward the palm.
fn side(joints: &[Shaped; JOINTS], mean: &[f64; ANGLES]) -> Result<Side, ManoError> {
    let [wrist, index, little] = [0, 1, 7].map(|joint| joints[joint].mean);
    let n = (index - wrist).cross(&(little - wrist));
    let mut bend = Vector3::zeros();
    // Joints 1, 4, 7, 10 begin index, middle, little and ring finger.
    for first in [1, 4, 7, 10] {
        let along = joints[first + 2].mean - joints[first].mean;
        for joint in first..first + 3 {
            let angles = &mean[3 * (joint - 1)..][..3];
            bend += Vector3::from_column_slice(angles).cross(&along);
        }
    }
    let cosine = n.dot(&bend) / (n.norm() * bend.norm());
    if cosine > MIN_BEND {
        Ok(Side::Right)
    } else if cosine < -MIN_BEND {
        Ok(Side::Left)
    } else {
        Err(ManoError::NotMano(
            "its mean pose does not bend the fingers toward a palm",
        ))
    }
}

fn is_one(row: &[f64], tolerance: f64) -> bool {
    (row.iter().sum::<f64>() - 1.0).abs() <= tolerance
}

/// Returns the sum of points by their weights.
fn weighted(points: &[Shaped], weights: &[f64]) -> Shaped {
    let mut sum = Shaped::default();
    for (point, &weight) in points.iter().zip(weights) {
        if weight != 0.0 {
            sum.mean += point.mean * weight;
            for (total, direction) in sum.directions.iter_mut().zip(&point.directions) {
                *total += direction * weight;
            }
        }
    }
    sum
}

fn vectors(numbers: &[f64]) -> Vec<Vector3<f64>> {
    let (rows, _) = numbers.as_chunks::<3>();
    rows.iter().map(|&row| row.into()).collect()
}

/// Returns the vectors of an array (3, N), one per entry of its last axis.
fn by_last_axis<const N: usize>(numbers: &[f64]) -> [Vector3<f64>; N] {
    std::array::from_fn(|k| Vector3::new(numbers[k], numbers[N + k], numbers[2 * N + k]))
}
