# To be read by system.sh: sets `disk`, the image of a Debian 12 with systemd and
# mosquitto. It is made once, of packages, with mmdebstrap, and never written to.
release="$(basename "$kernel"/lib/modules/*)"
disk="$build/system-$(cat "$here/image.sh" "$here/modules-guest.txt" | sha256sum | cut -c 1-12)-$release.ext4"
if [ ! -f "$disk" ]; then
    if [ "$(id -u)" != 0 ]; then
        echo "image.sh: making the disk of the guest needs root; run \`make test-vm\` once as root" >&2
        exit 2
    fi
    echo "image.sh: making $(basename "$disk"), about a minute"
    root="$build/system-root"
    rm -rf "$root" "$build"/system-*.ext4
    mmdebstrap --quiet --mode=root --variant=minbase \
        --include=systemd-sysv,udev,kmod,procps,iproute2,mosquitto,python3 \
        --dpkgopt='path-exclude=/usr/share/man/*' \
        --dpkgopt='path-exclude=/usr/share/locale/*' \
        --dpkgopt='path-exclude=/usr/share/doc/*/*' \
        --dpkgopt='path-include=/usr/share/doc/traverse/*' \
        bookworm "$root" ${DEBIAN_MIRROR:-}
    modules="$root/usr/lib/modules/$release"
    mkdir -p "$modules"
    cp "$kernel/lib/modules/$release"/modules.* "$modules/"
    while read -r part; do
        mkdir -p "$modules/kernel/$(dirname "$part")"
        cp -r "$kernel/lib/modules/$release/kernel/$part" "$modules/kernel/$part"
    done <"$here/modules-guest.txt"
    depmod -b "$root" "$release"
    echo guest >"$root/etc/hostname"
    echo 127.0.0.1 localhost guest >"$root/etc/hosts"
    : >"$root/etc/machine-id"
    for unit in apt-daily.timer apt-daily-upgrade.timer dpkg-db-backup.timer \
        e2scrub_all.timer e2scrub_reap.service fstrim.timer getty@tty1.service \
        serial-getty@ttyS0.service systemd-binfmt.service \
        proc-sys-fs-binfmt_misc.automount systemd-networkd-wait-online.service; do
        ln -sf /dev/null "$root/etc/systemd/system/$unit"
    done
    mkdir -p "$root/mnt/out" "$root/opt/check/tests"
    cat >"$root/etc/fstab" <<FSTAB
out   /mnt/out         9p trans=virtio,version=9p2000.L,msize=512000 0 0
tests /opt/check/tests 9p trans=virtio,version=9p2000.L,msize=512000,ro,cache=loose 0 0
FSTAB
    cat >"$root/etc/systemd/system/check.service" <<UNIT
[Unit]
After=multi-user.target
RequiresMountsFor=/mnt/out /opt/check/tests
FailureAction=poweroff-force
SuccessAction=poweroff-force

[Service]
Type=oneshot
Environment=HOME=/root PYTHONDONTWRITEBYTECODE=1 TRAVERSE_VM_OUT=/mnt/out
ExecStart=/bin/sh /opt/check/tests/vm/system/job.sh
StandardOutput=tty
StandardError=tty
TTYPath=/dev/ttyS0
UNIT
    mkdir -p "$root/etc/systemd/system/default.target.wants"
    ln -sf ../check.service "$root/etc/systemd/system/default.target.wants/check.service"
    mke2fs -q -t ext4 -d "$root" "$disk.part" 1500M >/dev/null
    rm -rf "$root"
    mv "$disk.part" "$disk"
fi
