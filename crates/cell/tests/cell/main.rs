//! Dispatcher and simulated cell over real sockets of the loopback interface.

mod halting;
mod lab;
mod remembering;
mod ros2;
mod serving;
