#!/usr/bin/env bash
# A server under load, measured from outside: bench_serving.sh BIN_DIR [KITTI_SEQUENCE]. Without a recording
# (GEM_DATA_DIR/sequences/00 by default) robots send simulated scans.
set -euo pipefail
bin="$1"
recording="${2:-${GEM_DATA_DIR:-}/sequences/00}"

scans=()
[[ -d "$recording/velodyne" ]] && scans=("$recording")
"$bin/gem" bench serving "${scans[@]}"
