#!/usr/bin/env bash
# Form, rules, types and unit tests of the page's scripts, by npm from the committed lock. Where Node cannot be had that is
# said in a line "NOT RUN"; with TRUEFLANK_BROWSER=all that ends the run.
set -uo pipefail
cd "$(dirname "$0")"

absent() {
    echo "page: NOT RUN: $1"
    [ "${TRUEFLANK_BROWSER:-}" = all ] && exit 1
    exit 0
}

if ! command -v npm >/dev/null && [ "$(id -u)" = 0 ] && command -v apt-get >/dev/null; then
    DEBIAN_FRONTEND=noninteractive timeout 300 apt-get install -y -q --no-install-recommends nodejs npm >/dev/null 2>&1
fi
command -v npm >/dev/null || absent "Node is not here (Debian packages nodejs and npm; not root, or no apt)"
if [ ! -e node_modules/.installed ] || [ package-lock.json -nt node_modules/.installed ]; then
    npm ci --no-audit --no-fund --ignore-scripts --loglevel=error || absent "npm could not install its tools"
    touch node_modules/.installed
fi
npm run --silent check
