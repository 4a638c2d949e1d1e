//! The program `pipeline`.

use std::{env, process::ExitCode, thread};

use mimalloc::MiMalloc;

/// Training and physics allocate and free large blocks in every step; the system's allocator
/// returns each to the kernel, which zeroes its pages at the next allocation: a tenth of a step.
#[global_allocator]
static ALLOCATOR: MiMalloc = MiMalloc;

/// Variable for the number of candle's threads for elementwise operations. They wait by spinning: beside another
/// program, training took twice as long with them as without, and on two free cores no less time. Matrix products
/// and our own code do not use them.
const CANDLE_THREADS: &str = "CANDLE_NUM_THREADS";
/// Variable for the number of all other threads. Without it candle counts the processors anew at every matrix
/// product, by reading `/proc/cpuinfo`: with 128 entries there, training took four times as long.
const THREADS: &str = "RAYON_NUM_THREADS";

fn main() -> ExitCode {
    set_where_unset(CANDLE_THREADS, 1);
    // As many as without the variable.
    set_where_unset(
        THREADS,
        thread::available_parallelism().map_or(1, Into::into),
    );
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
