#!/usr/bin/env bash
# Runs every fuzzer from its seeds, SECONDS_EACH seconds (60), JOBS at a time (2): fuzz.sh BUILD_DIR. What does harm is
# left in BUILD_DIR/fuzz/NAME/found; mended, it goes to tests/fuzz/crashes/NAME, where every test run tries it again.
set -euo pipefail
build=$(cd "$1" && pwd)
export SECONDS_EACH=${SECONDS_EACH:-60} OUT=$build/fuzz DICTIONARY=$PWD/tests/fuzz/gem.dict
export ASAN_OPTIONS=detect_leaks=1:allocator_may_return_null=1 UBSAN_OPTIONS=print_stacktrace=1

"$build/bin/write_seeds" "$OUT/seeds"

fuzz() {
  local fuzzer=$1 name=${1##*/fuzz_}
  mkdir -p "$OUT/$name/corpus" "$OUT/$name/found"
  rm -f "$OUT/$name/found/"*
  if "$fuzzer" -max_total_time="$SECONDS_EACH" -timeout=25 -rss_limit_mb=1536 -max_len=8192 -dict="$DICTIONARY" \
    -print_final_stats=1 -artifact_prefix="$OUT/$name/found/" "$OUT/$name/corpus" "$OUT/seeds/$name" \
    >"$OUT/$name/log" 2>&1; then
    echo "$name: $(sed -n 's/^stat::number_of_executed_units: *//p' "$OUT/$name/log") inputs, no harm"
  else
    tail -40 "$OUT/$name/log"
    echo "$name: FAILED, see $OUT/$name"
    return 1
  fi
}
export -f fuzz

printf '%s\n' "$build"/bin/fuzz_* | xargs -P "${JOBS:-2}" -I{} bash -c 'fuzz {}'
