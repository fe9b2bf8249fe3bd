#!/bin/sh
# Makes the Debian packages of what install.sh puts into place: build/traverse_*.deb,
# build/traverse-lab_*.deb with what only the lab's commands need, and
# build/traverse-fleet_*.deb with what the store of all arms needs. BUILD: another folder.
# MACHINE=aarch64: for another machine than this one.
# Needs no root and no debhelper; the network only where wheels are not yet on disk.
set -eu
umask 022
here="$(cd "$(dirname "$0")" && pwd)"
checkout="$(cd "$here/../.." && pwd)"
build="${BUILD:-$checkout/build}"
python="${SYSTEM_PYTHON:-/usr/bin/python3}"
version="$(sed -n 's/^version = "\(.*\)"$/\1/p' "$checkout/pyproject.toml")"
case "${MACHINE:=$(uname -m)}" in
    x86_64) architecture=amd64 ;;
    aarch64) architecture=arm64 ;;
    *) architecture="$(dpkg --print-architecture)" ;;
esac
export MACHINE
# Wheels with compiled parts serve one Python: that of the system it is made on.
this="$("$python" -c 'import sys; print("3.%d" % sys.version_info[1])')"
next="$("$python" -c 'import sys; print("3.%d" % (sys.version_info[1] + 1))')"
# Times of files are those of the last change of the sources, or of now.
SOURCE_DATE_EPOCH="$(git -C "$checkout" log -1 --format=%ct 2>/dev/null || date +%s)"
export SOURCE_DATE_EPOCH

root="$build/package/root"
lab="$build/package/lab"
fleet="$build/package/fleet"
rm -rf "$root" "$lab" "$fleet"
sh "$here/install.sh" "$root" "$lab" "$fleet"

# package TREE NAME: with the rest of its control file on standard input.
package() {
    doc="$1/usr/share/doc/$2"
    mkdir -m 755 "$1/DEBIAN"
    {
        printf 'Package: %s\nVersion: %s\nArchitecture: %s\n' "$2" "$version" "$architecture"
        printf 'Maintainer: Traverse <traverse@localhost>\nSection: science\nPriority: optional\n'
        printf 'Installed-Size: %s\n' "$(du -sk --exclude=DEBIAN "$1" | cut -f 1)"
        cat
    } >"$1/DEBIAN/control"
    # Licences of everything in it, and its changelog, where Debian looks for them.
    "$python" "$here/copyright.py" "$checkout/LICENSE" "$2" "$1"
    {
        printf '%s (%s) unstable; urgency=medium\n\n' "$2" "$version"
        printf '  * What has changed is in /usr/share/doc/traverse/CHANGELOG.md.\n\n'
        printf ' -- Traverse <traverse@localhost>  %s\n' "$(LC_ALL=C date -u -d "@$SOURCE_DATE_EPOCH" '+%a, %d %b %Y %H:%M:%S +0000')"
    } | gzip -9n >"$doc/changelog.gz"
    install -D -m 644 "$here/debian/$2.lintian-overrides" "$1/usr/share/lintian/overrides/$2"
    install -m 755 "$here/debian/prerm" "$1/DEBIAN/prerm"
    [ ! -f "$here/debian/$2.postrm" ] || install -m 755 "$here/debian/$2.postrm" "$1/DEBIAN/postrm"
    { cat "$here/debian/$2.postinst" 2>/dev/null || printf '#!/bin/sh\nset -e\n'; cat "$here/debian/start-again"; } >"$1/DEBIAN/postinst"
    chmod 755 "$1/DEBIAN/postinst"
    [ ! -d "$1/etc" ] || (cd "$1" && find etc -type f | sed 's|^|/|') >"$1/DEBIAN/conffiles"
    (cd "$1" && find usr -type f -exec md5sum {} +) >"$1/DEBIAN/md5sums"
    dpkg-deb --root-owner-group -Zxz -z2 --build "$1" "$build/${2}_${version}_$architecture.deb" >/dev/null
    echo "$build/${2}_${version}_$architecture.deb"
}

# A library may be in another package than in an earlier build: of the same version, or
# none of them would be installed beside the others, each replaces files of the others.
package "$root" traverse <<CONTROL
Depends: python3 (>= $this), python3 (<< $next), libc6 (>= 2.28), libgcc-s1, libstdc++6, zlib1g, procps
Recommends: systemd, udev
Suggests: traverse-lab (= $version), mosquitto (>= 2.0), iproute2, bash-completion
Replaces: traverse-lab, traverse-fleet
Description: measurement daemon of an articulated-arm coordinate measuring machine
 Reads the encoders of a measuring arm, computes where the centre of the
 probe's ball is, and publishes points over MQTT. One service an arm:
 traverse@ARM.service. Others: the operator's page in a browser,
 traverse-page@ARM.service, and gateways to other programs (Home Assistant,
 Foxglove, OPC UA), traverse-gateway@NAME.service.
 .
 The package brings a Python environment of its own in /usr/lib/traverse, with
 drivers for serial lines, CAN, Modbus and GPIO lines.
CONTROL
package "$lab" traverse-lab <<CONTROL
Depends: traverse (= $version)
Replaces: traverse, traverse-fleet
Description: daily check, identification and acceptance of a measuring arm
 Libraries (scipy, matplotlib) for the commands daily-check, identify, predict,
 diagnose, verify, certify, align and probe of traverse. Works on the arm's
 computer or on any other.
CONTROL
package "$fleet" traverse-fleet <<CONTROL
Depends: traverse-lab (= $version)
Replaces: traverse, traverse-lab
Suggests: postgresql
Description: store of the points of many measuring arms
 Libraries (pyarrow, psycopg) for the commands store and fleet of traverse, and
 for Parquet. One service a store: traverse-store@NAME.service.
CONTROL
