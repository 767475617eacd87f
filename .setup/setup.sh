#!/usr/bin/env bash
# Makes .venv from the lock file and installs the project in it; does nothing when all of it is there already.
#   setup.sh bench   also what only `make bench` needs: the peers to measure against
#   PYTHON=...  the interpreter to use (default: python3 if it is new enough, else the newest python3.x on PATH)
set -euo pipefail
cd "$(dirname "$0")/.."

VENV=.venv
LOCK=.setup/requirements.txt
LOG=$VENV/setup.log
# Written last, removed first: a stamp that is there says that the step before it was finished.
LOCK_STAMP=$VENV/.lock.sha256
PROJECT_STAMP=$VENV/.project.sha256
BENCH_LOCK=.setup/bench.txt
BENCH_STAMP=$VENV/.bench.sha256
KERNEL_STAMP=$VENV/.kernels.sha256

say() { printf 'setup: %s\n' "$*"; }
fail() { printf 'setup: %s\n' "$*" >&2; exit 1; }
hash_of() { cat "$@" | { sha256sum 2>/dev/null || shasum -a 256; } | cut -d' ' -f1; }

version_of() { "$1" -c 'import sys; print("%d.%d.%d" % sys.version_info[:3])' 2>/dev/null; }
is_new_enough() { "$1" -c 'import sys; sys.exit(sys.version_info < (3, 11))' 2>/dev/null; }
is_tested() { "$1" -c 'import sys; sys.exit(not (3, 11) <= sys.version_info < (3, 14))' 2>/dev/null; }
has_venv() { "$1" -c 'import ensurepip, venv' 2>/dev/null; }

# Sets `python`. A version manager's shim may exist and fail, so each candidate is run, not only looked up.
find_python() {
    local candidate without_venv=
    if [ -n "${PYTHON:-}" ]; then
        is_new_enough "$PYTHON" || fail "PYTHON=$PYTHON is not a Python 3.11 or newer; name another one"
        has_venv "$PYTHON" || fail "PYTHON=$PYTHON has no venv module; install it (Debian: apt install python3-venv)"
        python=$PYTHON
        return
    fi
    for check in is_tested is_new_enough; do
        for candidate in python3 python3.13 python3.12 python3.11 python3.14 python; do
            command -v "$candidate" >/dev/null 2>&1 && $check "$candidate" || continue
            if has_venv "$candidate"; then python=$candidate; return; fi
            without_venv=$candidate
        done
    done
    [ -z "$without_venv" ] || fail "$without_venv has no venv module; install it (Debian: apt install python3-venv) and run again"
    fail "no Python 3.11 or newer found; install one, or name it: make setup PYTHON=/path/to/python3.12"
}

# True if .venv was finished from this lock file, lies where it was made, and still runs.
venv_is_whole() {
    [ -s "$LOCK_STAMP" ] && [ -x "$VENV/bin/python" ] || return 1
    [ "$(sed -n 2p "$LOCK_STAMP")" = "$PWD" ] || return 1
    "$VENV/bin/python" -c '' 2>/dev/null || return 1
    [ -z "${PYTHON:-}" ] || [ "$(version_of "$PYTHON")" = "$(version_of "$VENV/bin/python")" ]
}

pip_install() {
    if ! "$VENV/bin/python" -m pip install --quiet --disable-pip-version-check --no-input "$@" >>"$LOG" 2>&1; then
        tail -n 25 "$LOG" >&2
        fail "installing failed (see above, whole log in $LOG); mend the cause and run again"
    fi
}

install_lock() {
    local wanted; wanted=$(hash_of "$LOCK")
    if venv_is_whole; then
        [ "$(sed -n 1p "$LOCK_STAMP")" = "$wanted" ] && return
        say "the lock file changed"
    else
        find_python
        say "Python $(version_of "$python") ($(command -v "$python"))"
        rm -rf "$VENV"
        "$python" -m venv "$VENV" || fail "$python could not make $VENV; see above"
    fi
    rm -f "$LOCK_STAMP" "$PROJECT_STAMP"
    say "installing $(grep -c '^[a-zA-Z0-9]' "$LOCK") pinned packages; this takes one to three minutes"
    pip_install --require-hashes -r "$LOCK"
    printf '%s\n%s\n' "$wanted" "$PWD" >"$LOCK_STAMP"
}

install_project() {
    local wanted; wanted=$(hash_of pyproject.toml)
    [ "$(cat "$PROJECT_STAMP" 2>/dev/null)" = "$wanted" ] && return
    rm -f "$PROJECT_STAMP"
    pip_install --no-deps --no-build-isolation --editable .
    printf '%s\n' "$wanted" >"$PROJECT_STAMP"
    say "project installed in $VENV"
}

# A peer that this machine cannot have is no reason not to measure the rest: its rows then say so.
install_bench() {
    local wanted; wanted=$(hash_of "$BENCH_LOCK" "$LOCK")
    [ "$(cat "$BENCH_STAMP" 2>/dev/null)" = "$wanted" ] && return
    say "installing the peers that make bench measures against; this takes a minute or two"
    local folder peer missing=""
    folder=$(mktemp -d)
    awk -v folder="$folder" '/^[a-zA-Z0-9]/ { split($0, part, "="); file = folder "/" part[1] } file { print >file }' "$BENCH_LOCK"
    for peer in "$folder"/*; do
        "$VENV/bin/python" -m pip install --quiet --disable-pip-version-check --no-input --no-deps --require-hashes \
            -r "$peer" >>"$LOG" 2>&1 || missing="$missing $(basename "$peer")"
    done
    rm -rf "$folder"
    printf '%s\n' "$wanted" >"$BENCH_STAMP"
    [ -z "$missing" ] || say "could not be had here:$missing (log in $LOG); the rows of these peers will say so"
}

# Compiled once, before anything has to wait for it. A kernel that was kept does not notice that a kernel it calls, in another file, has changed.
compile_kernels() {
    local wanted; wanted=$(grep -rl --include='*.py' njit planner sim | LC_ALL=C sort | { files=$(cat); hash_of $files; })
    [ "$(cat "$KERNEL_STAMP" 2>/dev/null)" = "$wanted" ] && return
    find planner sim -path '*/__pycache__/*' \( -name '*.nbi' -o -name '*.nbc' \) -delete
    say "compiling the numeric kernels; this takes a minute or two"
    if "$VENV/bin/python" .setup/compile_kernels.py >>"$LOG" 2>&1; then
        printf '%s\n' "$wanted" >"$KERNEL_STAMP"
    else
        say "not all kernels could be compiled now (log in $LOG); the rest follows when it is needed"
    fi
}

# One set-up at a time in a checkout: the second waits and then finds everything done.
exec 9<"$LOCK"
if command -v flock >/dev/null 2>&1; then flock 9; fi
install_lock
install_project
compile_kernels
if [ "${1:-}" = bench ]; then install_bench; fi
said=$("$VENV/bin/python" cellctl/console/build.py) || exit 1
case $said in *"up to date"* | *"nothing to build"*) ;; *) printf '%s\n' "$said" ;; esac
