#!/bin/sh
# Certificates for mtls.json5, router.json5 and their clients: an authority of your own, and one certificate per name.
#
#   make-certificates.sh DIR NAME[=ADDRESS,...] ...
#   make-certificates.sh tls rover1=rover1.local,192.168.1.20 operator viewer
#
# NAME becomes the common name, by which access is given. ADDRESSes are the host names and IP addresses under which
# others connect to it; one who only connects has none. What exists is kept, so names can be added later.
# DIR/authority.key makes new users: keep it off the rovers.
set -eu
umask 077

DAYS_AUTHORITY=3650
DAYS=825

fail() {
    echo "make-certificates.sh: $1" >&2
    exit 2
}

silently() {
    said=$("$@" 2>&1) || fail "$* failed: $said"
}

alternative_names() { # ADDRESS,... -> DNS:a,IP:b
    echo "$1" | tr ',' '\n' | sed -E '/^([0-9.]+|.*:.*)$/ s/^/IP:/; /^IP:/! s/^/DNS:/' | paste -s -d ,
}

make_authority() {
    [ ! -e authority.crt ] || { echo "kept   authority.crt"; return; }
    silently openssl req -x509 -newkey ec -pkeyopt ec_paramgen_curve:P-256 -nodes -days "$DAYS_AUTHORITY" \
        -subj "/CN=lrm authority" -addext "basicConstraints=critical,CA:TRUE,pathlen:0" \
        -addext "keyUsage=critical,keyCertSign,cRLSign" -keyout authority.key -out authority.crt
    chmod 644 authority.crt
    echo "made   authority.crt authority.key"
}

make_certificate() { # NAME ADDRESS,...
    [ ! -e "$1.crt" ] || { echo "kept   $1.crt"; return; }
    [ -e authority.key ] || fail "no authority.key in $DIR; make certificates where it is kept"
    usage=clientAuth names=DNS:$1
    [ -z "$2" ] || { usage=serverAuth,clientAuth; names=$(alternative_names "$2"); }
    silently openssl req -new -newkey ec -pkeyopt ec_paramgen_curve:P-256 -nodes -subj "/CN=$1" \
        -keyout "$1.key" -out "$1.csr"
    printf '%s\n' "basicConstraints=critical,CA:FALSE" "keyUsage=critical,digitalSignature" \
        "extendedKeyUsage=$usage" "subjectAltName=$names" > "$1.ext"
    silently openssl x509 -req -in "$1.csr" -CA authority.crt -CAkey authority.key -CAcreateserial -days "$DAYS" \
        -extfile "$1.ext" -out "$1.crt"
    rm -f "$1.csr" "$1.ext"
    chmod 644 "$1.crt"
    echo "made   $1.crt $1.key  $names"
}

[ $# -ge 2 ] || fail "usage: make-certificates.sh DIR NAME[=ADDRESS,...] ..."
command -v openssl >/dev/null || fail "openssl is not installed"
DIR=$1
shift
for entry in "$@"; do
    case ${entry%%=*} in
        '' | authority | *[!A-Za-z0-9_-]*)
            fail "'${entry%%=*}' cannot be a name: letters, digits, - and _ only, and not 'authority'" ;;
    esac
done
mkdir -p "$DIR"
cd "$DIR"
make_authority
for entry in "$@"; do
    case $entry in
        *=*) make_certificate "${entry%%=*}" "${entry#*=}" ;;
        *) make_certificate "$entry" "" ;;
    esac
done
