#!/bin/sh
# The stage `map` as a program. It notes that it begins and waits where a test holds it, as the stage does.
set -eu
add=0 modulo=0 more=0
while read -r key value; do
    value=${value%,} value=${value#\"}
    value=${value%\"}
    case $key in
        '"partition":') partition=$value ;;
        '"seed":') seed=$value ;;
        '"add":') add=$value ;;
        '"modulo":') modulo=$value ;;
        '"data.bin":') data=$value ;;
    esac
done < job.json
if [ -n "${OWN_STAGES_LOG:-}" ]; then
    echo "map parts $partition $$ $seed" >> "$OWN_STAGES_LOG"
fi
while [ -d "${OWN_STAGES_GATE:-}" ] && [ ! -e "$OWN_STAGES_GATE/$partition.go" ]; do
    sleep 0.01
done
byte=0 to=
while [ $byte -lt 256 ]; do
    changed=$(((byte + add + more) % 256))
    if [ "$modulo" -gt 0 ]; then
        changed=$((changed % modulo))
    fi
    to="$to\\$((changed / 64))$((changed / 8 % 8))$((changed % 8))"
    byte=$((byte + 1))
done
LC_ALL=C tr '\000-\377' "$to" < "$data" > out/data.bin
