#!/usr/bin/env bash
# Writes requirements.txt, and bench.txt for what only `make bench` needs, from the ranges in pyproject.toml: exact versions and hashes for all systems and Python
# 3.11 to 3.13, no host names; and runtime.txt, what the service alone needs, for the container file. Pins that still fit stay; UPGRADE=1 takes the newest of everything.
set -euo pipefail
cd "$(dirname "$0")/.."
[ -x .venv/bin/python ] || { echo "lock: run \`make setup\` first" >&2; exit 1; }
folder=$(mktemp -d) && trap 'rm -rf "$folder"' EXIT
.venv/bin/python -m venv "$folder/uv"
"$folder/uv/bin/pip" install --quiet --disable-pip-version-check uv
compile() { # GROUP FILE [OPTION ...]
    "$folder/uv/bin/uv" pip compile --output-file "$2" --generate-hashes --universal --python-version 3.11 \
        --no-emit-index-url --no-header --quiet ${UPGRADE:+--upgrade} "${@:3}" --group "$1"
    if grep -n '://' "$2"; then echo "lock: the lines above of $2 name a host" >&2; exit 1; fi
    echo "lock: $(grep -c '^[a-zA-Z0-9]' "$2") packages in $2"
}
compile dev .setup/requirements.txt pyproject.toml
compile bench .setup/bench.txt --constraint .setup/requirements.txt
.venv/bin/python - <<'PY' >"$folder/runtime.in"
import tomllib
project = tomllib.load(open("pyproject.toml", "rb"))["project"]
print("\n".join([*project["dependencies"], *project["optional-dependencies"]["opcua"], *project["optional-dependencies"]["postgres"]]))
PY
"$folder/uv/bin/uv" pip compile --output-file .setup/runtime.txt --generate-hashes --universal --python-version 3.11 \
    --no-emit-index-url --no-header --no-annotate --quiet --constraint .setup/requirements.txt "$folder/runtime.in"
if grep -n '://' .setup/runtime.txt; then echo "lock: the lines above of .setup/runtime.txt name a host" >&2; exit 1; fi
echo "lock: $(grep -c '^[a-zA-Z0-9]' .setup/runtime.txt) packages in .setup/runtime.txt"
