//! A small exact linear program: the simplex method on a dense tableau.

/// Size below which a number of the tableau is a zero: entries are about 1.
const ZERO: f64 = 1e-10;

/// Solution of a linear program and of its dual.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Solution {
    /// Values of the variables.
    pub(crate) x: Vec<f64>,
    /// The equations' multipliers: growth of the maximum with each right side.
    pub(crate) dual: Vec<f64>,
    /// The maximum.
    pub(crate) value: f64,
}

/// The tableau: rows of equations in terms of a basis, each with its right side last.
struct Tableau {
    rows: Vec<Vec<f64>>,
    /// Reduced costs: gain of the objective per unit of each variable.
    gains: Vec<f64>,
    /// Basic variable of each row.
    basis: Vec<usize>,
    /// Variables of the program; artificial ones follow.
    n: usize,
}

/// Maximizes `gain · x` over `x ≥ 0` with `columns x = right`, by two phases with Bland's rule, which cannot cycle
/// (Chvátal, *Linear Programming*, 1983, chapters 3 and 8). `right` must not be negative.
///
/// Returns `None` if no `x` satisfies the equations, or the gain has no bound.
pub(crate) fn maximize(columns: &[Vec<f64>], right: &[f64], gain: &[f64]) -> Option<Solution> {
    let (n, m) = (columns.len(), right.len());
    let row = |idx: usize| {
        let of_columns = columns.iter().map(|column| column[idx]);
        let artificial = (0..m).map(|other| if other == idx { 1.0 } else { 0.0 });
        of_columns.chain(artificial).chain([right[idx]]).collect()
    };
    let rows: Vec<Vec<f64>> = (0..m).map(row).collect();
    // The first phase maximizes minus the sum of the artificial variables, which are its basis.
    let sum = |column: usize| rows.iter().map(|row| row[column]).sum::<f64>();
    let gains = (0..=n + m).map(|column| {
        if (n..n + m).contains(&column) {
            0.0
        } else {
            sum(column)
        }
    });
    let mut tableau = Tableau {
        gains: gains.collect(),
        rows,
        basis: (n..n + m).collect(),
        n,
    };
    tableau.climb()?;
    let left: f64 = tableau
        .values(|variable| variable >= n)
        .map(|(_, value)| value)
        .sum();
    if left > 1e-9 {
        return None;
    }
    tableau.drive_out();
    tableau.price(gain);
    tableau.climb()?;
    let mut x = vec![0.0; n];
    for (variable, value) in tableau.values(|variable| variable < n) {
        x[variable] = value;
    }
    Some(Solution {
        value: x.iter().zip(gain).map(|(x, gain)| x * gain).sum(),
        x,
        dual: tableau.gains[n..n + m].iter().map(|gain| -gain).collect(),
    })
}

impl Tableau {
    /// Returns the basic variables that count, each with its value.
    fn values(&self, counts: impl Fn(usize) -> bool) -> impl Iterator<Item = (usize, f64)> {
        let rows = self.basis.iter().zip(&self.rows);
        let values = rows.filter_map(|(&variable, row)| Some((variable, *row.last()?)));
        values.filter(move |(variable, _)| counts(*variable))
    }

    /// Exchanges variables while one of the program's gains; `None` if it gains without bound.
    fn climb(&mut self) -> Option<()> {
        loop {
            let Some(enters) = (0..self.n).find(|&variable| self.gains[variable] > ZERO) else {
                return Some(());
            };
            let ratio = |row: &Vec<f64>| {
                let (size, value) = (row[enters], *row.last()?);
                (size > ZERO).then(|| value.max(0.0) / size)
            };
            let ratios = self.rows.iter().enumerate();
            let ratios = ratios.filter_map(|(idx, row)| Some((idx, ratio(row)?)));
            let leaves = ratios.min_by(|(a, of_a), (b, of_b)| {
                of_a.total_cmp(of_b)
                    .then(self.basis[*a].cmp(&self.basis[*b]))
            });
            let (row, _) = leaves?;
            self.pivot(row, enters);
        }
    }

