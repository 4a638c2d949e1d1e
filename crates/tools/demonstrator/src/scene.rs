//! One recording: an object, a hand that takes it, and others that stand around.

use std::f64::consts::TAU;

use nalgebra::{UnitQuaternion, Vector3};
use rand::Rng;
use rand_chacha::ChaCha8Rng;
use spatial::{Object, Pose, RestingPose, Table};

use crate::{
    DemonstratorError, Recipe,
    body::Body,
    grasp::grasps,
    hand::{Hand, Side, Size, point},
    noise::{between, stream},
    reach::{RecordedFrame, record},
};

/// A recording before it is written.
pub(crate) struct Scene {
    /// Index of the person.
    pub(crate) subject: usize,
    pub(crate) hand: Hand,
    /// Indices into the bodies, in the order of `ycb_ids`.
    pub(crate) objects: Vec<usize>,
    /// Index of the grasped one in `objects`.
    pub(crate) grasped: usize,
    /// Poses of all objects in the first frame; the grasped one's is also in the frames.
    pub(crate) table_from_objects: Vec<Pose<Table, Object>>,
    pub(crate) frames: Vec<RecordedFrame>,
}

/// Ranges of the positions of grasped objects on the table, in meters.
const GRASPED_X_M: [f64; 2] = [0.45, 0.75];
const GRASPED_Y_M: [f64; 2] = [0.20, 0.42];
/// Ranges of the positions of other objects, in meters.
const OTHERS_X_M: [f64; 2] = [0.08, 1.12];
const OTHERS_Y_M: [f64; 2] = [-0.04, 0.64];
/// Room between objects, and between the hand and other objects, in meters.
const ROOM_M: f64 = 0.04;
/// Maximum number of rounds of drawing grasps.
const ROUNDS: usize = 12;

/// Makes one recording.
pub(crate) fn make(
    recipe: &Recipe,
    bodies: &[Body],
    recording: usize,
) -> Result<Scene, DemonstratorError> {
    let mut rng = stream(recipe.seed, "recording", recording);
    let target = (recording / recipe.sequences_per_object) % bodies.len();
    let subject = recording % recipe.subjects;
    let left =
        recipe.left_every > 0 && recording % recipe.left_every == recipe.left_every.min(4) - 1;
    let side = if left { Side::Left } else { Side::Right };
    let person = Size::draw(
        &mut stream(recipe.seed, "subject", subject),
        recipe.hand_size_sd,
        recipe.bone_length_sd,
    );
    let hand = Hand::new(side, &person);
    let body = &bodies[target];
    for _ in 0..ROUNDS {
        let rest = body.draw_rest(&mut rng, recipe.lying_share);
        let place = Vector3::new(
            between(&mut rng, GRASPED_X_M),
            between(&mut rng, GRASPED_Y_M),
            0.0,
        );
        let table_from_object = placed(&rest, place, &mut rng);
        for grasp in grasps(
            body,
            &rest,
            &hand,
            recipe.grasp_draws,
            recipe.grasp_tries,
            &mut rng,
        ) {
            let Some(frames) = record(recipe, body, &hand, &grasp, &table_from_object, &mut rng)
            else {
                continue;
            };
            let others = place_others(recipe, bodies, target, &hand, &frames, &mut rng);
            if others.len() < recipe.distractors[0] {
                continue;
            }
            let grasped = rng.random_range(0..=others.len());
            let mut all = others;
            all.insert(grasped, (target, table_from_object));
            let (objects, table_from_objects) = all.into_iter().unzip();
            return Ok(Scene {
                subject,
                hand,
                objects,
                grasped,
                table_from_objects,
                frames,
            });
        }
    }
    Err(DemonstratorError::NoGrasp {
        object: body.kind.name,
        recording,
    })
}

/// Puts an object down at a place with a random yaw.
fn placed(rest: &RestingPose, place: Vector3<f64>, rng: &mut ChaCha8Rng) -> Pose<Table, Object> {
    let yaw = UnitQuaternion::from_axis_angle(&Vector3::z_axis(), between(rng, [0.0, TAU]));
    Pose::<Table, Table>::from_parts(place, yaw) * rest.table_from_object()
}

