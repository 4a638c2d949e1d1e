//! The errors of a stereo camera's depths.

use nalgebra::Vector2;
use options::options;
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use rand_distr::StandardNormal;

use crate::{DepthView, Intrinsics, Rendered};

/// Largest lengths in pixels of an image.
const MAX_PIXELS: f64 = 100.0;
/// Longest baseline, in meters.
const MAX_BASELINE_M: f64 = 10.0;
/// Disparities that differ by more than this lie on different things, in pixels.
const EDGE_PX: f64 = 1.0;
/// Side of the blocks of pixels that an edge is fattened alike in, in pixels.
const BLOCK: usize = 8;

/// The errors of a stereo camera, each off at 0; the defaults are a well-tuned Intel `RealSense` D435 (baseline: its data
/// sheet, 2019; disparity: Grunnet-Jepsen, Sweetser and Woodfill, "Best-known-methods for tuning Intel `RealSense` D400
/// depth cameras for best performance", 2018: 0.08 pixels on what has texture).
#[options]
pub struct StereoNoise {
    /// Distance between the two cameras (m); 0: depths without any error
    #[option(default = 0.05, range = 0.0..=MAX_BASELINE_M, why = "no stereo camera is wider")]
    pub baseline_m: f64,
    /// Standard deviation of the disparity, in pixels
    #[option(default = 0.08, range = 0.0..=MAX_PIXELS, why = "it is a part of an image")]
    pub disparity_px: f64,
    /// Distance between pixels whose disparity errors are independent: windows that are compared overlap
    #[option(default = 5.0, range = 1.0..=MAX_PIXELS, why = "it is a part of an image")]
    pub correlation_px: f64,
    /// Steps of a disparity within one pixel, as the D400 cameras resolve it; 0: none
    #[option(default = 32.0, range = 0.0..=1e6, why = "more make no difference")]
    pub disparity_steps: f64,
    /// Standard deviation of where in the image a depth was measured, along each axis (Handa et al., "A benchmark for RGB-D
    /// visual odometry, 3D reconstruction and SLAM", 2014, section III)
    #[option(default = 0.5, range = 0.0..=MAX_PIXELS, why = "it is a part of an image")]
    pub lateral_px: f64,
    /// Farthest that a near surface extends over what is behind it: half of the window that is compared (Scharstein and
    /// Szeliski, "A taxonomy and evaluation of dense two-frame stereo correspondence algorithms", 2002, section 4)
    #[option(default = 2.0, range = 0.0..=MAX_PIXELS, why = "it is a part of an image")]
    pub fattening_px: f64,
    /// Angle between ray and normal from which depths are missing, more often toward 90 degrees (rad; Nguyen, Izadi and
    /// Lovell, "Modeling Kinect sensor noise", 2012, section 3); 0: never
    #[option(default = 1.22, range = 0.0..=1.58, why = "a surface is seen from at most 90 degrees")]
    pub grazing_rad: f64,
    /// Share of the pixels that are lost in patches: dark, shiny or without texture
    #[option(default = 0.02, range = 0.0..=0.9, why = "an image without depths shows nothing")]
    pub hole_share: f64,
    /// Whether what only one of the two cameras sees has no depth
    #[option(default = true)]
    pub half_occlusion: bool,
    /// Factor on all of them but the baseline, the steps and the angle, for a study
    #[option(default = 1.0, range = 0.0..=100.0, why = "an image without depths shows nothing")]
    pub level: f64,
}

