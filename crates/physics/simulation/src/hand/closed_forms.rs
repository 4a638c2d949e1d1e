//! The hand's physics against closed-form theory.

use nalgebra::{DVector, UnitQuaternion, Vector3};
use rapier3d::prelude::{ColliderBuilder, RigidBodyBuilder};
use robot::{DynamicsModel, FreeRootState, JointMotion, RobotModel};
use spatial::{Object, Pose, Table};

use super::{
    HandBodies, PalmJoint, finger_mut,
    tests::{FINGER, finger},
};
use crate::{
    config::SceneConfig,
    desired::DesiredStep,
    fixture,
    units::{LENGTH_UNITS_PER_M, engine_pose, length, mass, meters, real, vector},
    world::{World, groups},
};

const ALLEGRO: &str = include_str!("../../../../../data/robots/allegro_right.urdf");

/// Swings about the middle of a joint's range, each joint in its own time: position, velocity and
/// acceleration.
fn swing(joint: usize, model: &RobotModel, time_s: f64) -> [f64; 3] {
    let limits = &model.joints()[joint];
    let middle = 0.5 * (limits.lower + limits.upper);
    let size = (0.35 * (limits.upper - limits.lower)).min(0.25);
    let frequency = 4.0 + 0.7 * (joint % 5) as f64;
    let (sin, cos) = (frequency * time_s).sin_cos();
    [
        middle + size * sin,
        size * frequency * cos,
        -size * frequency * frequency * sin,
    ]
}

/// Returns the most that a joint lags behind its course over the third second, under each controller.
fn lags(scene: &SceneConfig, world: &World, hand: &HandBodies, model: &RobotModel) -> [f64; 2] {
    let step_s = scene.time_step_s;
    let all = |time_s: f64, order: usize| -> Vec<f64> {
        let joints = 0..model.dof();
        joints
            .map(|joint| swing(joint, model, time_s)[order])
            .collect()
    };
    [false, true].map(|looks_ahead| {
        let mut world = world.fork();
        hand.place(&mut world, &Pose::identity(), &all(0.0, 0));
        let mut most: f64 = 0.0;
        for step in 0..750 {
            let time_s = f64::from(step) * step_s;
            // The palm swings too.
            let ahead_s = time_s + step_s;
            let turn = Vector3::new(0.4 * (2.0 * ahead_s).sin(), 0.0, 0.0);
            let table_from_palm = Pose::from_parts(
                [0.1 * (3.0 * ahead_s).sin(), 0.0, 0.05 * ahead_s],
                UnitQuaternion::from_scaled_axis(turn),
            );
            hand.move_palm(&mut world, &table_from_palm, step_s);
            if looks_ahead {
                let desired = DesiredStep {
                    q: all(ahead_s, 0),
                    velocity: all(time_s + step_s / 2.0, 1),
                    acceleration: Some(all(time_s, 2)),
                };
                hand.follow(&mut world, &desired);
            } else {
                hand.drive(&mut world, &all(ahead_s, 0));
            }
            world.step().unwrap();
            if step >= 500 {
                let found = hand.positions(&world);
                for (found, desired) in found.iter().zip(all(ahead_s, 0)) {
                    most = most.max((found - desired).abs());
                }
            }
        }
        most
    })
}

#[test]
fn feedforward_follows_a_sinusoid_ten_times_closer_than_pd_alone() {
    let scene = fixture::scene();
    let (world, hand) = finger(&scene);
    let model = RobotModel::from_urdf(FINGER).unwrap();
    let [pd, feedforward] = lags(&scene, &world, &hand, &model);
    println!("finger: PD {pd} rad, with feedforward {feedforward} rad");
    assert!(pd > 0.01, "{pd}");
    assert!(10.0 * feedforward < pd, "{feedforward} against {pd}");

    let model = RobotModel::from_urdf(ALLEGRO).unwrap();
    let mut world = World::empty(&scene);
    let hand = HandBodies::insert(&mut world, &scene, &model).unwrap();
    let [pd, feedforward] = lags(&scene, &world, &hand, &model);
    println!("hand: PD {pd} rad, with feedforward {feedforward} rad");
    assert!(pd > 0.01, "{pd}");
    assert!(10.0 * feedforward < pd, "{feedforward} against {pd}");
}

