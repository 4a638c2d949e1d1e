//! Rows of `candidates` and `draws` of the motions that were sampled, and the object of which they were.

use robot::Depth;
use sampling::{CodeOrigin, Orientation, SampledMotions, SampledObject};
use schemas::{
    candidates::{Candidate, DrawSource, ObjectSplit, Origin},
    draws::{Draw, Draws, Refusal},
    objects::Object,
};

/// Generator name of the candidates.
const GENERATOR: &str = "cgf";

/// Returns an object as it is sampled for.
pub fn sampled_object(object: &Object) -> SampledObject<'_> {
    let orientations = object.rests.iter().map(|orientation| Orientation {
        rest: orientation.rest,
        seen_n: orientation.seen_n,
        probability: orientation.probability,
    });
    SampledObject {
        name: &object.name,
        points_m: &object.points_m,
        vertices_m: &object.vertices_m,
        orientations: orientations.collect(),
    }
}

/// Returns the candidates of an object by their numbers, and all draws, by candidate and then by draw.
pub(crate) fn draws_of(object: &str, sampled: SampledMotions) -> (Vec<Candidate>, Draws) {
    let object_split = Some(if sampled.is_learned {
        ObjectSplit::Seen
    } else {
        ObjectSplit::Unseen
    });
    let mut candidates = Vec::with_capacity(sampled.motions.len());
    let mut draws = Draws::new();
    for (number, sampled) in sampled.motions.into_iter().enumerate() {
        let candidate = Candidate {
            candidate_id: format!("{object}-{number:05}"),
            generator: GENERATOR.to_owned(),
            source: source(&sampled.draw, object_split),
            latent: sampled.latent,
            table_from_object: sampled.draw.table_from_object,
            limit_excess_rad: sampled.draw.limit_excess_rad,
            depth_m: sampled.draw.depth.map(Depth::deepest_m),
            residual_m2: None,
            motion: sampled.motion,
        };
        let refused = sampled.refused.iter().map(|draw| Draw {
            source: source(draw, object_split),
            refused: Some(deeper_in(draw.depth.unwrap_or_default())),
            depth_m: draw.depth.map(Depth::deepest_m),
            table_from_object: draw.table_from_object,
            limit_excess_rad: draw.limit_excess_rad,
            ..Draw::kept(&candidate)
        });
        let first = draws.len();
        draws.extend(refused.chain([Draw::kept(&candidate)]));
        draws[first..].sort_by_key(|draw| draw.source.draw_n);
        candidates.push(candidate);
    }
    (candidates, draws)
}

fn source(draw: &sampling::Draw, object_split: Option<ObjectSplit>) -> DrawSource {
    let (origin, demonstration) = match &draw.origin {
        CodeOrigin::Prior => (Origin::Prior, ""),
        CodeOrigin::Posterior { demonstration } => (Origin::Posterior, demonstration.as_str()),
        CodeOrigin::Path { from } => (Origin::Path, from.as_str()),
    };
    DrawSource {
        draw_n: draw.draw_n,
        origin,
        demonstration: demonstration.to_owned(),
        object_split,
    }
}

/// Returns in what a hand is deeper.
fn deeper_in(depth: Depth) -> Refusal {
    if depth.object_m >= depth.table_m {
        Refusal::Object
    } else {
        Refusal::Table
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_hand_is_deepest_in_the_object_or_in_the_table() {
        let check = |object_m: f64, table_m: f64, refusal: Refusal| {
            assert_eq!(deeper_in(Depth { object_m, table_m }), refusal);
        };
        check(0.02, 0.01, Refusal::Object);
        check(0.01, 0.02, Refusal::Table);
        check(0.01, 0.01, Refusal::Object);
    }
}
