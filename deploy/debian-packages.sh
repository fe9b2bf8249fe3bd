#!/bin/sh
# Installs the Debian packages of one or more groups, or says which are missing.
# Usage: debian-packages.sh GROUP...        install what is missing
#        debian-packages.sh --list          print the table: group|what must be there|packages
# What must be there: programs, `header:FILE` of this Python, `module:NAME` of this Python
# or `file:PATTERN`. PYTHON names another interpreter than python3.
set -eu
python="${PYTHON:-python3}"
# Programs that only root runs are in places that an ordinary user's PATH lacks.
PATH="$PATH:/usr/sbin:/sbin"
table() {
    cat <<'TABLE'
python|module:ensurepip module:venv|python3-venv
compiler|gcc as ld header:Python.h|gcc libc6-dev python3-dev
cplusplus|g++ as ld|g++
mosquitto|mosquitto mosquitto_passwd mosquitto_pub mosquitto_sub|mosquitto mosquitto-clients
postgresql|file:/usr/lib/postgresql/*/bin/initdb|postgresql
openssl|openssl|openssl
jq|jq|jq
chromium|chromium|chromium
node|node npm|nodejs npm
vm|qemu-system-x86_64 busybox ip mmdebstrap depmod mke2fs|qemu-system-x86 busybox-static iproute2 mmdebstrap kmod e2fsprogs
fresh|mmdebstrap unshare|mmdebstrap util-linux
avr|avr-gcc avr-size avr-objcopy|gcc-avr avr-libc
arm|arm-none-eabi-gcc arm-none-eabi-objcopy arm-none-eabi-size python3|gcc-arm-none-eabi
cppcheck|cppcheck|cppcheck
simavr|file:/usr/include/simavr/sim_avr.h|libsimavr-dev
aarch64|aarch64-linux-gnu-gcc qemu-aarch64|gcc-aarch64-linux-gnu libc6-dev-arm64-cross qemu-user
prometheus|promtool|prometheus
systemd|systemd-analyze systemd-sysusers systemd-tmpfiles|systemd
groff|groff|groff
elfutils|eu-strip|elfutils
xvfb|Xvfb xterm|xvfb xterm
TABLE
}

is_there() {
    case "$1" in
        module:*) "$python" -c "import ${1#module:}" 2>/dev/null ;;
        header:*) "$python" -c "
import pathlib, sys, sysconfig
sys.exit(not (pathlib.Path(sysconfig.get_path('include')) / '${1#header:}').exists())" ;;
        file:*) ls ${1#file:} >/dev/null 2>&1 ;;
        *) command -v "$1" >/dev/null ;;
    esac
}

if [ "${1:-}" = --list ]; then
    table
    exit 0
fi
missing=""
for group in "$@"; do
    row="$(table | grep "^$group|")" || { echo "debian-packages.sh: unknown group '$group'" >&2; exit 2; }
    wanted="${row#*|}"
    for one in ${wanted%|*}; do
        is_there "$one" || { missing="$missing ${wanted#*|}"; break; }
    done
done
[ -n "$missing" ] || exit 0
if [ "$(id -u)" != 0 ] || ! command -v apt-get >/dev/null; then
    echo "Missing Debian packages:$missing. Install them with: sudo apt-get install$missing" >&2
    exit 2
fi
echo "Installing Debian packages:$missing"
# One list of packages serves several groups, one after the other.
[ -n "$(find /var/lib/apt/lists -name '*_Packages*' -mmin -60 2>/dev/null)" ] || apt-get update -qq
# A broker started by its package would hold port 1883; the tests start their own.
# Another target of make may be installing its own: its end is waited for.
DEBIAN_FRONTEND=noninteractive apt-get install -o DPkg::Lock::Timeout=900 -y -qq --no-install-recommends $missing >/dev/null
