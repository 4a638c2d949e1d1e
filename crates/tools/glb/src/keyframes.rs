//! The fewest moments between which linear interpolation stays within a tolerance.

/// Maximum error of a link's shown position at any moment, in meters.
pub const TOLERANCE_M: f64 = 5e-5;

/// Returns the places of the moments to keep, the first and the last among them. `error_m(from, to, at)` is
/// how far off moment `at` is if it is interpolated between `from` and `to`, in meters.
///
/// Each key frame is the last one up to which every moment since the one before is within the tolerance.
pub(crate) fn keyframes(n: usize, error_m: impl Fn(usize, usize, usize) -> f64) -> Vec<usize> {
    let fits =
        |from: usize, to: usize| (from + 1..to).all(|at| error_m(from, to, at) <= TOLERANCE_M);
    let mut kept = vec![0];
    let mut from = 0;
    while from + 1 < n {
        // As far as it fits in doubled steps, then by halves: not always the farthest, always within.
        let mut good = from + 1;
        let mut stride = 1;
        let mut bad = n;
        while good + stride < bad {
            if fits(from, good + stride) {
                good += stride;
                stride *= 2;
            } else {
                bad = good + stride;
                stride = 1;
                if good + stride >= bad {
                    break;
                }
            }
        }
        if good + 1 < n && bad == n && fits(from, n - 1) {
            good = n - 1;
        }
        kept.push(good);
        from = good;
    }
    kept
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_needs_its_ends_and_a_corner_its_own_key() {
        let check = |values: &[f64], expected: &[usize]| {
            let error = |from: usize, to: usize, at: usize| {
                let share = (at - from) as f64 / (to - from) as f64;
                (values[from] + share * (values[to] - values[from]) - values[at]).abs()
            };
            let kept = keyframes(values.len(), error);
            assert_eq!(kept, expected, "{values:?}");
        };
        check(&[0.0], &[0]);
        check(&[0.0, 1.0], &[0, 1]);
        check(&[0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0], &[0, 6]);
        check(&[0.0, 1.0, 2.0, 3.0, 3.0, 3.0, 3.0, 3.0], &[0, 3, 7]);
        check(&[0.0, 0.0, 1.0, 0.0, 0.0], &[0, 1, 2, 3, 4]);
    }
}