#[test]
fn a_heavy_hand_is_followed_as_well_because_the_controller_knows_its_mass() {
    let mut scene = fixture::scene();
    let model = RobotModel::from_urdf(ALLEGRO).unwrap();
    // Without a stiff spring, nothing but the feedforward keeps up.
    scene.drive.stiffness = 2.0;
    scene.drive.damping = 0.1;
    scene.hand_mass_scale = 3.0;
    let mut world = World::empty(&scene);
    let hand = HandBodies::insert(&mut world, &scene, &model).unwrap();
    let [pd, feedforward] = lags(&scene, &world, &hand, &model);
    println!("heavy hand: PD {pd} rad, with feedforward {feedforward} rad");
    assert!(10.0 * feedforward < pd, "{feedforward} against {pd}");
}

#[test]
fn feedforward_and_springs_together_give_no_more_than_the_torque_limit() {
    let mut scene = fixture::scene();
    scene.drive.torque_limit = 0.05;
    let (mut world, hand) = finger(&scene);
    hand.place(&mut world, &Pose::identity(), &[0.0]);
    let mut most: f64 = 0.0;
    for step in 0..50 {
        let desired = DesiredStep {
            q: vec![if step < 25 { 0.5 } else { -0.5 }],
            velocity: vec![1.0],
            acceleration: Some(vec![300.0]),
        };
        hand.follow(&mut world, &desired);
        world.step().unwrap();
        most = most.max(hand.torques(&world)[0].abs());
    }
    assert!(most > 0.04 && most < 0.051, "{most} Nm");
}

#[test]
fn the_engine_accelerates_joints_as_inverse_dynamics_says() {
    let mut scene = fixture::scene();
    scene.time_step_s = 1e-4;
    // Torques alone: springs and brakes of nothing.
    scene.drive.stiffness = 1e-3;
    scene.drive.damping = 0.0;
    scene.drive.torque_limit = 1e3;
    let model = RobotModel::from_urdf(ALLEGRO).unwrap();
    let mut world = World::empty(&scene);
    let hand = HandBodies::insert(&mut world, &scene, &model).unwrap();
    let dof = model.dof();
    let number = |joint: usize, factor: f64| (factor * (1.0 + joint as f64)).sin();
    let q: Vec<f64> = (0..dof).map(|joint| swing(joint, &model, 0.3)[0]).collect();
    let velocity: Vec<f64> = (0..dof).map(|joint| 3.0 * number(joint, 2.3)).collect();
    let wanted: Vec<f64> = (0..dof).map(|joint| 60.0 * number(joint, 3.1)).collect();
    hand.place(&mut world, &Pose::identity(), &q);
    let set = |world: &mut World| {
        for drive in &hand.drives {
            let (multibody, address) = finger_mut(&mut world.multibodies, drive.body).unwrap();
            multibody.generalized_velocity_mut()[address.coordinate] = real(velocity[drive.joint]);
        }
    };
    set(&mut world);
    let desired = DesiredStep {
        q: q.clone(),
        velocity: velocity.clone(),
        acceleration: Some(wanted.clone()),
    };
    hand.follow(&mut world, &desired);
    world.step().unwrap();
    let mut worst: f64 = 0.0;
    for drive in &hand.drives {
        let (multibody, address) = super::finger(&world.multibodies, drive.body).unwrap();
        let after = f64::from(multibody.generalized_velocity()[address.coordinate]);
        let found = (after - velocity[drive.joint]) / scene.time_step_s;
        worst = worst.max((found - wanted[drive.joint]).abs());
    }
    println!("accelerations up to 60 rad/s²: {worst} apart");
    assert!(worst < 0.6, "{worst} rad/s²");
}

