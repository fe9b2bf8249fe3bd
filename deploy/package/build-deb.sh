#!/bin/sh
# Makes the Debian packages of what install.sh puts into place: build/traverse_*.deb, and
# build/traverse-lab_*.deb with what only the lab's commands need. BUILD: another folder.
# Needs no root and no debhelper; the network only where wheels are not yet on disk.
set -eu
umask 022
here="$(cd "$(dirname "$0")" && pwd)"
checkout="$(cd "$here/../.." && pwd)"
build="${BUILD:-$checkout/build}"
root="$build/package/root"
python="${SYSTEM_PYTHON:-/usr/bin/python3}"
version="$(sed -n 's/^version = "\(.*\)"$/\1/p' "$checkout/pyproject.toml")"
architecture="$(dpkg --print-architecture)"
# Wheels with compiled parts serve one Python: that of the system it is made on.
this="$("$python" -c 'import sys; print("3.%d" % sys.version_info[1])')"
next="$("$python" -c 'import sys; print("3.%d" % (sys.version_info[1] + 1))')"

lab="$build/package/lab"

rm -rf "$root" "$lab"
sh "$here/install.sh" "$root" "$lab"
mkdir -m 755 "$root/DEBIAN" "$lab/DEBIAN"
for script in postinst prerm postrm; do
    install -m 755 "$here/debian/$script" "$root/DEBIAN/$script"
done
(cd "$root" && find etc -type f | sed 's|^|/|') >"$root/DEBIAN/conffiles"
cat >"$root/DEBIAN/control" <<CONTROL
Package: traverse
Version: $version
Architecture: $architecture
Maintainer: Traverse <traverse@localhost>
Section: science
Priority: optional
Installed-Size: $(du -sk --exclude=DEBIAN "$root" | cut -f 1)
Depends: python3 (>= $this), python3 (<< $next), libc6 (>= 2.28), procps
Recommends: systemd, udev
Suggests: traverse-lab (= $version), mosquitto (>= 2.0), iproute2, bash-completion
Description: measurement daemon of an articulated-arm coordinate measuring machine
 Reads the encoders of a measuring arm, computes where the centre of the
 probe's ball is, and publishes points over MQTT. One service an arm:
 traverse@ARM.service. The operator's page in a browser is another:
 traverse-page@ARM.service.
 .
 The package brings a Python environment of its own in /usr/lib/traverse, with
 drivers for serial lines, CAN, Modbus and GPIO lines.
CONTROL
cat >"$lab/DEBIAN/control" <<CONTROL
Package: traverse-lab
Version: $version
Architecture: $architecture
Maintainer: Traverse <traverse@localhost>
Section: science
Priority: optional
Installed-Size: $(du -sk --exclude=DEBIAN "$lab" | cut -f 1)
Depends: traverse (= $version)
Description: daily check, identification and acceptance of a measuring arm
 Libraries (scipy, matplotlib) for the commands daily-check, identify, predict,
 diagnose, verify, align and probe of traverse. Works on the arm's computer or
 on any other.
CONTROL
# Licences of everything in a package, and its changelog, where Debian looks for them.
"$python" "$here/copyright.py" "$checkout/LICENSE" traverse "$root"
"$python" "$here/copyright.py" "$checkout/LICENSE" traverse-lab "$lab"
for tree in "$root" "$lab"; do
    name="$(sed -n 's/^Package: //p' "$tree/DEBIAN/control")"
    doc="$tree/usr/share/doc/$name"
    {
        printf '%s (%s) unstable; urgency=medium\n\n' "$name" "$version"
        printf '  * What has changed is in /usr/share/doc/traverse/CHANGELOG.md.\n\n'
        printf ' -- Traverse <traverse@localhost>  %s\n' "$(LC_ALL=C date -u -d "@$(date +%s)" '+%a, %d %b %Y %H:%M:%S +0000')"
    } | gzip -9n >"$doc/changelog.gz"
    install -D -m 644 "$here/debian/$name.lintian-overrides" "$tree/usr/share/lintian/overrides/$name"
done
# Times of files are those of the last change of the sources, or of now.
if stamp="$(git -C "$checkout" log -1 --format=%ct 2>/dev/null)"; then
    export SOURCE_DATE_EPOCH="$stamp"
fi
for tree in "$root" "$lab"; do
    (cd "$tree" && find usr -type f -exec md5sum {} +) >"$tree/DEBIAN/md5sums"
    name="$(sed -n 's/^Package: //p' "$tree/DEBIAN/control")"
    package="$build/${name}_${version}_$architecture.deb"
    dpkg-deb --root-owner-group -Zxz -z2 --build "$tree" "$package" >/dev/null
    echo "$package"
done
