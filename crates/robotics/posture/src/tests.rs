//! The solver against central differences, a dense solver and hands made up for it.

use nalgebra::{DMatrix, DVector, Point3, Vector3};
use proptest::prelude::*;
use robot::{Link, RobotModel, SelfCollision, SelfGaps};
use spatial::{Palm, Pose};

use crate::{
    evaluate::{Evaluation, State},
    moments::HessianForm,
    *,
};

/// A joint of a made-up hand: parent link, kind, axis, limits and what it mimics.
type MadeJoint = (
    usize,
    &'static str,
    [f64; 3],
    (f64, f64),
    Option<(usize, f64, f64)>,
);

/// A hand with a wrist of two joints, three fingers of unlike length, a sliding joint, one without
/// limits, a mimicking joint in its own finger and one in another finger.
const JOINTS: [MadeJoint; 12] = [
    (0, "revolute", [0.0, 1.0, 0.0], (-0.5, 0.4), None),
    (1, "revolute", [1.0, 0.0, 0.0], (-0.6, 0.6), None),
    (2, "revolute", [0.0, 0.0, -1.0], (-0.4, 0.4), None),
    (3, "revolute", [0.3, 1.0, 0.2], (-0.2, 1.6), None),
    (
        4,
        "revolute",
        [0.0, 1.0, 0.0],
        (-0.2, 1.6),
        Some((3, 0.8, 0.1)),
    ),
    (2, "prismatic", [0.0, 1.0, 1.0], (-0.02, 0.03), None),
    (6, "continuous", [0.0, 1.0, 0.0], (0.0, 0.0), None),
    (
        7,
        "revolute",
        [0.0, 1.0, 0.0],
        (-0.2, 1.6),
        Some((3, -0.5, 0.3)),
    ),
    (2, "revolute", [1.0, 0.0, 0.0], (0.1, 1.2), None),
    (9, "revolute", [0.0, 1.0, 0.0], (-0.2, 1.4), None),
    (10, "revolute", [0.0, 1.0, 0.0], (-0.2, 1.4), None),
    (11, "revolute", [0.0, 0.0, 1.0], (-0.2, 1.4), None),
];

fn made_up() -> RobotModel {
    let mut xml = "<robot name=\"made_up\"><link name=\"l0\"/>".to_owned();
    for (idx, (parent, kind, axis, (lower, upper), mimic)) in JOINTS.iter().enumerate() {
        let n = idx + 1;
        let spread = 0.03 * (n as f64 * 1.7).sin();
        let mimic = mimic.map_or(String::new(), |(joint, multiplier, offset)| {
            format!("<mimic joint=\"j{joint}\" multiplier=\"{multiplier}\" offset=\"{offset}\"/>")
        });
        let limit = if *kind == "continuous" {
            String::new()
        } else {
            format!("<limit lower=\"{lower}\" upper=\"{upper}\" effort=\"1\" velocity=\"1\"/>")
        };
        xml += &format!(
            "<link name=\"l{n}\"/><joint name=\"j{idx}\" type=\"{kind}\">\
             <origin xyz=\"{spread} {} 0.04\" rpy=\"{spread} 0.2 {}\"/>\
             <parent link=\"l{parent}\"/><child link=\"l{n}\"/>\
             <axis xyz=\"{} {} {}\"/>{limit}{mimic}</joint>",
            -0.5 * spread,
            4.0 * spread,
            axis[0],
            axis[1],
            axis[2],
        );
    }
    RobotModel::from_urdf(&(xml + "</robot>")).unwrap()
}

/// The points of the made-up hand: the tip and the middle of each finger, one on the wrist, one on
/// the root.
fn attached(model: &RobotModel) -> Vec<(usize, Point3<f64>)> {
    [
        ("l5", 0.03),
        ("l4", 0.0),
        ("l8", 0.04),
        ("l6", 0.01),
        ("l12", 0.03),
        ("l10", 0.0),
        ("l1", 0.02),
        ("l0", -0.05),
    ]
    .iter()
    .map(|&(link, z)| {
        (
            model.require_link(link).unwrap(),
            Point3::new(0.004, -0.002, z),
        )
    })
    .collect()
}

/// Everything that a task can ask, about a posture.
#[derive(Debug, Clone)]
struct Case {
    targets: Vec<Target>,
    before: Posture,
    points: Vec<Point3<f64>>,
    rest: Vec<f64>,
    at: Posture,
    direction: Vector3<f64>,
}

fn unit() -> impl Strategy<Value = f64> {
    -1.0..1.0_f64
}

fn vector(reach: f64) -> impl Strategy<Value = Vector3<f64>> {
    prop::array::uniform3(-reach..reach).prop_map(Vector3::from)
}

