//! Dispatcher and simulated cell over real sockets of the loopback interface.

mod access;
mod believing;
mod carried;
mod halting;
mod impostor;
mod lab;
mod papers;
mod remembering;
mod ros2;
mod serving;
mod signing;
mod watching;
