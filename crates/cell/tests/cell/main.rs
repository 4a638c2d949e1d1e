//! Dispatcher and simulated cell over real sockets of the loopback interface.

mod access;
mod arm;
mod halting;
mod impostor;
mod lab;
mod papers;
mod report_checks;
mod restart;
mod ros2;
mod serving;
mod signing;
mod watching;
