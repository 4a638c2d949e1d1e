//! Makes the digests of the sources that decide this stage's output.

fn main() {
    code_digest::emit();
}
