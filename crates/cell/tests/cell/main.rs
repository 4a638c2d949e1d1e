//! Dispatcher and simulated cell over real sockets of the loopback interface.

mod access;
mod carried;
mod halting;
mod lab;
mod papers;
mod remembering;
mod ros2;
mod serving;
mod watching;
