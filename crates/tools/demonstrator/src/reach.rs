//! From a grasp to a recording: reach, hold, lift, hand-over, frame by frame.

use nalgebra::{Isometry3, Point3, Translation3, UnitQuaternion, Vector3};
use rand_chacha::ChaCha8Rng;
use spatial::{Object, Pose, Table};

use crate::{
    Recipe,
    body::Body,
    grasp::Grasp,
    hand::{Hand, Joints, blend, clamped, point, posture_deg},
    noise::{LowPass, between, direction, normal3},
};

/// Poses of hand and object in one frame of a recording; the table's frame has z up and z = 0 at
/// its surface.
#[derive(Debug, Clone)]
pub(crate) struct RecordedFrame {
    /// The wrist's pose and the joints; `None` while the hand is out of sight.
    pub(crate) hand: Option<(Pose<Table, Hand>, Joints)>,
    /// The grasped object's pose.
    pub(crate) table_from_object: Pose<Table, Object>,
}

/// Largest depth of flesh below the surface, or below the table, during the reach, in meters.
const MAX_REACH_DEPTH_M: f64 = 0.003;
/// Ways tried before a grasp is given up.
const TRIES: usize = 12;
/// Exponent of time that moves the peak of speed from a half to 44 % of the reach: people take
/// longer to slow down (Jeannerod, "The timing of natural prehension movements", 1984).
const SKEW: f64 = 0.85;
/// The wrist has turned by this part of the reach.
const TURNED_BY: f64 = 0.8;

/// Returns the share of a path covered after a share of its time, with minimum jerk (Flash and Hogan,
/// "The coordination of arm movements", 1985).
pub(crate) fn minimum_jerk(time: f64) -> f64 {
    let t = time.clamp(0.0, 1.0);
    t * t * t * (10.0 + t * (6.0 * t - 15.0))
}

/// The path to a grasp: the wrist's and the fingers' postures.
struct ReachPath {
    start: Pose<Table, Hand>,
    end: Pose<Table, Hand>,
    bow: Vector3<f64>,
    postures: [Joints; 3],
    /// When the hand is open widest, as a share of the reach.
    open_at: f64,
}

impl ReachPath {
    /// Returns the hand after a share of the reach's time.
    fn at(&self, time: f64) -> (Pose<Table, Hand>, Joints) {
        let share = minimum_jerk(time.powf(SKEW));
        let (from, to) = (self.start.translation.vector, self.end.translation.vector);
        let position = from + (to - from) * share + self.bow * (4.0 * share * (1.0 - share));
        let turned = minimum_jerk(time / TURNED_BY);
        let rotation = self.start.rotation.slerp(&self.end.rotation, turned);
        let [start, open, closed] = &self.postures;
        let q = if time < self.open_at {
            blend(start, open, minimum_jerk(time / self.open_at))
        } else {
            blend(
                open,
                closed,
                minimum_jerk((time - self.open_at) / (1.0 - self.open_at)),
            )
        };
        (Pose::from_parts(position, rotation), q)
    }
}

/// Shows a grasp; `None` if no collision-free path to it was found.
pub(crate) fn record(
    recipe: &Recipe,
    body: &Body,
    hand: &Hand,
    grasp: &Grasp,
    table_from_object: &Pose<Table, Object>,
    rng: &mut ChaCha8Rng,
) -> Option<Vec<RecordedFrame>> {
    let frames_in = |time_s: f64| {
        (1..10_000)
            .take_while(|&n| f64::from(n) / recipe.rate_hz < time_s)
            .count()
            .max(1)
    };
    let n_reach = frames_in(between(rng, recipe.reach_time_s));
    let path = (0..TRIES)
        .map(|_| draw_path(recipe, hand, grasp, table_from_object, rng))
        .find(|path| is_free(path, n_reach, body, hand, table_from_object))?;
    let n_empty = frames_up_to(recipe.empty_frames_max, rng);
    let n_hold = frames_in(between(rng, recipe.hold_time_s));
    let n_lift = frames_in(between(rng, recipe.lift_time_s));
    let n_over = frames_in(recipe.handover_time_s);
    let lift = Vector3::z() * between(rng, recipe.lift_height_m);
    let heading = direction(rng).into_inner();
    let aside = Vector3::new(heading.x, heading.y, 0.0)
        .try_normalize(1e-6)
        .unwrap_or_else(Vector3::x);
    let over = aside * between(rng, recipe.handover_distance_m);
    let turn = normal3(rng) * 0.08;

    let mut frames = Vec::new();
    let at_rest = |hand| RecordedFrame {
        hand,
        table_from_object: *table_from_object,
    };
    frames.extend((0..n_empty).map(|_| at_rest(None)));
    frames.extend((0..=n_reach).map(|k| at_rest(Some(path.at(k as f64 / n_reach as f64)))));
    let (end, q) = path.at(1.0);
    frames.extend((0..n_hold).map(|_| at_rest(Some((end, q)))));
    // Hand and object move as one, about the object's middle.
    let pivot = Point3::from(table_from_object.translation.vector);
    let carried = |shift: Vector3<f64>, turn: Vector3<f64>| {
        let rotation = UnitQuaternion::from_scaled_axis(turn);
        let about = Isometry3::rotation_wrt_point(rotation, pivot);
        let after = Translation3::from(shift) * about;
        RecordedFrame {
            hand: Some((Pose::new(after * *end), q)),
            table_from_object: Pose::new(after * **table_from_object),
        }
    };
    frames.extend((1..=n_lift).map(|k| {
        let share = minimum_jerk(k as f64 / n_lift as f64);
        carried(lift * share, turn * share)
    }));
    frames.extend((1..=n_over).map(|k| {
        let share = minimum_jerk(k as f64 / n_over as f64);
        carried(lift + over * share, turn)
    }));
    add_noise(recipe, &mut frames, rng);
    Some(frames)
}

