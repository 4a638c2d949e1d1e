//! Dependencies between unknowns, and the place of each pair in the normal equations.

use crate::{
    SolverError,
    compiled::{Body, BodyPoint, Root},
};

/// Maximum number of unknowns of one finger, and of the trunk.
pub(crate) const MAX_JOINTS: usize = 64;

/// The order of the unknowns and the places of their second derivatives.
///
/// First the trunk: the root's six unknowns and the joints that move more than one finger. Then
/// finger by finger. Two fingers share no second derivative, so that the matrix is an arrow: one
/// block per finger, bordered by the trunk.
/// It is stored by rows of `stride` numbers, one row per unknown: first those with the trunk (in
/// the trunk's own rows up to the diagonal), then those with the same finger (from the diagonal on).
#[derive(Debug, Clone)]
pub(crate) struct Layout {
    /// Number of unknowns.
    pub(crate) n: usize,
    /// Number of the root's unknowns: 6 or 0.
    pub(crate) n_root: usize,
    /// Number of the trunk's unknowns, the root's among them.
    pub(crate) n_trunk: usize,
    /// Numbers in a row.
    pub(crate) stride: usize,
    /// The model's joint of each unknown after the root's.
    pub(crate) joints: Vec<usize>,
    /// First unknown and number of unknowns of each finger.
    pub(crate) fingers: Vec<(usize, usize)>,
    /// The unknown of each body; not used for the root.
    pub(crate) unknowns: Vec<usize>,
    /// Place of each unknown's own second derivative.
    pub(crate) diagonal: Vec<usize>,
    /// Pairs of a body with itself and with each one above it, body by body.
    pub(crate) pairs: Vec<Pair>,
    /// First and last pair of each body.
    pub(crate) pairs_of: Vec<(usize, usize)>,
}

/// A body above another one, or the same.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Pair {
    /// The upper body.
    pub(crate) above: usize,
    /// Index at which the pair's second derivative is added.
    pub(crate) place: usize,
    /// Factor on it: the multipliers of mimicking joints, twice if both are one unknown.
    pub(crate) factor: f64,
}

impl Layout {
    /// Lays out the unknowns of these bodies.
    pub(crate) fn new(
        root: Root,
        bodies: &[Body],
        points: &[BodyPoint],
        dof: usize,
    ) -> Result<Self, SolverError> {
        Self::of_groups(root, bodies, &groups(bodies, points, dof))
    }

    /// Lays out the unknowns of these bodies with all of them in the trunk: every pair has a place.
    pub(crate) fn coupled(root: Root, bodies: &[Body], dof: usize) -> Result<Self, SolverError> {
        Self::of_groups(root, bodies, &vec![None; dof])
    }

    fn of_groups(
        root: Root,
        bodies: &[Body],
        group_of_joint: &[Option<usize>],
    ) -> Result<Self, SolverError> {
        let dof = group_of_joint.len();
        let n_root = match root {
            Root::Fixed => 0,
            Root::Free | Root::Angles => 6,
        };
        let n_groups = group_of_joint.iter().flatten().map(|&g| g + 1).max();
        let mut joints: Vec<usize> = (0..dof).filter(|&j| group_of_joint[j].is_none()).collect();
        let n_trunk = n_root + joints.len();
        let mut fingers = Vec::new();
        for group in 0..n_groups.unwrap_or(0) {
            let first = n_root + joints.len();
            joints.extend((0..dof).filter(|&j| group_of_joint[j] == Some(group)));
            let len = n_root + joints.len() - first;
            if len > 0 {
                fingers.push((first, len));
            }
        }
        let longest = fingers.iter().map(|&(_, len)| len).max().unwrap_or(0);
        if n_trunk.max(longest) > MAX_JOINTS {
            return Err(SolverError::TooManyJoints {
                found: n_trunk.max(longest),
                most: MAX_JOINTS,
            });
        }
        let mut layout = Self {
            n: n_root + dof,
            n_root,
            n_trunk,
            stride: n_trunk + longest,
            joints,
            fingers,
            unknowns: Vec::new(),
            diagonal: Vec::new(),
            pairs: Vec::new(),
            pairs_of: Vec::new(),
        };
        layout.diagonal = (0..layout.n).filter_map(|u| layout.place(u, u)).collect();
        let mut unknown_of_joint = vec![0; dof];
        for (slot, &joint) in layout.joints.iter().enumerate() {
            unknown_of_joint[joint] = n_root + slot;
        }
        layout.unknowns = bodies
            .iter()
            .map(|body| unknown_of_joint.get(body.joint).copied().unwrap_or(0))
            .collect();
        layout.pair(bodies);
        Ok(layout)
    }

    /// Returns the finger of an unknown and its number in it; `None` if it is the trunk's.
    fn finger(&self, unknown: usize) -> Option<(usize, usize)> {
        let of = |&(first, len): &(usize, usize)| (first..first + len).contains(&unknown);
        let finger = self.fingers.iter().position(of)?;
        Some((finger, unknown - self.fingers[finger].0))
    }

    /// Returns the index of the second derivative by two unknowns; `None` if it is always 0.
    pub(crate) fn place(&self, a: usize, b: usize) -> Option<usize> {
        match (self.finger(a), self.finger(b)) {
            (None, None) => Some(a.max(b) * self.stride + a.min(b)),
            (None, Some(_)) => Some(b * self.stride + a),
            (Some(_), None) => Some(a * self.stride + b),
            (Some((f, i)), Some((g, j))) if f == g => {
                Some(a.min(b) * self.stride + self.n_trunk + i.max(j))
            }
            (Some(_), Some(_)) => None,
        }
    }

