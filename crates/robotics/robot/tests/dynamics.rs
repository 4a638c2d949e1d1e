//! Properties of kinematics and dynamics that hold for every robot: derivatives, energy, symmetry.

use nalgebra::{DMatrix, DVector, Point3, UnitQuaternion, Vector3, Vector6};
use proptest::prelude::*;
use robot::{DynamicsModel, FreeRootState, JointMotion, RobotModel, pose_from_twist};
use spatial::{Palm, Pose, Twist, World};

/// Joints that turn, slide and follow others; axes askew; masses on fixed links.
const ROBOTS: [&str; 3] = [
    include_str!("golden/odd_arm.urdf"),
    include_str!("golden/mimic_hand.urdf"),
    include_str!("../../../../data/robots/xarm6_allegro.urdf"),
];

const GRAVITY: Vector3<f64> = Vector3::new(0.0, 0.0, -9.81);

/// The most degrees of freedom of those, and a root's.
const MAX_DOF: usize = 28;

fn robots() -> impl Iterator<Item = RobotModel> {
    ROBOTS.iter().map(|xml| RobotModel::from_urdf(xml).unwrap())
}

fn six() -> impl Strategy<Value = Vector6<f64>> {
    prop::array::uniform6(-2.0..2.0).prop_map(Vector6::from)
}

fn twist(numbers: &[f64]) -> Twist<Palm> {
    Twist::from_array(numbers.try_into().unwrap())
}

fn numbers() -> impl Strategy<Value = Vec<f64>> {
    prop::collection::vec(-1.5..1.5, MAX_DOF)
}

fn pose() -> impl Strategy<Value = Pose<World, Palm>> {
    six().prop_map(|twist| Pose::new(*pose_from_twist(&Twist::from_array(twist.into()))))
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]

    /// Central differences of positions of points and of turns.
    #[test]
    fn jacobian_is_the_derivative_of_the_pose(
        q in numbers(),
        point in prop::array::uniform3(-0.1..0.1),
        which in 0_usize..1000,
    ) {
        const STEP: f64 = 1e-6;
        for model in robots() {
            let q = &q[..model.dof()];
            let link = which % model.links().len();
            let at = |joint: usize, step: f64| {
                let mut moved = q.to_vec();
                moved[joint] += step;
                model.forward_kinematics::<Palm>(&moved).unwrap()[link]
            };
            let palm_from_links = model.forward_kinematics::<Palm>(q).unwrap();
            let point_in_palm = palm_from_links[link] * Point3::from(point);
            let jacobian = model.geometric_jacobian(&palm_from_links, link, &point_in_palm);
            for joint in 0..model.dof() {
                let (more, less) = (at(joint, STEP), at(joint, -STEP));
                let moved = (more * Point3::from(point) - less * Point3::from(point)) / (2.0 * STEP);
                let turned = (more.rotation * less.rotation.inverse()).scaled_axis() / (2.0 * STEP);
                let analytic = jacobian.column(joint);
                prop_assert!((analytic.fixed_rows::<3>(0) - moved).norm() < 1e-7);
                prop_assert!((analytic.fixed_rows::<3>(3) - turned).norm() < 1e-7);
            }
        }
    }

    /// One algorithm gives forces for accelerations, the other the matrix between them.
    #[test]
    fn inverse_dynamics_is_mass_times_acceleration_and_bias(
        world_from_palm in pose(),
        q in numbers(),
        velocity in numbers(),
        acceleration in numbers(),
    ) {
        for model in robots() {
            let n = model.dof();
            let bodies = DynamicsModel::new(&model).with_armature(0.02).with_mass_scale(1.5);
            let efforts = |acceleration: &[f64]| {
                let root = FreeRootState {
                    world_from_palm,
                    velocity: twist(&velocity[..6]),
                    acceleration: twist(&acceleration[..6]),
                };
                let motion = JointMotion {
                    q: &q[..n],
                    velocity: &velocity[6..6 + n],
                    acceleration: &acceleration[6..6 + n],
                };
                let efforts = bodies.inverse_dynamics(&root, &motion, &GRAVITY).unwrap();
                let all = efforts.root.iter().chain(&efforts.joints).copied();
                DVector::from_iterator(6 + n, all)
            };
            let mass = bodies.free_mass_matrix(&q[..n]).unwrap();
            let bias = efforts(&[0.0; MAX_DOF]);
            let product = &mass * DVector::from_column_slice(&acceleration[..6 + n]);
            let difference = efforts(&acceleration) - bias - &product;
            prop_assert!(difference.amax() < 1e-12 * (1.0 + product.amax()), "{difference}");
        }
    }

    /// Positive definite where every joint moves some mass.
    #[test]
    fn mass_matrix_is_symmetric_and_positive_definite(q in numbers()) {
        for model in robots() {
            let bodies = DynamicsModel::new(&model);
            let mass = bodies.free_mass_matrix(&q[..model.dof()]).unwrap();
            prop_assert_eq!(&mass, &mass.transpose());
            // The last link of the odd arm has none.
            let massless: Vec<usize> = (0..mass.nrows()).filter(|&idx| mass[(idx, idx)] == 0.0).collect();
            prop_assert_eq!(massless.len(), usize::from(model.name() == "odd_arm"));
            let mass: DMatrix<f64> = mass.remove_rows_at(&massless).remove_columns_at(&massless);
            prop_assert!(mass.cholesky().is_some());
        }
    }

    /// A twist kept for two times is the same as kept for their sum.
    #[test]
    fn exponentials_of_one_twist_compose(twist in six(), a in -1.0..1.0, b in -1.0..1.0) {
        let twist = Twist::<Palm>::from_array(twist.into());
        let composed = pose_from_twist(&(twist * a)) * pose_from_twist(&(twist * b));
        let at_once = pose_from_twist(&(twist * (a + b)));
        prop_assert!((composed.inverse() * at_once).translation.vector.norm() < 1e-12);
        prop_assert!(composed.rotation.angle_to(&at_once.rotation) < 1e-7);
    }
}

