#!/bin/sh
# Installs the daemon on a rover, or removes it.
#
#   install.sh             the program in /opt/lrm, units, udev rule, user, configuration; run it again to upgrade
#   install.sh program     the program alone
#   install.sh uninstall   removes all of that, but keeps configuration that was changed, and what the daemon saved
#   install.sh purge       removes these too
#
# DESTDIR=DIR puts the files below DIR instead, for a package or an image, and touches nothing else: no program, no
# user, no running systemd. PYTHON=... names the Python (3.11 or later) that builds /opt/lrm. pip's own variables count
# (PIP_NO_INDEX=1 PIP_FIND_LINKS=wheels for a rover without a network).
#
# A configuration file that was changed is never overwritten: the new one is put beside it as FILE.new.
# A running daemon is not restarted, for it may be holding a load. Each version has a folder of its own, and the link
# /opt/lrm/current names the newest: processes that a running daemon starts anew are of the version that it began with.
set -eu
umask 022

SOURCE=$(cd "$(dirname "$0")/.." && pwd)
DESTDIR=${DESTDIR:-}
DESTDIR=${DESTDIR%/}
PYTHON=${PYTHON:-python3}
PROGRAM=${PROGRAM:-/opt/lrm}
AS_INSTALLED=/usr/local/share/lrm
UNITS="lrmd.service lrmd-sim.service"

say() { printf '%-9s %s\n' "$1" "$2"; }

fail() {
    echo "install.sh: $1" >&2
    exit 2
}

# Every file that is installed: mode, source, destination. Those below /etc are the person's to change.
files() {
    echo "644 systemd/lrmd.service /usr/local/lib/systemd/system/lrmd.service
644 systemd/lrmd-sim.service /usr/local/lib/systemd/system/lrmd-sim.service
644 systemd/70-lrm-arm.rules /usr/local/lib/udev/rules.d/70-lrm-arm.rules
644 systemd/lrm.sysusers /usr/local/lib/sysusers.d/lrm.conf
644 systemd/lrm.tmpfiles /usr/local/lib/tmpfiles.d/lrm.conf
644 docs/install.md /usr/local/share/doc/lrm/install.md
644 config/lrmd.toml /etc/lrm/lrmd.toml"
    (cd "$SOURCE" && for path in config/zenoh/*.json5; do echo "640 $path /etc/lrm/zenoh/${path##*/}"; done)
    echo "644 config/zenoh/credentials.example /etc/lrm/zenoh/credentials.example
644 config/zenoh/README.md /etc/lrm/zenoh/README.md
755 config/zenoh/make-certificates.sh /etc/lrm/zenoh/make-certificates.sh"
}

check() {
    [ "$(uname -s)" = Linux ] || fail "this is $(uname -s); the daemon runs on Linux with systemd"
    files | while read -r _ source _; do
        [ -f "$SOURCE/$source" ] || fail "$source is missing in $SOURCE; run this from a complete copy of the project"
    done
    [ -z "$DESTDIR" ] || return 0
    [ "$(id -u)" = 0 ] || fail "must run as root: sudo make install (or set DESTDIR)"
    for program in systemctl systemd-sysusers systemd-tmpfiles udevadm runuser; do
        command -v "$program" >/dev/null || fail "$program is missing; the daemon runs on Linux with systemd"
    done
}

check_python() {
    "$PYTHON" -c 'import sys, venv, ensurepip; sys.exit(sys.version_info < (3, 11))' 2>/dev/null ||
        fail "$PYTHON is not Python 3.11 or later with venv (apt install python3-venv); set PYTHON="
    home=$("$PYTHON" -c 'import os, sys; print(os.path.realpath(sys.base_prefix))')
    case $home/ in
        /home/* | /root/*) fail "$PYTHON is in $home, which a service cannot see; set PYTHON=/usr/bin/python3" ;;
    esac
}

# Whether a person changed the file below /etc since it was installed: it is not as it was then.
changed() { # DESTINATION
    case $1 in
        /etc/*) [ -e "$DESTDIR$1" ] && ! cmp -s "$DESTDIR$1" "$DESTDIR$AS_INSTALLED$1" ;;
        *) false ;;
    esac
}

write() { # MODE SOURCE TARGET
    mkdir -p "${3%/*}"
    install -m "$1" "$SOURCE/$2" "$3.part"
    mv -f "$3.part" "$3"
}

put() { # MODE SOURCE DESTINATION
    if cmp -s "$SOURCE/$2" "$DESTDIR$3"; then
        chmod "$1" "$DESTDIR$3"
        rm -f "$DESTDIR$3.new"
        say same "$3"
    elif changed "$3"; then
        write "$1" "$2" "$DESTDIR$3.new"
        say kept "$3, which was changed; the new one is $3.new"
        return
    else
        write "$1" "$2" "$DESTDIR$3"
        say put "$3"
    fi
    case $3 in /etc/*) write "$1" "$2" "$DESTDIR$AS_INSTALLED$3" ;; esac
}

# A folder for this version that is not there yet; the name of one that is says nothing of its content.
new_folder() {
    version=$(sed -n 's/^version = "\(.*\)"/\1/p' "$SOURCE/pyproject.toml")
    [ -n "$version" ] || fail "pyproject.toml has no version in $SOURCE"
    folder=$PROGRAM/$version
    number=1
    while [ -e "$folder" ]; do
        number=$((number + 1))
        folder=$PROGRAM/$version-$number
    done
    echo "$folder"
}

put_program() {
    folder=$(new_folder)
    say build "$folder"
    mkdir -p "$PROGRAM"
    trap 'rm -rf "$folder"' EXIT # unless all of it is there
    "$PYTHON" -m venv "$folder"
    # pip runs as root: nothing that it fetches is run or kept unless its hash is known
    pip() { "$folder/bin/python" -m pip install --quiet --disable-pip-version-check "$@"; }
    pip --require-hashes -r "$SOURCE/systemd/requirements.txt"
    command -v "${CC:-cc}" >/dev/null || command -v gcc >/dev/null || command -v clang >/dev/null ||
        pip --require-hashes -r "$SOURCE/systemd/compiler.txt"
    pip --no-deps --no-build-isolation "$SOURCE"
    [ -x "$folder/bin/lrmd" ] || fail "the project was installed to $folder, but brought no program lrmd"
    trap - EXIT
    ln -sfn "${folder##*/}" "$PROGRAM/current.part"
    mv -fT "$PROGRAM/current.part" "$PROGRAM/current"
    sweep_versions "$folder"
}

