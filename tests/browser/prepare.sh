#!/usr/bin/env bash
# Install Debian's Chromium and fonts with Chinese for `make browser`, when root. Where it cannot be had that is said in a line "NOT RUN", and the
# tests say so too; with TRUEFLANK_BROWSER=all that ends the run.
set -uo pipefail

has_chromium() {
    [ -x "${CHROMIUM:-/usr/bin/chromium}" ]
}

if ! has_chromium && [ "$(id -u)" = 0 ] && command -v apt-get >/dev/null; then
    export DEBIAN_FRONTEND=noninteractive
    timeout 300 apt-get install -y -q --no-install-recommends chromium fonts-wqy-microhei fonts-dejavu-core >/dev/null 2>&1 ||
        { timeout 120 apt-get update -q && timeout 300 apt-get install -y -q --no-install-recommends chromium fonts-wqy-microhei fonts-dejavu-core; } >/dev/null 2>&1
fi
has_chromium && exit 0
echo "browser: NOT RUN: chromium (Debian package chromium; not root, or no apt)"
[ "${TRUEFLANK_BROWSER:-}" = all ] && exit 1
exit 0