/// Returns the accelerations of a robot on which nothing but gravity acts, with a held root.
fn falling(bodies: &DynamicsModel, q: &[f64], velocity: &[f64]) -> DVector<f64> {
    let still = vec![0.0; q.len()];
    let motion = JointMotion {
        q,
        velocity,
        acceleration: &still,
    };
    let root = FreeRootState::still(Pose::identity());
    let bias = bodies.inverse_dynamics(&root, &motion, &GRAVITY).unwrap();
    let mass = bodies.mass_matrix(q).unwrap();
    mass.cholesky().unwrap().solve(&-bias.joints)
}

/// Returns kinetic and potential energy in joules.
fn energy(bodies: &DynamicsModel, q: &[f64], velocity: &[f64]) -> f64 {
    let velocity = DVector::from_column_slice(velocity);
    let kinetic = 0.5 * velocity.dot(&(bodies.mass_matrix(q).unwrap() * &velocity));
    let center = bodies.center_of_mass(q).unwrap();
    kinetic - bodies.mass_kg() * GRAVITY.dot(&center.coords)
}

/// Moves a falling robot on by the method of Runge and Kutta of fourth order.
fn swing(bodies: &DynamicsModel, q: &mut DVector<f64>, velocity: &mut DVector<f64>, step_s: f64) {
    let rate = |q: &DVector<f64>, v: &DVector<f64>| falling(bodies, q.as_slice(), v.as_slice());
    let half = step_s / 2.0;
    let (v1, a1) = (velocity.clone(), rate(q, velocity));
    let v2 = &*velocity + &a1 * half;
    let a2 = rate(&(&*q + &v1 * half), &v2);
    let v3 = &*velocity + &a2 * half;
    let a3 = rate(&(&*q + &v2 * half), &v3);
    let v4 = &*velocity + &a3 * step_s;
    let a4 = rate(&(&*q + &v3 * step_s), &v4);
    *q += (v1 + v2 * 2.0 + v3 * 2.0 + v4) * (step_s / 6.0);
    *velocity += (a1 + a2 * 2.0 + a3 * 2.0 + a4) * (step_s / 6.0);
}

#[test]
fn swinging_chain_keeps_its_energy() {
    // A chain of three links, and the hand whose fingers follow each other.
    let mut chain = r#"<robot name="chain"><link name="l0"/>"#.to_owned();
    for idx in 1..4 {
        chain += &format!(
            r#"<link name="l{idx}"><inertial><origin xyz="0.1 0 -0.02"/><mass value="0.5"/><inertia ixx="1e-4" ixy="2e-5" ixz="0" iyy="2e-3" iyz="0" izz="2e-3"/></inertial></link><joint name="j{idx}" type="continuous"><origin xyz="0.2 0.03 0" rpy="0.4 0 0"/><parent link="l{}"/><child link="l{idx}"/><axis xyz="0 1 0"/></joint>"#,
            idx - 1
        );
    }
    for (xml, step_s, most_j) in [
        (chain + "</robot>", 1e-4, 1e-11),
        (ROBOTS[1].to_owned(), 5e-5, 1e-11),
    ] {
        let model = RobotModel::from_urdf(&xml).unwrap();
        let bodies = DynamicsModel::new(&model);
        let mut q = DVector::from_element(model.dof(), 0.3);
        let mut velocity = DVector::from_element(model.dof(), 0.5);
        let before = energy(&bodies, q.as_slice(), velocity.as_slice());
        let start = q.clone();
        let (mut most_kinetic, mut worst) = (0.0_f64, 0.0_f64);
        for _ in 0..5000 {
            swing(&bodies, &mut q, &mut velocity, step_s);
            let now = energy(&bodies, q.as_slice(), velocity.as_slice());
            worst = worst.max((now - before).abs());
            let mass = bodies.mass_matrix(q.as_slice()).unwrap();
            most_kinetic = most_kinetic.max(0.5 * velocity.dot(&(mass * &velocity)));
        }
        println!(
            "{}: {worst:.1e} J lost or won, {most_kinetic:.1e} J at most",
            model.name()
        );
        assert!((q - start).amax() > 0.5, "{} hardly moved", model.name());
        assert!(worst < most_j, "{}: {worst:e} J", model.name());
        assert!(most_kinetic > 1e9 * most_j, "{}", model.name());
    }
}

