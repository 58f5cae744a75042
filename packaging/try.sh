#!/bin/sh
# The daemon on a simulated board, and the workbench: what the image does when it is run. Both in the background, as a shell
# that waits for a program in front hears no signal: `docker stop` would wait ten seconds, and kill.
set -eu
lrmd --config "${LRMD_CONFIG:-/etc/lrm/lrmd.toml}" --simulated --log-level warning &
daemon=$!
workbench=
trap 'kill $workbench "$daemon" 2>/dev/null; wait || true' EXIT
trap 'exit 0' INT TERM
lrm-ident workbench --no-open --port "${PORT:-8080}" "$@" &
workbench=$!
wait "$workbench"
