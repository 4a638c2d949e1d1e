//! Makes the digests of the sources that decide the recordings.

fn main() {
    code_digest::emit();
}