/// Places other objects clear of the paths of hand and objects.
fn place_others(
    recipe: &Recipe,
    bodies: &[Body],
    target: usize,
    hand: &Hand,
    frames: &[RecordedFrame],
    rng: &mut ChaCha8Rng,
) -> Vec<(usize, Pose<Table, Object>)> {
    let [fewest, most] = recipe.distractors;
    let wanted = rng.random_range(fewest..=most);
    // Moving bodies, as points with a radius.
    let mut taken: Vec<(Vector3<f64>, f64)> = Vec::new();
    for frame in frames {
        taken.push((
            frame.table_from_object.translation.vector,
            bodies[target].radius_m,
        ));
        if let Some((pose, q)) = &frame.hand {
            let points = hand.points_in(pose, q);
            taken.extend(
                points
                    .iter()
                    .take(point::LANDMARKS)
                    .map(|p| (p.coords, 0.02)),
            );
        }
    }
    let mut others: Vec<(usize, Pose<Table, Object>)> = Vec::new();
    for _ in 0..400 {
        if others.len() == wanted {
            break;
        }
        let idx = rng.random_range(0..bodies.len());
        let place = Vector3::new(between(rng, OTHERS_X_M), between(rng, OTHERS_Y_M), 0.0);
        let body = &bodies[idx];
        let pose = placed(&body.upright(), place, rng);
        let is_new = idx != target && others.iter().all(|(other, _)| *other != idx);
        let (low, high) = body.mesh.bounds();
        let wide = low.coords.xy().norm().max(high.coords.xy().norm());
        let tall = high.z - low.z;
        let is_free = taken.iter().all(|(at, radius)| {
            (at - place).xy().norm() > wide + radius + ROOM_M || at.z > tall + radius + ROOM_M
        });
        if is_new && is_free {
            taken.push((place, wide));
            others.push((idx, pose));
        }
    }
    others
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{
        grasp::TOUCHING_M,
        hand::{FINGERS, ranges},
        objects::OBJECT_KINDS,
    };

    /// The committed recipe without noise, with few recordings.
    fn recipe() -> Recipe {
        let text = include_str!("../../../../data/sample/recipe.toml");
        let mut recipe = Recipe::from_toml(text).unwrap();
        recipe.sequences_per_object = 2;
        (recipe.grasp_draws, recipe.grasp_tries) = (300, 10);
        (
            recipe.wrist_noise_m,
            recipe.wrist_noise_rad,
            recipe.joint_noise_rad,
        ) = (0.0, 0.0, 0.0);
        recipe
    }

    /// The hand while it reaches: until two frames are alike.
    fn reach(scene: &Scene) -> Vec<(Pose<Table, Hand>, crate::hand::Joints)> {
        let seen: Vec<_> = scene.frames.iter().filter_map(|frame| frame.hand).collect();
        let end = seen.windows(2).position(|pair| pair[0] == pair[1]).unwrap();
        seen[..=end].to_vec()
    }

    /// Position of the largest value, as a share of the length.
    fn peak(values: &[f64]) -> f64 {
        let largest = values.iter().copied().fold(f64::MIN, f64::max);
        values.iter().position(|&value| value == largest).unwrap() as f64
            / (values.len() - 1) as f64
    }

    #[test]
    fn recordings_look_like_people_reaching_and_grasping() {
        let recipe = recipe();
        let bodies: Vec<Body> = OBJECT_KINDS.iter().map(Body::new).collect();
        for recording in 0..bodies.len() * recipe.sequences_per_object {
            let scene = make(&recipe, &bodies, recording).unwrap();
            let name = format!(
                "{recording} {}",
                bodies[scene.objects[scene.grasped]].kind.name
            );
            assert!((40..=110).contains(&scene.frames.len()), "{name}");
            holds_well(&scene, &bodies, &name);
            moves_well(&scene, &recipe, &name);
        }
    }

    fn holds_well(scene: &Scene, bodies: &[Body], name: &str) {
        let body = &bodies[scene.objects[scene.grasped]];
        let (pose, q) = *reach(scene).last().unwrap();
        let table_from_object = scene.table_from_objects[scene.grasped];
        let object_from_table = table_from_object.inverse();
        let points = scene.hand.points_in(&(object_from_table * pose), &q);
        let touching = (0..FINGERS)
            .filter(|finger| {
                let near = body.surface.signed_distance(&points[point::PADS + finger]);
                (near.distance_m - scene.hand.pad_radius_m(*finger)).abs() < TOUCHING_M
            })
            .count();
        assert!(touching >= 3, "{name}: {touching} fingers touch");
        for (radius, flesh) in scene
            .hand
            .radii_m()
            .iter()
            .zip(points.iter().skip(point::FLESH))
        {
            assert!(
                body.surface.signed_distance(flesh).distance_m > radius - 0.003,
                "{name}: flesh in the object"
            );
            assert!(
                (table_from_object * *flesh).z > *radius,
                "{name}: flesh in the table"
            );
        }
    }

    fn moves_well(scene: &Scene, recipe: &Recipe, name: &str) {
        for (pose, q) in scene.frames.iter().filter_map(|frame| frame.hand) {
            let inside = q
                .iter()
                .zip(ranges())
                .all(|(angle, [low, high])| (low..=high).contains(angle));
            assert!(inside, "{name}: a joint is out of range");
            let points = scene.hand.points_in(&pose, &q);
            assert!(
                points.iter().take(point::LANDMARKS).all(|p| p.z > 0.0),
                "{name}: the hand crosses the table"
            );
        }
        let reach = reach(scene);
        let apertures: Vec<f64> = reach
            .iter()
            .map(|(_, q)| scene.hand.aperture_m(q))
            .collect();
        assert!(
            (0.58..=0.82).contains(&peak(&apertures)),
            "{name}: open widest at {}",
            peak(&apertures)
        );
        let speeds: Vec<f64> = reach
            .windows(2)
            .map(|pair| {
                (pair[1].0.translation.vector - pair[0].0.translation.vector).norm()
                    * recipe.rate_hz
            })
            .collect();
        assert!(
            (0.35..=0.55).contains(&peak(&speeds)),
            "{name}: fastest at {}",
            peak(&speeds)
        );
        let rises = speeds
            .windows(2)
            .take_while(|pair| pair[1] > pair[0] - 1e-3)
            .count();
        let falls = speeds
            .windows(2)
            .skip(rises)
            .all(|pair| pair[1] < pair[0] + 1e-3);
        assert!(falls, "{name}: more than one peak in {speeds:.2?}");
    }
}
