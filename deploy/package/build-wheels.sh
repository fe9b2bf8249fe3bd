#!/bin/sh
# Builds wheels for x86_64 and aarch64 and the source distribution into dist/.
# Usage: build-wheels.sh [FOLDER]
# One wheel an architecture serves CPython 3.11 and later, and any Linux with glibc 2.17
# and later: of which the kernel's symbols are checked here.
set -eu
here="$(cd "$(dirname "$0")" && pwd)"
checkout="$(cd "$here/../.." && pwd)"
dist="${1:-$checkout/dist}"
pip="$checkout/.venv/bin/pip"
glibc=2.17
work="$(mktemp -d)"
trap 'rm -rf "$work"' EXIT
mkdir -p "$work/source" "$dist"
# A copy of what is in the repository: nothing that was built gets in.
git -C "$checkout" ls-files -z |
    tar -C "$checkout" --null --ignore-failed-read --files-from=- -cf - | tar -C "$work/source" -xf -

for machine in x86_64 aarch64; do
    prefix="$machine-linux-gnu"
    command -v "$prefix-gcc" >/dev/null || { echo "$0: no $prefix-gcc: sh deploy/debian-packages.sh aarch64" >&2; exit 2; }
    rm -rf "$work/source/build"
    # Headers of the stable ABI are the same for both machines.
    CC="$prefix-gcc" LDSHARED="$prefix-gcc -shared -s" \
        _PYTHON_HOST_PLATFORM="manylinux_$(echo $glibc | tr . _)_$machine" \
        "$pip" wheel --quiet --no-deps --wheel-dir "$work" "$work/source"
    kernel="$(find "$work/source/build" -name 'compiled.abi3.so')"
    [ -n "$kernel" ] || { echo "$0: the kernel was not built for $machine" >&2; exit 1; }
    newest="$("$prefix-objdump" -T "$kernel" | grep -o 'GLIBC_[0-9.]*' | sed 's/GLIBC_//' | sort -uV | tail -n 1)"
    if [ "$(printf '%s\n' "$newest" $glibc | sort -V | tail -n 1)" != $glibc ]; then
        echo "$0: the kernel for $machine needs glibc $newest, more than $glibc" >&2
        exit 1
    fi
done

# The source distribution is the repository: its tests run from it, as from a clone.
wheel="$(ls "$work"/*-manylinux*_x86_64.whl)"
name="$(basename "$wheel" | cut -d - -f 1,2)"
mkdir "$work/sdist"
rm -rf "$work/source/build"
find "$work/source" -name '*.egg-info' -prune -exec rm -r {} +
find "$work/source" -name '*.so' -delete
mv "$work/source" "$work/sdist/$name"
"$checkout/.venv/bin/python" -m zipfile -e "$wheel" "$work/unpacked"
cp "$work/unpacked/$name.dist-info/METADATA" "$work/sdist/$name/PKG-INFO"
tar -C "$work/sdist" --owner=0 --group=0 --sort=name -czf "$dist/$name.tar.gz" "$name"
mv "$work"/*.whl "$dist"
ls -l "$dist"
