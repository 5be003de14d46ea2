# The daemon under systemd: two fed cameras, a projector line that the feeder follows, and one fault after the other.
. ./configure.sh
ctl() { runuser -u granaryd -- /usr/bin/granaryctl "$@"; }
property() { systemctl show -P "$1" granaryd; }
# register ADDRESS [TYPE]: one value over Modbus; empty while the daemon does not answer.
register() {
  mbpoll -q -m tcp -a 1 -p 1502 -t "${2:-4}" -B -0 -r "$1" -c 1 -1 127.0.0.1 2>/dev/null |
    sed -n 's/^\[[0-9]*\]:[[:space:]]*\([^ ]*\).*/\1/p'
}
has_bit() { local status; status=$(register 0) && [[ -n $status ]] && ((status >> $1 & 1)); }
is_valid() { has_bit 0; }
is_held() { has_bit 1; }
has_camera_fault() { has_bit 12; }
has_projector_fault() { has_bit 13; }
sequence() { register 5; }
measured_after() { local now; now=$(sequence) && [[ -n $now ]] && is_valid && ((now > $1)); }
# With a new figure from now on, and all within a minute of the fault's end: that is what is promised.
measures_again() {
  local before
  before=$(sequence)
  until_true 60 measured_after "${before:-0}"
}
journal_has() { journalctl -u granaryd -o cat | grep -q -- "$1"; }
restarted() { [[ $(property NRestarts) -gt $1 && $(property ActiveState) == active ]]; }
line_is_low() { [[ $(<"$light") == 0 ]]; }
# Reads the line without a fork, so that the pulse is not over when it is found.
wait_for_light() {
  local end=$((SECONDS + 60)) value=0
  while ((SECONDS < end)); do
    read -r value <"$light"
    [[ $value == 1 ]] && return 0
  done
  return 1
}
feeder=
feed() {
  [[ -z $feeder ]] || { kill -KILL "$feeder" && wait "$feeder"; } 2>/dev/null
  vm_feeder "/opt/granary/frames/$1" /dev/video40 /dev/video41 "$light" ${2:+"$2"} &
  feeder=$!
  sleep 1
}
# The trace as "rise", "fall", "begin", "end" and "lit" or "dark", one a line.
events() {
  awk '/gpio_value:/ {print $NF == 1 ? "rise" : "fall"}
       /exposure [0-9]+ begins/ {print "begin"} /exposure [0-9]+ ends/ {print "end"}
       /exposure [0-9]+ was/ {print $NF}' "$1"
}
# Every exposure called lit began after the line rose and ended before it fell again, and there was one.
lit_exposures_lie_in_pulses() {
  events "$1" | awk '$1 == "rise" {up = 1} $1 == "fall" {up = 0; whole = 0} $1 == "begin" {whole = up}
    $1 == "end" {ended = whole && up} $1 == "lit" {lit++; if (!ended) bad++} END {exit !(lit > 0 && !bad)}'
}
rises() { events "$1" | grep -c rise; }

install -m644 /opt/granary/systemd/granaryd.service /etc/systemd/system/granaryd.service
ln -sf /opt/granary/bin/granaryd /opt/granary/bin/granaryctl /usr/bin/
mkdir -p /etc/systemd/system/granaryd.service.d
printf '[Unit]\nStartLimitIntervalSec=0\n[Service]\nWatchdogSec=6\nRestartSec=1\n' \
  >/etc/systemd/system/granaryd.service.d/vm.conf
systemctl daemon-reload
configure free /dev/video41 free
check "the configuration is accepted" granaryd --check-config

echo "== one pulse, one pair"
feed empty
check "granaryctl takes the reference of the empty bin through V4L2" ctl reference
feed grain
install -d -o granaryd /run/snapshot
echo >/sys/kernel/tracing/trace
check "granaryctl takes a snapshot" ctl snapshot -o /run/snapshot
cp /sys/kernel/tracing/trace /run/snapshot.trace
check "one pulse for one pair" test "$(rises /run/snapshot.trace)" = 1
check "lit pictures were exposed within the pulse" lit_exposures_lie_in_pulses /run/snapshot.trace

echo "== the daemon measures"
echo >/sys/kernel/tracing/trace
check "the unit starts (Type=notify)" systemctl start granaryd
check "a volume is published" until_true 60 is_valid
truth=$(cat /opt/granary/frames/volume_m3)
ctl --json history >/host/history.json
read -r volume u95 < <(awk -F'[:,]' '/"volume_m3": [0-9]/ {v = $2} /"volume_u95_m3": [0-9]/ {u = $2} END {print v, u}' /host/history.json)
check "and it is right: $volume ± $u95 m³, there are $truth" awk -v v="$volume" -v u="$u95" -v t="$truth" \
  'BEGIN {exit !(v > 0 && u > 0 && u < 0.05 * t && v - t <= u && t - v <= u)}'
