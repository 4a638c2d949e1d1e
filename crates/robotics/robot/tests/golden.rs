//! Kinematics and dynamics against Pinocchio, whose numbers `golden/make.py` wrote down.

use std::path::{Path, PathBuf};

use nalgebra::{
    DMatrix, DVector, Isometry3, Matrix6xX, Point3, Quaternion, UnitQuaternion, Vector3,
};
use robot::{DynamicsModel, FreeRootState, JointMotion, RobotModel};
use serde::Deserialize;
use spatial::{Palm, Pose, Twist, World};

/// Greatest difference, relative to the greatest number of the same kind in the same state: one of a
/// thousandth of that, such as a finger's torque beside an arm's, then agrees to 1e-9.
const TOLERANCE: f64 = 1e-12;

/// Contents of the file that `make.py` wrote.
#[derive(Deserialize)]
struct Golden {
    pinocchio: String,
    states: usize,
    gravity: f64,
    robots: Vec<GoldenRobot>,
}

/// One robot of it, with the names of joints and links in the order of its numbers.
#[derive(Deserialize)]
struct GoldenRobot {
    name: String,
    seed: u64,
    joints: Vec<String>,
    links: Vec<String>,
    numbers: usize,
    published: bool,
}

fn here() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/golden")
}

fn golden() -> Golden {
    let text = std::fs::read_to_string(here().join("golden.json")).unwrap();
    serde_json::from_str(&text).unwrap()
}

/// Returns the URDF of a robot; `None` if this machine does not have it.
fn urdf(robot: &GoldenRobot) -> Option<String> {
    let file = format!("{}.urdf", robot.name.trim_start_matches("published_"));
    let path = if robot.published {
        measured_data::folder("urdf")?.join(file)
    } else {
        let made_up = here().join(&file);
        if made_up.exists() {
            made_up
        } else {
            here().join("../../../../../data/robots").join(file)
        }
    };
    std::fs::read_to_string(path).ok()
}

/// Steele, Lea and Flood, *Fast splittable pseudorandom number generators*, 2014: as in `make.py`.
struct SplitMix64(u64);

impl SplitMix64 {
    /// Returns a number in [-1, 1).
    fn unit(&mut self) -> f64 {
        self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        z ^= z >> 31;
        (z >> 11) as f64 / (1_u64 << 52) as f64 - 1.0
    }

    fn vector(&mut self, n: usize) -> DVector<f64> {
        DVector::from_fn(n, |_, _| self.unit())
    }
}

/// Reads numbers in the order in which they were written, and compares ours with them.
struct Compare {
    numbers: std::vec::IntoIter<f64>,
    at: String,
    /// Greatest relative difference so far.
    worst: f64,
}

impl Compare {
    fn check(&mut self, what: &str, ours: &[f64]) {
        let theirs: Vec<f64> = self.numbers.by_ref().take(ours.len()).collect();
        assert_eq!(theirs.len(), ours.len(), "{}: {what}", self.at);
        let scale = theirs
            .iter()
            .fold(0.0_f64, |most, number| most.max(number.abs()));
        for (idx, (ours, theirs)) in ours.iter().zip(&theirs).enumerate() {
            let difference = (ours - theirs).abs() / scale.max(f64::MIN_POSITIVE);
            assert!(
                difference <= TOLERANCE,
                "{}: {what} {idx} is {ours:e}, Pinocchio has {theirs:e}",
                self.at
            );
            self.worst = self.worst.max(difference);
        }
    }
}

fn twist(numbers: &[f64]) -> Twist<Palm> {
    Twist::from_array(numbers.try_into().unwrap())
}

/// Returns the 12 entries of `[R | p]`, row by row.
fn entries(pose: &Isometry3<f64>) -> Vec<f64> {
    let matrix = pose.to_homogeneous();
    (0..12).map(|idx| matrix[(idx / 4, idx % 4)]).collect()
}

fn by_rows(matrix: &DMatrix<f64>) -> Vec<f64> {
    matrix.transpose().as_slice().to_vec()
}

/// A robot with its joints and links in the order of the numbers.
struct Robot {
    model: RobotModel,
    bodies: DynamicsModel,
    /// Index among our joints of each of Pinocchio's.
    joints: Vec<usize>,
    links: Vec<usize>,
    weights: DVector<f64>,
    gravity: Vector3<f64>,
}