#[test]
fn free_robot_in_free_fall_keeps_its_momentum() {
    let model = RobotModel::from_urdf(ROBOTS[0]).unwrap();
    let bodies = DynamicsModel::new(&model);
    let n = model.dof();
    let mut q = vec![0.2; n];
    // Nothing acts on it: from the bias and the mass matrix comes its acceleration.
    let mut root = FreeRootState::still(Pose::from_parts(
        Vector3::new(0.3, -0.2, 0.5),
        UnitQuaternion::from_euler_angles(0.3, 0.8, -0.4),
    ));
    root.velocity = Twist::from_array([0.2, 0.1, -0.3, 0.5, -0.4, 0.7]);
    let mut velocity: Vec<f64> = (0..n).map(|idx| 0.4 - 0.1 * idx as f64).collect();
    // The frame without mass does not move on its own.
    let massless = model.joint("pan_joint").unwrap();
    velocity[massless] = 0.0;
    let momentum = |root: &FreeRootState, q: &[f64], velocity: &[f64]| {
        let all = [&root.velocity.to_array(), velocity].concat();
        let mass = bodies.free_mass_matrix(q).unwrap();
        let in_root = mass.rows(0, 6) * DVector::from_vec(all);
        root.world_from_palm.rotation * in_root.fixed_rows::<3>(0)
    };
    let before = momentum(&root, &q, &velocity);
    let step_s = 1e-4;
    for _ in 0..2000 {
        let zeros = vec![0.0; n];
        let motion = JointMotion {
            q: &q,
            velocity: &velocity,
            acceleration: &zeros,
        };
        let bias = bodies
            .inverse_dynamics(&root, &motion, &Vector3::zeros())
            .unwrap();
        let all = bias.root.iter().chain(&bias.joints).copied();
        let bias = DVector::from_iterator(6 + n, all).remove_row(6 + massless);
        let mass = bodies.free_mass_matrix(&q).unwrap();
        let mass = mass.remove_row(6 + massless).remove_column(6 + massless);
        let acceleration = mass
            .cholesky()
            .unwrap()
            .solve(&-bias)
            .insert_row(6 + massless, 0.0);
        let rate = twist(&acceleration.as_slice()[..6]);
        root.velocity.linear += rate.linear * step_s;
        root.velocity.angular += rate.angular * step_s;
        for idx in 0..n {
            velocity[idx] += acceleration[6 + idx] * step_s;
            q[idx] += velocity[idx] * step_s;
        }
        root.world_from_palm = root.after(step_s);
    }
    let drift = (momentum(&root, &q, &velocity) - before).norm() / before.norm();
    assert!(drift < 1e-3, "{drift}");
    assert!(before.norm() > 0.1);
}

