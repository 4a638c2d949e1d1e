//! RRT-Connect: two trees that grow towards each other.

use rand::Rng;

use crate::{
    configuration::{Configuration, Metric, Region},
    tree::Tree,
};

/// Parameters of the growth of two trees.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Growth {
    /// Distances and their weights.
    pub metric: Metric,
    /// Greatest length of an edge, in the metric.
    pub step: f64,
    /// Greatest distance between two checked configurations of an edge, in the metric.
    pub spacing: f64,
    /// Share of the targets that are drawn; the others are the other tree's root.
    pub drawn_share: f64,
    /// Number of nodes of both trees at which the search ends.
    pub max_nodes: usize,
    /// Number of checks at which the search ends.
    pub max_checks: u64,
}

/// Collision check of configurations, with a count.
pub(crate) struct Checked<'a> {
    free: &'a dyn Fn(&Configuration) -> bool,
    /// Configurations checked.
    pub(crate) checks_n: u64,
}

impl<'a> Checked<'a> {
    /// Takes the check that says whether a configuration is free.
    pub(crate) fn new(free: &'a dyn Fn(&Configuration) -> bool) -> Self {
        Self { free, checks_n: 0 }
    }

    /// Says whether a configuration is free.
    pub(crate) fn is_free(&mut self, at: &Configuration) -> bool {
        self.checks_n += 1;
        (self.free)(at)
    }

    /// Says whether the straight line from a free configuration to another is free, both checked no farther than
    /// `spacing` apart.
    pub(crate) fn is_free_between(
        &mut self,
        from: &Configuration,
        to: &Configuration,
        metric: &Metric,
        spacing: f64,
    ) -> bool {
        let parts = (metric.distance(from, to) / spacing).ceil().max(1.0);
        let mut part = 1.0;
        while part <= parts {
            if !self.is_free(&from.towards(to, part / parts)) {
                return false;
            }
            part += 1.0;
        }
        true
    }
}

/// The result of a search.
#[derive(Debug, Clone)]
pub(crate) struct Search {
    /// The way from start to goal, if there is one.
    pub(crate) path: Option<Vec<Configuration>>,
    /// The way to the node of the start's tree that is nearest to the goal.
    pub(crate) nearest: Vec<Configuration>,
    /// Nodes of both trees.
    pub(crate) nodes_n: usize,
}

/// Whether a tree came to its target.
enum Extension {
    /// The edge is blocked.
    Trapped,
    /// It is nearer, with this new node.
    Advanced(usize),
    /// It is there, with this node.
    Reached(usize),
}

/// Searches a way between two free configurations.
///
/// The first target is the goal itself. From then on each tree in turn is extended by one edge towards a target, and
/// the other one by as many edges as are free towards the new node (J. J. Kuffner and S. M. LaValle, *RRT-Connect: An
/// Efficient Approach to Single-Query Path Planning*, 2000, section 2). The target is a draw, or the root of the other
/// tree.
pub(crate) fn connect(
    ends: [&Configuration; 2],
    growth: &Growth,
    region: &Region,
    checked: &mut Checked<'_>,
    rng: &mut impl Rng,
) -> Search {
    let mut trees = ends.map(|end| Tree::new(end.clone()));
    let mut growing = 0;
    let mut path =
        greedy(&mut trees[0], 1, ends[1], growth, checked).map(|node| trees[0].way_to(node));
    let has_budget = |trees: &[Tree; 2], checks_n: u64| {
        trees[0].len() + trees[1].len() < growth.max_nodes && checks_n < growth.max_checks
    };
    while path.is_none() && has_budget(&trees, checked.checks_n) {
        let other = 1 - growing;
        let target = if rng.random::<f64>() < growth.drawn_share {
            region.draw(rng)
        } else {
            trees[other].root().clone()
        };
        let extension = extend(&mut trees[growing], None, &target, growth, checked);
        if let Extension::Advanced(node) | Extension::Reached(node) = extension {
            let target = trees[growing].node(node).clone();
            let grown_n = trees[growing].len();
            if let Some(met) = greedy(&mut trees[other], grown_n, &target, growth, checked) {
                let mut ways = [(growing, node), (other, met)];
                ways.sort_unstable();
                let [from_start, from_goal] = ways.map(|(tree, node)| trees[tree].way_to(node));
                // Both end at the same configuration.
                let back = from_goal.into_iter().rev().skip(1);
                path = Some(from_start.into_iter().chain(back).collect());
            }
        }
        growing = other;
    }
    let nearest = trees[0].nearest(ends[1], &growth.metric);
    Search {
        path,
        nearest: trees[0].way_to(nearest),
        nodes_n: trees[0].len() + trees[1].len(),
    }
}

