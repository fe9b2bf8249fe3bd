#!/bin/sh
# Runs a command of the checkout in a virtual machine with Debian's stock kernel.
# Usage: run.sh SECONDS COMMAND...
# The guest sees the files of this machine, read-only below a layer of memory, has no
# network, and is emulated whole, without KVM. OUT is a folder that both can write to;
# the command finds it in the variable TRAVERSE_VM_OUT. The exit status is the
# command's, or 4 if it has not ended in time.
set -eu
limit_s="$1"
shift
here="$(cd "$(dirname "$0")" && pwd)"
. "$here/kernel.sh"
case "$checkout/" in
/tmp/* | /run/* | /mnt/* | /dev/shm/*)
    echo "run.sh: the guest has an empty ${checkout%"${checkout#/*/}"} of its own and does not see $checkout; move the checkout elsewhere" >&2
    exit 2
    ;;
esac
out="$build/out"
rm -rf "$out"
mkdir -p "$out"

quoted() { for word in "$@"; do printf "'%s' " "$(printf %s "$word" | sed "s/'/'\\\\''/g")"; done; }
cat >"$build/job" <<JOB
export PATH=/usr/local/sbin:/usr/local/bin:/usr/sbin:/usr/bin:/sbin:/bin HOME=/tmp
export TRAVERSE_VM_OUT=/mnt/out OPENBLAS_NUM_THREADS=1 PYTHONDONTWRITEBYTECODE=1
cd $(quoted "$checkout") && exec $(quoted "$@")
JOB
pack_initial "$build/initial.gz" "$here/init" "$here/modules.txt" "$build/job"

status=0
emulate "$limit_s" -initrd "$build/initial.gz" \
    -append "console=ttyS0 quiet panic=-1" \
    -fsdev local,id=host,path=/,security_model=none,readonly=on,multidevs=remap \
    -device virtio-9p-pci,fsdev=host,mount_tag=host \
    -fsdev "local,id=out,path=$out,security_model=none" \
    -device virtio-9p-pci,fsdev=out,mount_tag=out || status=$?
if [ ! -f "$out/status" ]; then
    echo "run.sh: the guest did not end its job within $limit_s s (qemu: $status)" >&2
    exit 4
fi
exit "$(cat "$out/status")"