/// Two rods that hang on each other and swing in one plane, against the equations of motion that
/// Lagrange's method gives (Spong, Hutchinson and Vidyasagar, *Robot Modeling and Control*, 2006,
/// §6.4, with angles from the vertical).
#[test]
fn double_pendulum_moves_by_the_equations_of_lagrange() {
    let (m1, m2, l1, c1, c2, i1, i2) = (0.7, 0.4, 0.3, 0.12, 0.2, 3e-3, 2e-3);
    let rod = |name: &str, mass: f64, center: f64, inertia: f64| {
        format!(
            r#"<link name="{name}"><inertial><origin xyz="0 0 -{center}"/><mass value="{mass}"/><inertia ixx="{inertia}" ixy="0" ixz="0" iyy="{inertia}" iyz="0" izz="1e-3"/></inertial></link>"#
        )
    };
    let hinge = |name: &str, parent: &str, child: &str, z: f64| {
        format!(
            r#"<joint name="{name}" type="continuous"><origin xyz="0 0 {z}"/><parent link="{parent}"/><child link="{child}"/><axis xyz="1 0 0"/></joint>"#
        )
    };
    let urdf = format!(
        r#"<robot name="pendulum"><link name="base"/>{}{}{}{}</robot>"#,
        rod("upper", m1, c1, i1),
        rod("lower", m2, c2, i2),
        hinge("shoulder", "base", "upper", 0.0),
        hinge("elbow", "upper", "lower", -l1),
    );
    let rotor = 5e-3;
    let bodies = DynamicsModel::new(&RobotModel::from_urdf(&urdf).unwrap()).with_armature(rotor);
    for [q1, q2, v1, v2, a1, a2] in [
        [0.3, -0.8, 1.5, -2.5, 4.0, 7.0],
        [2.0, 1.1, -3.0, 0.5, -6.0, 1.0],
        [-1.2, 0.0, 0.0, 2.0, 0.0, -9.0],
    ] {
        let g = 9.81;
        let (sin, cos) = f64::sin_cos(q2);
        let m22 = i2 + m2 * c2 * c2;
        let m12 = m22 + m2 * l1 * c2 * cos;
        let m11 = i1 + m1 * c1 * c1 + m2 * l1 * l1 + m22 + 2.0 * m2 * l1 * c2 * cos;
        let h = m2 * l1 * c2 * sin;
        let weight2 = m2 * g * c2 * (q1 + q2).sin();
        let weight1 = (m1 * c1 + m2 * l1) * g * q1.sin() + weight2;
        let expected = [
            (m11 + rotor) * a1 + m12 * a2 - h * (2.0 * v1 * v2 + v2 * v2) + weight1,
            m12 * a1 + (m22 + rotor) * a2 + h * v1 * v1 + weight2,
        ];
        let motion = JointMotion {
            q: &[q1, q2],
            velocity: &[v1, v2],
            acceleration: &[a1, a2],
        };
        let root = FreeRootState::still(Pose::identity());
        let found = bodies.inverse_dynamics(&root, &motion, &GRAVITY).unwrap();
        for (found, expected) in found.joints.iter().zip(expected) {
            assert!((found - expected).abs() < 1e-12, "{found} {expected}");
        }
        let of_links = bodies.link_efforts(&root, &motion, &GRAVITY).unwrap();
        assert_eq!(of_links, found.joints.as_slice());
    }
}

/// A joint that moves several links needs the sum of the efforts of each, by its gearing.
#[test]
fn joint_force_is_the_sum_over_its_links() {
    let model = RobotModel::from_urdf(ROBOTS[1]).unwrap();
    let bodies = DynamicsModel::new(&model).with_armature(0.01);
    let numbers = |factor: f64| -> Vec<f64> {
        (0..model.dof())
            .map(|joint| (factor * (1.0 + joint as f64)).sin())
            .collect()
    };
    let (q, velocity, acceleration) = (numbers(1.3), numbers(2.1), numbers(3.7));
    let motion = JointMotion {
        q: &q,
        velocity: &velocity,
        acceleration: &acceleration,
    };
    let root = FreeRootState::still(Pose::identity());
    let together = bodies.inverse_dynamics(&root, &motion, &GRAVITY).unwrap();
    let alone = bodies.link_efforts(&root, &motion, &GRAVITY).unwrap();
    let mut sums = vec![0.0; model.dof()];
    let moving = model.links().iter().filter(|link| link.kind.is_some());
    let mut followers = 0;
    for (link, effort) in moving.zip(&alone) {
        let joint = link.joint.unwrap();
        sums[joint] += link.multiplier * effort;
        followers += usize::from(model.joints()[joint].link != model.link(&link.name).unwrap());
    }
    assert!(followers > 0);
    for (sum, joint) in sums.iter().zip(&together.joints) {
        assert!((sum - joint).abs() < 1e-12, "{sum} {joint}");
    }
}

#[test]
fn rejects_wrong_dof_everywhere() {
    let model = RobotModel::from_urdf(ROBOTS[0]).unwrap();
    let bodies = DynamicsModel::new(&model);
    let right = vec![0.0; model.dof()];
    let wrong = vec![0.0; model.dof() + 1];
    assert!(bodies.mass_matrix(&wrong).is_err());
    assert!(bodies.center_of_mass(&wrong).is_err());
    for (q, velocity, acceleration) in [
        (&wrong, &right, &right),
        (&right, &wrong, &right),
        (&right, &right, &wrong),
    ] {
        let motion = JointMotion {
            q,
            velocity,
            acceleration,
        };
        let root = FreeRootState::still(Pose::identity());
        assert!(bodies.inverse_dynamics(&root, &motion, &GRAVITY).is_err());
    }
}
