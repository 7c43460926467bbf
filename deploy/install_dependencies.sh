#!/usr/bin/env bash
# Installs what building and testing need on Debian 12, if it is missing. Asks apt nothing when all is there.
#   deploy/install_dependencies.sh [--lint] [--deploy] [--node]
# Also what is needed for checking the sources, for testing what is in deploy/, for the client in tests/node.
set -euo pipefail

packages=(
  cmake ninja-build make g++ pkg-config ccache mold git ca-certificates
  libgrpc++-dev protobuf-compiler-grpc protobuf-compiler libprotobuf-dev libabsl-dev libeigen3-dev
  prometheus-cpp-dev libzstd-dev libxxhash-dev libgoogle-perftools-dev libyaml-cpp-dev libcli11-dev libspdlog-dev libpng-dev zlib1g-dev libssl-dev
  libopencv-calib3d-dev
  libgtest-dev libgmock-dev libbenchmark-dev
)
for option in "$@"; do
  case $option in
    --lint) packages+=(clang clang-tidy clang-format libclang-rt-14-dev) ;;
    --deploy) packages+=(python3 python3-yaml prometheus systemd) ;;
    --node) command -v node >/dev/null && command -v npm >/dev/null || packages+=(nodejs npm) ;; # whoever made them
    *) echo "install_dependencies: $option is unknown, want --lint, --deploy or --node" >&2; exit 2 ;;
  esac
done

missing=()
for package in "${packages[@]}"; do
  dpkg-query --show --showformat='${db:Status-Status}' "$package" 2>/dev/null | grep -qx installed || missing+=("$package")
done
[[ ${#missing[@]} -eq 0 ]] && exit 0

echo "installing: ${missing[*]}"
sudo=()
if [[ $(id -u) -ne 0 ]]; then sudo=(sudo); fi
"${sudo[@]}" apt-get update -qq
DEBIAN_FRONTEND=noninteractive "${sudo[@]}" apt-get install -y -qq --no-install-recommends "${missing[@]}" >/dev/null