/// Extends a tree, beside another one of so many nodes, towards a target as far as its edges are free; returns the node
/// there if it is reached.
fn greedy(
    tree: &mut Tree,
    others_n: usize,
    target: &Configuration,
    growth: &Growth,
    checked: &mut Checked<'_>,
) -> Option<usize> {
    let mut from = None;
    while tree.len() + others_n < growth.max_nodes && checked.checks_n < growth.max_checks {
        match extend(tree, from, target, growth, checked) {
            Extension::Trapped => return None,
            Extension::Advanced(node) => from = Some(node),
            Extension::Reached(node) => return Some(node),
        }
    }
    None
}

/// Extends a tree by one edge towards a target, from a node, or from the one that is nearest to it.
fn extend(
    tree: &mut Tree,
    from: Option<usize>,
    target: &Configuration,
    growth: &Growth,
    checked: &mut Checked<'_>,
) -> Extension {
    let from = from.unwrap_or_else(|| tree.nearest(target, &growth.metric));
    let node = tree.node(from);
    let distance = growth.metric.distance(node, target);
    if distance == 0.0 {
        return Extension::Reached(from);
    }
    let reaches = distance <= growth.step;
    let to = if reaches {
        target.clone()
    } else {
        node.towards(target, growth.step / distance)
    };
    if !checked.is_free_between(node, &to, &growth.metric, growth.spacing) {
        return Extension::Trapped;
    }
    let node = tree.add(to, from);
    if reaches {
        Extension::Reached(node)
    } else {
        Extension::Advanced(node)
    }
}

#[cfg(test)]
mod tests {
    use std::collections::VecDeque;

    use nalgebra::Vector3;
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;

    use super::*;
    use crate::configuration::tests::at;

    const METRIC: Metric = Metric {
        translation_per_m: 1.0,
        rotation_per_rad: 0.0,
        joint_per_rad: 1.0,
    };

    fn growth() -> Growth {
        Growth {
            metric: METRIC,
            step: 0.05,
            spacing: 0.01,
            drawn_share: 0.5,
            max_nodes: 3000,
            max_checks: 30_000,
        }
    }

    /// The two joints of a hand whose palm stands still: a unit square.
    fn place(x: f64, y: f64) -> Configuration {
        at([0.0; 3], [0.0; 3], [x, y])
    }

    fn square() -> Region {
        Region {
            palm_m: [Vector3::zeros(); 2],
            joints: vec![[0.0, 1.0]; 2],
        }
    }

    fn search(
        ends: [[f64; 2]; 2],
        seed: u64,
        free: &dyn Fn(&Configuration) -> bool,
    ) -> (Search, u64) {
        let [start, goal] = ends.map(|[x, y]| place(x, y));
        let mut checked = Checked::new(free);
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let search = connect(
            [&start, &goal],
            &growth(),
            &square(),
            &mut checked,
            &mut rng,
        );
        (search, checked.checks_n)
    }

    /// Checks a path at a tenth of the spacing: it is free, its edges are no longer than a step, it begins and ends
    /// where it should.
    fn verify(search: &Search, ends: [[f64; 2]; 2], free: &dyn Fn(&Configuration) -> bool) {
        let path = search.path.as_ref().unwrap();
        let [first, last] = ends.map(|[x, y]| place(x, y).q);
        assert_eq!([&path[0].q, &path[path.len() - 1].q], [&first, &last]);
        for pair in path.windows(2) {
            let length = METRIC.distance(&pair[0], &pair[1]);
            assert!(length > 0.0 && length <= growth().step + 1e-12, "{length}");
            for part in 0..=50 {
                assert!(free(&pair[0].towards(&pair[1], f64::from(part) / 50.0)));
            }
        }
    }

    /// Edges that end in a wall are found by their checks, which are this far apart at most.
    const MARGIN: f64 = 0.01;

    /// A wall in the middle with one gap.
    fn wall(gap: [f64; 2], margin: f64) -> impl Fn(&Configuration) -> bool {
        move |at| {
            let [x, y] = [at.q[0], at.q[1]];
            let in_wall = (0.45 + margin..0.55 - margin).contains(&x);
            let in_gap = (gap[0] - margin..gap[1] + margin).contains(&y);
            !in_wall || in_gap
        }
    }

    #[test]
    fn free_space_is_crossed_on_the_straight_line() {
        let ends = [[0.1, 0.1], [0.886, 0.7]];
        let (found, checks_n) = search(ends, 1, &|_| true);
        verify(&found, ends, &|_| true);
        // A length of 0.989: nineteen edges of 0.05 and a last one of 0.039, and nothing in vain.
        let path = found.path.as_ref().unwrap();
        assert_eq!((path.len(), found.nodes_n), (21, 22));
        let [start, goal] = [&path[0], &path[20]];
        for node in path {
            let [a, b] = [start, goal].map(|end| METRIC.distance(end, node));
            assert!((a + b - METRIC.distance(start, goal)).abs() < 1e-9);
        }
        // Rounding may add a check to an edge of five.
        assert!((98..=118).contains(&checks_n), "{checks_n}");
    }

