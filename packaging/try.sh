#!/bin/sh
# The daemon on a simulated board in the background, and the workbench in front: what the image does when it is run.
set -eu
lrmd --config "${LRMD_CONFIG:-/etc/lrm/lrmd.toml}" --simulated --log-level warning &
daemon=$!
trap 'kill "$daemon" 2>/dev/null; wait "$daemon" || true' EXIT
trap 'exit 0' INT TERM
lrm-ident workbench --no-open --port "${PORT:-8080}" "$@"
