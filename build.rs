//! Digests the code of every stage, for `dataflow::code!`.

fn main() {
    code_digest::emit();
}
