#!/bin/sh
# Builds the wheel that is given on, for x86_64 with the C library 2.28 or later: optimized for size.
# It compiles everything in a profile of its own, and needs `pip install maturin ziglang auditwheel`.
set -eu
crate=$(dirname "$0")
wheels=${1:-wheels}
profile=${PROFILE:-wheel}
# Linked as usual, but with the C library's symbols as zig has them of an old one: zig's own linker folds no equal
# functions, which are a tenth of the program.
stubs=$(mktemp -d)
trap 'rm -rf "$stubs"' EXIT
echo > "$stubs/nothing.c"
ZIG_GLOBAL_CACHE_DIR="$stubs/zig" ZIG_LOCAL_CACHE_DIR="$stubs/zig" python3 -m ziglang cc -shared \
    -target x86_64-linux-gnu.2.28 "$stubs/nothing.c" -o "$stubs/nothing.so" -lm -ldl -lpthread -lrt -lutil
find "$stubs/zig" -name 'lib*.so.*' -exec cp {} "$stubs" \;
find "$stubs/zig" -name libc_nonshared.a -exec cp {} "$stubs" \;
for library in m dl pthread rt util; do
    ln -s "$(basename "$stubs"/lib$library.so.*)" "$stubs/lib$library.so"
done
echo "GROUP ( libc.so.6 libc_nonshared.a )" > "$stubs/libc.so"
maturin build --profile "$profile" --manifest-path "$crate/Cargo.toml" --out "$wheels" \
    --compatibility manylinux_2_28 -- "-Clink-arg=-L$stubs" -Clink-arg=-Wl,--icf=all
for wheel in "$wheels"/*manylinux_2_28_x86_64.whl; do
    ls -l "$wheel"
    auditwheel show "$wheel" | grep -F '"manylinux_2_28_x86_64"'
done
