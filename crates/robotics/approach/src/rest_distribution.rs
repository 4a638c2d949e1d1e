//! Resting poses of an object, with their frequencies.

use nalgebra::Vector3;
use schemas::objects::Object;
use spatial::RestingPose;

use crate::RestChoice;

/// The resting poses of an object, each with its weight.
#[derive(Debug, Clone, PartialEq)]
pub struct RestDistribution {
    weighted: Vec<(RestingPose, f64)>,
}

impl RestDistribution {
    /// Returns the resting poses of an object, weighted by how often each was recorded, or else by its probability;
    /// upright on its lowest point if no resting pose is known. Unlike `sample`, which weights those of objects not in
    /// training by probability.
    pub fn of(object: &Object, choice: RestChoice) -> Self {
        let seen = || {
            let rests = object.rests.iter();
            rests
                .map(|rest| (rest.rest, f64::from(rest.seen_n)))
                .collect()
        };
        let stable = || {
            let rests = object.rests.iter();
            rests.map(|rest| (rest.rest, rest.probability)).collect()
        };
        let some =
            |weighted: &Vec<(RestingPose, f64)>| weighted.iter().any(|(_, weight)| *weight > 0.0);
        let weighted = match choice {
            RestChoice::Seen => Some(seen()).filter(some),
            RestChoice::Stable => None,
        };
        let weighted = weighted.or_else(|| Some(stable()).filter(some));
        let first = || object.rests.first().map(|rest| vec![(rest.rest, 1.0)]);
        let weighted = weighted.or_else(first);
        Self {
            weighted: weighted.unwrap_or_else(|| vec![(upright(object), 1.0)]),
        }
    }

    /// Returns the pose at a share, in `[0, 1)`, of the weights.
    pub fn at(&self, share: f64) -> RestingPose {
        let total: f64 = self.weighted.iter().map(|(_, weight)| weight).sum();
        let mut left = share * total;
        let mut chosen = self.weighted[0].0;
        for (rest, weight) in &self.weighted {
            if *weight > 0.0 {
                chosen = *rest;
                if left < *weight {
                    break;
                }
                left -= weight;
            }
        }
        chosen
    }
}

/// Puts the mesh's lowest point on the table.
fn upright(object: &Object) -> RestingPose {
    let heights = object.vertices_m.iter().map(|[_, _, z]| *z);
    RestingPose {
        up_in_object: Vector3::z_axis(),
        height_m: -heights.min_by(f64::total_cmp).unwrap_or(0.0),
    }
}

#[cfg(test)]
mod tests {
    use schemas::objects::RestingOrientation;

    use super::*;
    use crate::fixture;

    fn lying(rests: &[(f64, u32, f64)]) -> Object {
        let rests = rests
            .iter()
            .map(|&(height_m, seen_n, probability)| RestingOrientation {
                rest: RestingPose {
                    up_in_object: Vector3::z_axis(),
                    height_m,
                },
                seen_n,
                probability,
            });
        Object {
            rests: rests.collect(),
            ..fixture::object()
        }
    }

    #[test]
    fn an_object_lies_as_often_as_it_was_seen_or_is_probable() {
        let check = |rests: &[(f64, u32, f64)], choice, share, height_m: f64| {
            let found = RestDistribution::of(&lying(rests), choice).at(share);
            assert!((found.height_m - height_m).abs() < 1e-12, "{found:?}");
        };
        let both = [(0.1, 3, 0.2), (0.2, 1, 0.8)];
        check(&both, RestChoice::Seen, 0.74, 0.1);
        check(&both, RestChoice::Seen, 0.76, 0.2);
        check(&both, RestChoice::Stable, 0.19, 0.1);
        check(&both, RestChoice::Stable, 0.21, 0.2);
        check(&[(0.1, 0, 0.0), (0.2, 0, 1.0)], RestChoice::Seen, 0.0, 0.2);
        check(
            &[(0.1, 0, 0.0), (0.2, 2, 0.0)],
            RestChoice::Stable,
            0.999,
            0.1,
        );
        check(&[(0.1, 0, 0.0)], RestChoice::Seen, 0.5, 0.1);
        check(&[], RestChoice::Seen, 0.5, fixture::BOX_HALF_M[2]);
    }
}
