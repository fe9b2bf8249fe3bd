#!/bin/sh
# Builds wheels for x86_64 and aarch64 and the source distribution into dist/.
# Usage: build-wheels.sh [FOLDER]
set -eu
here="$(cd "$(dirname "$0")" && pwd)"
checkout="$(cd "$here/../.." && pwd)"
dist="${1:-$checkout/dist}"
pip="$checkout/.venv/bin/pip"
work="$(mktemp -d)"
trap 'rm -rf "$work"' EXIT
. "$here/wheel.sh"
mkdir -p "$dist"
copy_sources
for machine in x86_64 aarch64; do
    build_wheel $machine
done

# The source distribution is the repository: its tests run from it, as from a clone.
wheel="$(ls "$work"/wheel/*-manylinux*_x86_64.whl)"
name="$(basename "$wheel" | cut -d - -f 1,2)"
mkdir "$work/sdist"
rm -rf "$work/source/build"
find "$work/source" -name '*.egg-info' -prune -exec rm -r {} +
find "$work/source" -name '*.so' -delete
mv "$work/source" "$work/sdist/$name"
"$checkout/.venv/bin/python" -m zipfile -e "$wheel" "$work/unpacked"
cp "$work/unpacked/$name.dist-info/METADATA" "$work/sdist/$name/PKG-INFO"
tar -C "$work/sdist" --owner=0 --group=0 --sort=name -czf "$dist/$name.tar.gz" "$name"
mv "$work"/wheel/*.whl "$dist"
ls -l "$dist"
