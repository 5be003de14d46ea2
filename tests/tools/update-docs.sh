#!/usr/bin/env bash
# update-docs.sh [BUILD_FOLDER]: writes anew what of docs/ the programs print (the tables of keys and registers, and the
# files for SCADA systems). Tests fail while any of it is stale. The programs are taken from BUILD_FOLDER as they are
# there: build granaryctl and granary_config_reference first.
set -euo pipefail
cd "$(dirname "$0")/../.."
build=${1:-build/release}
fresh=$(mktemp -d)
trap 'rm -rf "$fresh"' EXIT

program() {
  local found
  found=$(find "$build" -type f -name "$1" -perm -u+x -print -quit)
  [[ -n $found ]] || { echo "update-docs: no $1 in $build; build it first" >&2; exit 1; }
  echo "$found"
}
granaryctl=$(program granaryctl)
reference=$(program granary_config_reference)

# All is made before anything is replaced: a program that fails half-way leaves docs/ as it was.
"$reference" >"$fresh/configuration.md"
"$granaryctl" registers --format markdown >"$fresh/map.md"
awk -v map="$fresh/map.md" '
  /^<!-- granaryctl registers --format markdown -->$/ {
    print; print ""
    while ((getline line < map) > 0) print line
    print ""
    inside = 1; begun++
  }
  /^<!-- end -->$/ { inside = 0; ended++ }
  !inside
  END { if (begun != 1 || ended != 1) { print "update-docs: docs/modbus.md lacks its two marks" > "/dev/stderr"; exit 1 } }
' docs/modbus.md >"$fresh/modbus.md"
mkdir "$fresh/scada"
"$granaryctl" registers --format csv >"$fresh/scada/granary-registers.csv"
"$granaryctl" registers --format json >"$fresh/scada/granary-registers.json"
"$granaryctl" registers --format telegraf >"$fresh/scada/telegraf.conf"
"$granaryctl" registers --format node-red >"$fresh/scada/node-red-flow.json"
"$granaryctl" registers --format ignition >"$fresh/scada/ignition-tags.csv"

mkdir -p docs/scada
for file in configuration.md modbus.md scada/granary-registers.csv scada/granary-registers.json scada/telegraf.conf \
  scada/node-red-flow.json scada/ignition-tags.csv; do
  cmp -s "$fresh/$file" "docs/$file" && continue
  cp "$fresh/$file" "docs/$file"
  echo "docs/$file"
done
