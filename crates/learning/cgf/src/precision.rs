//! The border between `f64` of kinematics and `f32` of tensors.

/// Rounds to the nearest `f32`.
#[expect(
    clippy::cast_possible_truncation,
    reason = "the one place where numbers enter tensors"
)]
pub(crate) fn narrow(number: f64) -> f32 {
    number as f32
}

/// Rounds every number to the nearest `f32`.
pub(crate) fn narrow_all(numbers: &[f64]) -> Vec<f32> {
    numbers.iter().map(|&number| narrow(number)).collect()
}

/// Returns a row number as candle counts rows.
#[expect(
    clippy::cast_possible_truncation,
    reason = "no tensor here has 2³² rows"
)]
pub(crate) fn row_index(row: usize) -> u32 {
    row as u32
}
