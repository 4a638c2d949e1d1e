//! The cost to minimize: a sum of terms over points and joints.

use nalgebra::{Point3, Vector3};

use crate::{evaluate::Posed, posture::Posture};

/// The function to minimize at one step of a motion:
///
/// `Σ wᵢ ρ(pᵢ − tᵢ) + Σ uᵢ h(‖vᵢ − xᵢ‖) + s Σ ‖pᵢ − p′ᵢ‖² + c ‖q − q′‖² + a ‖q − r‖² + Σ (v r)²`
///
/// over targeted points `p` with targets `t` and vectors `v` between points with targets `x`, where dashes mark the
/// step solved before. The last sum is over the residuals that a [`Terms`] hands in, of single points and of pairs of
/// links.
#[derive(Debug, Clone, Copy)]
pub struct Task<'a> {
    /// Target positions of the points.
    pub targets: &'a [Target],
    /// Loss of a point's distance to its target.
    pub loss: Loss,
    /// Target vectors between points, if there are any.
    pub vectors: Option<VectorTargets<'a>>,
    /// Smoothness terms, relative to the step solved before; `None` for the first.
    pub smoothness: Option<Smoothness<'a>>,
    /// Regularization of otherwise unconstrained joints.
    pub prior: Option<PosturePrior<'a>>,
}

/// Target position of a point.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Target {
    /// The point, as numbered when the hand was compiled.
    pub point: usize,
    /// Its target position in the object frame, in meters.
    pub point_in_object: Point3<f64>,
    /// The factor `w` of its loss.
    pub weight: f64,
}

/// Target vectors between points.
#[derive(Debug, Clone, Copy)]
pub struct VectorTargets<'a> {
    /// The targets.
    pub vectors: &'a [VectorTarget],
    /// Distance from the target up to which the loss `h` is the parabola `d²/2β`, in meters; beyond, it is `d − β/2`
    /// (Huber, "Robust estimation of a location parameter", 1964, divided by β).
    pub beta_m: f64,
}

/// Target of a vector from one point to another.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct VectorTarget {
    /// The vector, as numbered when the hand was compiled.
    pub vector: usize,
    /// Its target along the object's axes, in meters.
    pub vector_in_object: Vector3<f64>,
    /// The factor `u` of its loss.
    pub weight: f64,
}

/// Loss of a point's distance to its target.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Loss {
    /// The squared distance (Ye et al., 2023, §III-A), in m².
    Squared,
    /// Per axis, `d²/2β` up to `β` and `|d| − β/2` beyond (Girshick, "Fast R-CNN", 2015, §2.3;
    /// dex-retargeting takes it with 0.02 m), in m.
    SmoothL1 {
        /// Distance at which the parabola ends, in meters.
        beta_m: f64,
    },
}

/// Smoothness terms of a step, relative to the one solved before.
#[derive(Debug, Clone, Copy)]
pub struct Smoothness<'a> {
    /// Positions of the targeted points at that step, in the order of the targets.
    pub points: &'a [Point3<f64>],
    /// The factor `s` of their squared motion: the paper's λ.
    pub point_weight: f64,
    /// The posture.
    pub posture: &'a Posture,
    /// The factor `c` of the joints' squared motion.
    pub joint_weight: f64,
    /// The factor of the root's squared motion: of its translation and of its angles, or of the one
    /// angle between where it has none.
    pub root_weight: f64,
}

/// Regularization of otherwise unconstrained joints.
#[derive(Debug, Clone, Copy)]
pub struct PosturePrior<'a> {
    /// Joint positions, in the model's order.
    pub q: &'a [f64],
    /// The factor `a` of the squared distance to them.
    pub weight: f64,
}

/// A number that should be 0, at a point of the hand: `(weight * residual)²` is added to the cost.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Residual {
    /// The point, as numbered when the hand was compiled.
    pub point: usize,
    /// Gradient of the residual by the point's position, in the object frame.
    pub gradient_in_object: Vector3<f64>,
    /// The number.
    pub residual: f64,
    /// Its weight.
    pub weight: f64,
}

/// A number that should be 0, between two links of the hand: `(weight * residual)²` is added to the cost.
///
/// It depends on the links' relative pose alone: the line through both points is along the gradient, so that no motion
/// that the links share changes the residual.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PairResidual {
    /// The links, by their numbers among the model's.
    pub links: [usize; 2],
    /// A point fixed to each, in the object frame.
    pub points_in_object: [Point3<f64>; 2],
    /// Gradient of the residual by the second point's position, and minus that by the first's, in the object frame.
    pub gradient_in_object: Vector3<f64>,
    /// The number.
    pub residual: f64,
    /// Its weight.
    pub weight: f64,
}

/// Terms that depend on the hand's environment, or on how its links lie to each other.
pub trait Terms {
    /// Adds the residuals at a posture to `residuals`, which comes empty.
    ///
    /// It is called once for each posture that is tried. The residuals must depend on the posture
    /// alone and be continuous; a residual that would be 0 may be left out.
    fn residuals(&mut self, hand: &Posed<'_>, residuals: &mut Vec<Residual>);

    /// Adds the residuals between links at a posture to `residuals`, which comes empty; none unless implemented.
    ///
    /// It is called as [`Terms::residuals`] is, and the same holds for them. A few at a time are meant: each costs the
    /// solver another solution of its equations.
    fn pair_residuals(&mut self, _hand: &Posed<'_>, _residuals: &mut Vec<PairResidual>) {}
}

/// No terms: an empty environment.
#[derive(Debug, Clone, Copy, Default)]
pub struct NoTerms;

impl Terms for NoTerms {
    fn residuals(&mut self, _hand: &Posed<'_>, _residuals: &mut Vec<Residual>) {}
}

impl<F: FnMut(&Posed<'_>, &mut Vec<Residual>)> Terms for F {
    fn residuals(&mut self, hand: &Posed<'_>, residuals: &mut Vec<Residual>) {
        self(hand, residuals);
    }
}

impl Loss {
    /// Returns the loss of a difference along one axis, its derivative, its second derivative, and
    /// a curvature at which a parabola with this value and derivative lies above it everywhere.
    #[inline]
    pub(crate) fn at(self, difference: f64) -> [f64; 4] {
        match self {
            Self::Squared => [difference * difference, 2.0 * difference, 2.0, 2.0],
            Self::SmoothL1 { beta_m } => {
                let size = difference.abs();
                if size < beta_m {
                    let curvature = 1.0 / beta_m;
                    let slope = difference * curvature;
                    [0.5 * difference * slope, slope, curvature, curvature]
                } else {
                    let slope = 1.0_f64.copysign(difference);
                    [size - 0.5 * beta_m, slope, 0.0, 1.0 / size]
                }
            }
        }
    }
}