fn frames_up_to(most: usize, rng: &mut ChaCha8Rng) -> usize {
    let share = between(rng, [0.0, (most + 1) as f64]);
    (1..=most).take_while(|&n| n as f64 <= share).count()
}

/// Draws a start behind the hand and the postures of the reach.
fn draw_path(
    recipe: &Recipe,
    hand: &Hand,
    grasp: &Grasp,
    table_from_object: &Pose<Table, Object>,
    rng: &mut ChaCha8Rng,
) -> ReachPath {
    let end = *table_from_object * grasp.placed.object_from_hand;
    let back = -(*table_from_object * grasp.toward);
    let aim = (back + Vector3::z() * 0.25 + normal3(rng) * 0.18).normalize();
    let distance = between(rng, recipe.reach_distance_m);
    let mut start_position = end.translation.vector + aim * distance;
    start_position.z = start_position.z.max(0.10);
    let chord = start_position - end.translation.vector;
    let swing = normal3(rng) + Vector3::z();
    let sideways = swing - chord * (chord.dot(&swing) / chord.norm_squared());
    let bow = sideways.normalize() * chord.norm() * between(rng, [0.02, 0.05]);
    let turn =
        UnitQuaternion::from_scaled_axis(direction(rng).into_inner() * between(rng, [0.1, 0.45]));

    let closed = grasp.placed.q;
    let mut flat = posture_deg([-20.0, 0.0, 0.0, 5.0], [0.0, 0.0, 8.0]);
    let mut curled = posture_deg([15.0, 0.0, 30.0, 35.0], [0.0, 50.0, 65.0]);
    for abduction in [1, 4, 7, 10, 13] {
        flat[abduction] = closed[abduction];
        curled[abduction] = closed[abduction] * 0.5;
    }
    // The hand opens to the width and a third of a hand more (Smeets and Brenner, "A new view on
    // grasping", 1999).
    let widest = hand.aperture_m(&closed) + between(rng, [0.028, 0.042]);
    let open = opened(hand, &closed, &flat, widest);
    let relaxed = posture_deg([0.0, 0.0, 10.0, 15.0], [0.0, 20.0, 30.0]);
    let at_start = hand.aperture_m(&open) * between(rng, [0.5, 0.75]);
    let first = opened(hand, &curled, &relaxed, at_start);
    ReachPath {
        start: Pose::from_parts(start_position, turn * end.rotation),
        end,
        bow,
        postures: [clamped(&first), open, closed],
        open_at: between(rng, [0.66, 0.76]),
    }
}

/// Returns the posture between two, nearest to the first, at which the hand is open so far.
fn opened(hand: &Hand, narrow: &Joints, wide: &Joints, aperture_m: f64) -> Joints {
    let steps = 50;
    (0..=steps)
        .map(|k| blend(narrow, wide, f64::from(k) / f64::from(steps)))
        .find(|q| hand.aperture_m(q) >= aperture_m)
        .unwrap_or(*wide)
}

/// Says whether the hand stays out of object and table, opens widest when it should, and does not
/// close before.
fn is_free(
    path: &ReachPath,
    n: usize,
    body: &Body,
    hand: &Hand,
    table_from_object: &Pose<Table, Object>,
) -> bool {
    let object_from_table = table_from_object.inverse();
    let mut widest = (0.0, 0.0);
    for k in 0..=n {
        let time = k as f64 / n as f64;
        let (table_from_hand, q) = path.at(time);
        let aperture = hand.aperture_m(&q);
        if aperture > widest.0 {
            widest = (aperture, time);
        }
        let points = hand.points_in(&table_from_hand, &q);
        for (radius, flesh) in hand.radii_m().iter().zip(points.iter().skip(point::FLESH)) {
            if radius - flesh.z > MAX_REACH_DEPTH_M {
                return false;
            }
            let near = body.surface.signed_distance(&(object_from_table * *flesh));
            if radius - near.distance_m > MAX_REACH_DEPTH_M {
                return false;
            }
        }
    }
    (0.6..=0.8).contains(&widest.1)
}

/// Adds the tracker's noise to wrist and joints: bones keep their lengths.
fn add_noise(recipe: &Recipe, frames: &mut [RecordedFrame], rng: &mut ChaCha8Rng) {
    let mut wrist = LowPass::<6>::new(recipe.noise_cutoff_hz, recipe.rate_hz, rng);
    let mut joints =
        LowPass::<{ crate::hand::DOF }>::new(recipe.noise_cutoff_hz, recipe.rate_hz, rng);
    for (pose, q) in frames.iter_mut().filter_map(|frame| frame.hand.as_mut()) {
        let [x, y, z, a, b, c] = wrist.next(rng);
        let shift = Vector3::new(x, y, z) * recipe.wrist_noise_m;
        let turn = Vector3::new(a, b, c) * recipe.wrist_noise_rad;
        *pose = Pose::from_parts(
            pose.translation.vector + shift,
            UnitQuaternion::from_scaled_axis(turn) * pose.rotation,
        );
        for (angle, noise) in q.iter_mut().zip(joints.next(rng)) {
            *angle += noise * recipe.joint_noise_rad;
        }
        *q = clamped(q);
    }
}
