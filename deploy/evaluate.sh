#!/usr/bin/env bash
# Runs all experiments and writes EVALUATION.md and deploy/evaluation/. Real recordings are used when GEM_DATA_DIR
# names them. usage: deploy/evaluate.sh BIN_DIR
set -euo pipefail
cd "$(dirname "$0")/.."
bin=$1 out=deploy/evaluation

data=()
if [[ -n ${GEM_DATA_DIR:-} ]]; then data=(--data "$GEM_DATA_DIR"); fi
begun=$SECONDS
"$bin/gem" evaluate all --out "$out" "${data[@]}"

{
  cat deploy/evaluation_intro.md
  printf 'Machine: %s, %s cores. The whole took %d minutes.\n\n' \
    "$(sed -n 's/^model name[^:]*: //p' /proc/cpuinfo | head -1)" "$(nproc)" $(((SECONDS - begun) / 60))
  cat "$out/sections.md"
} >EVALUATION.md
rm "$out"/sections.md "$out"/*/report.md
echo "EVALUATION.md written in $(((SECONDS - begun) / 60)) min"
