//! The program `pipeline`.

use std::{env, process::ExitCode};

use mimalloc::MiMalloc;

/// Training and physics take and give back large pieces of memory in every step; the system's allocator
/// returns each to the kernel, which clears it page by page when it is taken again: a tenth of a step.
#[global_allocator]
static ALLOCATOR: MiMalloc = MiMalloc;

/// What says how many threads candle has for operations on single numbers.
const CANDLE_THREADS: &str = "CANDLE_NUM_THREADS";

fn main() -> ExitCode {
    if env::var_os(CANDLE_THREADS).is_none() {
        // These threads wait for each other spinning: with another program beside, a training took twice
        // as long with them as without, and on two free cores no less. Products of matrices and all that
        // is ours are not theirs.
        #[expect(unsafe_code, reason = "there is no other way to tell candle")]
        // SAFETY: no other thread is there yet that could read or write the environment.
        unsafe {
            env::set_var(CANDLE_THREADS, "1");
        }
    }
    pipeline::command_line(&pipeline::kinds())
}
