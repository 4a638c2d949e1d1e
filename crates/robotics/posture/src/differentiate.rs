//! The cost's first two derivatives at a posture.

use nalgebra::{Matrix3, Vector3};

use crate::{
    compiled::Root,
    evaluate::{Evaluation, NOBODY, State, columns},
    moments::{HessianForm, Moments, SpatialVector},
    task::Task,
};

impl Evaluation<'_> {
    /// Computes the derivatives at the posture whose cost was last computed, which is `state`.
    pub(crate) fn differentiate(&mut self, state: &State, task: &Task<'_>, form: HessianForm) {
        self.gradient.fill(0.0);
        self.hessian.fill(0.0);
        self.gather(form);
        self.gather_vectors(form);
        self.joints(form);
        self.couple_ends(form);
        if self.hand.layout.n_root > 0 {
            self.root_block(state, task);
        }
        self.springs(state, task);
        self.pair_slopes();
        self.pair_rows();
    }

    /// Computes the gradient alone, at the posture whose cost was last computed, which is `state`.
    pub(crate) fn slopes(&mut self, state: &State, task: &Task<'_>) {
        let hand = self.hand;
        let layout = &hand.layout;
        self.gradient.fill(0.0);
        self.wrenches.fill(SpatialVector::ZERO);
        for pull in &self.pulls {
            self.wrenches[pull.body].add_force(&pull.r, &pull.slope);
        }
        for residual in &self.residuals {
            let Some(point) = hand.points.get(residual.point) else {
                continue;
            };
            let frame = &self.frames[point.body];
            let r = frame.origin + frame.rotation * point.offset;
            let slope = 2.0 * residual.weight * residual.weight * residual.residual;
            self.wrenches[point.body].add_force(&r, &(residual.gradient_in_object * slope));
        }
        for (idx, body) in hand.bodies.iter().enumerate().skip(1).rev() {
            let wrench = self.wrenches[idx];
            let twist = self.frames[idx].twist(body.is_prismatic);
            self.gradient[layout.unknowns[idx]] += body.multiplier * wrench.dot(&twist);
            self.wrenches[body.parent].add(&wrench);
        }
        if layout.n_root > 0 {
            let wrench = self.wrenches[0];
            let turn = match self.root_turns() {
                Some(turns) => turns.tr_mul(&wrench.angular),
                None => wrench.angular,
            };
            for a in 0..3 {
                self.gradient[a] += wrench.linear[a];
                self.gradient[3 + a] += turn[a];
            }
            if let Some(smoothness) = &task.smoothness
                && smoothness.root_weight > 0.0
            {
                let weight = 2.0 * smoothness.root_weight;
                let (along, turned) = self.root_motion(&state.root, &smoothness.posture.root);
                for a in 0..3 {
                    self.gradient[a] += weight * along[a];
                    self.gradient[3 + a] += weight * turned[a];
                }
            }
        }
        let joints = &layout.joints;
        let gradient = &mut self.gradient[layout.n_root..];
        let mut add = |before: &[f64], weight: f64| {
            for ((slope, q), &joint) in gradient.iter_mut().zip(&state.q).zip(joints) {
                *slope += 2.0 * weight * (q - before[joint]);
            }
        };
        if let Some(smoothness) = &task.smoothness
            && smoothness.joint_weight > 0.0
        {
            add(&smoothness.posture.q, smoothness.joint_weight);
        }
        if let Some(prior) = &task.prior {
            add(prior.q, prior.weight);
        }
        self.pair_slopes();
    }

    /// Gathers the moments of each body's own terms.
    ///
    /// Afterwards `carriers` names, for each body, whose memory holds its moments so far.
    fn gather(&mut self, form: HessianForm) {
        self.carriers.fill(NOBODY);
        for pull in &self.pulls {
            let curvature = match form {
                HessianForm::Exact => &pull.curvature,
                HessianForm::Convex => &pull.convex,
            };
            let moments = own(&mut self.moments, &mut self.carriers, pull.body);
            moments.add_point(&pull.r, &pull.slope, curvature, form);
        }
        for residual in &self.residuals {
            let Some(point) = self.hand.points.get(residual.point) else {
                continue;
            };
            let frame = &self.frames[point.body];
            let r = frame.origin + frame.rotation * point.offset;
            let curvature = 2.0 * residual.weight * residual.weight;
            let slope = curvature * residual.residual;
            let moments = own(&mut self.moments, &mut self.carriers, point.body);
            moments.add_line(&r, &residual.gradient_in_object, slope, curvature, form);
        }
    }

    /// Returns a body's own moments.
    pub(crate) fn own_moments(&mut self, body: usize) -> &mut Moments {
        own(&mut self.moments, &mut self.carriers, body)
    }

    /// Adds what every joint and pair of joints says, from the tips to the root.
    fn joints(&mut self, form: HessianForm) {
        let hand = self.hand;
        let layout = &hand.layout;
        let turns = self.root_turns();
        let frames = self.twists.iter_mut().zip(&self.frames);
        for ((twist, frame), body) in frames.zip(&hand.bodies) {
            *twist = frame.twist(body.is_prismatic);
        }
        for (idx, body) in hand.bodies.iter().enumerate().skip(1).rev() {
            let carrier = self.carriers[idx];
            if carrier == NOBODY {
                continue;
            }
            let moments = &self.moments[carrier];
            let twist = &self.twists[idx];
            let unknown = layout.unknowns[idx];
            self.gradient[unknown] += body.multiplier * moments.slope(twist);
            let change = moments.curvature(twist, form);
            if layout.n_root > 0 {
                let turn = match &turns {
                    Some(turns) => turns.tr_mul(&change.angular),
                    None => change.angular,
                };
                let row = &mut self.hessian[unknown * layout.stride..][..6];
                for axis in 0..3 {
                    row[axis] += body.multiplier * change.linear[axis];
                    row[3 + axis] += body.multiplier * turn[axis];
                }
            }
            let (first, last) = layout.pairs_of[idx];
            for pair in &layout.pairs[first..last] {
                self.hessian[pair.place] += pair.factor * self.twists[pair.above].dot(&change);
            }
            // All below is done: the parent may take the memory over.
            let parent = body.parent;
            match self.carriers[parent] {
                NOBODY => self.carriers[parent] = carrier,
                other => {
                    let moments = self.moments[carrier];
                    self.moments[other].add(&moments);
                }
            }
        }
    }

    /// Returns the axes of the root's three angles, in the object's frame; `None` where it has none.
    pub(crate) fn root_turns(&self) -> Option<Matrix3<f64>> {
        if self.hand.root != Root::Angles {
            return None;
        }
        // The third axis is the root's own z; the second one is the new y after the first turn.
        let [_, _, third] = columns(&self.root.rotation);
        Some(Matrix3::from_columns(&[
            Vector3::x(),
            self.root.second_axis,
            third,
        ]))
    }

    /// Adds what the root's own six unknowns say.
    fn root_block(&mut self, state: &State, task: &Task<'_>) {
        let carrier = self.carriers[0];
        let moments = if carrier == NOBODY {
            &Moments::ZERO
        } else {
            &self.moments[carrier]
        };
        let (linear, mixed, mut angular) = moments.root();
        let mut moment = moments.moment;
        let mut mixed = *mixed;
        if let Some(turns) = self.root_turns() {
            moment = turns.tr_mul(&moment);
            mixed *= turns;
            // The earlier axis is above the later one.
            let upper = turns.tr_mul(&(moments.angular() * turns));
            for (a, b) in [(0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2)] {
                angular[(a, b)] = upper[(a, b)];
                angular[(b, a)] = upper[(a, b)];
            }
        }
        let stride = self.hand.layout.stride;
        for a in 0..3 {
            self.gradient[a] += moments.force[a];
            self.gradient[3 + a] += moment[a];
            for b in 0..=a {
                self.hessian[a * stride + b] += linear[(a, b)];
                self.hessian[(3 + a) * stride + 3 + b] += angular[(a, b)];
            }
            for b in 0..3 {
                self.hessian[(3 + a) * stride + b] += mixed[(b, a)];
            }
        }
        let Some(smoothness) = &task.smoothness else {
            return;
        };
        if smoothness.root_weight > 0.0 {
            let weight = 2.0 * smoothness.root_weight;
            let (along, turned) = self.root_motion(&state.root, &smoothness.posture.root);
            let bend = match self.hand.root {
                // The logarithm's second derivative, to second order in the angle.
                Root::Free => turned.cross_matrix() * turned.cross_matrix() / 12.0,
                Root::Angles | Root::Fixed => Matrix3::zeros(),
            };
            for a in 0..3 {
                self.gradient[a] += weight * along[a];
                self.gradient[3 + a] += weight * turned[a];
                self.hessian[a * stride + a] += weight;
                self.hessian[(3 + a) * stride + 3 + a] += weight;
                for b in 0..=a {
                    self.hessian[(3 + a) * stride + 3 + b] += weight * bend[(a, b)];
                }
            }
        }
    }

    /// Adds what joints say of their motion and their distance from rest.
    fn springs(&mut self, state: &State, task: &Task<'_>) {
        let layout = &self.hand.layout;
        let mut add = |before: &[f64], weight: f64| {
            for (slot, (q, &joint)) in state.q.iter().zip(&layout.joints).enumerate() {
                let unknown = layout.n_root + slot;
                self.gradient[unknown] += 2.0 * weight * (q - before[joint]);
                self.hessian[layout.diagonal[unknown]] += 2.0 * weight;
            }
        };
        if let Some(smoothness) = &task.smoothness
            && smoothness.joint_weight > 0.0
        {
            add(&smoothness.posture.q, smoothness.joint_weight);
        }
        if let Some(prior) = &task.prior {
            add(prior.q, prior.weight);
        }
    }
}

/// Returns a body's own moments, cleared when first asked for.
#[inline]
fn own<'a>(moments: &'a mut [Moments], carriers: &mut [usize], body: usize) -> &'a mut Moments {
    let moments = &mut moments[body];
    if carriers[body] == NOBODY {
        carriers[body] = body;
        *moments = Moments::ZERO;
    }
    moments
}
