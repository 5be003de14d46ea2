#!/usr/bin/env bash
# Installs what building, testing and the demo need on Debian 12 or 13: only what is missing, through apt, as root or
# with sudo. Where nothing is missing it touches neither apt nor the network. `--list` prints the packages and ends.
set -euo pipefail

# The one list; the names are the same on both releases. OpenCV and PCL have no smaller package that carries their
# headers together with what CMake or pkg-config ask for; the built programs link only six of their libraries.
packages=(
  build-essential cmake ninja-build pkg-config
  libopencv-dev libpcl-dev libeigen3-dev libtbb-dev libhwy-dev             # pipeline
  libpng-dev zlib1g-dev
  libspdlog-dev libfmt-dev nlohmann-json3-dev                             # drivers and daemon
  libmodbus-dev libssl-dev libsystemd-dev libsqlitecpp-dev libsqlite3-dev
  libhowardhinnant-date-dev tzdata libturbojpeg0-dev
  libgpiod-dev                                                            # the projector's line
  libaravis-dev                                                           # GenICam cameras; brings GLib and libusb
  libtomlplusplus-dev libcli11-dev                                        # config and granaryctl
  libgtest-dev libgmock-dev libbenchmark-dev binutils mbpoll              # tests; mbpoll also reads the demo
  python3-pymodbus python3-serial-asyncio                                 # tests: a Modbus client that is not ours
  iproute2                                                                # the network of ./demo --gige
  gnuplot-nox                                                             # run by granaryctl sweep and the benchmarks
)

if [[ ${1:-} == --list ]]; then
  printf '%s\n' "${packages[@]}"
  exit 0
fi

if ! command -v dpkg-query >/dev/null || ! command -v apt-get >/dev/null; then
  echo "install-packages: this is no Debian; install by hand the equivalents of: ${packages[*]}" >&2
  exit 1
fi

missing=()
for package in "${packages[@]}"; do
  # Removed packages that left their configuration behind are known to dpkg but not installed; of one that is there for
  # several architectures there are several lines.
  states=$(dpkg-query -W -f='${db:Status-Status}\n' "$package" 2>/dev/null || true)
  grep -qx installed <<<"$states" || missing+=("$package")
done
[[ ${#missing[@]} -gt 0 ]] || exit 0

as_root=()
if [[ $(id -u) -ne 0 ]]; then
  if ! command -v sudo >/dev/null; then
    echo "install-packages: missing: ${missing[*]}" >&2
    echo "install-packages: run this as root, or install sudo, or type as root: apt-get update && apt-get install ${missing[*]}" >&2
    exit 1
  fi
  as_root=(sudo)
fi

echo "Installing ${#missing[@]} missing packages: ${missing[*]}" >&2
apt() {
  # Through env, so that sudo does not drop the variable; -q and no terminal, so that a log stays readable.
  "${as_root[@]}" env DEBIAN_FRONTEND=noninteractive apt-get -q -y -o Dpkg::Use-Pty=0 "$@" </dev/null >&2
}
apt update
apt install --no-install-recommends "${missing[@]}"
