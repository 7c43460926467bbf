#!/usr/bin/env bash
# The client in Node, against the golden vectors and a server: test_node.sh BIN_DIR. Exits with 77 if its packages cannot be
# had, as where there is no network: then nothing was tested.
set -euo pipefail
cd "$(dirname "$0")/.."
GEM_BIN=$(cd "$1" && pwd)
export GEM_BIN
if ! { deploy/install_dependencies.sh --node && npm ci --prefix tests/node; } >build/npm.log 2>&1; then
  tail -20 build/npm.log >&2
  echo "SKIPPED: the packages of tests/node cannot be had; nothing was tested" >&2
  exit 77
fi
cd tests/node
exec node --test
