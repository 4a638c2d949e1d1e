//! The Python module `pipeline`: the program, and the kinematics and retargeting that its stages use, on numpy's arrays.
//!
//! It computes nothing itself: every class is a face of a crate that the stages use too, and gives the same bits.
//! What comes from Python (arrays, paths, names) is checked once here, and every failure is an exception
//! `pipeline.Error` with what is wrong and what to do. Long calls release the interpreter's lock.
//!
//! `pipeline/_pipeline.pyi` beside it has the types; a test compares it with the module.

mod arrays;
mod error;
mod lake;
mod library_hand;
mod motions;
mod own_hand;
mod program;
mod retargeter;
mod robot;
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
        error::Error,
        lake::{Lake, Table},
        motions::Motion,
        program::main,
        retargeter::Retargeter,
        robot::Robot,
        threads::after_fork,
    };
    #[pymodule_export]
    #[expect(non_upper_case_globals, reason = "the name that Python looks for")]
    const __version__: &str = env!("CARGO_PKG_VERSION");
}
