//! Dispatcher and simulated cell over real sockets of the loopback interface.

mod access;
mod addressing;
mod arm;
mod credential_folder;
mod halting;
mod impostor;
mod instant;
mod lab;
mod path;
mod report_checks;
mod restart;
mod ros2;
mod serving;
mod signing;
mod tls;
mod watching;