/// Returns linear and angular momentum about the origin, and the energy, of freely moving bodies.
fn carried(
    hand: &HandBodies,
    world: &World,
    bodies: &DynamicsModel,
) -> (Vector3<f64>, Vector3<f64>, f64) {
    let (multibody, _) = super::finger(&world.multibodies, hand.roots[0].body).unwrap();
    let q = hand.positions(world);
    let palm = hand.table_from_palm(world);
    let speed = |idx: usize| f64::from(multibody.generalized_velocity()[idx]);
    let into_palm = palm.rotation.inverse();
    let linear = into_palm * Vector3::new(speed(0), speed(1), speed(2)) / LENGTH_UNITS_PER_M;
    let angular = into_palm * Vector3::new(speed(3), speed(4), speed(5));
    let joints = hand.joints.iter().map(|&idx| {
        let body = hand.drives[idx].body;
        speed(
            super::finger(&world.multibodies, body)
                .unwrap()
                .1
                .coordinate,
        )
    });
    let all: Vec<f64> = linear
        .iter()
        .chain(&angular)
        .copied()
        .chain(joints)
        .collect();
    let all = DVector::from_vec(all);
    let momentum = bodies.free_mass_matrix(&q).unwrap() * &all;
    let linear = palm.rotation * momentum.fixed_rows::<3>(0);
    let angular = palm.rotation * momentum.fixed_rows::<3>(3);
    let about_origin = angular + palm.translation.vector.cross(&linear);
    (linear, about_origin, 0.5 * all.dot(&momentum))
}

#[test]
fn a_free_hand_keeps_its_momentum_and_its_energy() {
    let mut scene = fixture::scene();
    scene.time_step_s = 1e-3;
    // A rotor's inertia is not a body's, and would carry momentum of its own.
    scene.drive.armature = 0.0;
    scene.drive.damping = 0.0;
    let model = RobotModel::from_urdf(FINGER).unwrap();
    let bodies = DynamicsModel::new(&model);
    let mut world = World::empty(&scene);
    let hand = HandBodies::insert_on(&mut world, &scene, &model, PalmJoint::Free).unwrap();
    let start = Pose::from_parts([0.1, -0.2, 0.3], UnitQuaternion::identity());
    hand.place(&mut world, &start, &[0.2]);
    {
        let root = hand.roots[0].body;
        let (multibody, _) = finger_mut(&mut world.multibodies, root).unwrap();
        let [x, y, z] = [0.3, -0.2, 0.1].map(length);
        let velocities = [x, y, z, 0.5, 1.0, -0.8, 3.0];
        for (target, speed) in multibody
            .generalized_velocity_mut()
            .iter_mut()
            .zip(velocities)
        {
            *target = speed;
        }
    }
    let (linear, angular, energy) = carried(&hand, &world, &bodies);
    assert!(linear.norm() > 0.1 && angular.norm() > 0.01 && energy > 0.01);
    let turned = hand.positions(&world)[0];
    let mut farthest: f64 = 0.0;
    let mut drift = [0.0_f64; 3];
    for _ in 0..400 {
        world.step().unwrap();
        farthest = farthest.max((hand.positions(&world)[0] - turned).abs());
        let now = carried(&hand, &world, &bodies);
        drift[0] = drift[0].max((now.0 - linear).norm() / linear.norm());
        drift[1] = drift[1].max((now.1 - angular).norm() / angular.norm());
        drift[2] = drift[2].max((now.2 - energy).abs() / energy);
    }
    println!("relative drift of momentum, spin and energy in 0.4 s: {drift:?}, turned {farthest}");
    assert!(farthest > 0.3, "{farthest} rad");
    assert!(drift.iter().all(|drift| *drift < 0.01), "{drift:?}");
}

/// Physics steps in which a pressed block is watched.
const SINKING_STEPS: u32 = 35;

