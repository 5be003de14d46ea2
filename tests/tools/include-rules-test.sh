#!/usr/bin/env bash
# Shows that include-rules.sh catches what it should and lets pass what it may, each with its file and line.
set -euo pipefail
rules=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)/include-rules.sh
tree=$(mktemp -d)
trap 'rm -rf "$tree"' EXIT
mkdir -p "$tree"/{pipeline,drivers,config,daemon}

if "$rules" "$tree" >/dev/null 2>&1; then
  echo "a tree without sources passes, so a wrong ROOT would too" >&2
  exit 1
fi

expected=""

# expect caught|passes FILE LINE: appends LINE to FILE and notes the verdict that it must get.
expect() {
  mkdir -p "$(dirname "$tree/$2")"
  printf '%s\n' "$3" >>"$tree/$2"
  [[ $1 == passes ]] || expected+="$2:$(wc -l <"$tree/$2")"$'\n'
}

expect passes pipeline/types/a.h '#include <opencv2/core/mat.hpp>'
expect passes pipeline/types/a.cpp '#include "pipeline/types/a.h"'
expect caught pipeline/types/a.h '#include <opencv2/imgproc.hpp>'
expect caught pipeline/types/a.h '#include "pipeline/options.h"'
expect caught pipeline/types/a.h '#include "a.h"'

expect passes pipeline/a.cpp '#include <pcl/point_types.h>'
expect passes pipeline/stereo/a.cpp '#include <hwy/highway.h>'
expect passes pipeline/file_bytes.cpp '#include <unistd.h>'
expect caught pipeline/volume.cpp '#include <unistd.h>'
expect passes pipeline/png_file.cpp '#include <png.h>'
expect passes pipeline/tiff_strips.cpp '#include <zlib.h>'
expect caught pipeline/frame_file.cpp '#include <png.h>'
expect caught pipeline/frame_file.cpp '#include <opencv2/imgcodecs.hpp>'
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
expect passes drivers/camera_aravis.cpp '#include <arv.h>'
expect passes drivers/camera_aravis_find.cpp '#include <arv.h>'
expect passes drivers/sim/gige.cpp '#include <arv.h>'
expect passes drivers/v4l2_node.cpp '#include <linux/videodev2.h>'
expect caught drivers/sim/a.cpp '#include "pipeline/rectify.h"'
expect caught drivers/a.cpp '#include "daemon/options.h"'
expect caught drivers/a.cpp '#include "config/config.h"'
expect caught drivers/a.cpp '#include <pcl/point_types.h>'
expect caught drivers/rig.cpp '#include <linux/videodev2.h>'
expect caught drivers/rig.cpp '#include <arv.h>'
expect caught drivers/camera_aravis.h '#include <arv.h>'
expect caught drivers/sim/camera_sim.cpp '#include <arv.h>'
expect caught drivers/a.cpp '#include <opencv2/imgcodecs.hpp>'
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
expect caught daemon/worker.cpp '#include <toml++/toml.h>'
expect caught daemon/worker.cpp '#include <zlib.h>'

status=0
report=$("$rules" "$tree") || status=$?
if [[ $status -ne 1 ]]; then
  echo "exit status $status with planted faults, not 1" >&2
  exit 1
fi
if ! diff <(LC_ALL=C sort <<<"${expected%$'\n'}") <(cut -d: -f1,2 <<<"$report" | LC_ALL=C sort) >&2; then
  echo "< should be caught, > should not; in the line's own words:" >&2
  printf '%s\n' "$report" >&2
  exit 1
fi
echo "$(wc -l <<<"$report") planted faults caught, nothing else"
