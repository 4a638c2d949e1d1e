//! What is minimized for one step, and its derivatives.

use nalgebra::{DMatrix, DVector, Isometry3, Point3, Vector3};

use crate::{
    RetargetConfig,
    goal::Goal,
    hand::{Hand, Posture},
    scene::{Gap, Scene},
};

/// Weight that draws joints without any other say to the middle of their range, in m/rad: far below
/// what a landmark says, enough to make the answer unique.
const TIE_BREAK_WEIGHT: f64 = 1e-3;

/// The function to minimize for one step: a sum of squares.
///
/// The paper's objective (§III-A), `Σ‖J_i(q_t) − j_i‖² + λ‖J_i(q_t) − J_i(q_{t−1})‖²`, and beside it
/// one-sided terms for the object and the table, a two-sided one for contacts, and two on joints.
pub(crate) struct Objective<'a> {
    /// The hand.
    pub(crate) hand: &'a Hand,
    /// The object and the table; `None` leaves both out.
    pub(crate) scene: Option<&'a Scene>,
    /// The weights.
    pub(crate) config: &'a RetargetConfig,
    /// What the step asks.
    pub(crate) goal: &'a Goal,
    /// The middle of each joint's range.
    pub(crate) mid_range: &'a [f64],
}

/// Where balls were when their distance was last asked, so that far ones need no further question.
#[derive(Debug, Clone, Default)]
pub(crate) struct Memory {
    asked: Vec<Option<(Point3<f64>, f64)>>,
}

/// The objective at one posture, with all that its derivatives need.
#[derive(Debug, Clone)]
pub(crate) struct Evaluation {
    /// The posture.
    pub(crate) posture: Posture,
    /// The value, in m².
    pub(crate) cost: f64,
    /// Where the hand's points are, in the object frame.
    pub(crate) points: Vec<Point3<f64>>,
    object_from_links: Vec<Isometry3<f64>>,
    contacts: Vec<Option<Gap>>,
    pushes: Vec<Push>,
}

/// A ball that is where it must not be.
#[derive(Debug, Clone, Copy)]
struct Push {
    link: usize,
    center: Point3<f64>,
    /// Where to: a unit vector in the object frame.
    away: Vector3<f64>,
    /// How far, in meters.
    depth_m: f64,
    weight: f64,
}

/// The objective to second order: `cost + 2 gradientᵀ x + xᵀ hessian x` (Gauss-Newton).
#[derive(Debug, Clone)]
pub(crate) struct Quadratic {
    /// Half the gradient, `(6 + dof)`.
    pub(crate) gradient: DVector<f64>,
    /// Half the Hessian without second derivatives of residuals, `(6 + dof, 6 + dof)`.
    pub(crate) hessian: DMatrix<f64>,
}