fn posture(turn: f64) -> impl Strategy<Value = Posture> {
    let q = prop::collection::vec(unit(), made_up().dof());
    (vector(0.1), vector(turn), q).prop_map(|(along, turn, q)| {
        let model = made_up();
        let q = q.iter().zip(model.joints());
        let q = q
            .map(|(x, joint)| {
                let (lower, upper) = (joint.lower.max(-1.0), joint.upper.min(1.0));
                lower + 0.5 * (x + 1.0) * (upper - lower)
            })
            .collect();
        Posture {
            root: RootPose::from_angles(along, turn),
            q,
        }
    })
}

fn case(noise: f64) -> impl Strategy<Value = Case> {
    let n = attached(&made_up()).len();
    let offsets = || prop::collection::vec(vector(noise), n);
    let weights = prop::collection::vec(0.1..2.0_f64, n);
    (
        posture(1.2),
        posture(1.2),
        offsets(),
        offsets(),
        weights,
        vector(1.0),
    )
        .prop_map(|(at, before, to, from, weights, direction)| {
            let model = made_up();
            let hand = CompiledHand::new(&model, Root::Free, &attached(&model)).unwrap();
            let mut solver = Solver::new(&hand);
            solver.place(&EMPTY_TASK, &at, &mut NoTerms).unwrap();
            let place = |point: usize| solver.posed().point(point).unwrap();
            let targets = to.iter().zip(&weights).enumerate();
            Case {
                targets: targets
                    .map(|(point, (to, &weight))| Target {
                        point,
                        point_in_object: place(point) + to,
                        weight,
                    })
                    .collect(),
                points: from
                    .iter()
                    .enumerate()
                    .map(|(point, from)| place(point) + from)
                    .collect(),
                rest: before.q.iter().map(|q| q * 0.5).collect(),
                before,
                at,
                direction: direction.try_normalize(1e-3).unwrap_or(Vector3::x()),
            }
        })
}

const EMPTY_TASK: Task<'static> = Task {
    targets: &[],
    loss: Loss::Squared,
    vectors: None,
    smoothness: None,
    prior: None,
};

impl Case {
    fn task(&self, loss: Loss) -> Task<'_> {
        Task {
            targets: &self.targets,
            loss,
            vectors: None,
            smoothness: Some(Smoothness {
                points: &self.points,
                point_weight: 0.2,
                posture: &self.before,
                joint_weight: 4e-3,
                root_weight: 3e-3,
            }),
            prior: Some(PosturePrior {
                q: &self.rest,
                weight: 1e-3,
            }),
        }
    }

    /// Two walls, each known by its distance from a point.
    fn terms(&self) -> impl Terms + use<> {
        let (a, b) = (self.direction, Vector3::new(0.6, 0.0, -0.8));
        move |hand: &Posed<'_>, residuals: &mut Vec<Residual>| {
            for (point, direction, weight) in [(0, a, 1.5), (4, b, 0.7), (6, a, 0.4)] {
                let residual = hand.point(point).unwrap().coords.dot(&direction) + 0.02;
                residuals.push(Residual {
                    point,
                    gradient_in_object: direction,
                    residual,
                    weight,
                });
            }
        }
    }
}

/// Returns the state moved by a step in the unknowns' coordinates.
fn moved(hand: &CompiledHand, state: &State, step: &[f64]) -> State {
    let (root, joints) = step.split_at(hand.layout.n_root);
    let mut moved = state.clone();
    if let &[x, y, z, a, b, c] = root {
        let (along, turn) = (Vector3::new(x, y, z), Vector3::new(a, b, c));
        moved.root = match hand.root {
            Root::Angles => {
                RootPose::from_angles(state.root.translation + along, state.root.angles + turn)
            }
            Root::Free | Root::Fixed => state.root.turned(along, turn),
        };
    }
    for (q, step) in moved.q.iter_mut().zip(joints) {
        *q += step;
    }
    moved
}

/// Returns the gradient and the whole Hessian.
fn derivatives(evaluation: &Evaluation<'_>) -> (DVector<f64>, DMatrix<f64>) {
    let layout = &evaluation.hand.layout;
    let n = layout.n;
    let mut hessian = DMatrix::zeros(n, n);
    for u in 0..n {
        let (mut unit, mut column) = (vec![0.0; n], vec![0.0; n]);
        unit[u] = 1.0;
        layout.product(&evaluation.hessian, &unit, &mut column);
        evaluation.pairs.add_product(&unit, &mut column);
        hessian.set_column(u, &DVector::from_vec(column));
    }
    (DVector::from_column_slice(&evaluation.gradient), hessian)
}

