#!/usr/bin/env bash
# Style of the sources: `format` checks, `fix` rewrites, `tidy` runs clang-tidy over build/clang, `proto` runs buf.
set -euo pipefail
cd "$(dirname "$0")/.."

sources() { git ls-files --cached --others --exclude-standard "$@"; }

case "${1:-}" in
  format) sources '*.h' '*.cc' '*.cu' | xargs clang-format --dry-run --Werror ;;
  fix) sources '*.h' '*.cc' '*.cu' | xargs clang-format -i ;;
  tidy)
    [[ -f build/clang/compile_commands.json ]] || cmake --preset clang >/dev/null
    # What needs CUDA is not in that build. Generated headers must exist before anything is analysed.
    cmake --build build/clang -j 2 --target gem_grpc >/dev/null
    sources '*.cc' | grep -v '^tests/\|^core/gpu/cuda_runtime.cc$' |
      xargs -P "${JOBS:-2}" -n 2 clang-tidy -p build/clang --quiet --warnings-as-errors='*' 2> >(grep -v 'warnings generated\|Suppressed\|Use -header-filter' >&2)
    ;;
  proto)
    if ! command -v npm >/dev/null; then
      echo "SKIPPED: buf needs npm, which is not here" >&2
      exit 0
    fi
    [[ -x build/buf/node_modules/.bin/buf ]] || npm install --silent --no-audit --no-fund --prefix build/buf @bufbuild/buf@1
    build/buf/node_modules/.bin/buf lint proto
    ;;
  *) echo "usage: $0 format|fix|tidy|proto" >&2; exit 2 ;;
esac
