//! The Python module `pipeline`: the program, and what its stages compute, on numpy's arrays.
//!
//! It computes nothing itself: every class is a face of a stage or of a crate that stages use, and gives the same bits.
//! What comes from Python (arrays, paths, names) is checked once here, and every failure is an exception
//! `pipeline.Error` with what is wrong and what to do. Long calls release the interpreter's lock.
//!
//! `pipeline/_pipeline.pyi` beside it has the types; a test compares it with the module.

mod arrays;
mod candidates;
mod error;
mod function;
mod hand;
mod lake;
mod library_hand;
mod motions;
mod object;
mod options;
mod own_hand;
mod plan;
mod program;
mod recording;
mod retargeter;
mod robot;
mod rollouts;
mod run;
mod threads;

use mimalloc::MiMalloc;
use pyo3::prelude::*;

#[global_allocator]
static ALLOCATOR: MiMalloc = MiMalloc;

/// The native part of the module.
#[pymodule]
mod _pipeline {
    #[pymodule_export]
    use super::{
        candidates::Candidates,
        error::Error,
        function::Function,
        hand::Hand,
        lake::{Lake, Recordings, Table},
        motions::Motion,
        object::Object,
        options::options,
        plan::Plan,
        program::main,
        recording::{Messages, Recording, save_recording},
        retargeter::Retargeter,
        robot::Robot,
        rollouts::{Rollout, Rollouts},
        threads::after_fork,
    };
    #[pymodule_export]
    #[expect(non_upper_case_globals, reason = "the name that Python looks for")]
    const __version__: &str = env!("CARGO_PKG_VERSION");
}
