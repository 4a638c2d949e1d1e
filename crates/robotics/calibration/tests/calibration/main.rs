//! Calibrations of drawn measurements, of measurements that must be refused, and beside other implementations.

mod drawing;
mod drawn;
mod golden;
mod refusals;