impl StereoNoise {
    /// Returns what a stereo camera whose left image it is measures of a perfect image.
    pub fn measured(&self, rendered: &Rendered, seed: u64) -> DepthView {
        let mut view = rendered.view.clone();
        if self.baseline_m <= 0.0 || self.level <= 0.0 {
            return view;
        }
        let intrinsics = view.intrinsics;
        let mut random = ChaCha8Rng::seed_from_u64(seed);
        let focal_baseline = intrinsics.focal[0] * self.baseline_m;
        let disparity_of = |depth_m: f64| {
            if depth_m > 0.0 {
                focal_baseline / depth_m
            } else {
                0.0
            }
        };
        let exact: Vec<f64> = view
            .depth_m
            .iter()
            .map(|&depth| disparity_of(depth))
            .collect();
        let mut disparity = self.fattened(&exact, &intrinsics, &mut random);
        disparity = self.moved(&disparity, &intrinsics, &mut random);
        let errors = smooth_normals(&intrinsics, self.correlation_px, &mut random);
        let patches = smooth_normals(&intrinsics, 12.0, &mut random);
        let lost_below = normal_quantile((self.hole_share * self.level).min(0.9));
        let hidden = if self.half_occlusion {
            hidden_from_the_right(&exact, &intrinsics)
        } else {
            vec![false; exact.len()]
        };
        for pixel in 0..exact.len() {
            let grazes = self.grazes(rendered.incidence[pixel], random.random());
            let is_lost = grazes || patches[pixel] < lost_below || hidden[pixel];
            let mut found = disparity[pixel] + self.level * self.disparity_px * errors[pixel];
            if self.disparity_steps > 0.0 {
                found = (found * self.disparity_steps).round() / self.disparity_steps;
            }
            view.depth_m[pixel] = if is_lost || disparity[pixel] <= 0.0 || found <= 0.0 {
                0.0
            } else {
                focal_baseline / found
            };
        }
        view
    }

    /// Says whether a depth is missing because the surface is seen at too flat an angle.
    fn grazes(&self, incidence: f64, chance: f64) -> bool {
        let angle = incidence.clamp(0.0, 1.0).acos();
        let room = std::f64::consts::FRAC_PI_2 - self.grazing_rad;
        self.grazing_rad > 0.0 && chance < (angle - self.grazing_rad) / room.max(1e-9)
    }

    /// Returns disparities in which near surfaces extend over what is behind them.
    fn fattened(
        &self,
        exact: &[f64],
        intrinsics: &Intrinsics,
        random: &mut ChaCha8Rng,
    ) -> Vec<f64> {
        let most = self.fattening_px * self.level;
        if most <= 0.0 {
            return exact.to_vec();
        }
        let blocks = intrinsics.width.div_ceil(BLOCK);
        let radius: Vec<f64> = (0..blocks * intrinsics.height.div_ceil(BLOCK))
            .map(|_| random.random_range(0.0..=most))
            .collect();
        let mut fattened = exact.to_vec();
        for (pixel, own) in fattened.iter_mut().enumerate() {
            let (x, y) = intrinsics.coordinates(pixel);
            let radius = radius[y / BLOCK * blocks + x / BLOCK];
            let reach = whole(radius);
            let near = |at: usize, n: usize| at.saturating_sub(reach)..(at + reach + 1).min(n);
            let mut nearest = *own;
            for row in near(y, intrinsics.height) {
                for column in near(x, intrinsics.width) {
                    let off = Vector2::new(column.abs_diff(x) as f64, row.abs_diff(y) as f64);
                    if off.norm() <= radius {
                        nearest = nearest.max(exact[row * intrinsics.width + column]);
                    }
                }
            }
            if nearest > *own + EDGE_PX {
                *own = nearest;
            }
        }
        fattened
    }

    /// Returns disparities that were measured beside their pixels.
    fn moved(
        &self,
        disparity: &[f64],
        intrinsics: &Intrinsics,
        random: &mut ChaCha8Rng,
    ) -> Vec<f64> {
        let deviation = self.lateral_px * self.level;
        if deviation <= 0.0 {
            return disparity.to_vec();
        }
        let at = |pixel: usize| {
            let (x, y) = intrinsics.coordinates(pixel);
            let off: [f64; 2] = [random.sample(StandardNormal), random.sample(StandardNormal)];
            let place = [x as f64 + deviation * off[0], y as f64 + deviation * off[1]];
            disparity[intrinsics.pixel(place).unwrap_or(pixel)]
        };
        (0..disparity.len()).map(at).collect()
    }
}

