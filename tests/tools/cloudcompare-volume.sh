#!/usr/bin/env bash
# CloudCompare's own 2.5-D volume of a saved cloud beside ours; run by hand (apt-get install cloudcompare).
#
#   granaryctl -c bay.toml measure --save DIR
#   tests/tools/cloudcompare-volume.sh [--area M2] DIR/cloud.ply …
#
# record.json lies beside cloud.ply. M2 is the grain floor; without it the rectangle around the cloud is taken.
#
# CloudCompare puts the cloud on a grid, takes the mean z of each cell's points, leaves empty cells out, and counts every
# cell whole: its grid has the outermost points on cell centres, so half a cell hangs over each edge. That share is in
# proportion to the grid step. So it runs with a step s and with 2 s, and the mean height (its volume over its surface)
# is carried on to a step of 0 and multiplied by the floor. Ours is given above z = 0, as CloudCompare's (mean level
# times floor), and as recorded, above the empty floor that the rig saw.
set -euo pipefail

fail() {
  echo "cloudcompare-volume: $*" >&2
  exit 1
}

program=$(command -v CloudCompare || command -v cloudcompare || true)
[ -n "$program" ] || fail "CloudCompare is not installed; apt-get install cloudcompare"

area=
if [ "${1:-}" = --area ]; then
  area=${2:-}
  [[ $area =~ ^[0-9]*\.?[0-9]+$ ]] || fail "--area wants the grain floor in m2, e.g. 95.28"
  shift 2
fi
[ $# -gt 0 ] || { echo "usage: cloudcompare-volume.sh [--area M2] CLOUD.ply …" >&2; exit 2; }

work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT

# A number of the record; nothing when it is null.
recorded() { sed -n "s/^  \"$2\": \([-0-9.e+]*\),\?$/\1/p" "$1"; }

# "points width depth" of the cloud: 28 bytes a vertex, x and y the first two floats.
extent() {
  local header
  header=$(LC_ALL=C grep -a -b -m1 '^end_header$' "$1" | cut -d: -f1)
  tail -c +$((header + 12)) "$1" | od -An -v -t f4 -w28 | awk '
    NR == 1 { x0 = x1 = $1; y0 = y1 = $2 }
    { if ($1 < x0) x0 = $1; if ($1 > x1) x1 = $1; if ($2 < y0) y0 = $2; if ($2 > y1) y1 = $2 }
    END { print NR, x1 - x0, y1 - y0 }'
}

# "volume surface filled%" that CloudCompare reports for $work/cloud.ply at the step $1.
volume() {
  QT_QPA_PLATFORM=offscreen "$program" -SILENT -NO_TIMESTAMP -AUTO_SAVE OFF -O "$work/cloud.ply" \
    -VOLUME -GRID_STEP "$1" -CONST_HEIGHT 0 > "$work/log" 2>&1 || fail "CloudCompare failed: $(tail -1 "$work/log")"
  awk '/^Volume:/ { v = $2 } /^Surface:/ { s = $2 } /^Matching cells:/ { m = $3 } END { print v, s, m }' \
    "$work/VolumeCalculationReport.txt"
}

for cloud in "$@"; do
  record=$(dirname "$cloud")/record.json
  [ -r "$cloud" ] || fail "$cloud cannot be read"
  LC_ALL=C grep -a -q -m1 '^property uchar interpolated' "$cloud" || fail "$cloud is no cloud.ply of granaryctl"
  ours=$(recorded "$record" volume_m3)
  level=$(recorded "$record" level_mean_m)
  [ -n "$ours" ] && [ -n "$level" ] || fail "$record has no volume"
  cp "$cloud" "$work/cloud.ply"
  read -r points width depth < <(extent "$cloud")
  # A step of about four point spacings, so that few cells are empty, of which twice fits both sides.
  step=$(awk -v n="$points" -v a="$width" -v b="$depth" 'BEGIN {
    if (b > a) { t = a; a = b; b = t }
    most = int(a / (8 * sqrt(a * b / n)))
    best = 1e9
    for (k = most; k > most / 2; --k) {
      cells = b * k / a; miss = cells - int(cells + 0.5); if (miss < 0) miss = -miss
      if (miss < best - 0.005) { best = miss; step = a / k / 2 }
    }
    printf "%.6f", step }')
  read -r v1 s1 filled < <(volume "$step")
  read -r v2 s2 _ < <(volume "$(awk -v s="$step" 'BEGIN { printf "%.6f", 2 * s }')")
  awk -v cloud="$cloud" -v floor="${area:-0}" -v a="$width" -v b="$depth" -v step="$step" -v filled="$filled" \
      -v v1="$v1" -v s1="$s1" -v v2="$v2" -v s2="$s2" -v ours="$ours" -v level="$level" 'BEGIN {
    if (floor == 0) floor = a * b
    theirs = (2 * v1 / s1 - v2 / s2) * floor
    printf "%s: floor %.4f m2, steps %.2f and %.2f mm, %s of the cells filled\n", cloud, floor, 1000 * step, 2000 * step, filled
    printf "  CloudCompare, as reported  %.6g and %.6g m3\n", v1, v2
    printf "  CloudCompare, step to 0    %.6g m3\n", theirs
    printf "  ours above z = 0           %.6g m3: CloudCompare differs by %+.3f %%\n", level * floor, 100 * (theirs / (level * floor) - 1)
    printf "  ours above the empty floor %.6g m3: CloudCompare differs by %+.3f %%\n", ours, 100 * (theirs / ours - 1)
  }'
done
