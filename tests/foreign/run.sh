#!/usr/bin/env bash
# run.sh [--bin FOLDER] [CLIENT…]: starts granaryd on a simulated bin and lets clients that are not ours read volume and
# error rate from it, each in two byte orders; prints the transcript that docs/modbus-clients.md shows. Clients: mbpoll,
# pymodbus, modbus-serial, node-red; default: those that are installed.
#   --bin FOLDER   where granaryd and granaryctl lie (default build/release/bin); $GRANARYD and $GRANARYCTL go before
# The npm clients are installed by: run.sh --install, into $GRANARY_FOREIGN (default ~/.cache/granary-foreign).
# Exit status: 0 all agree, 1 one does not, 77 the only client asked for is not installed.
set -euo pipefail
here=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)
cd "$here/../.."

modules=${GRANARY_FOREIGN:-$HOME/.cache/granary-foreign}
bin=build/release/bin clients=()
while [[ $# -gt 0 ]]; do
  case $1 in
    --bin)
      bin=$2
      shift 2
      ;;
    --install)
      mkdir -p "$modules"
      cp "$here/package.json" "$modules/"
      # Optional parts are for serial ports, scripts for building them.
      exec npm install --prefix "$modules" --omit=optional --ignore-scripts --no-audit --no-fund
      ;;
    mbpoll | pymodbus | modbus-serial | node-red)
      clients+=("$1")
      shift
      ;;
    *)
      sed -n '2,9s/^# //p' "${BASH_SOURCE[0]}" >&2
      exit 2
      ;;
  esac
done

