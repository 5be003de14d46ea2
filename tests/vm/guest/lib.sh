# What the guest's scripts share. Each check prints one line, "ok" or "FAIL" with the time since boot.
set -u

passed=0 failed=0

uptime_s() { cut -d' ' -f1 /proc/uptime; }

verdict() {
  if [[ $1 -eq 0 ]]; then
    passed=$((passed + 1))
    echo "ok   [$(uptime_s)] $2"
  else
    failed=$((failed + 1))
    echo "FAIL [$(uptime_s)] $2"
  fi
}

# check NAME COMMAND...
check() {
  local name=$1 status=0
  shift
  "$@" || status=$?
  verdict $status "$name"
}

# until_true SECONDS COMMAND...: waits for what must happen; the time is a limit only, and generous.
until_true() {
  local end=$((SECONDS + $1))
  shift
  until "$@" >/dev/null 2>&1; do
    ((SECONDS < end)) || return 1
    sleep 0.2
  done
}

# run_tests PROGRAM [OPTION...]: a GoogleTest program, one line a test, and what a failed one says.
run_tests() {
  local line end=none
  while IFS= read -r line; do
    case $line in
      '[       OK ]'*) verdict 0 "${line#*] }" ;;
      '[  FAILED  ] '*' ms)') verdict 1 "${line#*] }" ;;
      '[ exit ] '*) end=${line#*] } ;;
      '[ '* | '[='* | '[-'* | *' FAILED TEST'* | '' | 'Running main'* | 'Note: '* | *'] [info] '* | *'] [warning] '*) ;;
      *) echo "     $line" ;;
    esac
  done < <(
    "$@" 2>&1
    echo "[ exit ] $?"
  )
  # 1: some failed, and have been counted.
  [[ $end == [01] ]] || verdict 1 "${1##*/} ended with $end"
}

# Pulses, exposures and their order, as the kernel wrote them down: "line 1", "exposure 7 begins", …
trace_on() {
  mountpoint -q /sys/kernel/tracing || mount -t tracefs tracefs /sys/kernel/tracing
  echo mono >/sys/kernel/tracing/trace_clock
  echo 1 >/sys/kernel/tracing/events/gpio/gpio_value/enable
  echo >/sys/kernel/tracing/trace
}
