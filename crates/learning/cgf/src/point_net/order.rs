//! An order in which points that follow each other lie near each other.

/// Returns an order of points `xyz` in which every run of `run` points is compact: halves along the
/// widest axis (Bentley, *Multidimensional binary search trees*, 1975, §2), down to single runs.
///
/// Nothing but speed depends on the order.
pub(super) fn near_together(xyz: &[[f32; 3]], run: usize) -> Vec<u32> {
    let mut order: Vec<u32> = (0..).take(xyz.len()).collect();
    split(xyz, run, &mut order);
    order
}

fn split(xyz: &[[f32; 3]], run: usize, order: &mut [u32]) {
    if order.len() <= run {
        return;
    }
    let mut low = [f32::INFINITY; 3];
    let mut high = [f32::NEG_INFINITY; 3];
    for &point in order.iter() {
        for (k, &x) in xyz[point as usize].iter().enumerate() {
            low[k] = low[k].min(x);
            high[k] = high[k].max(x);
        }
    }
    let extent = |k: usize| high[k] - low[k];
    let mut axis = 0;
    for k in 1..3 {
        if extent(k) > extent(axis) {
            axis = k;
        }
    }
    let half = order.len().div_ceil(run) / 2 * run;
    let at = |point: &u32| xyz[*point as usize][axis];
    order.select_nth_unstable_by(half, |a, b| at(a).total_cmp(&at(b)));
    let (before, after) = order.split_at_mut(half);
    split(xyz, run, before);
    split(xyz, run, after);
}

#[cfg(test)]
mod tests {
    use super::near_together;
    use crate::{precision::narrow, random::Random};

    #[test]
    fn every_point_comes_once_and_runs_are_compact() {
        let mut random = Random::new(3, 0);
        let xyz: Vec<[f32; 3]> = (0..1000)
            .map(|_| std::array::from_fn(|_| narrow(random.uniform())))
            .collect();
        let order = near_together(&xyz, 16);
        let mut all = order.clone();
        all.sort_unstable();
        assert!((0..1000).eq(all));
        for run in order.chunks(16) {
            let extent = (0..3).map(|k| {
                let at = run.iter().map(|&p| xyz[p as usize][k]);
                at.clone().fold(0.0, f32::max) - at.fold(1.0, f32::min)
            });
            // Sixteen of a thousand points in a unit cube: a box of about 0.25 to 0.5.
            assert!(extent.fold(0.0, f32::max) < 0.8, "{run:?}");
        }
    }
}
