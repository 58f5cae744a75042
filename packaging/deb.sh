#!/bin/sh
# Builds the Debian package of the daemon: dist/lrm-arm_VERSION_ARCHITECTURE.deb.
#
#   packaging/deb.sh [WHEEL]     WHEEL: the project's own, already built; otherwise pip builds it
#
# The package holds the packages that the daemon needs, so it is for the Python that builds it (PYTHON=, default
# /usr/bin/python3) and for this architecture: build it on the Debian release that the rover has. pip's own variables
# count, and it keeps nothing that it fetches unless its hash stands in REQUIREMENTS (default: those of install.sh). Files, units and user are those of systemd/install.sh, below /usr instead of /usr/local.
set -eu
umask 022

SOURCE=$(cd "$(dirname "$0")/.." && pwd)
PYTHON=${PYTHON:-/usr/bin/python3}
OUT=${OUT:-$SOURCE/dist}
REQUIREMENTS=${REQUIREMENTS:-$SOURCE/systemd/requirements.txt}
WHAT=${1:-$SOURCE}

fail() {
    echo "deb.sh: $1" >&2
    exit 2
}

command -v dpkg-deb >/dev/null || fail "dpkg-deb is missing (apt install dpkg)"
"$PYTHON" -c 'import sys; sys.exit(sys.version_info < (3, 11))' || fail "$PYTHON is not Python 3.11 or later; set PYTHON="
"$PYTHON" -m pip --version >/dev/null 2>&1 || fail "$PYTHON has no pip (apt install python3-pip)"

version=$(sed -n 's/^version = "\(.*\)"/\1/p' "$SOURCE/pyproject.toml" | head -n 1)
machine=$(dpkg --print-architecture)
this=$("$PYTHON" -c 'import sys; print("{}.{}".format(*sys.version_info))')
next=$("$PYTHON" -c 'import sys; print("{}.{}".format(sys.version_info[0], sys.version_info[1] + 1))')
stage=$(mktemp -d)
trap 'rm -rf "$stage"' EXIT
chmod 755 "$stage"

# units, rules, user, configuration
DESTDIR=$stage PYTHON=$PYTHON "$SOURCE/systemd/install.sh" >/dev/null
cp -R "$stage/usr/local/lib" "$stage/usr/lib"
mkdir -p "$stage/usr/share"
cp -R "$stage/usr/local/share/doc" "$stage/usr/share"
rm -rf "${stage:?}/usr/local"
sed -i 's|/usr/local/share/doc|/usr/share/doc|' "$stage"/usr/lib/systemd/system/*.service

# the program: packages in one folder, and a starter for each command
program=$stage/opt/lrm/$version
mkdir -p "$program/bin"
pip() {
    PYTHONPATH=$program/lib "$PYTHON" -m pip install --quiet --disable-pip-version-check --no-compile \
        --root-user-action ignore --target "$program/lib" "$@"
}
pip --require-hashes -r "$REQUIREMENTS"
command -v "${CC:-cc}" >/dev/null || command -v gcc >/dev/null || command -v clang >/dev/null || [ -n "${1:-}" ] ||
    pip --require-hashes -r "$SOURCE/systemd/compiler.txt"
rm -rf "$program/lib/bin"
pip --no-deps --no-build-isolation "$WHAT"
rm -rf "$program/lib/bin"
for command in "lrmd lrmd.main" "lrmd-board lrmd.sim.process" "lrm lrmd.cli.__main__"; do
    name=${command% *}
    cat >"$program/bin/$name" <<STARTER
#!/bin/sh
PYTHONPATH=\$(dirname "\$(readlink -f "\$0")")/../lib\${PYTHONPATH:+:\$PYTHONPATH}
export PYTHONPATH
exec "\${LRM_PYTHON:-$PYTHON}" -s -c 'import sys; sys.argv[0] = "$name"; from ${command#* } import main; sys.exit(main())' "\$@"
STARTER
    chmod 755 "$program/bin/$name"
    mkdir -p "$stage/usr/bin"
    ln -s "/opt/lrm/current/bin/$name" "$stage/usr/bin/$name"
done
ln -s "$version" "$stage/opt/lrm/current"
mkdir -p "$stage/usr/share/doc/lrm-arm"
install -m 644 "$SOURCE/LICENSE" "$stage/usr/share/doc/lrm-arm/copyright"

mkdir -p "$stage/DEBIAN"
(cd "$stage" && find etc -type f | sed 's|^|/|' | sort) >"$stage/DEBIAN/conffiles"
size=$(du -sk --exclude=DEBIAN "$stage" | cut -f 1)
cat >"$stage/DEBIAN/control" <<CONTROL
Package: lrm-arm
Version: $version
Architecture: $machine
Maintainer: The lrm-arm developers <maintainers@lrm-arm.invalid>
Installed-Size: $size
Depends: python3 (>= $this), python3 (<< $next), systemd (>= 250)
Section: science
Priority: optional
Homepage: https://github.com/lrm-arm/lrm-arm
Description: daemon that drives a calibrated robot arm on RC servos
 It owns the servo board, computes which joint angles put the tip of the bent arm at a goal, and never moves a servo
 that nobody asked to move. The offline tool lrm-ident is not in this package.
CONTROL
cat >"$stage/DEBIAN/postinst" <<'SCRIPT'
#!/bin/sh
set -e
if [ "$1" = configure ] && [ -d /run/systemd/system ]; then
    systemd-sysusers lrm.conf
    systemd-tmpfiles --create lrm.conf
    systemctl daemon-reload
    udevadm control --reload && udevadm trigger --subsystem-match=tty || true
    systemctl enable --quiet lrmd.service
    # a running daemon is not restarted: it may be holding a load
fi
SCRIPT
cat >"$stage/DEBIAN/prerm" <<'SCRIPT'
#!/bin/sh
set -e
if [ "$1" = remove ] && [ -d /run/systemd/system ]; then
    systemctl disable --quiet --now lrmd.service lrmd-sim.service || true
fi
find /opt/lrm -name __pycache__ -type d -prune -exec rm -rf {} + # what Python compiled there
SCRIPT
chmod 755 "$stage/DEBIAN/postinst" "$stage/DEBIAN/prerm"
mkdir -p "$OUT"
package=$OUT/lrm-arm_${version}_$machine.deb
dpkg-deb --root-owner-group --build "$stage" "$package" >/dev/null
echo "$package"