    #[test]
    fn the_one_gap_in_a_wall_is_found() {
        let ends = [[0.1, 0.9], [0.9, 0.9]];
        for seed in 0..20 {
            let (found, checks_n) = search(ends, seed, &wall([0.1, 0.2], 0.0));
            verify(&found, ends, &wall([0.1, 0.2], MARGIN));
            assert!(checks_n < 30_000, "{checks_n}");
        }
    }

    #[test]
    fn no_way_leads_out_of_a_closed_box() {
        // The start is in a box whose walls are 0.1 thick.
        let free = |at: &Configuration| {
            let out = at.q.iter().map(|x| (x - 0.3).abs()).fold(0.0, f64::max);
            !(0.1..0.2).contains(&out)
        };
        let (found, checks_n) = search([[0.3, 0.3], [0.9, 0.9]], 1, &free);
        assert!(found.path.is_none());
        // In two dimensions the box is full before the nodes are: the checks end the search.
        assert!(found.nodes_n >= growth().max_nodes || checks_n >= growth().max_checks);
        // The way to the nearest node ends in the corner of the box.
        let last = &found.nearest[found.nearest.len() - 1];
        assert!(METRIC.distance(last, &place(0.4, 0.4)) < 0.03, "{last:?}");
        for pair in found.nearest.windows(2) {
            assert!(pair.iter().all(free));
        }
    }

    #[test]
    fn the_search_ends_with_its_checks() {
        let [start, goal] = [place(0.3, 0.3), place(0.9, 0.9)];
        let free = |at: &Configuration| at.q[0] < 0.5;
        let mut checked = Checked::new(&free);
        let growth = Growth {
            max_checks: 500,
            ..growth()
        };
        let mut rng = ChaCha8Rng::seed_from_u64(1);
        let found = connect([&start, &goal], &growth, &square(), &mut checked, &mut rng);
        assert!(found.path.is_none() && found.nodes_n < growth.max_nodes);
        // The last extensions may be under way: an edge of five checks and one of as many again.
        assert!(
            (500..510).contains(&checked.checks_n),
            "{}",
            checked.checks_n
        );
    }

    /// Says by flood fill on a grid whether two places are joined, places being free or not.
    fn are_joined(
        ends: [[f64; 2]; 2],
        cells: usize,
        free: &dyn Fn(&Configuration) -> bool,
    ) -> bool {
        let width = 1.0 / cells as f64;
        let cell = |at: f64| {
            (0..cells)
                .take_while(|cell| (*cell + 1) as f64 * width <= at)
                .count()
        };
        let cell_of = |[x, y]: [f64; 2]| [x, y].map(cell);
        let is_free = |[i, j]: [usize; 2]| {
            let [x, y] = [i, j].map(|of| (of as f64 + 0.5) * width);
            free(&place(x, y))
        };
        let [from, to] = ends.map(cell_of);
        let mut seen = vec![false; cells * cells];
        let mut queue = VecDeque::from([from]);
        while let Some([i, j]) = queue.pop_front() {
            if [i, j] == to {
                return true;
            }
            let around = [
                [i.wrapping_sub(1), j],
                [i + 1, j],
                [i, j.wrapping_sub(1)],
                [i, j + 1],
            ];
            for next in around {
                let inside = next.iter().all(|of| *of < cells);
                if inside && !seen[next[0] * cells + next[1]] && is_free(next) {
                    seen[next[0] * cells + next[1]] = true;
                    queue.push_back(next);
                }
            }
        }
        false
    }

    #[test]
    fn brute_force_on_a_grid_agrees_on_which_places_are_joined() {
        let ends = [[0.05, 0.05], [0.95, 0.95]];
        let mut counts = [0; 2];
        for seed in 0..60 {
            // Discs, of which some leave no way. Where it depends on 2 cm more or less, the case is left out.
            let mut rng = ChaCha8Rng::seed_from_u64(1000 + seed);
            let mut discs: Vec<[f64; 3]> = (0..20 + 2 * seed)
                .map(|_| {
                    let [x, y, r]: [f64; 3] = [rng.random(), rng.random(), rng.random()];
                    [x, y, 0.04 + 0.06 * r]
                })
                .collect();
            let is_far = |[x, y, radius]: &[f64; 3], end: &[f64; 2]| {
                (end[0] - x).hypot(end[1] - y) > radius + 0.03
            };
            discs.retain(|disc| ends.iter().all(|end| is_far(disc, end)));
            let free = |by: f64| {
                let discs = &discs;
                move |at: &Configuration| {
                    discs
                        .iter()
                        .all(|[x, y, radius]| (at.q[0] - x).hypot(at.q[1] - y) > radius + by)
                }
            };
            let [narrow, wide] = [0.02, -0.02].map(|by| are_joined(ends, 200, &free(by)));
            if narrow != wide {
                continue;
            }
            let (found, _) = search(ends, seed, &free(0.0));
            assert_eq!(found.path.is_some(), wide, "seed {seed}");
            if wide {
                verify(&found, ends, &free(-MARGIN));
            }
            counts[usize::from(wide)] += 1;
        }
        assert!(counts.iter().all(|n| *n >= 5), "{counts:?}");
    }
}