/// Compares gradient and Hessian with central differences of the cost and of the gradient.
fn check_derivatives(case: &Case, root: Root, loss: Loss) -> Result<(), TestCaseError> {
    let model = made_up();
    let hand = CompiledHand::new(&model, root, &attached(&model)).unwrap();
    check_derivatives_of(&hand, case, &case.task(loss))
}

fn check_derivatives_of(
    hand: &CompiledHand,
    case: &Case,
    task: &Task<'_>,
) -> Result<(), TestCaseError> {
    const STEP: f64 = 1e-5;
    let n = hand.unknowns();
    let mut terms = case.terms();
    let mut evaluation = Evaluation::new(hand);
    let q = hand.layout.joints.iter().map(|&j| case.at.q[j]).collect();
    let state = State {
        root: case.at.root,
        q,
    };
    let mut at = |step: &[f64]| {
        let state = moved(hand, &state, step);
        let cost = evaluation.cost(&state, task, &mut terms);
        evaluation.differentiate(&state, task, HessianForm::Exact);
        let (gradient, hessian) = derivatives(&evaluation);
        evaluation.slopes(&state, task);
        let alone = DVector::from_column_slice(&evaluation.gradient);
        (cost, gradient, hessian, alone)
    };
    let (_, gradient, hessian, alone) = at(&vec![0.0; n]);
    let error = (&gradient - &alone).norm();
    prop_assert!(
        error < 1e-12 * (1.0 + gradient.norm()),
        "gradient alone off by {error:e}"
    );
    let mut numeric = (DVector::zeros(n), DMatrix::zeros(n, n));
    for u in 0..n {
        let mut step = vec![0.0; n];
        step[u] = STEP;
        let ahead = at(&step);
        step[u] = -STEP;
        let behind = at(&step);
        numeric.0[u] = (ahead.0 - behind.0) / (2.0 * STEP);
        numeric
            .1
            .set_column(u, &((ahead.1 - behind.1) / (2.0 * STEP)));
    }
    let error = (&gradient - &numeric.0).norm();
    prop_assert!(
        error < 1e-7 * (1.0 + gradient.norm()),
        "gradient off by {error:e}"
    );
    // Gradients at two orientations are along two sets of axes; what that adds is antisymmetric.
    let symmetric = (&numeric.1 + numeric.1.transpose()) * 0.5;
    let error = (&hessian - &symmetric).norm();
    prop_assert!(
        error < 1e-5 * (1.0 + hessian.norm()),
        "Hessian off by {error:e} of {:e}\n{:.4}",
        hessian.norm(),
        &hessian - &symmetric
    );
    Ok(())
}