impl Robot {
    /// Returns numbers per joint in our order.
    fn ours(&self, theirs: &[f64]) -> Vec<f64> {
        let mut ours = vec![0.0; theirs.len()];
        for (&joint, &number) in self.joints.iter().zip(theirs) {
            ours[joint] = number;
        }
        ours
    }

    /// Returns numbers per column in their order; the root's `n_root` come first.
    fn columns(&self, n_root: usize) -> Vec<usize> {
        let joints = self.joints.iter().map(|joint| n_root + joint);
        (0..n_root).chain(joints).collect()
    }

    fn sum(&self, entries: &[f64]) -> f64 {
        entries.iter().zip(&self.weights).map(|(a, b)| a * b).sum()
    }

    /// Compares everything in one state.
    fn check(
        &self,
        compare: &mut Compare,
        free: Option<&FreeRootState>,
        [q, velocity, acceleration]: [&[f64]; 3],
        everything: bool,
    ) {
        let [q, velocity, acceleration] = [q, velocity, acceleration].map(|n| self.ours(n));
        let n_root = if free.is_some() { 6 } else { 0 };
        let root = free
            .copied()
            .unwrap_or_else(|| FreeRootState::still(Pose::identity()));
        let world_from_palm = &root.world_from_palm;
        let columns = self.columns(n_root);
        let palm_from_links = self.model.forward_kinematics(&q).unwrap();
        let (mut poses, mut jacobians, mut rest) = (Vec::new(), Vec::new(), Vec::new());
        for &link in &self.links {
            let pose = entries(&(*world_from_palm * palm_from_links[link]));
            let origin = Point3::from(palm_from_links[link].translation.vector);
            let held = self
                .model
                .geometric_jacobian(&palm_from_links, link, &origin);
            let jacobian: Matrix6xX<f64> = match free {
                Some(_) => with_root(world_from_palm, &origin, &held),
                None => held,
            };
            let jacobian = by_rows(&DMatrix::from_fn(6, columns.len(), |row, column| {
                jacobian[(row, columns[column])]
            }));
            poses.push(self.sum(&pose));
            jacobians.push(self.sum(&jacobian));
            rest.extend(pose);
            rest.extend(jacobian);
        }
        compare.check("pose of link", &poses);
        compare.check("Jacobian of link", &jacobians);
        let motion = JointMotion {
            q: &q,
            velocity: &velocity,
            acceleration: &acceleration,
        };
        let efforts = self
            .bodies
            .inverse_dynamics(&root, &motion, &self.gravity)
            .unwrap();
        let zeros = vec![0.0; q.len()];
        let still = JointMotion {
            q: &q,
            velocity: &zeros,
            acceleration: &zeros,
        };
        let held = self
            .bodies
            .inverse_dynamics(
                &FreeRootState::still(*world_from_palm),
                &still,
                &self.gravity,
            )
            .unwrap();
        for (what, efforts) in [("inverse dynamics", efforts), ("gravity", held)] {
            let all: Vec<f64> = efforts
                .root
                .iter()
                .chain(&efforts.joints)
                .copied()
                .collect();
            let from = 6 - n_root;
            let ours: Vec<f64> = columns.iter().map(|column| all[from + column]).collect();
            compare.check(what, &ours);
        }
        let mass = match free {
            Some(_) => self.bodies.free_mass_matrix(&q).unwrap(),
            None => self.bodies.mass_matrix(&q).unwrap(),
        };
        let n = columns.len();
        let mass = DMatrix::from_fn(n, n, |row, column| mass[(columns[row], columns[column])]);
        compare.check("mass", mass.diagonal().as_slice());
        let product = &mass * self.weights.rows(0, n);
        compare.check("mass matrix times weights", product.as_slice());
        if free.is_some() {
            compare.check("root after its twist", &entries(&root.after(1.0)));
        }
        if everything {
            compare.check("entry of poses and Jacobians", &rest);
            compare.check("entry of mass matrix", &by_rows(&mass));
        }
    }
}

