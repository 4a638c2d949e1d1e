//! The program `pipeline`.

use std::process::ExitCode;

fn main() -> ExitCode {
    pipeline::command_line(&pipeline::kinds())
}
