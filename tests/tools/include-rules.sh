#!/usr/bin/env bash
# include-rules.sh ROOT: checks which folder includes what (docs/architecture.md). One line a fault, exit 1 if any.
# Data flows drivers -> pipeline -> daemon, includes flow towards the plain values; a rule that no machine checks is gone
# in a year. Every include must be on its folder's list: a new library is a decision, made by adding it here.
set -euo pipefail
root=${1:?usage: include-rules.sh ROOT}
cd "$root"

mapfile -t files < <(find pipeline drivers config daemon -type f \( -name '*.h' -o -name '*.cpp' \) | LC_ALL=C sort)
if [[ ${#files[@]} -eq 0 ]]; then
  echo "include-rules: no sources under $root" >&2
  exit 1
fi

awk '
function fault(why) { printf "%s:%d: %s: %s\n", FILENAME, FNR, target, why; faults++ }

# Of several prefixes, written "a b c": does the include begin with one?
function begins(prefixes,    parts, count, i) {
  count = split(prefixes, parts, " ")
  for (i = 1; i <= count; i++) if (index(target, parts[i]) == 1) return 1
  return 0
}
function standard() { return target ~ /^[a-z0-9_]+$/ }
function cpp() { return FILENAME ~ /\.cpp$/ }

# One device library, one file: what knows the hardware stays in one place.
function device_headers() {
  if (target == "arv.h" && FILENAME !~ /^drivers\/(camera_aravis[a-z0-9_]*|sim\/gige)\.cpp$/) return "only drivers/camera_aravis*.cpp and drivers/sim/gige.cpp"
  if (target == "linux/videodev2.h" && FILENAME !~ /^drivers\/v4l2_[a-z]+\.cpp$/) return "only drivers/v4l2_*.cpp"
  if (target == "gpiod.h" && FILENAME !~ /^drivers\/projector_gpio[a-z0-9_]*\.cpp$/) return "only drivers/projector_gpio*.cpp"
  return ""
}

function check_types() {
  if (quoted) { if (!begins("pipeline/types/")) fault("pipeline/types/ includes nothing else of ours") }
  else if (!standard() && !begins("Eigen/ opencv2/core")) fault("pipeline/types/ knows only std, Eigen and OpenCV core")
}
function check_pipeline() {
  if (quoted) { if (!begins("pipeline/")) fault("pipeline/ includes only itself: no drivers, daemon, config") }
  else if (begins("pcl/ nlohmann/ hwy/")) { if (!cpp() && FILENAME !~ /-inl\.h$/) fault("in pipeline/ only .cpp files include it") }
  else if (begins("fcntl.h sys/stat.h unistd.h")) { if (FILENAME !~ /^pipeline\/[a-z_]*file[a-z_]*\.cpp$/) fault("in pipeline/ only *file*.cpp touches files") }
  else if (begins("png.h zlib.h")) { if (FILENAME !~ /^pipeline\/(png|tiff)_[a-z]+\.cpp$/) fault("in pipeline/ only the readers png_*.cpp and tiff_*.cpp include it") }
  else if (target == "opencv2/imgcodecs.hpp" || target == "opencv2/highgui.hpp") fault("it brings GPL libraries along; use frame_file.h")
  else if (!standard() && !begins("Eigen/ opencv2/ tbb/ oneapi/tbb sys/mman.h sys/resource.h"))
    fault("pipeline/ knows std, Eigen, OpenCV, PCL, Highway, TBB, libpng, zlib and JSON")
}
function check_drivers() {
  if (quoted) {
    if (!begins("drivers/ pipeline/types/") && target !~ /^pipeline\/(frame_file|file_error)\.h$/)
      fault("drivers/ includes itself, pipeline/types/ and the readers frame_file.h and file_error.h")
  } else if (begins("pcl/ toml++/ CLI/ systemd/ SQLiteCpp/ png.h zlib.h opencv2/imgcodecs opencv2/highgui"))
    fault("no business of a driver")
}
function check_config() {
  if (quoted) {
    if (!begins("config/ pipeline/types/") && target !~ /^(pipeline|drivers|daemon)\/([a-z0-9_]+\/)?options\.h$/)
      fault("config/ includes itself, pipeline/types/ and the options.h of the others")
  } else if (!standard() && !begins("toml++/ date/ Eigen/ arpa/inet.h netinet/in.h"))
    fault("config/ knows std, Eigen, toml++ and date")
}
function check_daemon() {
  if (quoted) {
    if (begins("config/") && FILENAME != "daemon/granaryd.cpp" && FILENAME !~ /^daemon\/ctl\//)
      fault("of daemon/ only granaryd.cpp and ctl/ include config/")
    else if (!begins("daemon/ drivers/ pipeline/ config/")) fault("includes are written from the top of the repository")
  } else if (begins("toml++/ pcl/ png.h zlib.h opencv2/imgcodecs opencv2/highgui"))
    fault("no business of the daemon")
}

# Figures are functions of their arguments: the pipeline asks no clock, but to time its stages.
/_clock::now *\(/ && FILENAME ~ /^pipeline\// && !(FILENAME == "pipeline/pipeline.cpp" && /steady_clock/) {
  target = "clock"; fault("pipeline/ reads no clock; pipeline.cpp alone times its stages with steady_clock")
}

/^[ \t]*#[ \t]*include[ \t]*[<"]/ {
  target = $0
  sub(/^[ \t]*#[ \t]*include[ \t]*/, "", target)
  quoted = substr(target, 1, 1) == "\""
  sub(/^[<"]/, "", target)
  sub(/[>"].*$/, "", target)

  only = device_headers()
  if (only != "") fault(only " includes it")
  else if (FILENAME ~ /^pipeline\/types\//) check_types()
  else if (FILENAME ~ /^pipeline\//) check_pipeline()
  else if (FILENAME ~ /^drivers\//) check_drivers()
  else if (FILENAME ~ /^config\//) check_config()
  else if (FILENAME ~ /^daemon\//) check_daemon()
}
END { exit faults > 0 }
' "${files[@]}"
