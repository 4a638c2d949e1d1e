//! Statistics of a dataset's numbers, by which policies normalize.

use crate::lerobot::{Feature, Recorded};

/// Extremes, mean and standard deviation of each number of a feature.
pub(super) struct FeatureStats {
    /// The feature's name.
    pub(super) name: &'static str,
    /// Least values.
    pub(super) min: Vec<f64>,
    /// Greatest values.
    pub(super) max: Vec<f64>,
    /// Means.
    pub(super) mean: Vec<f64>,
    /// Standard deviations, of all frames.
    pub(super) std: Vec<f64>,
    /// Number of frames.
    pub(super) frames_n: usize,
}

/// Statistics of every feature.
pub(super) struct Stats(pub(super) Vec<FeatureStats>);

impl Stats {
    /// Of all frames of some episodes.
    pub(super) fn of(recorded: &[Recorded<'_>], features: &[Feature], fps: u32) -> Self {
        let frames = || recorded.iter().flat_map(|one| &one.frames);
        let of_feature = |(name, names, numbers): &Feature| {
            let columns = (0..names.len())
                .map(|idx| frames().map(move |frame| f64::from(numbers(frame)[idx])));
            FeatureStats::of(name, columns)
        };
        let times = recorded.iter().flat_map(|one| 0..one.frames.len());
        let times = times.map(|frame| frame as f64 / f64::from(fps));
        let all = features.iter().map(of_feature);
        Self(
            all.chain([FeatureStats::of("timestamp", [times].into_iter())])
                .collect(),
        )
    }
}

impl FeatureStats {
    fn of(name: &'static str, columns: impl Iterator<Item = impl Iterator<Item = f64>>) -> Self {
        let mut stats = Self {
            name,
            min: Vec::new(),
            max: Vec::new(),
            mean: Vec::new(),
            std: Vec::new(),
            frames_n: 0,
        };
        for column in columns {
            let numbers: Vec<f64> = column.collect();
            let n = numbers.len().max(1) as f64;
            let mean = numbers.iter().sum::<f64>() / n;
            let variance = numbers
                .iter()
                .map(|number| (number - mean).powi(2))
                .sum::<f64>()
                / n;
            stats
                .min
                .push(numbers.iter().copied().fold(f64::INFINITY, f64::min));
            stats
                .max
                .push(numbers.iter().copied().fold(f64::NEG_INFINITY, f64::max));
            stats.mean.push(mean);
            stats.std.push(variance.sqrt());
            stats.frames_n = numbers.len();
        }
        stats
    }

    /// The statistics that are lists of numbers, by name.
    pub(super) fn numbers(&self) -> [(&'static str, &Vec<f64>); 4] {
        [
            ("min", &self.min),
            ("max", &self.max),
            ("mean", &self.mean),
            ("std", &self.std),
        ]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn are_those_of_every_column() {
        let columns = [vec![1.0, 3.0, 5.0], vec![-2.0, -2.0, -2.0]];
        let stats = FeatureStats::of("action", columns.into_iter().map(Vec::into_iter));
        assert_eq!((stats.min, stats.max), (vec![1.0, -2.0], vec![5.0, -2.0]));
        assert_eq!((stats.mean, stats.frames_n), (vec![3.0, -2.0], 3));
        assert!((stats.std[0] - (8.0_f64 / 3.0).sqrt()).abs() < 1e-12);
        assert_eq!(stats.std[1], 0.0);
    }
}
