#!/usr/bin/env bash
# Runs pytest: with arguments just so; without, the whole suite as two processes side by side, one per core.
# What computes goes into one, what talks over wires and to browsers into the other; the first one's report is printed when both have ended.
set -uo pipefail
cd "$(dirname "$0")/.."

PYTHON=.venv/bin/python
if [ $# -gt 0 ]; then
    exec "$PYTHON" -m pytest "$@"
fi

COMPUTING=(tests/unit/planner tests/unit/sim tests/property tests/fuzz tests/unit/cellctl)
REPORT=$(mktemp)
trap 'rm -f "$REPORT"' EXIT

"$PYTHON" -m pytest -p no:cacheprovider "${COMPUTING[@]}" >"$REPORT" 2>&1 &
computing=$!
"$PYTHON" -m pytest "${COMPUTING[@]/#/--ignore=}"
wires=$?
wait "$computing"
computed=$?
printf '\ntests: %s\n' "${COMPUTING[*]}"
cat "$REPORT"
[ "$wires" -eq 0 ] && [ "$computed" -eq 0 ]
