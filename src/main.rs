//! The program `pipeline`.

use std::{
    alloc::{GlobalAlloc, Layout},
    env,
    process::ExitCode,
};

use mimalloc::MiMalloc;

#[global_allocator]
static ALLOCATOR: Allocator = Allocator;

/// Training and physics allocate and free large blocks in every step; the system's allocator
/// returns each to the kernel, which zeroes its pages at the next allocation: a tenth of a step.
/// Where it has no more memory, the program says so and ends.
struct Allocator;

#[expect(
    unsafe_code,
    reason = "an allocator is one by such functions; these only pass on"
)]
// SAFETY: every block is that of `MiMalloc`, which keeps the contract.
unsafe impl GlobalAlloc for Allocator {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        // SAFETY: as of the caller.
        checked(unsafe { MiMalloc.alloc(layout) }, layout.size())
    }

    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        // SAFETY: as of the caller.
        checked(unsafe { MiMalloc.alloc_zeroed(layout) }, layout.size())
    }

    unsafe fn realloc(&self, block: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        // SAFETY: as of the caller.
        checked(unsafe { MiMalloc.realloc(block, layout, size) }, size)
    }

    unsafe fn dealloc(&self, block: *mut u8, layout: Layout) {
        // SAFETY: as of the caller.
        unsafe { MiMalloc.dealloc(block, layout) }
    }
}

/// Passes a block on, if there is one.
#[inline]
fn checked(block: *mut u8, bytes: usize) -> *mut u8 {
    if block.is_null() {
        pipeline::out_of_memory(bytes);
    }
    block
}

/// Variable for the number of candle's threads for elementwise operations. They wait by spinning: beside another
/// program, training took twice as long with them as without, and on two free cores no less time.
const CANDLE_THREADS: &str = "CANDLE_NUM_THREADS";
/// Variable for the number of rayon's threads.
const THREADS: &str = "RAYON_NUM_THREADS";

fn main() -> ExitCode {
    set_where_unset(CANDLE_THREADS, 1);
    // As many as without the variable, where there is memory for them.
    set_where_unset(THREADS, pipeline::threads());
    pipeline::command_line(&pipeline::kinds())
}

/// Sets a variable of the environment that has no value.
fn set_where_unset(variable: &str, number: usize) {
    if env::var_os(variable).is_none() {
        #[expect(unsafe_code, reason = "there is no other way to tell candle")]
        // SAFETY: no other thread exists yet that could read or write the environment.
        unsafe {
            env::set_var(variable, number.to_string());
        }
    }
}