    /// Returns the places of the second derivatives by all pairs of unknowns, `(unknown, unknown)`; 0 where there is
    /// none, which is never asked for.
    pub(crate) fn places(&self) -> Vec<usize> {
        let pairs = (0..self.n).flat_map(|a| (0..self.n).map(move |b| (a, b)));
        pairs.map(|(a, b)| self.place(a, b).unwrap_or(0)).collect()
    }

    /// Writes the matrix times a vector to `product`.
    pub(crate) fn product(&self, hessian: &[f64], vector: &[f64], product: &mut [f64]) {
        let n_trunk = self.n_trunk;
        product.fill(0.0);
        for a in 0..n_trunk {
            let row = &hessian[a * self.stride..][..=a];
            let (last, others) = (row[a], &row[..a]);
            let mut sum = last * vector[a];
            for (b, &value) in others.iter().enumerate() {
                sum += value * vector[b];
                product[b] += value * vector[a];
            }
            product[a] += sum;
        }
        for &(first, len) in &self.fingers {
            for i in 0..len {
                let u = first + i;
                let row = &hessian[u * self.stride..][..self.stride];
                let (trunk, finger) = row.split_at(n_trunk);
                let mut sum = finger[i] * vector[u];
                for (b, &value) in trunk.iter().enumerate() {
                    sum += value * vector[b];
                    product[b] += value * vector[u];
                }
                for (j, &value) in finger[..len].iter().enumerate().skip(i + 1) {
                    sum += value * vector[first + j];
                    product[first + j] += value * vector[u];
                }
                product[u] += sum;
            }
        }
    }

    /// Returns one element of the matrix times a vector.
    pub(crate) fn product_at(&self, hessian: &[f64], vector: &[f64], u: usize) -> f64 {
        let row = &hessian[u * self.stride..][..self.stride];
        let (trunk, finger) = row.split_at(self.n_trunk);
        let Some((f, i)) = self.finger(u) else {
            let trunk =
                (0..self.n_trunk).map(|b| hessian[u.max(b) * self.stride + u.min(b)] * vector[b]);
            let fingers = (self.n_trunk..self.n).map(|v| hessian[v * self.stride + u] * vector[v]);
            return trunk.chain(fingers).sum();
        };
        let (first, len) = self.fingers[f];
        let mut sum: f64 = trunk.iter().zip(vector).map(|(a, b)| a * b).sum();
        for (j, value) in vector[first..first + len].iter().enumerate() {
            let place = (first + i.min(j)) * self.stride + self.n_trunk + i.max(j);
            sum += value * if j < i { hessian[place] } else { finger[j] };
        }
        sum
    }

    fn pair(&mut self, bodies: &[Body]) {
        for (idx, body) in bodies.iter().enumerate() {
            let first = self.pairs.len();
            let mut above = idx;
            while above != 0 {
                let (a, b) = (self.unknowns[idx], self.unknowns[above]);
                if let Some(place) = self.place(a, b) {
                    let twice = if above != idx && a == b { 2.0 } else { 1.0 };
                    self.pairs.push(Pair {
                        above,
                        place,
                        factor: twice * body.multiplier * bodies[above].multiplier,
                    });
                }
                above = bodies[above].parent;
            }
            self.pairs_of.push((first, self.pairs.len()));
        }
    }
}

/// Returns the finger of each joint; `None` for those of the trunk.
///
/// From the root on, a body below which everything hangs is the trunk's; where the tree first
/// branches, each branch is a finger. A joint that moves bodies of several fingers is the trunk's.
fn groups(bodies: &[Body], points: &[BodyPoint], dof: usize) -> Vec<Option<usize>> {
    let mut carries = vec![false; bodies.len()];
    for point in points {
        carries[point.body] = true;
    }
    for idx in (1..bodies.len()).rev() {
        carries[bodies[idx].parent] |= carries[idx];
    }
    let carries = &carries;
    let below = |parent: usize| {
        (1..bodies.len()).filter(move |&idx| bodies[idx].parent == parent && carries[idx])
    };
    let mut is_trunk = vec![false; bodies.len()];
    is_trunk[0] = true;
    let mut last = 0;
    while let Some(only) = below(last).next() {
        let branches = below(last).count() > 1;
        let ends = below(only).next().is_none();
        if branches || ends {
            break;
        }
        is_trunk[only] = true;
        last = only;
    }
    // Each body's finger is that of its parent, or a new one below the trunk.
    let mut finger = vec![None; bodies.len()];
    let mut n_fingers = 0;
    for idx in 1..bodies.len() {
        if is_trunk[idx] {
            continue;
        }
        let parent = bodies[idx].parent;
        finger[idx] = finger[parent].or_else(|| {
            n_fingers += 1;
            Some(n_fingers - 1)
        });
    }
    (0..dof)
        .map(|joint| {
            let mut moved = (1..bodies.len()).filter(|&idx| bodies[idx].joint == joint);
            let first = finger[moved.next()?];
            moved.all(|idx| finger[idx] == first).then_some(first)?
        })
        .collect()
}
