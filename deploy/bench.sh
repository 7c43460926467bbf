#!/usr/bin/env bash
# Prints the figures of PERFORMANCE.md: bench.sh BIN_DIR [KITTI_SEQUENCE]. Without a recording
# (GEM_DATA_DIR/sequences/00 by default), the local mapper runs stage by stage on a simulated scan.
set -euo pipefail
bin="$1"
recording="${2:-${GEM_DATA_DIR:-}/sequences/00}"

if [[ -d "$recording/velodyne" ]]; then
  echo "== local mapper, cpu, $recording (ms a scan; factor: total over read pass)"
  for threads in 1 2; do
    for window in "8 0.2" "16 0.2" "8 0.1" "16 0.1"; do
      read -r size cell <<<"$window"
      for run in 1 2 3; do
        printf '%s thread(s), %s m at %s m, run %s: ' "$threads" "$size" "$cell" "$run"
        "$bin/gem" bench local "$recording" --backend cpu --threads "$threads" --local_size_m "$size" \
          --cell_size_m "$cell" --json |
          sed -E 's/.*"read_pass_ms":([0-9.]+),"total_ms":\{"median":([0-9.]+),"p95":([0-9.]+)\},(.*)\}/\1 \2 \3 \4/' |
          awk '{printf "factor %.1f, total %s, p95 %s, read pass %s, %s\n", $2 / $1, $2, $3, $1, $4}'
      done
    done
  done
else
  echo "no recording at $recording: see README for KITTI; the stages run on a simulated scan"
fi

if [[ -x "$bin/local_stages_bench" ]]; then
  echo "== stages of the local mapper: name/vectors/window; vectors 0 baseline, 1 AVX2, 2 AVX-512; window 0 8 m at 0.2 m, 1 16 m at 0.1 m"
  "$bin/local_stages_bench" --benchmark_min_time=0.2
fi

echo "== global mapper: a map of 3.7 km"
for threads in 1 2; do
  echo "$threads thread(s)"
  "$bin/gem" bench global --threads "$threads"
done

echo "== ten corrections a second beside a streaming robot, through a gem_server"
"$bin/gem" bench corrections
