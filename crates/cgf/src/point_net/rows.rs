//! Products of matrices and statistics of columns, for rows that belong to clouds.

use candle_core::{Device, Tensor};
use rayon::prelude::*;

use super::Normalized;
use crate::{CgfError, precision::narrow};

/// Which factor of a product is turned over.
#[derive(Debug, Clone, Copy)]
pub(super) enum Transposed {
    Neither,
    Left,
    Right,
}

/// Multiplies two matrices given as rows.
pub(super) fn product(
    left: &[f32],
    left_shape: [usize; 2],
    right: &[f32],
    right_shape: [usize; 2],
    transposed: Transposed,
) -> Result<Vec<f32>, CgfError> {
    let left = Tensor::from_slice(left, &left_shape[..], &Device::Cpu)?;
    let right = Tensor::from_slice(right, &right_shape[..], &Device::Cpu)?;
    let product = match transposed {
        Transposed::Neither => left.matmul(&right)?,
        Transposed::Left => left.t()?.matmul(&right)?,
        Transposed::Right => left.matmul(&right.t()?)?,
    };
    Ok(product.flatten_all()?.to_vec1()?)
}

/// Adds up what `add` adds per cloud, in the order of the clouds.
pub(super) fn cloud_sums(
    n_clouds: usize,
    width: usize,
    add: impl Fn(usize, &mut [f64]) + Sync,
) -> Vec<f64> {
    let per_cloud: Vec<Vec<f64>> = (0..n_clouds)
        .into_par_iter()
        .map(|cloud| {
            let mut sums = vec![0.0; width];
            add(cloud, &mut sums);
            sums
        })
        .collect();
    let mut total = vec![0.0; width];
    for sums in per_cloud {
        for (total, sum) in total.iter_mut().zip(sums) {
            *total += sum;
        }
    }
    total
}

pub(super) fn column_means(rows: &[f32], width: usize, points: usize) -> Vec<f64> {
    let n_rows = rows.len() / width;
    let mut sums = cloud_sums(n_rows / points, width, |cloud, sums| {
        for row in rows[cloud * points * width..(cloud + 1) * points * width].chunks_exact(width) {
            for (sum, &x) in sums.iter_mut().zip(row) {
                *sum += f64::from(x);
            }
        }
    });
    for sum in &mut sums {
        *sum /= n_rows as f64;
    }
    sums
}

pub(super) fn measure(rows: &[f32], width: usize, points: usize) -> Normalized {
    let mean = column_means(rows, width, points);
    let n_rows = rows.len() / width;
    let mut variance = cloud_sums(n_rows / points, width, |cloud, sums| {
        for row in rows[cloud * points * width..(cloud + 1) * points * width].chunks_exact(width) {
            for ((sum, &x), mean) in sums.iter_mut().zip(row).zip(&mean) {
                *sum += (f64::from(x) - mean).powi(2);
            }
        }
    });
    for sum in &mut variance {
        *sum /= n_rows as f64;
    }
    Normalized { mean, variance }
}

/// Returns the covariance matrix of the columns, cloud by cloud in `f32`, summed in `f64`.
pub(super) fn covariance(rows: &[f32], mean: &[f64], points: usize) -> Result<Vec<f32>, CgfError> {
    let width = mean.len();
    let mut sums = vec![0.0_f64; width * width];
    for cloud in rows.chunks_exact(points * width) {
        let centered: Vec<f32> = cloud
            .chunks_exact(width)
            .flat_map(|row| row.iter().zip(mean).map(|(&x, &mean)| x - narrow(mean)))
            .collect();
        let squares = product(
            &centered,
            [points, width],
            &centered,
            [points, width],
            Transposed::Left,
        )?;
        for (sum, &square) in sums.iter_mut().zip(&squares) {
            *sum += f64::from(square);
        }
    }
    let n_rows = (rows.len() / width) as f64;
    Ok(sums.iter().map(|sum| narrow(sum / n_rows)).collect())
}
