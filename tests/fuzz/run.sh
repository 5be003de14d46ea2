#!/usr/bin/env bash
# run.sh MINUTES [TARGET…]: builds the fuzz targets with clang's libFuzzer under the address and undefined-behaviour
# sanitizers and runs each (default: modbus_fuzz and rtu_fuzz) for so many minutes, one job at low priority. New inputs
# stay in build/fuzz/found/, what crashes in build/fuzz/crashes/; minimise that and commit it in corpus/:
#   build/fuzz/modbus_fuzz -minimize_crash=1 -runs=100000 FILE
# In corpus/ files with a name are by seeds.py, those named by a hash were found. To add what reaches new code:
#   build/fuzz/modbus_fuzz -set_cover_merge=1 -use_counters=0 -use_cmp=0 -max_len=600 tests/fuzz/corpus/modbus \
#     build/fuzz/found/modbus
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/../.."

if [[ ! ${1:-} =~ ^[1-9][0-9]*$ ]]; then
  sed -n '2,8s/^# //p' "${BASH_SOURCE[0]}" >&2
  exit 2
fi
seconds=$((60 * $1))
shift
targets=("$@")
[[ ${#targets[@]} -gt 0 ]] || targets=(modbus_fuzz rtu_fuzz)

compiler=$(command -v clang++ || command -v clang++-19 || command -v clang++-14 || true)
if [[ -z $compiler ]]; then
  echo "run.sh: no clang++; type as root: apt-get install clang libclang-rt-dev" >&2
  exit 1
fi

out=build/fuzz
mkdir -p "$out/crashes"
# Built without CMake: what the targets need are a few files of the Modbus map, and clang has no part in other builds.
sources=(daemon/control.cpp daemon/modbus/{answer,framing,registers,registers_table,rtu_frame,rtu_framing,status,units,write}.cpp
  pipeline/types/{bin,bin_faults,reason}.cpp)
flags=(-std=c++20 -O1 -g -fno-omit-frame-pointer -fno-sanitize-recover=all -I. -isystem /usr/include/eigen3
  -isystem /usr/include/opencv4 -DSPDLOG_COMPILED_LIB -DSPDLOG_FMT_EXTERNAL -DSPDLOG_SHARED_LIB -DFMT_SHARED)
# The float-to-integer checks of the integer mirror are among these.
sanitizers=address,undefined,float-cast-overflow,float-divide-by-zero
cache=$(command -v ccache || true)
objects=()
for source in "${sources[@]}"; do
  object=$out/$(basename "$source" .cpp).o
  ${cache:+"$cache"} "$compiler" "${flags[@]}" -fsanitize=fuzzer-no-link,$sanitizers -c "$source" -o "$object"
  objects+=("$object")
done
for target in "${targets[@]}"; do
  "$compiler" "${flags[@]}" -fsanitize=fuzzer,$sanitizers "tests/fuzz/$target.cpp" "${objects[@]}" -o "$out/$target" \
    -lspdlog -lfmt -lopencv_core
done

export ASAN_OPTIONS=detect_stack_use_after_return=1 UBSAN_OPTIONS=print_stacktrace=1
for target in "${targets[@]}"; do
  corpus=${target%_fuzz}
  mkdir -p "$out/found/$corpus"
  echo "== $target, $((seconds / 60)) min" >&2
  # The first folder takes what is found; the committed one is only read.
  nice "$out/$target" -max_total_time="$seconds" -max_len=2048 -timeout=10 -rss_limit_mb=2048 -print_final_stats=1 \
    -artifact_prefix="$out/crashes/$corpus-" "$out/found/$corpus" "tests/fuzz/corpus/$corpus"
done