proptest! {
    /// To 1e-7 and 1e-5 of their size. A kink of the loss within a step would be seen, and is rare.
    #[test]
    fn derivatives_of_all_terms_are_right(case in case(0.05), root in 0..3_usize, smooth in any::<bool>()) {
        let root = [Root::Fixed, Root::Free, Root::Angles][root];
        let loss = if smooth { Loss::SmoothL1 { beta_m: 0.02 } } else { Loss::Squared };
        let mut case = case;
        // The logarithm's second derivative is exact for small turns only.
        case.before.root = case.at.root.turned(Vector3::new(0.01, 0.0, 0.02), case.direction * 0.05);
        let near_kink = case.targets.iter().enumerate().any(|(idx, target)| {
            let offset = case.targets[idx].point_in_object - place_of(&case.at, root, target.point);
            offset.iter().any(|x| (x.abs() - 0.02).abs() < 1e-4)
        });
        prop_assume!(!near_kink);
        check_derivatives(&case, root, loss)?;
    }

    /// Of vectors from the palm, which have a place in the arrow, and between fingers, which have none there.
    #[test]
    fn derivatives_of_vectors_are_right(
        case in case(0.05),
        root in 0..3_usize,
        between_fingers in any::<bool>(),
        offsets in prop::array::uniform3(vector(0.05)),
    ) {
        let root = [Root::Fixed, Root::Free, Root::Angles][root];
        let mut case = case;
        case.before.root = case.at.root.turned(Vector3::new(0.01, 0.0, 0.02), case.direction * 0.05);
        prop_assume!(offsets.iter().all(|offset| (offset.norm() - 0.02).abs() > 1e-4));
        let ends = if between_fingers { [[0, 4], [7, 2], [6, 0]] } else { [[7, 0], [6, 4], [7, 6]] };
        let model = made_up();
        let hand = CompiledHand::with_vectors(&model, root, &attached(&model), &ends).unwrap();
        prop_assert_eq!(hand.layout.fingers.is_empty(), between_fingers);
        let place = |point| place_of(&case.at, root, point);
        let vectors = offsets.iter().enumerate().map(|(vector, offset)| VectorTarget {
            vector,
            vector_in_object: place(ends[vector][1]) - place(ends[vector][0]) + offset,
            weight: 0.5 + vector as f64,
        });
        let vectors: Vec<VectorTarget> = vectors.collect();
        let task = Task {
            vectors: Some(VectorTargets { vectors: &vectors, beta_m: 0.02 }),
            ..case.task(Loss::Squared)
        };
        check_derivatives_of(&hand, &case, &task)?;
    }

    /// From anywhere, limits hold and the cost only falls.
    #[test]
    fn answers_are_within_limits(case in case(0.2), start in posture(3.0), root in 0..3_usize) {
        let root = [Root::Fixed, Root::Free, Root::Angles][root];
        let model = made_up();
        let hand = CompiledHand::new(&model, root, &attached(&model)).unwrap();
        let mut solver = Solver::new(&hand);
        let task = case.task(Loss::Squared);
        let before = solver.place(&task, &start, &mut case.terms()).unwrap();
        let mut found = start.clone();
        let outcome = solver.minimize(&task, &mut found, &OPTIONS, &mut case.terms()).unwrap();
        prop_assert!(outcome.cost <= before && outcome.converged, "{before} {outcome:?}");
        for (joint, q) in model.joints().iter().zip(&found.q) {
            prop_assert!((joint.lower..=joint.upper).contains(q), "{} at {q}", joint.name);
        }
        let again = solver.place(&task, &found, &mut case.terms()).unwrap();
        prop_assert!((again - outcome.cost).abs() < 1e-12 * again.max(1e-3));
        if root == Root::Fixed {
            prop_assert_eq!(found.root, start.root);
        }
        let held = SearchOptions { root_motion: RootMotion::Fixed, ..OPTIONS };
        let mut kept = start.clone();
        let held = solver.minimize(&task, &mut kept, &held, &mut case.terms()).unwrap();
        prop_assert!(held.converged && held.cost <= before);
        prop_assert_eq!(kept.root, start.root);
    }

    /// Near an answer, the minimum is the one that a dense solver with the model's own kinematics
    /// finds.
    #[test]
    fn agrees_with_a_dense_solver(case in case(0.01)) {
        let model = made_up();
        let hand = CompiledHand::new(&model, Root::Fixed, &attached(&model)).unwrap();
        let mut solver = Solver::new(&hand);
        let task = Task {
            vectors: None,
            smoothness: None,
            prior: Some(PosturePrior { q: &case.rest, weight: 1e-3 }),
            ..case.task(Loss::Squared)
        };
        let mut found = case.at.clone();
        let outcome = solver.minimize(&task, &mut found, &OPTIONS, &mut NoTerms).unwrap();
        let reference = dense(&model, &case);
        prop_assert!((outcome.cost - reference).abs() < 1e-6 * reference + 1e-12, "{} {reference}", outcome.cost);
    }
}

/// Distances of points on pairs of links, each of which should be as long as this, in meters.
struct Rods([f64; 3]);

impl Rods {
    /// Points of two fingers, of two others, and of a finger and the root.
    const POINTS: [[usize; 2]; 3] = [[0, 4], [4, 2], [7, 0]];
}

