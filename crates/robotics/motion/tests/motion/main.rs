//! Motions whose rates are exact, and what is between their steps.

mod checks;
mod spline;
mod swings;
