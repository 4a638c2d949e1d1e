//! A path as a line that can be shortened, and walked at constant speed.

use rand::Rng;

use crate::{
    configuration::{Configuration, Metric},
    connect::Checked,
};

/// A way through configurations, with the distance of each from its beginning.
#[derive(Debug, Clone)]
pub(crate) struct Path {
    nodes: Vec<Configuration>,
    /// Length of the way to each node.
    lengths: Vec<f64>,
    metric: Metric,
}

impl Path {
    /// Takes the nodes of a way, of which there is at least one.
    pub(crate) fn new(nodes: Vec<Configuration>, metric: Metric) -> Self {
        let mut lengths = vec![0.0];
        let mut length = 0.0;
        for pair in nodes.windows(2) {
            length += metric.distance(&pair[0], &pair[1]);
            lengths.push(length);
        }
        Self {
            nodes,
            lengths,
            metric,
        }
    }

    /// Returns the length of the whole way.
    pub(crate) fn length(&self) -> f64 {
        self.lengths[self.lengths.len() - 1]
    }

    /// Returns the configuration after this share of the length.
    pub(crate) fn at(&self, share: f64) -> Configuration {
        self.at_length(share * self.length()).0
    }

    /// Returns the configuration after a length, and the number of the node that comes next, at least 1.
    fn at_length(&self, length: f64) -> (Configuration, usize) {
        let last = self.nodes.len() - 1;
        let next = self.lengths.partition_point(|to| *to <= length);
        if next > last {
            return (self.nodes[last].clone(), last.max(1));
        }
        let next = next.max(1);
        let [from, to] = [self.lengths[next - 1], self.lengths[next]];
        let share = ((length - from) / (to - from)).clamp(0.0, 1.0);
        let between = self.nodes[next - 1].towards(&self.nodes[next], share);
        (between, next)
    }

    /// Replaces parts of the way by straight lines that are free: so many times two places on it are drawn (Geraerts
    /// and Overmars, *Creating High-quality Paths for Motion Planning*, 2007, section 3).
    pub(crate) fn shortened(
        mut self,
        attempts: usize,
        spacing: f64,
        checked: &mut Checked<'_>,
        rng: &mut impl Rng,
    ) -> Self {
        for _ in 0..attempts {
            let [a, b] = [0, 1].map(|_| rng.random::<f64>() * self.length());
            let [(from, after_from), (to, after_to)] =
                [a.min(b), a.max(b)].map(|length| self.at_length(length));
            // On one edge there is nothing to gain.
            if after_from == after_to || !checked.is_free_between(&from, &to, &self.metric, spacing)
            {
                continue;
            }
            let mut nodes = self.nodes[..after_from].to_vec();
            nodes.extend([from, to]);
            nodes.extend_from_slice(&self.nodes[after_to..]);
            self = Self::new(nodes, self.metric);
        }
        self
    }
}

#[cfg(test)]
mod tests {
    use rand::SeedableRng;
    use rand_chacha::ChaCha8Rng;

    use super::*;
    use crate::configuration::tests::at;

    const METRIC: Metric = Metric {
        translation_per_m: 1.0,
        rotation_per_rad: 1.0,
        joint_per_rad: 1.0,
    };

    fn path(places: &[[f64; 2]]) -> Path {
        let nodes = places.iter().map(|&q| at([0.0; 3], [0.0; 3], q));
        Path::new(nodes.collect(), METRIC)
    }

    #[test]
    fn a_path_is_walked_at_constant_speed() {
        let path = path(&[[0.0, 0.0], [3.0, 0.0], [3.0, 1.0]]);
        assert_eq!(path.length(), 4.0);
        let check = |share: f64, expected: [f64; 2]| {
            let found = path.at(share).q;
            let off = found.iter().zip(expected).map(|(a, b)| (a - b).abs());
            assert!(off.fold(0.0, f64::max) < 1e-12, "{found:?}");
        };
        check(0.0, [0.0, 0.0]);
        check(0.5, [2.0, 0.0]);
        check(0.75, [3.0, 0.0]);
        check(0.875, [3.0, 0.5]);
        check(1.0, [3.0, 1.0]);
    }

    #[test]
    fn a_path_of_one_place_stays_there() {
        let path = path(&[[0.3, 0.4]]);
        assert_eq!(path.length(), 0.0);
        assert_eq!(path.at(0.7).q, [0.3, 0.4]);
    }

    #[test]
    fn shortcuts_keep_the_ends_and_what_is_free() {
        // Around the corner of a square that is in the way.
        let free = |at: &Configuration| at.q[0] <= 0.0 || at.q[1] >= 1.0;
        let long = path(&[[-1.0, 0.0], [-1.0, 2.0], [1.0, 2.0], [1.0, 1.0]]);
        let mut checked = Checked::new(&free);
        let mut rng = ChaCha8Rng::seed_from_u64(5);
        let short = long.clone().shortened(200, 0.01, &mut checked, &mut rng);
        // The shortest way touches the corner: √2 and 1.
        let shortest = 2.0_f64.sqrt() + 1.0;
        assert!(short.length() >= shortest - 0.02 && short.length() < shortest + 0.15);
        assert_eq!(short.at(0.0).q, [-1.0, 0.0]);
        assert_eq!(short.at(1.0).q, [1.0, 1.0]);
        assert!(checked.checks_n > 200);
        for part in 0..=1000 {
            let at = short.at(f64::from(part) / 1000.0);
            let deep = at.q[0].min(1.0 - at.q[1]);
            assert!(deep < 0.01, "{at:?}");
        }
        let none = long.clone().shortened(0, 0.01, &mut checked, &mut rng);
        assert_eq!(none.length(), long.length());
    }
}
