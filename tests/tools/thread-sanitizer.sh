#!/usr/bin/env bash
# Runs the matcher's tests under the thread sanitizer. Debian's oneTBB is built without it, so that the sanitizer sees
# no task wait for another and calls every result a race; suppressing those would suppress all there is. So oneTBB is
# built from Debian's source with the sanitizer first (half a minute; needs the network once).
set -euo pipefail
cd "$(dirname "${BASH_SOURCE[0]}")/../.."

tests=(census_test aggregate_test coarse_test match_test match_fuzz_test refine_test)
tbb="$PWD/build/tsan-tbb"
if [[ ! -e $tbb/libtbb.so.12 ]]; then
  mkdir -p "$tbb/lists/partial"
  # Sources from lists of its own, so that the machine's are left as they are.
  echo "deb-src http://deb.debian.org/debian $(. /etc/os-release && echo "$VERSION_CODENAME") main" >"$tbb/sources.list"
  apt=(apt-get -q -o "Dir::Etc::sourcelist=$tbb/sources.list" -o Dir::Etc::sourceparts=/dev/null
    -o "Dir::State::lists=$tbb/lists")
  "${apt[@]}" update >&2
  (cd "$tbb" && "${apt[@]}" source --download-only onetbb >&2 && tar xf onetbb_*.orig.tar.*)
  cmake -S "$tbb"/oneTBB-* -B "$tbb/build" -G Ninja -DCMAKE_BUILD_TYPE=RelWithDebInfo -DTBB_SANITIZE=thread \
    -DTBB_TEST=OFF -DTBB_STRICT=OFF -DTBBMALLOC_BUILD=OFF >&2
  cmake --build "$tbb/build" --target tbb >&2
  cp "$(find "$tbb/build" -name 'libtbb*.so.12' | head -n1)" "$tbb/libtbb.so.12"
fi

tests/tools/build.sh --preset tsan -- "${tests[@]}"
# One process a program: each test alone would mostly start and stop.
export LD_LIBRARY_PATH="$tbb" TSAN_OPTIONS=halt_on_error=1
for test in "${tests[@]}"; do
  echo "$test" >&2
  build/tsan/bin/"$test" --gtest_brief=1
done
