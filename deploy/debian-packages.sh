#!/bin/sh
# Installs the Debian packages that a target needs, or says which are missing.
# Usage: debian-packages.sh python | mosquitto | pykdl | vm
set -eu
case "$1" in
    python) python3 -c 'import ensurepip, venv' 2>/dev/null && exit 0; packages="python3-venv" ;;
    mosquitto) PATH="$PATH:/usr/sbin"; command -v mosquitto >/dev/null && command -v openssl >/dev/null && exit 0
        packages="mosquitto openssl" ;;
    chromium) command -v chromium >/dev/null && exit 0; packages="chromium" ;;
    node) command -v npm >/dev/null && exit 0; packages="nodejs npm" ;;
    pykdl) ls /usr/lib/python3/dist-packages/PyKDL.*.so >/dev/null 2>&1 && exit 0; packages="python3-pykdl" ;;
    vm) command -v qemu-system-x86_64 >/dev/null && command -v busybox >/dev/null && command -v ip >/dev/null &&
            command -v mmdebstrap >/dev/null && exit 0
        packages="qemu-system-x86 busybox-static iproute2 mmdebstrap" ;;
    *) echo "debian-packages.sh: unknown group '$1'" >&2; exit 2 ;;
esac
if [ "$(id -u)" = 0 ] && command -v apt-get >/dev/null; then
    apt-get update -qq
    # A broker started by its package would hold port 1883; the tests start their own.
    DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends $packages >/dev/null
else
    echo "Missing Debian package: $packages. Install it with: sudo apt-get install $packages" >&2
    exit 2
fi
