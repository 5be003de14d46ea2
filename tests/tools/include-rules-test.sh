#!/usr/bin/env bash
# Shows that include-rules.sh catches what it should and lets pass what it may: each case is one file in a bare tree.
set -euo pipefail
rules=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)/include-rules.sh
tree=$(mktemp -d)
trap 'rm -rf "$tree"' EXIT
faults=0

# expect caught|passes FILE LINE: does the checker's verdict on FILE with just that LINE agree?
expect() {
  rm -rf "${tree:?}"/*
  mkdir -p "$tree"/{pipeline,drivers,config,daemon} "$(dirname "$tree/$2")"
  printf '// A file.\n%s\n' "$3" >"$tree/$2"
  local verdict=passes output
  output=$("$rules" "$tree") || verdict=caught
  if [[ $verdict != "$1" ]]; then
    echo "FAULT: $2 with '$3' should be: $1, but: $verdict"
    faults=$((faults + 1))
  elif [[ $verdict == caught && $output != "$2:2: "* ]]; then
    echo "FAULT: $2 with '$3' is reported as '$output', not with file and line"
    faults=$((faults + 1))
  fi
}

expect passes pipeline/types/a.h '#include <opencv2/core/mat.hpp>'
expect passes pipeline/types/a.cpp '#include "pipeline/types/a.h"'
expect caught pipeline/types/a.h '#include <opencv2/imgproc.hpp>'
expect caught pipeline/types/a.h '#include "pipeline/options.h"'
expect caught pipeline/types/a.h '#include "a.h"'

expect passes pipeline/a.cpp '#include <pcl/point_types.h>'
expect passes pipeline/stereo/a.cpp '#include <hwy/highway.h>'
expect caught pipeline/a.h '#include <pcl/point_types.h>'
expect caught pipeline/a.cpp '#include "drivers/rig.h"'
expect caught pipeline/a.cpp '#  include "daemon/options.h"'
expect caught pipeline/a.cpp '#include "config/config.h"'
expect caught pipeline/stereo/a.cpp '#include <spdlog/spdlog.h>'
expect caught pipeline/a.cpp 'auto t = std::chrono::system_clock::now();'
expect caught pipeline/volume.cpp 'auto t = std::chrono::steady_clock::now();'
expect passes pipeline/pipeline.cpp 'auto t = std::chrono::steady_clock::now();'

expect passes drivers/a.cpp '#include <spdlog/spdlog.h>'
expect passes drivers/camera_replay.cpp '#include "pipeline/frame_file.h"'
expect passes drivers/camera_v4l2.cpp '#include <linux/videodev2.h>'
expect caught drivers/sim/a.cpp '#include "pipeline/rectify.h"'
expect caught drivers/a.cpp '#include "daemon/options.h"'
expect caught drivers/a.cpp '#include "config/config.h"'
expect caught drivers/rig.cpp '#include <linux/videodev2.h>'
expect caught drivers/rig.cpp '#include <arv.h>'
expect caught daemon/worker.cpp '#include <gpiod.h>'

expect passes config/a.cpp '#include "daemon/options.h"'
expect passes config/a.cpp '#include <toml++/toml.h>'
expect caught config/a.cpp '#include "pipeline/pipeline.h"'
expect caught config/a.cpp '#include <spdlog/spdlog.h>'

expect passes daemon/granaryd.cpp '#include "config/config.h"'
expect passes daemon/ctl/measure.cpp '#include "config/config.h"'
expect passes daemon/worker.cpp '#include "drivers/rig.h"'
expect caught daemon/worker.cpp '#include "config/config.h"'
expect caught daemon/worker.cpp '#include "worker.h"'

rm -rf "${tree:?}"/*
mkdir -p "$tree"/{pipeline,drivers,config,daemon}
if "$rules" "$tree" >/dev/null 2>&1; then
  echo "FAULT: a tree without sources passes, so a wrong ROOT would too"
  faults=$((faults + 1))
fi

[[ $faults -eq 0 ]] || exit 1
echo "include-rules.sh judges every case right"
