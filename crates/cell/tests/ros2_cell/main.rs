//! A cell on ROS 2, and controllers that stand in for those of a robot, each a party of its own at a
//! router, as they would be at the router of `rmw_zenoh`.

#[path = "../../examples/ros2_cell/config.rs"]
mod config;
#[path = "../../examples/ros2_cell/controllers.rs"]
mod controllers;
#[path = "../../examples/ros2_cell/emulated.rs"]
mod emulated;
#[path = "../../examples/ros2_cell/executing.rs"]
mod executing;
mod faults;
mod going_wrong;
mod lab;
#[path = "../../examples/ros2_cell/machine.rs"]
mod machine;
#[path = "../../examples/ros2_cell/measurements.rs"]
mod measurements;
mod motions;
#[path = "../../examples/ros2_cell/path.rs"]
mod path;
mod stopping;
mod wire;
