//! The program `pipeline`.

use std::{env, process::ExitCode};

use mimalloc::MiMalloc;

/// Training and physics allocate and free large blocks in every step; the system's allocator
/// returns each to the kernel, which zeroes its pages at the next allocation: a tenth of a step.
#[global_allocator]
static ALLOCATOR: MiMalloc = MiMalloc;

/// Variable for the number of candle's threads for elementwise operations.
const CANDLE_THREADS: &str = "CANDLE_NUM_THREADS";

fn main() -> ExitCode {
    if env::var_os(CANDLE_THREADS).is_none() {
        // These threads wait by spinning: beside another program, training took twice as long with
        // them as without, and on two free cores no less time. Matrix products and our own code do
        // not use them.
        #[expect(unsafe_code, reason = "there is no other way to tell candle")]
        // SAFETY: no other thread exists yet that could read or write the environment.
        unsafe {
            env::set_var(CANDLE_THREADS, "1");
        }
    }
    pipeline::command_line(&pipeline::kinds())
}
