#!/bin/sh
# Installs trueflank from this folder, without a network: sh install.sh [FOLDER]   (default: ~/trueflank)
# Each version gets a folder of its own, FOLDER/trueflank starts the one installed last. Runs, site files, approvals and
# the audit trail are never touched. To go back, run the installer of the older bundle again: it
# only chooses what is there. To mend a version, delete its folder first.
set -eu
here=$(cd "$(dirname "$0")" && pwd)
there=${1:-"$HOME/trueflank"}
version=$(cat "$here/VERSION")
python=${PYTHON:-python3.11}
command -v "$python" >/dev/null 2>&1 || python=python3
"$python" -c 'import sys; sys.exit(sys.version_info[:2] != (3, 11))' || {
    echo "install: this bundle needs Python 3.11 with venv; install it, or name it: PYTHON=/path/to/python3.11 sh install.sh" >&2
    exit 2
}
(cd "$here" && sha256sum --quiet -c SHA256SUMS) || {
    echo "install: a file of the bundle is not as it was made; nothing was installed. Copy the archive again" >&2
    exit 2
}
mkdir -p "$there/versions"
there=$(cd "$there" && pwd)
new="$there/versions/$version"
# A version stands whole or not at all: it is made beside, and carries its lock when it is whole. One that is there already
# is only chosen again.
if ! cmp -s "$here/requirements.lock" "$new/requirements.lock"; then
    rm -rf "$new.new"
    "$python" -m venv "$new.new"
    "$new.new/bin/python" -m pip install --quiet --disable-pip-version-check --no-index --no-cache-dir \
        --find-links "$here/wheels" --require-hashes -r "$here/requirements.lock"
    cp "$here/requirements.lock" "$new.new/"
    rm -rf "$new"
    mv "$new.new" "$new"
fi
printf '#!/bin/sh\nexec "%s/bin/python" -m gateway.cli "$@"\n' "$new" >"$there/trueflank.new"
chmod +x "$there/trueflank.new"
mv "$there/trueflank.new" "$there/trueflank"
echo "trueflank $version is installed. Start it: $there/trueflank --help"
