//! Cost terms of a hand's links against each other.

use nalgebra::IsometryMatrix3;
use robot::{SelfCollision, SelfGaps};

use crate::{PairResidual, Posed, Residual, Terms};

/// The residuals of links that are nearer to each other than a margin: finger against finger, and finger against palm.
#[derive(Debug, Clone)]
pub struct SelfGapTerms<'a> {
    collision: &'a SelfCollision,
    margin_m: f64,
    weight: f64,
    gaps: SelfGaps,
}

impl<'a> SelfGapTerms<'a> {
    /// Makes the terms of a hand's collision shapes, with the distance that they keep in meters; the weight multiplies
    /// what is missing to it before it is squared.
    pub fn new(collision: &'a SelfCollision, margin_m: f64, weight: f64) -> Self {
        Self {
            collision,
            margin_m,
            weight,
            gaps: SelfGaps::default(),
        }
    }

    /// Takes over what other terms of the same shapes found last: the next posture near that one takes less time, with
    /// the same residuals.
    pub fn remember(&mut self, other: &SelfGapTerms<'_>) {
        self.gaps.clone_from(&other.gaps);
    }

    /// Returns the greatest depth of a link in another, in meters.
    #[cfg(test)]
    pub(crate) fn depth_m(&mut self, posed: &Posed<'_>) -> f64 {
        self.find(posed, 0.0);
        self.gaps.depth_m()
    }

    fn find(&mut self, posed: &Posed<'_>, margin_m: f64) {
        let pose = |link: usize| posed.link(link).unwrap_or_else(IsometryMatrix3::identity);
        self.collision.gaps_at(pose, margin_m, &mut self.gaps);
    }
}

impl Terms for SelfGapTerms<'_> {
    fn residuals(&mut self, _posed: &Posed<'_>, _residuals: &mut Vec<Residual>) {}

    fn pair_residuals(&mut self, posed: &Posed<'_>, residuals: &mut Vec<PairResidual>) {
        self.find(posed, self.margin_m);
        let gaps = self.gaps.gaps().iter();
        residuals.extend(gaps.map(|gap| PairResidual {
            links: gap.links,
            points_in_object: gap.points,
            gradient_in_object: gap.normal,
            residual: gap.gap_m - self.margin_m,
            weight: self.weight,
        }));
    }
}
