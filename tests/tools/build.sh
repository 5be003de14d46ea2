#!/usr/bin/env bash
# build.sh [--preset NAME] [-D…] [-- TARGET…]: installs what is missing, configures build/NAME (default release) and
# builds the targets (default all).
# What ./demo and ./check have in common; quiet where there is nothing to do.
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/../.."

preset=release
if [[ ${1:-} == --preset ]]; then
  preset=$2
  shift 2
fi
definitions=()
while [[ $# -gt 0 && $1 != -- ]]; do
  definitions+=("$1")
  shift
done
[[ $# -eq 0 ]] || shift

tests/tools/install-packages.sh

# One compiler run on PCL's templates takes up to 1.5 GiB: more jobs than memory would swap a small machine to a halt.
cores=$(nproc)
memory_jobs=$(awk '/^MemAvailable/ {print int($2 / (1536 * 1024))}' /proc/meminfo 2>/dev/null || true)
memory_jobs=${memory_jobs:-$cores}
jobs=$((memory_jobs < cores ? memory_jobs : cores))
((jobs >= 1)) || jobs=1

# Configured once; ninja itself configures again when a CMake file has changed.
if [[ ! -f build/$preset/build.ninja || ${#definitions[@]} -gt 0 ]]; then
  cmake --preset "$preset" "${definitions[@]}" >&2
fi
exec cmake --build "build/$preset" --parallel "$jobs" ${1:+--target "$@"} >&2
