#!/bin/sh
# Runs a command of the checkout in a virtual machine with Debian's stock kernel.
# Usage: run.sh SECONDS COMMAND...
# The guest sees the files of this machine, read-only below a layer of memory, has no
# network, and is emulated whole, without KVM. OUT is a folder that both can write to;
# the command finds it in the variable TRAVERSE_VM_OUT. The exit status is the
# command's, or 4 if it has not ended in time.
set -eu
seconds="$1"
shift
here="$(cd "$(dirname "$0")" && pwd)"
checkout="$(cd "$here/../.." && pwd)"
build="$checkout/build/vm"
out="$build/out"
mkdir -p "$build"

quoted() { for word in "$@"; do printf "'%s' " "$(printf %s "$word" | sed "s/'/'\\\\''/g")"; done; }

# The kernel: fetched as a package and unpacked, never installed.
image="$(apt-cache depends linux-image-amd64 | sed -n 's/.*Depends: \(linux-image-[0-9][^ ]*\)$/\1/p' | head -n 1)"
if [ -z "$image" ]; then
    echo "run.sh: apt knows no package linux-image-amd64; this needs Debian on amd64, after apt-get update" >&2
    exit 2
fi
kernel="$build/$image"
if [ ! -d "$kernel" ]; then
    (cd "$build" && apt-get download -qq "$image")
    dpkg-deb -x "$build/$image"_*.deb "$kernel.part"
    mv "$kernel.part" "$kernel"
    rm "$build/$image"_*.deb
fi

# The initial file system: busybox, the modules, our init and the job.
rm -rf "$build/initial" "$out"
mkdir -p "$build/initial/bin" "$build/initial/modules" "$out"
cp "$(command -v busybox)" "$build/initial/bin/busybox"
cp "$here/init" "$build/initial/init"
chmod 755 "$build/initial/init"
cp "$here/modules.txt" "$build/initial/modules/list"
while read -r module; do
    cp "$kernel"/lib/modules/*/kernel/"$module.ko" "$build/initial/modules/"
done <"$here/modules.txt"
cat >"$build/initial/job" <<JOB
export PATH=/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin HOME=/tmp
export TRAVERSE_VM_OUT=/mnt/out OPENBLAS_NUM_THREADS=1 PYTHONDONTWRITEBYTECODE=1
cd $(quoted "$checkout") && exec $(quoted "$@")
JOB
(cd "$build/initial" && find . | busybox cpio -o -H newc 2>/dev/null | gzip -1) >"$build/initial.gz"

status=0
timeout --foreground "$seconds" qemu-system-x86_64 \
    -machine q35 -accel tcg,thread=multi -cpu max -smp 2 -m 1024 \
    -nodefaults -no-user-config -display none -serial stdio -no-reboot -nic none \
    -kernel "$kernel"/boot/vmlinuz-* -initrd "$build/initial.gz" \
    -append "console=ttyS0 quiet panic=-1" \
    -fsdev local,id=host,path=/,security_model=none,readonly=on,multidevs=remap \
    -device virtio-9p-pci,fsdev=host,mount_tag=host \
    -fsdev "local,id=out,path=$out,security_model=none" \
    -device virtio-9p-pci,fsdev=out,mount_tag=out </dev/null || status=$?
if [ ! -f "$out/status" ]; then
    echo "run.sh: the guest did not end its job within $seconds s (qemu: $status)" >&2
    exit 4
fi
exit "$(cat "$out/status")"
