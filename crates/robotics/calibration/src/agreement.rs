//! How well measurements agree.

/// Error of one measurement.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Residual {
    /// Distance between the measured and the predicted point or origin of the board, in meters.
    pub offset_m: f64,
    /// Angle between the measured and the predicted rotation, in radians; `None` of points.
    pub rotation_rad: Option<f64>,
}

/// Errors of measurements, in their order.
#[derive(Debug, Clone, PartialEq)]
pub struct Agreement(pub Vec<Residual>);

impl Agreement {
    /// Returns the root mean square of the offsets, and that of the angles.
    pub fn rms(&self) -> Residual {
        let angles: Option<Vec<f64>> = self.0.iter().map(|it| it.rotation_rad).collect();
        Residual {
            offset_m: rms(self.0.iter().map(|it| it.offset_m)),
            rotation_rad: angles.map(|angles| rms(angles.into_iter())),
        }
    }

    /// Returns the number, from 1, of the measurement with the largest offset, and its error.
    pub fn largest(&self) -> Option<(usize, Residual)> {
        let errors = self.0.iter().copied().enumerate();
        let largest = errors.max_by(|(_, a), (_, b)| a.offset_m.total_cmp(&b.offset_m));
        largest.map(|(idx, error)| (idx + 1, error))
    }
}

/// Returns the root mean square of numbers, 0 of none.
pub(crate) fn rms(numbers: impl ExactSizeIterator<Item = f64>) -> f64 {
    let n = numbers.len().max(1) as f64;
    (numbers.map(|number| number * number).sum::<f64>() / n).sqrt()
}
