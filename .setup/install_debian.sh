#!/usr/bin/env bash
# Installs the Debian programs that some tests play against, those that are missing. Tests whose program is absent
# are skipped with that reason, so nothing here is an error: one line says what was left out and why.
set -uo pipefail
cd "$(dirname "$0")/.."

RETRY_AFTER_MIN=60 # an attempt that failed (no network, say) is not repeated by every test run
TRIED=.venv/.debian_tried

# Whether a package's program or library is there; faster than asking dpkg, and true for other ways of installing.
is_there() {
    case $1 in
        linuxcnc-uspace) command -v rs274 ;;                      # independent G-code interpreter
        libmodbus5) compgen -G '/usr/lib/*/libmodbus.so.5*' ;;    # independent Modbus slave
        postgresql) compgen -G '/usr/lib/postgresql/*/bin/initdb' || command -v initdb ;; # database of a store that is shared
        *) command -v "$1" ;;                                     # chromium; mbpoll, a Modbus master; socat
    esac >/dev/null 2>&1
}
PACKAGES=(chromium mbpoll socat linuxcnc-uspace libmodbus5 postgresql)

say() { printf 'tools: %s\n' "$*"; }
collect_missing() {
    missing=()
    for package in "${PACKAGES[@]}"; do
        is_there "$package" || missing+=("$package")
    done
}

collect_missing
[ ${#missing[@]} -eq 0 ] && exit 0
leave() { say "${missing[*]} not installed ($1); the tests that need them are skipped"; exit 0; }

command -v apt-get >/dev/null 2>&1 || leave "no apt here"
root=()
if [ "$(id -u)" -ne 0 ]; then
    sudo -n true 2>/dev/null || leave "needs root: sudo apt-get install ${missing[*]}"
    root=(sudo -n)
fi
[ -n "$(find "$TRIED" -mmin -$RETRY_AFTER_MIN 2>/dev/null)" ] && leave "tried within the hour; rm $TRIED to try again"

apt() {
    "${root[@]}" env DEBIAN_FRONTEND=noninteractive apt-get -qq -y --no-install-recommends \
        -o DPkg::Lock::Timeout=60 -o Acquire::Retries=1 -o Acquire::http::Timeout=15 -o Acquire::https::Timeout=15 "$@" \
        >>"$log" 2>&1 </dev/null
}
# Debian's package would make a database server of the machine's own and start it; tests make theirs.
NO_SERVER=/etc/postgresql-common/createcluster.d/hybridcell.conf
tidy_up() {
    rm -f "$log"
    "${root[@]}" rm -f "$NO_SERVER"
}
log=$(mktemp) && trap tidy_up EXIT
if [[ " ${missing[*]} " == *" postgresql "* ]]; then
    "${root[@]}" mkdir -p "${NO_SERVER%/*}" && "${root[@]}" tee "$NO_SERVER" >/dev/null <<<'create_main_cluster = false'
fi
say "installing ${missing[*]}"
apt update
if ! apt install "${missing[@]}"; then
    for package in "${missing[@]}"; do apt install "$package"; done
fi
collect_missing
if [ ${#missing[@]} -gt 0 ]; then
    [ -d .venv ] && touch "$TRIED"
    leave "apt says: $(grep -m1 '^E:' "$log" || tail -n 1 "$log")"
fi
exit 0
