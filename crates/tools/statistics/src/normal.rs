//! The standard normal distribution.

/// Its 97.5th percentile.
pub(crate) const Z_975: f64 = 1.959_963_984_540_054;

/// Returns the probability of a value of at most `z`, within 7.5e-8.
///
/// M. Abramowitz and I. A. Stegun, *Handbook of Mathematical Functions*, 1964, formula 26.2.17.
pub(crate) fn probability(z: f64) -> f64 {
    const B: [f64; 5] = [
        0.319_381_530,
        -0.356_563_782,
        1.781_477_937,
        -1.821_255_978,
        1.330_274_429,
    ];
    let t = 1.0 / (1.0 + 0.231_641_9 * z.abs());
    let series = B.iter().rev().fold(0.0, |sum, b| t * (b + sum));
    let density = (-0.5 * z * z).exp() / std::f64::consts::TAU.sqrt();
    let above = density * series;
    if z < 0.0 { above } else { 1.0 - above }
}

/// Returns the value below which the probability is `p`, in 0..1, by bisection of [`probability`].
pub(crate) fn percentile(p: f64) -> f64 {
    /// Farther out than 1 in 10⁸.
    const MAX_ABS: f64 = 6.0;
    let (mut low, mut high) = (-MAX_ABS, MAX_ABS);
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if probability(middle) < p {
            low = middle;
        } else {
            high = middle;
        }
    }
    0.5 * (low + high)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The values of the table of E. S. Pearson and H. O. Hartley, *Biometrika Tables for
    /// Statisticians*, 1966, table 1.
    #[test]
    fn probabilities_and_percentiles_are_the_published_ones() {
        for (z, p) in [
            (0.0, 0.5),
            (0.5, 0.691_462_5),
            (1.0, 0.841_344_7),
            (-1.0, 0.158_655_3),
            (Z_975, 0.975),
            (-3.0, 0.001_349_9),
        ] {
            let (found, expected) = (probability(z), p);
            assert!((found - expected).abs() < 1.3e-7, "{z}: {found}");
            assert!((percentile(p) - z).abs() < 3e-5, "{p}: {}", percentile(p));
        }
    }
}