# Removes what earlier installations left, but for what a running process was started from.
sweep_versions() { # FOLDER that stays
    for old in "$PROGRAM"/*/; do
        old=${old%/}
        [ ! -L "$old" ] || continue # the link, and lib64 of a release that had no folders of versions
        case ${old##*/} in
            bin | include | lib | share) used=$PROGRAM/lib ;; # that release
            *) used=$old ;;
        esac
        [ "$old" != "$1" ] || continue
        if grep -qsF "$used/" /proc/[0-9]*/maps; then
            say kept "$old, which a running process uses; the next installation removes it"
        else
            rm -rf "$old"
            say removed "$old"
        fi
    done
    [ -d "$PROGRAM/lib" ] || rm -rf "$PROGRAM/lib64" "$PROGRAM/pyvenv.cfg"
}

check_program() { # as the daemon's user, who reads other files than root does
    runuser -u lrm -- "$PROGRAM/current/bin/lrmd" --config /etc/lrm/lrmd.toml --check
}

tell_system() {
    systemctl daemon-reload
    udevadm control --reload
    udevadm trigger --subsystem-match=tty
}

install_all() {
    check
    [ -n "$DESTDIR" ] || check_python
    files | while read -r mode source destination; do put "$mode" "$source" "$destination"; done
    if [ -n "$DESTDIR" ]; then
        say staged "below $DESTDIR: no program, no user, nothing started"
        return
    fi
    systemd-sysusers lrm.conf
    systemd-tmpfiles --create lrm.conf
    put_program
    check_program
    tell_system
    systemctl enable --quiet lrmd.service
    say ready "at the next boot; now: systemctl start lrmd (after an upgrade restart it, the arm at rest)"
}

take() { # DESTINATION, also a changed one if $PURGE
    rm -f "$DESTDIR$1.new"
    [ -e "$DESTDIR$1" ] || return 0
    if [ -z "$PURGE" ] && changed "$1"; then
        say kept "$1, which was changed"
    else
        rm -f "$DESTDIR$1"
        say removed "$1"
    fi
}

# The project's own folders, where nothing is left in them.
sweep() {
    for folder in /etc/lrm/zenoh /etc/lrm /usr/local/share/doc/lrm; do
        rmdir "$DESTDIR$folder" 2>/dev/null || true
    done
}

uninstall_all() {
    PURGE=$1
    check
    if [ -z "$DESTDIR" ]; then
        for unit in $UNITS; do systemctl disable --quiet --now "$unit" 2>/dev/null || true; done
        rm -rf "$PROGRAM"
        say removed "$PROGRAM"
    fi
    files | while read -r _ _ destination; do take "$destination"; done
    rm -rf "$DESTDIR$AS_INSTALLED"
    if [ -n "$PURGE" ]; then
        for path in etc/lrm var/lib/lrmd var/lib/lrmd-sim var/lib/private/lrmd-sim; do rm -rf "$DESTDIR/$path"; done
        say removed "/etc/lrm and what the daemon saved"
    fi
    sweep
    [ -n "$DESTDIR" ] || tell_system
}

case ${1:-install} in
    install) install_all ;;
    program) put_program ;;
    uninstall) uninstall_all "" ;;
    purge) uninstall_all all ;;
    *) fail "usage: [DESTDIR=DIR] [PYTHON=PROGRAM] install.sh [install|program|uninstall|purge]" ;;
esac