python=/usr/bin/python3
has() {
  case $1 in
    mbpoll) command -v mbpoll >/dev/null ;;
    pymodbus) "$python" -c 'from pymodbus.client import ModbusTcpClient' 2>/dev/null ;;
    modbus-serial) command -v node >/dev/null && [[ -d $modules/node_modules/modbus-serial ]] ;;
    node-red) command -v node >/dev/null && [[ -d $modules/node_modules/node-red-contrib-modbus ]] ;;
  esac
}
if [[ ${#clients[@]} -eq 0 ]]; then
  for client in mbpoll pymodbus modbus-serial node-red; do
    if has "$client"; then clients+=("$client"); else echo "$client is not installed: left out" >&2; fi
  done
elif [[ ${#clients[@]} -eq 1 ]] && ! has "${clients[0]}"; then
  echo "${clients[0]} is not installed" >&2
  exit 77
fi

granaryd=${GRANARYD:-$bin/granaryd} granaryctl=${GRANARYCTL:-$bin/granaryctl}
for program in "$granaryd" "$granaryctl"; do
  [[ -x $program ]] || { echo "run.sh: no $program; build it or say --bin FOLDER" >&2; exit 2; }
done

work=$(mktemp -d)
daemon='' node_red=''
finish() {
  [[ -z $node_red ]] || kill "$node_red" 2>/dev/null || true
  [[ -z $daemon ]] || kill "$daemon" 2>/dev/null || true
  wait 2>/dev/null || true
  rm -rf "$work"
}
trap finish EXIT

# A port that nobody listens on now.
port=$((20000 + RANDOM % 10000))
while (: >"/dev/tcp/127.0.0.1/$port") 2>/dev/null; do port=$((20000 + RANDOM % 10000)); done

# One measurement an hour, so that figures stand still while they are read. 127.0.0.2 may read but not write.
cat >"$work/granaryd.toml" <<TOML
[site]
name = "foreign clients"
[modbus.tcp]
listen = "127.0.0.1:$port"
allow = ["127.0.0.0/8"]
write_allow = ["127.0.0.1/32"]
[[bin]]
id = 1
name = "bay-1"
footprint_m = [[0.0, 0.0], [0.52, 0.0], [0.52, 0.355], [0.0, 0.355]]
height_m = 0.285
schedule = { every = "1h" }
[bin.inventory]
book_mass_kg = 15.25
density_kg_m3 = 790.0
[[bin.rig]]
name = "a"
calibration = "$PWD/config/sim/stereo.yml"
pose = "$PWD/config/sim/world.yml"
left = { driver = "sim" }
right = { driver = "sim" }
projector = { driver = "sim" }
[bin.rig.sim]
volume_m3 = 0.0193
TOML
export STATE_DIRECTORY=$work/state
mkdir -p "$STATE_DIRECTORY"

start_daemon() {
  "$granaryd" --config "$work/granaryd.toml" >>"$work/granaryd.log" 2>&1 &
  daemon=$!
}
newest() { # FIELD of the newest record
  "$granaryctl" -c "$work/granaryd.toml" history --json |
    "$python" -c 'import json, sys; print(json.load(sys.stdin)[-1][sys.argv[1]])' "$1"
}
await_measurement() {
  for ((i = 0; i < 600; ++i)); do
    if volume=$(newest volume_m3 2>/dev/null) && [[ $volume != None ]]; then return; fi
    if ! kill -0 "$daemon" 2>/dev/null; then break; fi
    sleep 0.2
  done
  echo "run.sh: no measurement:" >&2
  cat "$work/granaryd.log" >&2
  exit 1
}

show() { # prints a command and runs it
  echo "\$ $*" | sed "s|$work|WORK|g; s|$modules|\$GRANARY_FOREIGN|g; s|$here|tests/foreign|g"
  "$@"
}

failed=0
compare() { # CLIENT: reads "order volume error-rate" lines
  local order v rate lines=0
  while read -r order v rate; do
    lines=$((lines + 1))
    # Six digits, and what a 32-bit float rounds.
    if "$python" - "$v" "$volume" "$rate" "$error_rate" <<'PY'; then
import sys
a, b, c, d = map(float, sys.argv[1:])
sys.exit(not (abs(a - b) <= 6e-6 * abs(b) and abs(c - d) <= 6e-6 * abs(d)))
PY
      printf '%-14s %-5s volume %-10s m³, error rate %-10s %%: as granaryctl has it\n' "$1" "$order" "$v" "$rate"
    else
      printf '%-14s %-5s volume %-10s m³, error rate %-10s %%: NOT as granaryctl has it\n' "$1" "$order" "$v" "$rate"
      failed=1
    fi
  done
  if ((lines < 2)); then
    echo "$1: $lines byte orders read, wanted two"
    failed=1
  fi
}
one_float() { # ADDRESS [-B]: as mbpoll prints it
  mbpoll -m tcp -a 1 -p "$port" -0 -1 "${@:2}" -t 4:float -r "$1" -c 1 127.0.0.1 |
    sed -n "s/^\[$1\]:[[:space:]]*//p"
}
pymodbus() {
  show "$python" "$here/pymodbus_client.py" "$port" "$@" 2>"$work/error" && return
  tail -n 3 "$work/error" >&2
  failed=1
}

start_daemon
await_measurement
error_rate=$(newest error_rate_percent)
utc=$(date -d "$(newest utc)" +%s)
echo "granaryctl history: volume $volume m³, error rate $error_rate %"

for client in "${clients[@]}"; do
  echo
  has "$client" || { echo "$client is not installed: left out" && continue; }
  case $client in
    mbpoll)
      echo "mbpoll $(dpkg-query -W -f='${Version}' mbpoll 2>/dev/null || mbpoll -V)"
      show mbpoll -m tcp -a 1 -p "$port" -0 -1 -B -t 4:float -r 10 -c 1 127.0.0.1 | grep -E '^(\$|\[)'
      echo "\$ mbpoll … -0 -1 -t 4:float -r 2210 …   # low word first, from the mirror"
      {
        echo "ABCD $(one_float 10 -B) $(one_float 36 -B)"
        echo "CDAB $(one_float 2210) $(one_float 2236)"
      } >"$work/out"
      compare mbpoll <"$work/out"
      ;;
    pymodbus)
      "$python" -c 'import pymodbus; print("pymodbus", pymodbus.__version__)'
      pymodbus read >"$work/out"
      grep '^\$' "$work/out"
      compare pymodbus < <(grep -v '^\$' "$work/out")
      pymodbus order >"$work/out"
      grep '^\$' "$work/out"
      compare "pymodbus, 900" < <(grep -v '^\$' "$work/out")
      pymodbus refused
      grep -m 1 -o 'modbus: 127.0.0.2.*' "$work/granaryd.log" | sed 's/^/log: /' || { echo "no log line" && failed=1; }
      ;;
    modbus-serial)
      node -p "'modbus-serial ' + require('$modules/node_modules/modbus-serial/package.json').version + ', node ' + process.version"
      NODE_PATH=$modules/node_modules show node "$here/modbus_serial.js" "$port" >"$work/out" || failed=1
      grep '^\$' "$work/out"
      compare modbus-serial < <(grep -v '^\$' "$work/out")
      ;;
    node-red)
      before=$failed
      node -p "['node-red', 'node-red-contrib-modbus'].map(p => p + ' ' + require('$modules/node_modules/' + p + '/package.json').version).join(', ') + ', node ' + process.version"
      mkdir -p "$work/node-red"
      ln -sfn "$modules/node_modules" "$work/node-red/node_modules"
      cp "$modules/package.json" "$work/node-red/"
      node "$here/node_red_flow.js" "$port" "$work/out.node-red" >"$work/flow.json"
      echo "\$ node-red --userDir WORK/node-red --settings tests/foreign/node_red_settings.js WORK/flow.json"
      node "$modules/node_modules/node-red/red.js" --userDir "$work/node-red" --settings "$here/node_red_settings.js" \
        "$work/flow.json" >"$work/node-red.log" 2>&1 &
      node_red=$!
      for ((i = 0; i < 300; ++i)); do
        [[ $(cut -d ' ' -f 1 "$work/out.node-red" 2>/dev/null | sort -u | wc -l) -lt 2 ]] || break
        kill -0 "$node_red" 2>/dev/null || break
        sleep 0.2
      done
      kill "$node_red" 2>/dev/null || true
      wait "$node_red" 2>/dev/null || true
      node_red=''
      touch "$work/out.node-red"
      compare node-red < <(sort -u -k 1,1 "$work/out.node-red")
      [[ $failed -eq $before ]] || cat "$work/node-red.log" >&2
      ;;
  esac
done

if printf '%s\n' "${clients[@]}" | grep -qx pymodbus && has pymodbus; then
  echo
  echo "Book data and a command:"
  pymodbus book
  utc=$(date -d "$(newest utc)" +%s)
  echo
  echo "kill -9, and started again:"
  kill -9 "$daemon"
  wait "$daemon" 2>/dev/null || true
  start_daemon
  pymodbus held "$utc"
fi

kill "$daemon"
wait "$daemon" || true
daemon=''
echo
[[ $failed -eq 0 ]] && echo "All agree." || echo "NOT all agree."
exit "$failed"
