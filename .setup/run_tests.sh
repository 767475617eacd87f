#!/usr/bin/env bash
# Runs pytest: with arguments just so; without, the whole suite as three processes, which tests/dealing.py deals the modules to.
# One talks to services, wires and browsers, one computes, a third fills their gaps at a low priority. Their reports come one after the other.
set -uo pipefail
cd "$(dirname "$0")/.."

PYTHON=.venv/bin/python
unset PYTHONDONTWRITEBYTECODE # hundreds of processes import the packages: they are compiled once
if [ $# -gt 0 ]; then
    exec "$PYTHON" -m pytest "$@"
fi

FOLDER=$(mktemp -d)
trap 'rm -rf "$FOLDER"' EXIT
mkdir "$FOLDER/taken"
DEALT=("$PYTHON" -m pytest -o console_output_style=classic -p no:cacheprovider -c pyproject.toml -p tests.dealing "--deal=$FOLDER/taken")

nice -n 5 "${DEALT[@]}" --lane=computed >"$FOLDER/computed" 2>&1 & # who waits for answers goes before who computes
computed=$!
nice -n 15 "${DEALT[@]}" --lane=gaps >"$FOLDER/gaps" 2>&1 &
gaps=$!
"${DEALT[@]}" --lane=served
failed=$?
for lane in computed gaps; do
    wait "${!lane}" || failed=1
    printf '\ntests beside these, %s:\n' "$lane"
    cat "$FOLDER/$lane"
done
exit "$failed"
