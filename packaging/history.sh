#!/bin/sh
# The history of speed and soak, kept in the branch `history` of the remote `origin`.
#
#   packaging/history.sh                       takes its file into docs/proofs and writes the page again
#   packaging/history.sh SPEED.json SOAK       adds a line to it first, and pushes it
set -eu
cd "$(dirname "$0")/.."
file=docs/proofs/history.json
parent=
if git fetch --quiet origin history 2>/dev/null; then
    parent=$(git rev-parse FETCH_HEAD)
    git show "$parent:history.json" > "$file"
fi
if [ $# -eq 2 ]; then
    python3 -m validation.proofs.history "$1" --soak "$2"
    kept=$(git hash-object -w "$file")
    tree=$(printf '100644 blob %s\thistory.json\n' "$kept" | git mktree)
    export GIT_AUTHOR_NAME=history GIT_AUTHOR_EMAIL=history@localhost
    export GIT_COMMITTER_NAME=history GIT_COMMITTER_EMAIL=history@localhost
    commit=$(git commit-tree "$tree" ${parent:+-p "$parent"} -m "Speed and soak of $(date +%F)")
    git push --quiet origin "$commit:refs/heads/history"
fi
python3 -m validation.proofs
