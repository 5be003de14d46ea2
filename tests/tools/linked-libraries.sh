#!/usr/bin/env bash
# linked-libraries.sh PROGRAM…: what the shipped programs link. Every library a program itself asks for must be on the
# list below, with its licence, and none that the loader brings in behind them may be one that we must not ship with.
set -euo pipefail
[[ $# -gt 0 ]] || { echo "usage: linked-libraries.sh PROGRAM…" >&2; exit 2; }

# Direct: Apache-2.0 and what may be linked with it as a shared library.
allowed='
  ld-linux libc libm libpthread librt libdl          # glibc, LGPL-2.1
  libstdc++ libgcc_s libatomic                       # GPL-3 with the runtime exception
  libopencv_core libopencv_imgproc libopencv_calib3d # Apache-2.0
  libpcl_common libpcl_kdtree libpcl_search libpcl_filters libpcl_segmentation libpcl_sample_consensus  # BSD
  libtbb libhwy                                      # Apache-2.0
  libspdlog libfmt libdate-tz libtomlplusplus                    # MIT
  libmodbus libsystemd libgpiod                      # LGPL-2.1
  libaravis-0.8 libglib-2.0 libgobject-2.0 libgio-2.0           # LGPL-2.1
  libSQLiteCpp libsqlite3                            # MIT, public domain
  libssl libcrypto                                   # Apache-2.0
  libturbojpeg                                       # IJG and BSD-3
  libpng16 libz libzstd                              # libpng, zlib, BSD
  libasan libubsan libtsan                           # the sanitizer presets
'
# Behind them: GPL, or half a desktop on an edge box.
refused='libgsl libfftw3 libreadline libvtk libmpi libQt5 libQt6 libcholmod'
# Debian's OpenCV picture codecs load GDAL and these; its libtiff loads jbig too.
refused+=' libopencv_imgcodecs libgdal libpoppler libx265 librttopo libjbig'

faults=0
fault() {
  echo "$1" >&2
  faults=$((faults + 1))
}
names=" $(sed 's/#.*//' <<<"$allowed" | tr -s ' \n' ' ') "

for program in "$@"; do
  # Into variables first: a failing command inside < <(…) would pass unseen.
  direct=$(readelf -d "$program")
  direct=$(sed -n 's/.*(NEEDED).*\[\(.*\)\]/\1/p' <<<"$direct")
  [[ -n $direct ]] || fault "$program: names no library at all; is it the program?"
  for library in $direct; do
    name=${library%%.so*}
    [[ $names == *" ${name%%-x86*} "* ]] || fault "$program: links $library, which is not on the list of allowed libraries"
  done

  loaded=$(ldd "$program")
  ! grep -q 'not found' <<<"$loaded" || fault "$program: $(grep 'not found' <<<"$loaded" | tr -s '\t\n' ' ')"
  for name in $refused; do
    ! grep -qE "^[[:space:]]*$name[-._0-9a-zA-Z]*\.so" <<<"$loaded" || fault "$program: brings in $name, which must not be shipped with it"
  done
done
[[ $faults -eq 0 ]] || exit 1
echo "$# programs link what they may"