/// Returns a link's Jacobian by the root's twist and the joints, in the world's frame, from its
/// Jacobian by the joints in the root's.
fn with_root(
    world_from_palm: &Pose<World, Palm>,
    point_in_palm: &Point3<f64>,
    held: &Matrix6xX<f64>,
) -> Matrix6xX<f64> {
    let rotation = *world_from_palm.rotation.to_rotation_matrix().matrix();
    let about = -(rotation * point_in_palm.coords.cross_matrix());
    let mut jacobian = Matrix6xX::zeros(6 + held.ncols());
    jacobian.fixed_view_mut::<3, 3>(0, 0).copy_from(&rotation);
    jacobian.fixed_view_mut::<3, 3>(0, 3).copy_from(&about);
    jacobian.fixed_view_mut::<3, 3>(3, 3).copy_from(&rotation);
    for half in [0, 3] {
        let turned = rotation * held.fixed_rows::<3>(half);
        let mut joints = jacobian.view_mut((half, 6), (3, held.ncols()));
        joints.copy_from(&turned);
    }
    jacobian
}

/// Compares a robot in all its states and returns the greatest relative difference.
fn check(golden: &Golden, robot: &GoldenRobot, xml: &str) -> f64 {
    let model = RobotModel::from_urdf(xml).unwrap_or_else(|err| panic!("{}: {err}", robot.name));
    assert_eq!(model.dof(), robot.joints.len(), "{}", robot.name);
    assert_eq!(model.links().len(), robot.links.len(), "{}", robot.name);
    let bytes = std::fs::read(here().join(format!("{}.f64", robot.name))).unwrap();
    let numbers: Vec<f64> = bytes
        .chunks_exact(8)
        .map(|chunk| f64::from_le_bytes(chunk.try_into().unwrap()))
        .collect();
    assert_eq!(numbers.len(), robot.numbers, "{}", robot.name);
    let n = model.dof();
    let mut random = SplitMix64(robot.seed);
    let find = |name: &String| model.require_link(name).unwrap();
    let ready = Robot {
        bodies: DynamicsModel::new(&model),
        joints: model.require_joints(&robot.joints).unwrap(),
        links: robot.links.iter().map(find).collect(),
        weights: random.vector(6 * (6 + n) + 12),
        gravity: Vector3::new(0.0, 0.0, -golden.gravity),
        model,
    };
    let mut compare = Compare {
        numbers: numbers.into_iter(),
        at: String::new(),
        worst: 0.0,
    };
    for state in 0..golden.states {
        let q = random.vector(n) * 1.5;
        let velocity = random.vector(6 + n) * 3.0;
        let acceleration = random.vector(6 + n) * 10.0;
        let (xyzw, place) = (random.vector(4), random.vector(3));
        let rotation = UnitQuaternion::from_quaternion(Quaternion::from_parts(
            xyzw[3],
            Vector3::new(xyzw[0], xyzw[1], xyzw[2]),
        ));
        let moving = FreeRootState {
            world_from_palm: Pose::from_parts(Vector3::new(place[0], place[1], place[2]), rotation),
            velocity: twist(&velocity.as_slice()[..6]),
            acceleration: twist(&acceleration.as_slice()[..6]),
        };
        let joints = [
            q.as_slice(),
            &velocity.as_slice()[6..],
            &acceleration.as_slice()[6..],
        ];
        for (name, free) in [("fixed", None), ("free", Some(&moving))] {
            compare.at = format!("{}, state {state}, {name} root", robot.name);
            ready.check(&mut compare, free, joints, state == 0);
        }
    }
    assert_eq!(compare.numbers.next(), None, "{}", robot.name);
    compare.worst
}

#[test]
fn pinocchio_agrees_on_our_robots_and_made_up_ones() {
    let golden = golden();
    assert_eq!((golden.pinocchio.as_str(), golden.states), ("4.1.0", 100));
    let mut n_robots = 0;
    for robot in golden.robots.iter().filter(|robot| !robot.published) {
        let worst = check(&golden, robot, &urdf(robot).unwrap());
        println!("{}: {worst:.1e} relative at most", robot.name);
        n_robots += 1;
    }
    assert_eq!(n_robots, 5);
}

#[test]
fn pinocchio_agrees_on_published_robots() {
    let golden = golden();
    for robot in golden.robots.iter().filter(|robot| robot.published) {
        let Some(xml) = urdf(robot) else {
            measured_data::print_skipped(&format!("`urdf` holds no `{}`", robot.name));
            continue;
        };
        let worst = check(&golden, robot, &xml);
        println!("{}: {worst:.1e} relative at most", robot.name);
    }
}
