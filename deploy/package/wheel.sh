# To be read by install.sh and build-wheels.sh, which set `checkout`, `pip` and `work`.
# One wheel a machine serves CPython 3.11 and later, and any Linux with glibc 2.17 and
# later: of which the kernel's symbols are checked here.
glibc=2.17

# copy_sources OPTIONS...: into $work/source; nothing that was built in the checkout
# gets in. OPTIONS are those of git ls-files.
copy_sources() {
    rm -rf "$work/source"
    mkdir -p "$work/source"
    if git -C "$checkout" rev-parse --git-dir >/dev/null 2>&1; then
        git -C "$checkout" ls-files -z "$@"
    else
        (cd "$checkout" && find . -path ./build -prune -o -path './.*' -prune -o \( -type f -o -type l \) -print0)
    fi | tar -C "$checkout" --null --ignore-failed-read --files-from=- -cf - | tar -C "$work/source" -xf -
}

# for_machine MACHINE COMMAND...: with the compiler of that machine. Headers of the
# stable ABI are the same for all; Debian's Python looks for its own by the machine.
for_machine() {
    prefix="$1-linux-gnu"
    command -v "$prefix-gcc" >/dev/null || { echo "$0: no $prefix-gcc: sh deploy/debian-packages.sh aarch64" >&2; exit 2; }
    mkdir -p "$work/include"
    [ -e "$work/include/$prefix" ] || ln -s "/usr/include/$(uname -m)-linux-gnu" "$work/include/$prefix"
    shift
    CC="$prefix-gcc -idirafter $work/include" LDSHARED="$prefix-gcc -shared -s" \
        _PYTHON_HOST_PLATFORM="manylinux_$(echo $glibc | tr . _)_${prefix%%-*}" "$@"
}

# build_wheel MACHINE: of $work/source, into $work/wheel.
build_wheel() {
    rm -rf "$work/source/build"
    for_machine "$1" "$pip" wheel --quiet --no-deps --wheel-dir "$work/wheel" "$work/source"
    kernel="$(find "$work/source/build" -name 'compiled.abi3.so')"
    [ -n "$kernel" ] || { echo "$0: the kernel was not built for $1" >&2; exit 1; }
    newest="$("$1-linux-gnu-objdump" -T "$kernel" | grep -o 'GLIBC_[0-9.]*' | sed 's/GLIBC_//' | sort -uV | tail -n 1)"
    if [ "$(printf '%s\n' "$newest" $glibc | sort -V | tail -n 1)" != $glibc ]; then
        echo "$0: the kernel for $1 needs glibc $newest, more than $glibc" >&2
        exit 1
    fi
}