/// Returns a standard normal number for each pixel; those `distance_px` apart and more are independent.
///
/// Normals on a coarser grid are interpolated linearly and divided by the norm of the weights, which keeps the variance.
fn smooth_normals(intrinsics: &Intrinsics, distance_px: f64, random: &mut ChaCha8Rng) -> Vec<f64> {
    let columns = whole(intrinsics.width as f64 / distance_px) + 2;
    let rows = whole(intrinsics.height as f64 / distance_px) + 2;
    let nodes: Vec<f64> = (0..columns * rows)
        .map(|_| random.sample(StandardNormal))
        .collect();
    let at = |pixel: usize| {
        let (x, y) = intrinsics.coordinates(pixel);
        let (u, v) = (x as f64 / distance_px, y as f64 / distance_px);
        let node = whole(v) * columns + whole(u);
        let (right, down) = (u.fract(), v.fract());
        let weights = [
            (1.0 - right) * (1.0 - down),
            right * (1.0 - down),
            (1.0 - right) * down,
            right * down,
        ];
        let corners = [node, node + 1, node + columns, node + columns + 1];
        let sum: f64 = corners
            .iter()
            .zip(weights)
            .map(|(&k, w)| w * nodes[k])
            .sum();
        sum / weights.iter().map(|w| w * w).sum::<f64>().sqrt()
    };
    (0..intrinsics.pixels_n()).map(at).collect()
}

/// Says of each pixel of the left image whether something nearer hides it from the right camera.
fn hidden_from_the_right(disparity: &[f64], intrinsics: &Intrinsics) -> Vec<bool> {
    let mut hidden = vec![false; disparity.len()];
    let rows = disparity
        .chunks(intrinsics.width)
        .zip(hidden.chunks_mut(intrinsics.width));
    for (disparity, hidden) in rows {
        let in_right = |x: usize| x as f64 - disparity[x];
        // From right to left a pixel of the left image is hidden where one beside it on the right is farther left in the
        // right image.
        let mut leftmost = f64::INFINITY;
        for x in (0..disparity.len()).rev() {
            let own = in_right(x);
            hidden[x] = own > leftmost + 0.5;
            leftmost = leftmost.min(own);
        }
    }
    hidden
}

/// Returns the number below which this share of standard normal numbers lies, by bisection.
fn normal_quantile(share: f64) -> f64 {
    if share <= 0.0 {
        return f64::NEG_INFINITY;
    }
    let (mut low, mut high) = (-8.0, 8.0);
    for _ in 0..60 {
        let middle = 0.5 * (low + high);
        if normal_share(middle) < share {
            low = middle;
        } else {
            high = middle;
        }
    }
    0.5 * (low + high)
}

/// Returns the share of standard normal numbers below `x` (Marsaglia, "Evaluating the normal distribution", 2004).
fn normal_share(x: f64) -> f64 {
    let (mut sum, mut term, mut k) = (x, x, 1.0);
    while term.abs() > 1e-17 && k < 400.0 {
        k += 2.0;
        term *= x * x / k;
        sum += term;
    }
    0.5 + sum * (-0.5 * x * x).exp() / std::f64::consts::TAU.sqrt()
}

/// Returns a length in whole pixels, rounded down.
#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "lengths in an image are small and not negative"
)]
fn whole(length: f64) -> usize {
    length as usize
}

#[cfg(test)]
mod tests {
    use spatial::Pose;

    use super::*;

    const FOCAL_BASELINE: f64 = 600.0 * 0.05;

    /// An image whose left half is at 0.5 m and whose right half is at 0.7 m, seen from the front.
    fn step() -> Rendered {
        let intrinsics = Intrinsics {
            width: 160,
            height: 120,
            focal: [600.0, 600.0],
            center: [79.5, 59.5],
        };
        let near = |pixel: usize| pixel % 160 < 80;
        Rendered {
            view: DepthView {
                intrinsics,
                world_from_camera: Pose::identity(),
                depth_m: (0..intrinsics.pixels_n())
                    .map(|pixel| if near(pixel) { 0.5 } else { 0.7 })
                    .collect(),
                mask: (0..intrinsics.pixels_n()).map(near).collect(),
            },
            incidence: vec![1.0; intrinsics.pixels_n()],
        }
    }

    /// No error but those that a test turns on.
    fn none() -> StereoNoise {
        StereoNoise {
            baseline_m: 0.05,
            disparity_px: 0.0,
            correlation_px: 5.0,
            disparity_steps: 0.0,
            lateral_px: 0.0,
            fattening_px: 0.0,
            grazing_rad: 0.0,
            hole_share: 0.0,
            half_occlusion: false,
            level: 1.0,
        }
    }

    #[test]
    fn without_errors_depths_are_exact() {
        let exact = step();
        let measured = none().measured(&exact, 3);
        for (a, b) in measured.depth_m.iter().zip(&exact.view.depth_m) {
            assert!((a - b).abs() < 1e-12);
        }
    }