    /// Takes artificial variables, which are zero by now, out of the basis; those of equations that follow from the
    /// others stay, and stay zero.
    fn drive_out(&mut self) {
        for row in 0..self.rows.len() {
            if self.basis[row] >= self.n {
                let sizes = self.rows[row][..self.n].iter().map(|size| size.abs());
                let largest = sizes.enumerate().max_by(|a, b| a.1.total_cmp(&b.1));
                if let Some((enters, size)) = largest
                    && size > ZERO
                {
                    self.pivot(row, enters);
                }
            }
        }
    }

    /// Writes the reduced costs of an objective.
    fn price(&mut self, gain: &[f64]) {
        self.gains.fill(0.0);
        self.gains[..self.n].copy_from_slice(gain);
        for (row, &variable) in self.rows.iter().zip(&self.basis) {
            let of_basis = gain.get(variable).copied().unwrap_or(0.0);
            for (left, size) in self.gains.iter_mut().zip(row) {
                *left -= of_basis * size;
            }
        }
    }

    /// Makes a variable basic in a row.
    fn pivot(&mut self, row: usize, enters: usize) {
        let size = self.rows[row][enters];
        for number in &mut self.rows[row] {
            *number /= size;
        }
        let pivot = self.rows[row].clone();
        let subtract = |from: &mut [f64]| {
            let times = from[enters];
            if times != 0.0 {
                for (number, of_pivot) in from.iter_mut().zip(&pivot) {
                    *number -= times * of_pivot;
                }
                from[enters] = 0.0;
            }
        };
        let others = self.rows.iter_mut().enumerate();
        others
            .filter(|(idx, _)| *idx != row)
            .for_each(|(_, other)| subtract(other));
        subtract(&mut self.gains);
        self.basis[row] = enters;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Chvátal, page 3: max 5x + 4y + 3z with three inequalities, here with slack variables.
    #[test]
    fn the_textbook_program_has_the_textbook_solution() {
        let columns = [
            vec![2.0, 4.0, 3.0],
            vec![3.0, 1.0, 4.0],
            vec![1.0, 2.0, 2.0],
            vec![1.0, 0.0, 0.0],
            vec![0.0, 1.0, 0.0],
            vec![0.0, 0.0, 1.0],
        ];
        let gain = [5.0, 4.0, 3.0, 0.0, 0.0, 0.0];
        let found = maximize(&columns, &[5.0, 11.0, 8.0], &gain).unwrap();
        assert!((found.value - 13.0).abs() < 1e-9);
        let expected = [2.0, 0.0, 1.0];
        for (x, expected) in found.x.iter().zip(expected) {
            assert!((x - expected).abs() < 1e-9, "{:?}", found.x);
        }
        // The right sides are worth 1, 0 and 1.
        for (y, expected) in found.dual.iter().zip([1.0, 0.0, 1.0]) {
            assert!((y - expected).abs() < 1e-9, "{:?}", found.dual);
        }
    }

    #[test]
    fn programs_without_solution_or_bound_have_none() {
        // x + y = 1 and x + y = 2.
        let columns = [vec![1.0, 1.0], vec![1.0, 1.0]];
        assert_eq!(maximize(&columns, &[1.0, 2.0], &[1.0, 0.0]), None);
        // x - y = 1, both as large as one likes.
        assert_eq!(
            maximize(&[vec![1.0], vec![-1.0]], &[1.0], &[1.0, 0.0]),
            None
        );
    }

    #[test]
    fn an_equation_that_follows_from_the_others_does_no_harm() {
        let columns = [vec![1.0, 2.0], vec![1.0, 2.0], vec![2.0, 4.0]];
        let found = maximize(&columns, &[1.0, 2.0], &[1.0, 0.0, 3.0]).unwrap();
        assert!((found.value - 1.5).abs() < 1e-9);
    }
}
