# To be read by other scripts of this folder: sets `build`, `checkout` and `kernel`,
# the folder of Debian's kernel. It is fetched as a package and unpacked, not installed.
checkout="$(cd "$here/../.." && pwd)"
build="$checkout/build/vm"
mkdir -p "$build"
image="$(apt-cache depends linux-image-amd64 | sed -n 's/.*Depends: \(linux-image-[0-9][^ ]*\)$/\1/p' | head -n 1)"
if [ -z "$image" ]; then
    echo "apt knows no package linux-image-amd64; this needs Debian on amd64, after apt-get update" >&2
    exit 2
fi
kernel="$build/$image"
if [ ! -d "$kernel" ]; then
    (cd "$build" && apt-get download -qq "$image")
    dpkg-deb -x "$build/$image"_*.deb "$kernel.part"
    mv "$kernel.part" "$kernel"
    rm "$build/$image"_*.deb
fi

# Packs a first file system: pack_initial FILE INIT MODULES [JOB].
pack_initial() {
    rm -rf "$build/initial"
    mkdir -p "$build/initial/bin" "$build/initial/modules"
    cp "$(command -v busybox)" "$build/initial/bin/busybox"
    install -m 755 "$2" "$build/initial/init"
    cp "$3" "$build/initial/modules/list"
    while read -r module; do
        cp "$kernel"/lib/modules/*/kernel/"$module.ko" "$build/initial/modules/"
    done <"$3"
    [ -z "${4:-}" ] || cp "$4" "$build/initial/job"
    (cd "$build/initial" && find . | busybox cpio -o -H newc 2>/dev/null | gzip -1) >"$1"
}

# The emulated computer: emulate SECONDS OPTION...; everything is emulated, without KVM.
emulate() {
    seconds="$1"
    shift
    timeout --foreground "$seconds" qemu-system-x86_64 \
        -machine q35 -accel tcg,thread=multi -cpu max -smp 2 -m 1024 \
        -nodefaults -no-user-config -display none -serial stdio -no-reboot -nic none \
        -kernel "$kernel"/boot/vmlinuz-* "$@" </dev/null
}
