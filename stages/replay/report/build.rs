//! Makes the digests of the sources that decide this stage's reports.

fn main() {
    code_digest::emit();
}