/// Returns the distance in meters by which a block sinks that a finger presses against a wall with a torque limit.
fn sunk_m(friction: f64, force_n: f64, mass_kg: f64) -> f64 {
    const ARM_M: f64 = 0.1;
    const HALF_M: f64 = 0.025;
    let at = |place: [f64; 3]| -> Pose<Table, Object> {
        Pose::from_parts(place, UnitQuaternion::identity())
    };
    let mut scene = fixture::scene();
    scene.friction = friction;
    scene.drive.torque_limit = force_n * ARM_M;
    let (mut world, hand) = finger(&scene);
    // Down for the finger is along y for the world.
    let turn = UnitQuaternion::from_axis_angle(&Vector3::x_axis(), std::f64::consts::FRAC_PI_2);
    let lying = Pose::from_parts([0.0; 3], turn);
    hand.place(&mut world, &lying, &[0.0]);
    let table_from_block = at([ARM_M, 0.01 + HALF_M, 0.0]);
    let block = world.bodies.insert(
        RigidBodyBuilder::dynamic()
            .pose(engine_pose(&table_from_block))
            .additional_mass_properties(rapier3d::prelude::MassProperties::new(
                vector(&Vector3::zeros()),
                mass(mass_kg),
                vector(&(Vector3::repeat(mass_kg * (2.0 * HALF_M).powi(2) / 6.0))),
            ))
            .gravity_scale(0.0)
            .can_sleep(false),
    );
    let half = length(HALF_M);
    world.colliders.insert_with_parent(
        ColliderBuilder::cuboid(half, half, half)
            .density(0.0)
            .friction(real(friction))
            .collision_groups(groups::object()),
        block,
        &mut world.bodies,
    );
    let table_from_wall = at([ARM_M, 0.01 + 2.0 * HALF_M + 0.05, 0.0]);
    let wall = world
        .bodies
        .insert(RigidBodyBuilder::fixed().pose(engine_pose(&table_from_wall)));
    world.colliders.insert_with_parent(
        ColliderBuilder::cuboid(length(0.2), length(0.05), length(0.2))
            .friction(real(friction))
            .collision_groups(groups::table()),
        wall,
        &mut world.bodies,
    );
    let press = |world: &mut World, steps: u32| {
        for _ in 0..steps {
            hand.drive(world, &[1.5]);
            world.step().unwrap();
        }
        meters(world.bodies[block].translation().z)
    };
    let before = press(&mut world, 50);
    world.bodies[block].set_gravity_scale(1.0, true);
    // Later the block has sunk by half its height, and the finger slides off it.
    before - press(&mut world, SINKING_STEPS)
}

#[test]
fn a_squeezed_block_slips_where_friction_on_both_sides_no_longer_carries_it() {
    let mass_kg = 0.2;
    for friction in [0.4, 0.8] {
        let at_slip_n = mass_kg * 9.81 / (2.0 * friction);
        let held = sunk_m(friction, 1.1 * at_slip_n, mass_kg);
        let sunk = sunk_m(friction, 0.8 * at_slip_n, mass_kg);
        println!("friction {friction}: {held} m and {sunk} m");
        assert!(held < 1e-3, "{held} m");
        // A fifth of the weight is not carried.
        let sinking_s = f64::from(SINKING_STEPS) * fixture::scene().time_step_s;
        let expected = 0.5 * 0.2 * 9.81 * sinking_s.powi(2);
        assert!(
            (sunk / expected - 1.0).abs() < 0.1,
            "{sunk} m, {expected} m"
        );
    }
}

/// A robot that stands still has nothing to do.
#[test]
fn pose_at_rest_needs_no_torque() {
    let scene = fixture::scene();
    let (mut world, hand) = finger(&scene);
    hand.place(&mut world, &Pose::identity(), &[0.3]);
    let desired = DesiredStep {
        q: vec![0.3],
        velocity: vec![0.0],
        acceleration: Some(vec![0.0]),
    };
    hand.follow(&mut world, &desired);
    assert!(hand.torques(&world)[0].abs() < 1e-6);
    let efforts = hand.dynamics.inverse_dynamics(
        &FreeRootState::still(spatial::Pose::identity()),
        &JointMotion {
            q: &[0.3],
            velocity: &[0.0],
            acceleration: &[2.0],
        },
        &Vector3::zeros(),
    );
    // Steiner: 4e-5 + 0.05 · 0.05², and the rotor's 1e-3, times 2 rad/s².
    assert!((efforts.unwrap().joints[0] - 2.0 * (4e-5 + 1.25e-4 + 1e-3)).abs() < 1e-12);
}
