#!/usr/bin/env bash
# Drives a simulated robot round a block with drifting odometry, closes the loop, sends the correction.
#   deploy/demo.sh [BIN_DIR [OUT_DIR]]      default: build/release/bin out
# Leaves before.png, after.png and timings.txt in OUT_DIR; any failure ends it loudly.
set -euo pipefail

bin=${1:-build/release/bin}
out=${2:-out}
map=block
session=demo
ready_seconds_max=20
stop_seconds_max=10

fail() {
  echo "demo: $*" >&2
  exit 1
}
for binary in gem gem_server; do
  [[ -x "$bin/$binary" ]] || fail "$bin/$binary is missing: run make build first"
done
mkdir -p "$out"
rm -f "$out"/{before,after}.png "$out"/{timings,server}.txt

server_pid=
work=$(mktemp -d)
cleanup() {
  local status=$?
  if [[ -n "$server_pid" ]]; then
    kill -TERM "$server_pid" 2>/dev/null || true
    wait "$server_pid" 2>/dev/null || true
  fi
  rm -rf "$work"
  if ((status != 0)); then
    echo "demo: failed with status $status; the server's last words, from $out/server.txt:" >&2
    tail -n 20 "$out/server.txt" >&2 || true
  fi
}
trap cleanup EXIT
trap 'exit 130' INT TERM

"$bin/gem_server" --listen 127.0.0.1:0 --metrics_listen 127.0.0.1:0 >"$out/server.txt" 2>&1 &
server_pid=$!
server=
for ((i = 0; i < ready_seconds_max * 10; ++i)); do
  server=$(sed -n 's/^gem_server ready grpc=\([^ ]*\) .*/\1/p' "$out/server.txt")
  [[ -n "$server" ]] && break
  kill -0 "$server_pid" 2>/dev/null || fail "the server ended before it was ready"
  sleep 0.1
done
[[ -n "$server" ]] || fail "the server was not ready after $ready_seconds_max s"

echo "== A robot drives round the block; its odometry drifts."
"$bin/gem" simulate block --server "$server" --map "$map" --robot demo_robot --session "$session" \
  --local_size_m 24 --submap_length_m 10 --save_corrected "$work/poses.txt" --save_times "$work/times.txt"
"$bin/gem" export --server "$server" --map "$map" --layer elevation --format png --out "$out/before.png"

echo "== The loop is closed: SLAM corrects the whole trajectory."
"$bin/gem" correct --server "$server" --map "$map" --session "$session" \
  --poses "$work/poses.txt" --times "$work/times.txt"
"$bin/gem" export --server "$server" --map "$map" --layer elevation --format png --out "$out/after.png"

"$bin/gem" status --server "$server" | tee "$out/timings.txt"

kill -TERM "$server_pid"
for ((i = 0; i < stop_seconds_max * 10; ++i)); do
  kill -0 "$server_pid" 2>/dev/null || break
  sleep 0.1
done
kill -0 "$server_pid" 2>/dev/null && fail "the server did not stop within $stop_seconds_max s"
pid=$server_pid
server_pid=
wait "$pid" || fail "the server ended with status $?"

for file in before.png after.png timings.txt; do
  [[ -s "$out/$file" ]] || fail "$out/$file is empty"
done
cmp -s "$out/before.png" "$out/after.png" && fail "the correction changed nothing"
echo "== Done: $out/before.png, $out/after.png, $out/timings.txt"
