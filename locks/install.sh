#!/usr/bin/env bash
# Install what locks pin into an environment: locks/install.sh PYTHON LOCK...
# Two halves at a time, for one pip waits for the network while it could unpack. Nothing is resolved: a lock names every
# package that another one needs, with its hashes.
set -euo pipefail
python=$1
shift
halves=$(mktemp -d)
trap 'rm -rf "$halves"' EXIT
# A package that two locks name is taken once.
cat "$@" | awk -v to="$halves" '
    /^[A-Za-z0-9]/ { split($1, pinned, "=="); fresh = !(pinned[1] in seen); seen[pinned[1]] = 1; count += fresh }
    fresh { print > (to "/" count % 2) }
'
for half in "$halves"/*; do
    # What is imported is compiled then; most of what is installed never is.
    "$python" -m pip install --quiet --disable-pip-version-check --no-compile --no-deps --require-hashes -r "$half" &
done
failed=0
for _ in "$halves"/*; do wait -n || failed=1; done
exit "$failed"
