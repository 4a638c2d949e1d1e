//! The space for a table on the screen.

use std::io::{self, IsTerminal};

use crate::report::{self, LEFT_OUT};

/// Rows shown on a terminal.
const ROWS: usize = 40;

/// Elements shown of each list where lines are limited.
const ELEMENTS: usize = 8;

/// Minimum width of a text column: below it, columns are left out instead.
const NARROW: usize = 12;

/// Characters between two columns.
const GAP: usize = 2;

/// The space for a table; unlimited if it is not for display.
#[derive(Debug, Clone, Copy, Default)]
pub(crate) struct Page {
    /// Characters in a line.
    pub(crate) width: Option<usize>,
    /// Rows without the header.
    pub(super) rows: Option<usize>,
}

impl Page {
    /// Returns the space on stdout. `COLUMNS` sets the width, even if stdout is not a terminal.
    pub(crate) fn of_stdout() -> Self {
        let stdout = io::stdout();
        Self {
            width: report::width_of(&stdout),
            rows: stdout.is_terminal().then_some(ROWS),
        }
    }

    /// Returns how many elements of a list are shown.
    pub(super) fn elements(self) -> usize {
        self.width.map_or(usize::MAX, |_| ELEMENTS)
    }

    /// Returns which rows of so many are shown: the first and the last.
    pub(super) fn rows_of(self, n_rows: usize) -> (usize, usize) {
        match self.rows {
            Some(limit) if n_rows > limit => (limit.div_ceil(2), limit / 2),
            _ => (n_rows, 0),
        }
    }
}

/// The preferred and the minimum width of a column.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct ColumnWidth {
    pub(super) full: usize,
    pub(super) least: usize,
}

impl ColumnWidth {
    /// Returns the widths of a text column.
    pub(super) fn text(full: usize) -> Self {
        Self {
            full,
            least: full.min(NARROW),
        }
    }

    /// Returns the widths of a number column: only its name may be cut.
    pub(super) fn numbers(name: usize, numbers: usize) -> Self {
        Self {
            full: name.max(numbers),
            least: numbers.max(NARROW.min(name)),
        }
    }
}

/// Returns the widths of the columns that fit, from the first on; fewer columns if even their
/// minimum widths do not fit.
pub(super) fn fit(wishes: &[ColumnWidth], width: usize) -> Vec<usize> {
    if let Some(widths) = shrink(wishes, width) {
        return widths;
    }
    // The ellipsis takes a column of its own.
    let room = width.saturating_sub(GAP + LEFT_OUT.chars().count());
    for n_kept in (1..wishes.len()).rev() {
        let kept = wishes.get(..n_kept).unwrap_or_default();
        if let Some(widths) = shrink(kept, room) {
            return widths;
        }
    }
    vec![room.max(1)]
}

/// Shrinks the widest column until all fit.
fn shrink(wishes: &[ColumnWidth], width: usize) -> Option<Vec<usize>> {
    let mut widths: Vec<usize> = wishes.iter().map(|wish| wish.full.min(width)).collect();
    let gaps = GAP * wishes.len().saturating_sub(1);
    while widths.iter().sum::<usize>() + gaps > width {
        let can_give = widths.iter_mut().zip(wishes);
        let can_give = can_give.filter(|(width, wish)| **width > wish.least);
        let (widest, _) = can_give.max_by_key(|(width, _)| **width)?;
        *widest -= 1;
    }
    Some(widths)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_widest_text_gives_first_and_numbers_never() {
        let wishes = [
            ColumnWidth::text(30),
            ColumnWidth::text(12),
            ColumnWidth::numbers(4, 10),
        ];
        assert_eq!(fit(&wishes, 100), [30, 12, 10]);
        assert_eq!(fit(&wishes, 40), [14, 12, 10]);
        assert_eq!(fit(&wishes, 38), [12, 12, 10]);
    }

    #[test]
    fn columns_that_do_not_fit_are_left_out_from_the_end() {
        let wishes = [ColumnWidth::text(20); 10];
        let widths = fit(&wishes, 40);
        assert!(widths.len() < 10 && !widths.is_empty());
        let used = widths.iter().sum::<usize>() + GAP * widths.len() + 1;
        assert!(used <= 40, "{widths:?}");
        assert_eq!(fit(&[ColumnWidth::numbers(3, 30)], 10), [10]);
    }

    #[test]
    fn the_first_and_the_last_rows_are_shown() {
        let page = Page {
            width: None,
            rows: Some(5),
        };
        assert_eq!(page.rows_of(5), (5, 0));
        assert_eq!(page.rows_of(6), (3, 2));
        assert_eq!(Page::default().rows_of(1000), (1000, 0));
    }
}
