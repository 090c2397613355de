#!/usr/bin/env bash
# Install the servers of `make services`: PostgreSQL and mosquitto from Debian, when root. What cannot be had is said in
# a line "NOT RUN", and its tests say so too; with TRUEFLANK_SERVICES=all that ends the run.
set -uo pipefail

has_postgresql() {
    command -v initdb >/dev/null || compgen -G "/usr/lib/postgresql/*/bin/initdb" >/dev/null
}

has_mosquitto() {
    command -v mosquitto >/dev/null || [ -x /usr/sbin/mosquitto ]
}

missing=0
for name in postgresql mosquitto; do
    "has_$name" && continue
    if [ "$(id -u)" = 0 ] && command -v apt-get >/dev/null; then
        export DEBIAN_FRONTEND=noninteractive
        apt-get install -y -q --no-install-recommends "$name" >/dev/null 2>&1 ||
            { apt-get update -q && apt-get install -y -q --no-install-recommends "$name"; } >/dev/null 2>&1
    fi
    "has_$name" && continue
    echo "services: NOT RUN: $name (Debian package $name; not root, or no apt)"
    missing=1
done
[ "$missing" = 1 ] && [ "${TRUEFLANK_SERVICES:-}" = all ] && exit 1
exit 0