impl Objective<'_> {
    /// Returns the number of unknowns: six of the palm and one per joint.
    pub(crate) fn dim(&self) -> usize {
        6 + self.hand.model.dof()
    }

    /// Evaluates the objective at a posture.
    pub(crate) fn evaluate(&self, posture: Posture, memory: &mut Memory) -> Evaluation {
        let object_from_links = self.hand.object_from_links(&posture);
        let mut cost = 0.0;
        let mut points = Vec::with_capacity(self.hand.points.len());
        let mut contacts = Vec::with_capacity(self.hand.points.len());
        for (idx, (point, goal)) in self.hand.points.iter().zip(&self.goal.points).enumerate() {
            let at = object_from_links
                .get(point.link)
                .map_or(goal.landmark, |object_from_link| {
                    object_from_link * point.point_in_link
                });
            cost += goal.weight.powi(2) * (at - goal.landmark).norm_squared();
            if let Some(before) = self.goal.previous.as_ref().and_then(|p| p.points.get(idx)) {
                cost += self.config.smoothness_weight.powi(2) * (at - before).norm_squared();
            }
            let gap = goal.contact.zip(self.scene).map(|(contact, scene)| {
                let gap = scene.gap(&at);
                cost += (contact.weight * (gap.distance_m - contact.distance_m)).powi(2);
                gap
            });
            points.push(at);
            contacts.push(gap);
        }
        let (q_before, joint_weight) = self.joint_anchor();
        for (q, before) in posture.q.iter().zip(q_before) {
            cost += (joint_weight * (q - before)).powi(2);
        }
        let pushes = self.pushes(&object_from_links, memory);
        cost += pushes
            .iter()
            .map(|push| (push.weight * push.depth_m).powi(2))
            .sum::<f64>();
        Evaluation {
            posture,
            cost,
            points,
            object_from_links,
            contacts,
            pushes,
        }
    }

    /// Returns the joint positions to stay near, and with which weight in m/rad.
    fn joint_anchor(&self) -> (&[f64], f64) {
        match &self.goal.previous {
            Some(previous) if self.config.joint_smoothness_weight > 0.0 => {
                (&previous.q, self.config.joint_smoothness_weight)
            }
            Some(_) | None => (self.mid_range, TIE_BREAK_WEIGHT),
        }
    }

    /// Returns the balls that are inside the object, its clearance or the table's margin.
    fn pushes(&self, object_from_links: &[Isometry3<f64>], memory: &mut Memory) -> Vec<Push> {
        let mut pushes = Vec::new();
        let Some(scene) = self.scene else {
            return pushes;
        };
        memory.asked.resize(self.hand.balls.len(), None);
        for (ball, asked) in self.hand.balls.iter().zip(&mut memory.asked) {
            let Some(center) = crate::balls::center(ball, object_from_links) else {
                continue;
            };
            let mut push = |away: Vector3<f64>, depth_m: f64, weight: f64| {
                pushes.push(Push {
                    link: ball.link,
                    center,
                    away,
                    depth_m,
                    weight,
                });
            };
            if self.config.table_weight > 0.0 {
                let needed = ball.radius_m + self.config.table_margin_m;
                let height = scene.height_m(&center);
                if height < needed {
                    push(scene.up(), needed - height, self.config.table_weight);
                }
            }
            if self.config.object_weight > 0.0 {
                let needed = ball.radius_m + self.goal.clearance_m;
                // A distance changes by no more than the way gone since it was asked.
                let is_far = asked.is_some_and(|(at, distance): (Point3<f64>, f64)| {
                    distance - (center - at).norm() > needed
                });
                if !is_far {
                    let gap = scene.gap(&center);
                    *asked = Some((center, gap.distance_m));
                    if gap.distance_m < needed {
                        push(gap.away, needed - gap.distance_m, self.config.object_weight);
                    }
                }
            }
        }
        pushes
    }

    /// Returns the objective to second order about an evaluated posture.
    pub(crate) fn expand(&self, at: &Evaluation) -> Quadratic {
        let mut quadratic = Quadratic {
            gradient: DVector::zeros(self.dim()),
            hessian: DMatrix::zeros(self.dim(), self.dim()),
        };
        let mut columns = Vec::with_capacity(self.dim());
        let goals = self.hand.points.iter().zip(&self.goal.points);
        for (idx, ((point, goal), found)) in goals.zip(&at.points).enumerate() {
            self.columns(at, point.link, found, &mut columns);
            let position = goal.weight.powi(2);
            let mut pull = (found - goal.landmark) * position;
            let mut stiffness = position;
            if let Some(before) = self.goal.previous.as_ref().and_then(|p| p.points.get(idx)) {
                let smoothness = self.config.smoothness_weight.powi(2);
                pull += (found - before) * smoothness;
                stiffness += smoothness;
            }
            quadratic.add_vector(&columns, &pull, stiffness);
            if let (Some(contact), Some(gap)) =
                (goal.contact, at.contacts.get(idx).copied().flatten())
            {
                let residual = gap.distance_m - contact.distance_m;
                quadratic.add_scalar(&columns, &gap.away, residual, contact.weight.powi(2));
            }
        }
        for push in &at.pushes {
            self.columns(at, push.link, &push.center, &mut columns);
            quadratic.add_scalar(&columns, &push.away, -push.depth_m, push.weight.powi(2));
        }
        let (q_before, joint_weight) = self.joint_anchor();
        for (joint, (q, before)) in at.posture.q.iter().zip(q_before).enumerate() {
            if let Some(gradient) = quadratic.gradient.get_mut(6 + joint) {
                *gradient += joint_weight.powi(2) * (q - before);
            }
            if let Some(diagonal) = quadratic.hessian.get_mut((6 + joint, 6 + joint)) {
                *diagonal += joint_weight.powi(2);
            }
        }
        quadratic
    }

    /// Collects the derivatives of a point of a link, in the object frame, by each unknown that
    /// moves it.
    fn columns(
        &self,
        at: &Evaluation,
        link: usize,
        point: &Point3<f64>,
        columns: &mut Vec<(usize, Vector3<f64>)>,
    ) {
        columns.clear();
        let arm = point.coords - at.posture.object_from_palm.translation.vector;
        for (axis, unit) in [Vector3::x(), Vector3::y(), Vector3::z()]
            .into_iter()
            .enumerate()
        {
            columns.push((axis, unit));
            columns.push((3 + axis, unit.cross(&arm)));
        }
        // The links' poses are given in the object frame here, and so are the derivatives.
        let model = &self.hand.model;
        model.visit_point_jacobian(&at.object_from_links, link, point, |joint, column| {
            columns.push((6 + joint, column));
        });
    }
}

impl Evaluation {
    /// Returns the greatest depth of a link inside the object or its clearance, in meters.
    pub(crate) fn object_depth_m(&self, scene: &Scene, hand: &Hand) -> f64 {
        hand.balls
            .iter()
            .filter_map(|ball| {
                let center = crate::balls::center(ball, &self.object_from_links)?;
                Some(ball.radius_m - scene.gap(&center).distance_m)
            })
            .fold(0.0, f64::max)
    }

    /// Returns the greatest depth of a link below the table, in meters.
    pub(crate) fn table_depth_m(&self, scene: &Scene, hand: &Hand) -> f64 {
        hand.balls
            .iter()
            .filter_map(|ball| {
                let center = crate::balls::center(ball, &self.object_from_links)?;
                Some(ball.radius_m - scene.height_m(&center))
            })
            .fold(0.0, f64::max)
    }
}

