#!/usr/bin/env bash
# debian-chroot-check.sh RELEASE [CTEST ARGUMENT…]: builds the sources in a bare Debian ("trixie", "bookworm") and runs
# tests there: the drivers' unit tests, or, with arguments for ctest, everything is built and those are run.
# As root, with mmdebstrap. $GRANARY_CHROOT names a folder to keep and use again (3 to 4 GB); else one is made and removed.
set -euo pipefail
release=${1:?usage: debian-chroot-check.sh RELEASE [CTEST ARGUMENT…]}
shift
self=$(realpath "${BASH_SOURCE[0]}")
source_dir=$(realpath "$(dirname "$self")/../..")

if [[ -z ${GRANARY_CHROOT_INSIDE:-} ]]; then
  for tool in mmdebstrap unshare; do
    command -v "$tool" >/dev/null || { echo "debian-chroot-check: $tool is missing (apt-get install mmdebstrap)" >&2; exit 1; }
  done
  [[ $(id -u) -eq 0 ]] || { echo "debian-chroot-check: run this as root, it mounts and changes root" >&2; exit 1; }
  chroot_dir=${GRANARY_CHROOT:-}
  if [[ -z $chroot_dir ]]; then
    chroot_dir=$(mktemp -d /var/tmp/granary-chroot.XXXXXX)
    # The mounts are gone with their namespace by then; should one not be, it is left alone.
    trap 'rm -rf --one-file-system "$chroot_dir"' EXIT
  fi
  mkdir -p "$chroot_dir"
  # Mounts and processes of their own: an interrupted run leaves neither behind.
  GRANARY_CHROOT_INSIDE=1 GRANARY_CHROOT=$(realpath "$chroot_dir") \
    unshare --mount --pid --fork --kill-child --propagation private "$self" "$release" "$@"
  exit
fi

root=$GRANARY_CHROOT
if [[ ! -e $root/etc/debian_version ]]; then
  mmdebstrap --mode=root --variant=apt "$release" "$root" >&2
fi
# shellcheck disable=SC1091
found=$(. "$root/etc/os-release" && echo "$VERSION_CODENAME")
[[ $found == "$release" ]] || { echo "debian-chroot-check: $root holds $found, not $release" >&2; exit 1; }

mkdir -p "$root/source" "$root/build" "$root/dev/shm"
mount -t proc proc "$root/proc"
mount -t tmpfs shm "$root/dev/shm"
mount --bind "$source_dir" "$root/source"
mount -o remount,bind,ro "$root/source"

inside() { chroot "$root" /usr/bin/env -i PATH=/usr/sbin:/usr/bin:/sbin:/bin HOME=/root LC_ALL=C.UTF-8 "$@"; }
inside /source/tests/tools/install-packages.sh
inside cmake -S /source -B /build -G Ninja -DCMAKE_BUILD_TYPE=Release -DGRANARY_WERROR=ON >&2
if [[ $# -gt 0 ]]; then
  inside cmake --build /build --parallel "$(nproc)" -- -k 0 >&2
  inside ctest --test-dir /build --output-on-failure "$@"
else
  mapfile -t tests < <(sed -n 's/^granary_test(\([a-z0-9_]*\) LABEL unit.*/\1/p' "$source_dir/tests/drivers/CMakeLists.txt")
  inside cmake --build /build --parallel "$(nproc)" --target "${tests[@]}" -- -k 0 >&2
  inside ctest --test-dir /build --output-on-failure -R "^($(IFS='|'; echo "${tests[*]}"))\\."
fi