impl Terms for Rods {
    fn residuals(&mut self, _hand: &Posed<'_>, _residuals: &mut Vec<Residual>) {}

    fn pair_residuals(&mut self, hand: &Posed<'_>, residuals: &mut Vec<PairResidual>) {
        let attached = attached(&made_up());
        for (points, length_m) in Self::POINTS.into_iter().zip(self.0) {
            let points_in_object = points.map(|point| hand.point(point).unwrap());
            let way = points_in_object[1] - points_in_object[0];
            residuals.push(PairResidual {
                links: points.map(|point| attached[point].0),
                points_in_object,
                gradient_in_object: way.normalize(),
                residual: way.norm() - length_m,
                weight: 2.0,
            });
        }
    }
}

/// The Allegro, the LEAP and the Shadow hand, with their palms fixed.
fn real_hands() -> [(&'static str, RobotModel, CompiledHand); 3] {
    ["allegro_right", "leap_right", "shadow_right"].map(|name| {
        let urdf = std::path::Path::new(crate::fixture::URDF).with_file_name(name);
        let urdf = std::fs::read_to_string(urdf.with_extension("urdf")).unwrap();
        let model = RobotModel::from_urdf(&urdf).unwrap();
        let points: Vec<(usize, Point3<f64>)> = (model.fingers().iter())
            .map(|finger| (finger.tip_link, finger.tip_offset_m.into()))
            .collect();
        let hand = CompiledHand::new(&model, Root::Fixed, &points).unwrap();
        (name, model, hand)
    })
}

proptest! {
    /// Slopes of residuals between links are right to 1e-7 of their size, and the second derivatives are Gauss-Newton's.
    #[test]
    fn derivatives_of_pairs_are_right(at in posture(1.2), root in 0..3_usize) {
        const STEP: f64 = 1e-6;
        let model = made_up();
        let root = [Root::Fixed, Root::Free, Root::Angles][root];
        let hand = CompiledHand::new(&model, root, &attached(&model)).unwrap();
        let mut evaluation = Evaluation::new(&hand);
        let q = hand.layout.joints.iter().map(|&j| at.q[j]).collect();
        let state = State { root: at.root, q };
        let mut rods = Rods([0.05, 0.2, 0.1]);
        let mut rods_at = |step: &[f64]| {
            let state = moved(&hand, &state, step);
            let cost = evaluation.cost(&state, &EMPTY_TASK, &mut rods);
            evaluation.differentiate(&state, &EMPTY_TASK, HessianForm::Exact);
            let residuals = evaluation.pair_residuals.iter().map(|pair| pair.residual);
            let residuals: Vec<f64> = residuals.collect();
            let (gradient, hessian) = derivatives(&evaluation);
            evaluation.slopes(&state, &EMPTY_TASK);
            assert_eq!(evaluation.gradient, gradient.as_slice());
            (cost, gradient, hessian, DVector::from_vec(residuals))
        };
        let n = hand.unknowns();
        let (_, gradient, hessian, _) = rods_at(&vec![0.0; n]);
        let (mut slopes, mut rates) = (DVector::zeros(n), DMatrix::zeros(3, n));
        for u in 0..n {
            let mut step = vec![0.0; n];
            step[u] = STEP;
            let ahead = rods_at(&step);
            step[u] = -STEP;
            let behind = rods_at(&step);
            slopes[u] = (ahead.0 - behind.0) / (2.0 * STEP);
            rates.set_column(u, &((ahead.3 - behind.3) / (2.0 * STEP)));
        }
        let off = (&gradient - slopes).norm();
        prop_assert!(off < 1e-7 * (1.0 + gradient.norm()), "gradient off by {off:e}");
        // The weight is 2.
        let off = (&hessian - rates.tr_mul(&rates) * 8.0).norm();
        prop_assert!(off < 1e-6 * (1.0 + hessian.norm()), "Hessian off by {off:e}");
    }

    /// With residuals between links, a step is that of the whole matrix, although the arrow has no place for them.
    #[test]
    fn steps_with_pairs_are_those_of_the_whole_matrix(case in case(0.05), root in 0..3_usize) {
        let model = made_up();
        let root = [Root::Fixed, Root::Free, Root::Angles][root];
        let hand = CompiledHand::new(&model, root, &attached(&model)).unwrap();
        let mut solver = Solver::new(&hand);
        let task = case.task(Loss::Squared);
        solver.state.root = case.at.root;
        solver.state.q = hand.layout.joints.iter().map(|&j| case.at.q[j]).collect();
        solver.evaluation.cost(&solver.state, &task, &mut Rods([0.05, 0.2, 0.1]));
        solver.evaluation.differentiate(&solver.state, &task, HessianForm::Convex);
        let (gradient, hessian) = derivatives(&solver.evaluation);
        solver.bounded_step(0.0, RootMotion::Free).unwrap();
        let step = DVector::from_column_slice(&solver.step);
        let slopes = &gradient + &hessian * &step;
        for u in (0..hand.unknowns()).filter(|&u| solver.free[u] > 0.0) {
            let slope = slopes[u].abs();
            prop_assert!(slope < 1e-6 * (1.0 + gradient.norm()), "{u}: {slope:e}");
        }
    }
}

/// Fingers whose targets lie in each other stop at their margins: in three hands, never deeper than 2 mm, and half of the
/// searches at no more than twice the cost of a dense solver, which may end at another of several minima.
#[test]
fn crossing_fingers_are_parted_as_by_a_dense_solver() {
    const MARGIN_M: f64 = 0.002;
    for (name, model, hand) in real_hands() {
        let collision = SelfCollision::new(&model);
        let mut solver = Solver::new(&hand);
        let options = SearchOptions::new(90, RootMotion::Fixed);
        let mut ratios = Vec::new();
        let mut share = 0.1_f64;
        for _ in 0..60 {
            let q = model.joints().iter().map(|joint| {
                // Numbers of all digits (Knuth, TAOCP 2, section 3.2.1).
                share = (share * 9301.0 + 0.233_333_333_333_333_34).fract();
                joint.lower + share * (joint.upper - joint.lower)
            });
            let drawn = Posture::new(&Pose::identity(), q.collect());
            solver.place(&EMPTY_TASK, &drawn, &mut NoTerms).unwrap();
            let mut terms = SelfGapTerms::new(&collision, MARGIN_M, GAP_WEIGHT);
            if terms.depth_m(&solver.posed()) <= 0.0 {
                continue;
            }
            let targets: Vec<Target> = (0..hand.point_count())
                .map(|point| Target {
                    point,
                    point_in_object: solver.posed().point(point).unwrap(),
                    weight: 0.01,
                })
                .collect();
            let task = Task {
                targets: &targets,
                prior: Some(PosturePrior {
                    q: &drawn.q,
                    weight: 2.5e-5,
                }),
                ..EMPTY_TASK
            };
            let mut found = Posture::new(&Pose::identity(), model.mid_range());
            let reference = dense_with_gaps(&model, &collision, MARGIN_M, &task, &found.q);
            let outcome = solver
                .minimize(&task, &mut found, &options, &mut terms)
                .unwrap();
            solver.place(&task, &found, &mut NoTerms).unwrap();
            let depth_m = terms.depth_m(&solver.posed());
            assert!(depth_m < 0.002, "{name}: {depth_m} m");
            ratios.push(outcome.cost / reference);
        }
        ratios.sort_unstable_by(f64::total_cmp);
        let median = ratios[ratios.len() / 2];
        assert!(ratios.len() > 10 && median < 2.0, "{name}: {ratios:?}");
    }
}

/// The weight of what links lack to their margins.
const GAP_WEIGHT: f64 = 3.0;

/// Returns the least cost that projected, damped Gauss-Newton steps on dense matrices find from a start.
fn dense_with_gaps(
    model: &RobotModel,
    collision: &SelfCollision,
    margin_m: f64,
    task: &Task<'_>,
    start: &[f64],
) -> f64 {
    let dof = model.dof();
    let mut gaps = SelfGaps::default();
    let points: Vec<(usize, Point3<f64>)> = (model.fingers().iter())
        .map(|finger| (finger.tip_link, finger.tip_offset_m.into()))
        .collect();
    let prior = task.prior.unwrap();
    let cost_and_model = |q: &DVector<f64>| {
        let poses = model.forward_kinematics::<Palm>(q.as_slice()).unwrap();
        let (mut cost, mut gradient, mut hessian) =
            targets_and_rest(model, &poses, &points, task.targets, &prior, q);
        for gap in collision.gaps(&poses, margin_m, &mut gaps) {
            let mut by_q = vec![0.0; dof];
            model.add_gap_gradient(&poses, gap, GAP_WEIGHT, &mut by_q);
            let row = DVector::from_vec(by_q);
            let residual = GAP_WEIGHT * (gap.gap_m - margin_m);
            cost += residual * residual;
            gradient += &row * (2.0 * residual);
            hessian += &row * row.transpose() * 2.0;
        }
        (cost, gradient, hessian)
    };
    projected_newton(model, &DVector::from_column_slice(start), cost_and_model)
}

const OPTIONS: SearchOptions = SearchOptions {
    relative_tolerance: 1e-12,
    min_decrease: 1e-16,
    max_iterations: 2000,
    root_motion: RootMotion::Free,
};

fn place_of(posture: &Posture, root: Root, point: usize) -> Point3<f64> {
    let model = made_up();
    let hand = CompiledHand::new(&model, root, &attached(&model)).unwrap();
    let mut solver = Solver::new(&hand);
    solver.place(&EMPTY_TASK, posture, &mut NoTerms).unwrap();
    solver.posed().point(point).unwrap()
}

/// Minimizes squared distances and rest by projected, damped Gauss-Newton steps on dense matrices,
/// one joint at a time where limits hold; returns the cost.
fn dense(model: &RobotModel, case: &Case) -> f64 {
    let points = attached(model);
    let object_from_palm = case.at.root.pose();
    let in_palm = |target: &Target| Target {
        point_in_object: object_from_palm.inverse_transform_point(&target.point_in_object),
        ..*target
    };
    let targets: Vec<Target> = case.targets.iter().map(in_palm).collect();
    let prior = PosturePrior {
        q: &case.rest,
        weight: 1e-3,
    };
    let cost_and_model = |q: &DVector<f64>| {
        let palm_from_links = model.forward_kinematics::<Palm>(q.as_slice()).unwrap();
        targets_and_rest(model, &palm_from_links, &points, &targets, &prior, q)
    };
    let start = DVector::from_column_slice(&case.at.q);
    projected_newton(model, &start, cost_and_model)
}

/// Returns the cost of squared distances from targets, in the frame of the links' poses, and of the distance from rest,
/// with its gradient and Gauss-Newton's matrix.
fn targets_and_rest(
    model: &RobotModel,
    frame_from_links: &[Pose<Palm, Link>],
    points: &[(usize, Point3<f64>)],
    targets: &[Target],
    prior: &PosturePrior<'_>,
    q: &DVector<f64>,
) -> (f64, DVector<f64>, DMatrix<f64>) {
    let dof = model.dof();
    let mut cost = 0.0;
    let (mut gradient, mut hessian) = (DVector::zeros(dof), DMatrix::zeros(dof, dof));
    for target in targets {
        let (link, offset) = points[target.point];
        let at = frame_from_links[link] * offset;
        let away = at - target.point_in_object;
        cost += target.weight * away.norm_squared();
        let jacobian = model.geometric_jacobian(frame_from_links, link, &at);
        let jacobian = jacobian.fixed_rows::<3>(0);
        gradient += jacobian.tr_mul(&away) * (2.0 * target.weight);
        hessian += jacobian.tr_mul(&jacobian) * (2.0 * target.weight);
    }
    for j in 0..dof {
        let away = q[j] - prior.q[j];
        cost += prior.weight * away * away;
        gradient[j] += 2.0 * prior.weight * away;
        hessian[(j, j)] += 2.0 * prior.weight;
    }
    (cost, gradient, hessian)
}

/// Minimizes by projected, damped Gauss-Newton steps on dense matrices, one joint at a time where limits hold; returns
/// the cost.
fn projected_newton(
    model: &RobotModel,
    start: &DVector<f64>,
    mut cost_and_model: impl FnMut(&DVector<f64>) -> (f64, DVector<f64>, DMatrix<f64>),
) -> f64 {
    let dof = model.dof();
    let clamp = |q: &DVector<f64>| {
        DVector::from_fn(dof, |j, _| {
            q[j].clamp(model.joints()[j].lower, model.joints()[j].upper)
        })
    };
    let mut q = clamp(start);
    let mut damping = 1e-3;
    let (mut cost, mut gradient, mut hessian) = cost_and_model(&q);
    for _ in 0..3000 {
        let mut matrix = hessian.clone();
        let mut right = -gradient.clone();
        for j in 0..dof {
            let (lower, upper) = (model.joints()[j].lower, model.joints()[j].upper);
            let is_held =
                (q[j] <= lower && gradient[j] > 0.0) || (q[j] >= upper && gradient[j] < 0.0);
            if is_held {
                matrix.row_mut(j).fill(0.0);
                matrix.column_mut(j).fill(0.0);
                right[j] = 0.0;
            }
            matrix[(j, j)] += if is_held { 1.0 } else { damping };
        }
        let step = matrix.cholesky().unwrap().solve(&right);
        let trial = clamp(&(&q + step));
        let at_trial = cost_and_model(&trial);
        if at_trial.0 < cost {
            q = trial;
            (cost, gradient, hessian) = at_trial;
            damping = (damping * 0.5).max(1e-9);
        } else {
            damping *= 4.0;
            if damping > 1e6 {
                break;
            }
        }
    }
    cost
}

#[test]
fn fingers_are_blocks_and_shared_columns_are_the_trunk() {
    let model = made_up();
    let hand = CompiledHand::new(&model, Root::Free, &attached(&model)).unwrap();
    let names = model.joint_names();
    let names: Vec<&str> = hand
        .layout
        .joints
        .iter()
        .map(|&j| names[j].as_str())
        .collect();
    // Joint 3 is mimicked in another finger; 4 and 7 mimic.
    assert_eq!(names[..3], ["j0", "j1", "j3"]);
    assert_eq!((hand.layout.n_trunk, hand.layout.n), (9, 16));
    let lengths: Vec<usize> = hand.layout.fingers.iter().map(|&(_, len)| len).collect();
    assert_eq!(lengths, [1, 2, 4]);
}

/// A finger that is bent the wrong way, with its last joint at a limit, finds the other bend.
#[test]
fn lower_cost_flexion_is_found() {
    let joint = |n: usize, z: f64| {
        format!(
            "<link name=\"l{n}\"/><joint name=\"j{n}\" type=\"revolute\"><origin xyz=\"0 0 {z}\"/>\
             <parent link=\"l{}\"/><child link=\"l{n}\"/><axis xyz=\"0 1 0\"/>\
             <limit lower=\"-0.2\" upper=\"1.6\" effort=\"1\" velocity=\"1\"/></joint>",
            n - 1
        )
    };
    let xml = format!(
        "<robot name=\"finger\"><link name=\"l0\"/>{}{}</robot>",
        joint(1, 0.0),
        joint(2, 0.05)
    );
    let model = RobotModel::from_urdf(&xml).unwrap();
    let hand = CompiledHand::new(&model, Root::Fixed, &[(2, Point3::new(0.0, 0.0, 0.04))]).unwrap();
    let mut solver = Solver::new(&hand);
    let reached = Posture::new(&Pose::identity(), vec![0.1, 1.2]);
    solver.place(&EMPTY_TASK, &reached, &mut NoTerms).unwrap();
    let target = Target {
        point: 0,
        point_in_object: solver.posed().point(0).unwrap(),
        weight: 1.0,
    };
    let task = Task {
        targets: &[target],
        ..EMPTY_TASK
    };
    let start = Posture::new(&Pose::identity(), vec![1.4, -0.2]);
    let mut stuck = start.clone();
    let poor = solver
        .minimize(&task, &mut stuck, &OPTIONS, &mut NoTerms)
        .unwrap();
    assert!(poor.cost > 1e-5 && stuck.q[1] == -0.2, "{poor:?} {stuck:?}");
    let mut found = start;
    let outcome = solver
        .minimize_with_flips(&task, &mut found, &OPTIONS, &mut NoTerms)
        .unwrap();
    assert!(
        outcome.cost < 1e-12 && (found.q[1] - 1.2).abs() < 1e-5,
        "{outcome:?} {found:?}"
    );
}

#[test]
fn one_sided_fingers_are_searched_once() {
    // One joint is locked, one has a single limit: it follows a joint by next to nothing.
    let xml = r#"<robot name="finger"><link name="l0"/><link name="l1"/><link name="l2"/><link name="l3"/>
        <joint name="locked" type="revolute"><parent link="l0"/><child link="l1"/><axis xyz="0 1 0"/>
            <limit lower="0" upper="0" effort="1" velocity="1"/></joint>
        <joint name="half" type="continuous"><origin xyz="0 0 0.05"/><parent link="l1"/><child link="l2"/>
            <axis xyz="0 1 0"/></joint>
        <joint name="follower" type="revolute"><parent link="l0"/><child link="l3"/><axis xyz="0 1 0"/>
            <limit lower="0" upper="1" effort="1" velocity="1"/><mimic joint="half" multiplier="1e-320"/></joint>
        </robot>"#;
    let model = RobotModel::from_urdf(xml).unwrap();
    let half = &model.joints()[1];
    assert_eq!((half.lower, half.upper), (0.0, f64::INFINITY));
    let hand = CompiledHand::new(&model, Root::Fixed, &[(2, Point3::new(0.0, 0.0, 0.04))]).unwrap();
    let mut solver = Solver::new(&hand);
    let target = Target {
        point: 0,
        point_in_object: Point3::new(-0.02, 0.0, 0.08),
        weight: 1.0,
    };
    let task = Task {
        targets: &[target],
        ..EMPTY_TASK
    };
    let start = Posture::new(&Pose::identity(), vec![0.0, 0.3]);
    let mut once = start.clone();
    let searched = solver
        .minimize(&task, &mut once, &OPTIONS, &mut NoTerms)
        .unwrap();
    assert_eq!(once.q, [0.0, 0.0]);
    let mut unbent = start;
    let outcome = solver
        .minimize_with_flips(&task, &mut unbent, &OPTIONS, &mut NoTerms)
        .unwrap();
    assert_eq!((unbent, outcome), (once, searched));
}

#[test]
fn refuses_tasks_that_do_not_fit_the_hand() {
    let model = made_up();
    let hand = CompiledHand::new(&model, Root::Free, &attached(&model)).unwrap();
    let mut solver = Solver::new(&hand);
    let start = Posture::new(&Pose::identity(), vec![0.2; model.dof()]);
    let target = Target {
        point: 0,
        point_in_object: Point3::origin(),
        weight: 1.0,
    };
    let mut check = |target: Target, posture: &Posture, expected: &str| {
        let task = Task {
            targets: &[target],
            ..EMPTY_TASK
        };
        let err = solver
            .minimize(&task, &mut posture.clone(), &OPTIONS, &mut NoTerms)
            .unwrap_err();
        assert_eq!(err.to_string(), expected);
    };
    let nowhere = Point3::new(0.0, f64::NAN, 0.0);
    check(
        Target {
            point_in_object: nowhere,
            ..target
        },
        &start,
        "target 0 is not a usable number",
    );
    check(
        Target {
            weight: -1.0,
            ..target
        },
        &start,
        "a target's weight is not a usable number",
    );
    check(
        Target { point: 8, ..target },
        &start,
        "no point 8, 8 are attached",
    );
    let short = Posture {
        q: vec![0.0; 2],
        ..start.clone()
    };
    check(target, &short, "2 joint positions, expected 10");
    let mut lost = start;
    lost.q[1] = f64::INFINITY;
    check(target, &lost, "a joint position is not a usable number");
    assert_eq!(
        CompiledHand::new(&model, Root::Free, &[(99, Point3::origin())]).unwrap_err(),
        SolverError::NoLink { link: 99 }
    );
}
