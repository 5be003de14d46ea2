#!/usr/bin/env bash
# fault-table.sh ROOT: every test that docs/faults.md names exists: `Suite.Claim` of GoogleTest under tests/, and
# `guest: claim`, a check of the virtual machine's scripts. One line a missing one, exit 1 if any.
set -euo pipefail
cd "${1:?usage: fault-table.sh ROOT}"

missing=0 found=0
while IFS= read -r name; do
  if [[ $name == guest:* ]]; then
    grep -rqF -- "check \"${name#guest: }\"" tests/vm/guest && found=$((found + 1)) && continue
  else
    suite=${name%%.*} claim=${name#*.}
    grep -rqE --include='*.cpp' -- "TEST(_F|_P)?\($suite, $claim\)" tests && found=$((found + 1)) && continue
  fi
  echo "docs/faults.md names a test that is not there: $name" >&2
  missing=$((missing + 1))
done < <(grep '^|' docs/faults.md | grep -oE '`([A-Z][A-Za-z0-9_]*\.[A-Z][A-Za-z0-9_]*|guest: [^`]+)`' | tr -d '`' | sort -u)

[[ $missing -eq 0 ]] || exit 1
[[ $found -gt 0 ]] || { echo "docs/faults.md names no test" >&2; exit 1; }
echo "$found tests of docs/faults.md are there"
