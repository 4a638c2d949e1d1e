//! Time and threads of a process: on the machine's clock, or on that of a simulation.
//!
//! What waits, retries or shares work asks this crate for the time, and for its threads. In a [`World`] the same code
//! runs in many simulated processes, one thread at a time, and an hour of waiting takes no time:
//!
//! ```
//! use std::time::Duration;
//!
//! let waited = clock::World::simulate(7, |world| {
//!     let began = clock::now();
//!     let process = world.start("machine", || clock::sleep(Duration::from_secs(3600)));
//!     while !process.is_over() {
//!         clock::sleep(Duration::from_secs(60));
//!     }
//!     clock::since(began)
//! });
//! assert_eq!(waited, Duration::from_secs(3600));
//! ```
//!
//! Invariants: of the threads of a world one runs at a time, and which is next follows from its seed; a process that
//! is killed does nothing more.
//!
//! What this crate deliberately does not simulate: files, locks between processes, and threads that are
//! interrupted between two waits.

mod condvar;
mod simulated;
mod threads;
mod time;
mod watched;

pub use condvar::{Condvar, lock};
pub use simulated::{Process, World, answer_after};
pub use threads::{all, beside, carry, spawn};
pub use time::{machine, now, process, random, since, sleep, wall};
pub use watched::{Pass, watched};