    #[test]
    fn the_error_of_a_depth_grows_with_its_square() {
        let noise = StereoNoise {
            disparity_px: 0.08,
            ..none()
        };
        let exact = step();
        let measured = noise.measured(&exact, 3);
        for is_near in [true, false] {
            let errors =
                (0..exact.view.depth_m.len()).filter(|&pixel| exact.view.mask[pixel] == is_near);
            let squares: Vec<f64> = errors
                .map(|pixel| (measured.depth_m[pixel] - exact.view.depth_m[pixel]).powi(2))
                .collect();
            let deviation = (squares.iter().sum::<f64>() / squares.len() as f64).sqrt();
            // z² / (f b) times the deviation of the disparity.
            let depth_m: f64 = if is_near { 0.5 } else { 0.7 };
            let expected = depth_m.powi(2) / FOCAL_BASELINE * 0.08;
            assert!(
                (deviation / expected - 1.0).abs() < 0.1,
                "{deviation} {expected}"
            );
        }
    }

    #[test]
    fn disparities_are_multiples_of_a_step() {
        let noise = StereoNoise {
            disparity_px: 0.08,
            disparity_steps: 32.0,
            ..none()
        };
        for depth_m in noise.measured(&step(), 3).depth_m {
            let steps = FOCAL_BASELINE / depth_m * 32.0;
            assert!((steps - steps.round()).abs() < 1e-6);
        }
    }

    #[test]
    fn the_near_side_of_an_edge_is_fattened_by_at_most_the_window() {
        let noise = StereoNoise {
            fattening_px: 3.0,
            ..none()
        };
        let measured = noise.measured(&step(), 3);
        let near = |pixel: usize| measured.depth_m[pixel] < 0.6;
        let columns: Vec<usize> = (0..120)
            .map(|row| (0..160).filter(|x| near(row * 160 + x)).count())
            .collect();
        assert!(columns.iter().all(|n| (80..=83).contains(n)));
        assert!(columns.contains(&80) && columns.contains(&82));
    }

    #[test]
    fn what_the_near_side_hides_from_the_right_camera_has_no_depth() {
        // The near side must be on the right to hide something that the left camera sees.
        let mut exact = step();
        exact.view.depth_m = exact
            .view
            .depth_m
            .iter()
            .map(|&depth_m| 1.2 - depth_m)
            .collect();
        let noise = StereoNoise {
            half_occlusion: true,
            ..none()
        };
        let measured = noise.measured(&exact, 3);
        let lost = (0..160).filter(|&x| measured.depth_m[60 * 160 + x] == 0.0);
        let lost: Vec<usize> = lost.collect();
        // Disparities of 60 and 42.9 pixels: 17.1 pixels beside the edge, less up to a half.
        assert_eq!(lost, (64..80).collect::<Vec<_>>());
    }

    #[test]
    fn patches_are_lost_as_often_as_asked_and_flat_angles_more_often() {
        let holes = StereoNoise {
            hole_share: 0.2,
            ..none()
        };
        let mut lost = 0.0;
        for seed in 0..20 {
            let measured = holes.measured(&step(), seed);
            lost += measured
                .depth_m
                .iter()
                .filter(|&&depth| depth == 0.0)
                .count() as f64;
        }
        let share = lost / (20.0 * 160.0 * 120.0);
        assert!((share - 0.2).abs() < 0.03, "{share}");
        let grazing = StereoNoise {
            grazing_rad: 1.2,
            ..none()
        };
        let share_at = |angle: f64| {
            let mut exact = step();
            exact.incidence.fill(angle.cos());
            let measured = grazing.measured(&exact, 3);
            measured
                .depth_m
                .iter()
                .filter(|&&depth| depth == 0.0)
                .count() as f64
                / (160.0 * 120.0)
        };
        assert_eq!(share_at(1.19), 0.0);
        let halfway = 0.5 * (1.2 + std::f64::consts::FRAC_PI_2);
        assert!((share_at(halfway) - 0.5).abs() < 0.02);
    }

    #[test]
    fn quantiles_are_those_of_the_normal_distribution() {
        // Tables: 0.02 and 0.2 of all numbers lie below these.
        assert!((normal_quantile(0.02) - -2.053_748_910_6).abs() < 1e-9);
        assert!((normal_quantile(0.2) - -0.841_621_233_6).abs() < 1e-9);
        assert_eq!(normal_quantile(0.0), f64::NEG_INFINITY);
    }
}