impl Quadratic {
    /// Adds a residual of three numbers whose gradient by the point is `pull` and whose curvature
    /// is `stiffness` in every direction.
    fn add_vector(
        &mut self,
        columns: &[(usize, Vector3<f64>)],
        pull: &Vector3<f64>,
        stiffness: f64,
    ) {
        for (n, &(i, a)) in columns.iter().enumerate() {
            self.gradient[i] += a.dot(pull);
            for &(j, b) in columns.iter().take(n + 1) {
                self.add(i, j, stiffness * a.dot(&b));
            }
        }
    }

    /// Adds a residual of one number that grows along `direction`.
    fn add_scalar(
        &mut self,
        columns: &[(usize, Vector3<f64>)],
        direction: &Vector3<f64>,
        residual: f64,
        weight: f64,
    ) {
        for (n, &(i, a)) in columns.iter().enumerate() {
            let a = a.dot(direction);
            self.gradient[i] += weight * a * residual;
            for &(j, b) in columns.iter().take(n + 1) {
                self.add(i, j, weight * a * b.dot(direction));
            }
        }
    }

    /// Adds to an entry and its mirror image.
    fn add(&mut self, i: usize, j: usize, value: f64) {
        self.hessian[(i, j)] += value;
        if i != j {
            self.hessian[(j, i)] += value;
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::{
        fixture,
        goal::{ContactGoal, PointGoal, Previous},
    };

    /// Any posture about the box, near enough to touch it.
    fn posture() -> impl Strategy<Value = Posture> {
        let part = |reach: f64| prop::array::uniform3(-reach..reach).prop_map(Vector3::from);
        (part(0.12), part(3.0), prop::collection::vec(-0.1..1.1, 16)).prop_map(|(t, r, q)| {
            Posture {
                object_from_palm: Isometry3::new(t, r),
                q,
            }
        })
    }

    fn goal(clearance_m: f64) -> Goal {
        let point = |i: usize| Point3::new(0.03 * i as f64 - 0.1, 0.08, 0.02 * i as f64);
        Goal {
            points: (0..9)
                .map(|i| PointGoal {
                    landmark: point(i),
                    weight: if i < 4 { 1.0 } else { 0.3 },
                    contact: (i < 2).then_some(ContactGoal {
                        distance_m: 0.012,
                        weight: 3.0,
                    }),
                })
                .collect(),
            clearance_m,
            previous: Some(Previous {
                points: (0..9)
                    .map(|i| point(i) + Vector3::new(0.01, 0.02, 0.0))
                    .collect(),
                q: vec![0.4; 16],
            }),
        }
    }

    proptest! {
        /// The gradient of everything at once against central differences, to 1e-4 of its length.
        #[test]
        fn gradient_is_the_derivative(posture in posture()) {
            const STEP: f64 = 1e-7;
            let config = fixture::config();
            let hand = fixture::hand();
            let scene = fixture::scene();
            let goal = goal(0.008);
            let mid_range = hand.model.mid_range();
            let objective = Objective {
                hand: &hand,
                scene: Some(&scene),
                config: &config,
                goal: &goal,
                mid_range: &mid_range,
            };
            let at = objective.evaluate(posture.clone(), &mut Memory::default());
            let quadratic = objective.expand(&at);
            let slope = |i: usize, by: f64| {
                let mut step = vec![0.0; objective.dim()];
                step[i] = by;
                let (lower, upper) = (vec![f64::NEG_INFINITY; 16], vec![f64::INFINITY; 16]);
                let moved = posture.moved(&step, &lower, &upper);
                (objective.evaluate(moved, &mut Memory::default()).cost - at.cost) / by
            };
            let ahead = DVector::from_fn(objective.dim(), |i, _| slope(i, STEP));
            let behind = DVector::from_fn(objective.dim(), |i, _| slope(i, -STEP));
            // Where two sides of the box are equally near, the distance has a kink: no derivative.
            prop_assume!((&ahead - &behind).norm() < 1e-4 * ahead.norm() + 1e-5);
            let numeric = (ahead + behind) / 2.0;
            let difference = (&numeric - &quadratic.gradient * 2.0).norm();
            prop_assert!(
                difference < 1e-4 * numeric.norm() + 1e-6,
                "{difference:e} of {:e}",
                numeric.norm()
            );
        }

        /// Asking only about near balls leaves nothing out, wherever the hand was before.
        #[test]
        fn memory_does_not_change_the_value(before in posture(), now in posture()) {
            let config = fixture::config();
            let hand = fixture::hand();
            let scene = fixture::scene();
            let goal = goal(0.008);
            let mid_range = hand.model.mid_range();
            let objective = Objective {
                hand: &hand,
                scene: Some(&scene),
                config: &config,
                goal: &goal,
                mid_range: &mid_range,
            };
            let mut memory = Memory::default();
            objective.evaluate(before, &mut memory);
            let remembered = objective.evaluate(now.clone(), &mut memory).cost;
            prop_assert_eq!(remembered, objective.evaluate(now, &mut Memory::default()).cost);
        }
    }
}
