#!/bin/bash
# Runs in the guest as root, started by vm-test.service; the exit status is the verdict. /opt/granary is what the host
# brought along, read only; /host is the host's folder for what is found here.
cd "$(dirname "$0")" || exit 1
. ./lib.sh
export PATH=/opt/granary/bin:$PATH
echo "== up after $(uptime_s) s, clock $(cat /sys/devices/system/clocksource/clocksource0/current_clocksource)"
ldconfig

. ./devices.sh
. ./drivers.sh
. ./daemon.sh

journalctl -b -o short-monotonic --no-hostname >/host/journal.txt
dmesg >/host/dmesg.txt
cp /run/*.trace /host/ 2>/dev/null
echo "== $(uptime_s) s: $passed passed, $failed failed"
[[ $passed -gt 0 && $failed -eq 0 ]]
