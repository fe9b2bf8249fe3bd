#!/bin/sh
# Boots Debian 12 with systemd in a virtual machine and lets it check packages there.
# Usage: system.sh SECONDS PACKAGE LAB_PACKAGE FLEET_PACKAGE
# The guest has a disk of its own, whose changes are thrown away, and of this machine
# it sees the folder tests/ and build/vm/system-out/. The exit status is that of
# tests/vm/system/job.sh, or 4 if it has not ended in time.
set -eu
limit_s="$1"
package="$2"
lab_package="$3"
fleet_package="$4"
here="$(cd "$(dirname "$0")" && pwd)"
. "$here/kernel.sh"
. "$here/image.sh"
out="$build/system-out"
rm -rf "$out"
mkdir -p "$out"
cp "$package" "$out/traverse.deb"
cp "$lab_package" "$out/traverse-lab.deb"
cp "$fleet_package" "$out/traverse-fleet.deb"
pack_initial "$build/initial-system.gz" "$here/init-system" "$here/modules-system.txt"

status=0
emulate "$limit_s" -initrd "$build/initial-system.gz" \
    -append "console=ttyS0 quiet panic=-1 systemd.show_status=0 mitigations=off" \
    -drive "file=$disk,format=raw,if=virtio,snapshot=on,cache=unsafe" \
    -device qemu-xhci -chardev null,id=line -device usb-serial,chardev=line,always-plugged=on \
    -fsdev "local,id=tests,path=$checkout/tests,security_model=none,readonly=on" \
    -device virtio-9p-pci,fsdev=tests,mount_tag=tests \
    -fsdev "local,id=out,path=$out,security_model=none" \
    -device virtio-9p-pci,fsdev=out,mount_tag=out || status=$?
if [ ! -f "$out/status" ]; then
    echo "system.sh: the guest did not end its job within $limit_s s (qemu: $status)" >&2
    exit 4
fi
exit "$(cat "$out/status")"
