#!/usr/bin/env bash
# Install the peers of `make interop`: Debian packages when root, node-opcua by npm from the committed lock, open62541 and
# parsers of structured text into the environment of the Python that is named (a parser is compiled where there is no
# wheel), LinuxCNC's kernel from Debian.
# What cannot be had is said in a line "NOT RUN"; with TRUEFLANK_INTEROP=all that ends the run.
set -uo pipefail
cd "$(dirname "$0")"
missing=0

absent() {
    echo "interop: NOT RUN: $1"
    missing=1
}

has_packages() {
    command -v mbpoll >/dev/null && command -v gcc >/dev/null && [ -e /usr/include/modbus/modbus.h ]
}

if ! has_packages; then
    if [ "$(id -u)" = 0 ] && command -v apt-get >/dev/null; then
        export DEBIAN_FRONTEND=noninteractive
        wanted="libmodbus-dev mbpoll gcc libc6-dev"
        apt-get install -y -q --no-install-recommends $wanted >/tmp/interop-apt.$$ 2>&1 ||
            { apt-get update -q && apt-get install -y -q --no-install-recommends $wanted; } >/tmp/interop-apt.$$ 2>&1 ||
            tail -5 /tmp/interop-apt.$$
        rm -f /tmp/interop-apt.$$
    fi
    has_packages || absent "libmodbus and mbpoll (Debian packages libmodbus-dev mbpoll gcc; not root, or no apt)"
fi

if has_packages; then
    mkdir -p built
    if [ mbserver.c -nt built/mbserver ]; then
        gcc -O2 -Wall -o built/mbserver mbserver.c -I/usr/include/modbus -lmodbus || absent "the libmodbus server does not build"
    fi
fi

if ! command -v node >/dev/null || ! command -v npm >/dev/null; then
    if [ "$(id -u)" = 0 ] && command -v apt-get >/dev/null; then
        DEBIAN_FRONTEND=noninteractive apt-get install -y -q --no-install-recommends nodejs npm >/dev/null 2>&1 || true
    fi
fi
if command -v node >/dev/null && command -v npm >/dev/null; then
    if [ ! -e node_modules/.installed ] || [ package-lock.json -nt node_modules/.installed ]; then
        if npm ci --no-audit --no-fund --ignore-scripts --loglevel=error; then
            touch node_modules/.installed
        else
            absent "node-opcua (npm could not install it)"
        fi
    fi
else
    absent "node-opcua (node and npm are not here)"
fi

has_parsers() {
    "$1" -c "import blark, tree_sitter, tree_sitter_iec61131_3_st" 2>/dev/null
}
has_open62541() {
    "$1" -c "import importlib.util as it, sys; sys.exit(it.find_spec('o6') is None)"
}

if [ -n "${1:-}" ] && ! { has_parsers "$1" && has_open62541 "$1"; }; then
    ../../locks/install.sh "$1" ../../locks/peers.lock
    has_open62541 "$1" || absent "open62541 (pip could not install o6, which brings it)"
    has_parsers "$1" || absent "the parsers of structured text (pip could not install blark and tree-sitter-iec61131-3-st)"
fi

# Not every computer can have a CNC kernel: where it is missing that is said, and nothing else fails for it.
if ! command -v linuxcnc >/dev/null && [ "$(id -u)" = 0 ] && command -v apt-get >/dev/null; then
    export DEBIAN_FRONTEND=noninteractive
    apt-get install -y -q --no-install-recommends linuxcnc-uspace >/dev/null 2>&1 ||
        { apt-get update -q && apt-get install -y -q --no-install-recommends linuxcnc-uspace; } >/dev/null 2>&1 || true
fi
command -v linuxcnc >/dev/null ||
    echo "interop: NOT RUN: the LinuxCNC kernel (Debian package linuxcnc-uspace; not root, or no apt)"

if [ "$missing" = 1 ] && [ "${TRUEFLANK_INTEROP:-}" = all ]; then
    echo "interop: everything must run here"
    exit 1
fi
exit 0