systemctl stop granaryd
pulses=$(journalctl -u granaryd -o cat | grep -c ' m³ ±')
cp /sys/kernel/tracing/trace /run/daemon.trace
check "no figure without a pulse: $(rises /run/daemon.trace) for $pulses" test "$(rises /run/daemon.trace)" -ge "$pulses"
check "lit pictures were exposed within the pulses" lit_exposures_lie_in_pulses /run/daemon.trace
check "SIGTERM ended it cleanly" test "$(property Result)" = success

echo "== how it ends"
systemctl start granaryd
check "SIGTERM while lit: the light was on" wait_for_light
systemctl stop granaryd
check "the line is low" line_is_low
check "and the end was clean" test "$(property Result)" = success
systemctl start granaryd
check "SIGKILL while lit: the light was on" wait_for_light
kill -KILL "$(property MainPID)"
until_true 5 line_is_low
check "the line is low" line_is_low
check "systemd starts it again" until_true 60 restarted 0
check "and it measures again" measures_again
check "SIGSTOP while lit: the light was on" wait_for_light
kill -STOP "$(property MainPID)"
check "the watchdog ends it and systemd starts it again" until_true 90 restarted 1
check "the journal says watchdog" journal_has "Watchdog timeout"
check "it measures again" measures_again
check "the journal has the daemon's own lines" journal_has 'bin 1 bay-1: .* m³ ±'

echo "== a camera falls silent"
kill -STOP $feeder
check "camera fault, last figure held" until_true 60 eval 'has_camera_fault && is_held && ! is_valid'
check "the journal says why" journal_has frame_missing
kill -CONT $feeder
check "it measures again" measures_again

echo "== the projector's line is held by another program"
systemctl stop granaryd
gpioset --mode=signal "$chip" 3=0 &
holder=$!
sleep 1
systemctl start granaryd
check "projector fault, last figure held" until_true 60 eval 'has_projector_fault && is_held && ! is_valid'
check "the journal names the program" journal_has gpioset
kill $holder
check "it measures again" measures_again

echo "== the GPIO chip is absent"
systemctl stop granaryd
echo 0 >"$gpio/live"
systemctl start granaryd
check "projector fault, last figure held" until_true 60 eval 'has_projector_fault && is_held && ! is_valid'
check "the journal says why" journal_has 'projector_fault.*granary-rig'
plug_chip
feed grain
check "it measures again" measures_again

# Not before what runs free: v4l2loopback goes on with the fewest buffers that it was ever asked for.
echo "== frames triggered by the line"
systemctl stop granaryd
configure line0 /dev/video41 line0
feed grain --triggered
echo >/sys/kernel/tracing/trace
check "granaryctl measures with cameras on the line" ctl measure
cp /sys/kernel/tracing/trace /run/triggered.trace
check "one pulse, and one exposure" test "$(events /run/triggered.trace | grep -c begin)" = 1 -a \
  "$(rises /run/triggered.trace)" = 1

echo "== a camera is unplugged"
modprobe -r vivid
# An HDMI input that shows what is put out on the HDMI output: a picture that stands still and is always lit.
modprobe vivid n_devs=1 node_types=0x101 num_inputs=1 input_types=3 num_outputs=1 output_types=1
vivid_output=${vivid_node%0}1
show_scene() {
  until_true 30 test -e "$vivid_node" -a -e "$vivid_output"
  for node in "$vivid_node" "$vivid_output"; do
    v4l2-ctl -d "$node" --set-dv-bt-timings cvt,width=640,height=480,fps=50 >/dev/null
  done
  v4l2-ctl -d "$vivid_node" -c loop_video=1,osd_text_mode=2
  vm_still "$vivid_output" /opt/granary/frames/grain/right-lit-0.grey &
  sleep 1
}
show_scene
# The left one on the line, the right one running free by its own clock.
configure line0 "$vivid_node" free
feed grain --triggered
systemctl start granaryd
check "it measures with the camera that can be unplugged" measures_again
before=$(sequence)
echo vivid.0 >/sys/bus/platform/drivers/vivid/unbind
check "unplugged: camera fault, last figure held" until_true 60 eval 'has_camera_fault && is_held && ! is_valid'
check "the journal names the camera" journal_has "camera_unavailable.*$vivid_node"
check "the daemon is still the same process" test "$(property ActiveState)" = active
echo vivid.0 >/sys/bus/platform/drivers/vivid/bind
show_scene
check "plugged: it measures again" measures_again
systemctl stop granaryd
restarts=$(journalctl -u granaryd -o cat | grep -c 'Scheduled restart job')
check "restarted twice in all, after SIGKILL and by the watchdog: $restarts" test "$restarts" = 2
# shellcheck disable=SC2046
kill $(jobs -p) 2>/dev/null
