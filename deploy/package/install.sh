#!/bin/sh
# Puts Traverse into place: programs, unit, rules, man page, completions, examples.
# Usage: install.sh DESTDIR [LABDIR]
# DESTDIR may be empty: then it is this system, and needs root. Nothing is started.
# LABDIR gets the libraries that only the lab needs; without it they go to DESTDIR too.
# The programs have an environment of their own in /usr/lib/traverse, which uses the
# system's Python and the versions of requirements.lock.
set -eu
umask 022
destdir="${1%/}"
here="$(cd "$(dirname "$0")" && pwd)"
checkout="$(cd "$here/../.." && pwd)"
pip="$checkout/.venv/bin/pip"
export PIP_QUIET=2 PIP_DISABLE_PIP_VERSION_CHECK=1
work="$checkout/build/package"
system_python="${SYSTEM_PYTHON:-/usr/bin/python3}"
home=/usr/lib/traverse
extras="daemon,can,modbus,gpio,page,demo"
lab="${2:+${2%/}}"

# A copy of the sources: what an earlier build left in the checkout does not get in.
rm -rf "$work/source"
mkdir -p "$work/source" "$work/wheel"
if git -C "$checkout" rev-parse --git-dir >/dev/null 2>&1; then
    git -C "$checkout" ls-files -z --cached --others --exclude-standard
else
    cd "$checkout" && find . -path ./build -prune -o -path './.*' -prune -o \( -type f -o -type l \) -print0
fi | tar -C "$checkout" --null --ignore-failed-read --files-from=- -cf - | tar -C "$work/source" -xf -
rm -f "$work"/wheel/*
"$pip" wheel --no-deps --wheel-dir "$work/wheel" "$work/source"
wheel="$(ls "$work"/wheel/traverse_cmm-*.whl)"

# The environment. Its programs look for it where it will be, not where it is made.
rm -rf "$destdir/usr/lib/traverse"
"$system_python" -m venv --without-pip "$destdir$home"
site=""
add() {
    "$pip" --python "$destdir$home/bin/python3" install --no-compile \
        --constraint "$checkout/requirements.lock" "$wheel[$1]"
    site="$(echo "$destdir$home"/lib/python3*/site-packages)"
    find "$destdir$home/bin" ! -type d ! -name 'python*' ! -name traverse -delete
    find "$destdir$home" -mindepth 1 -maxdepth 1 ! -name bin ! -name 'lib*' ! -name pyvenv.cfg -exec rm -r {} +
    find "$site" -type d -name tests -prune -exec rm -r {} +
    find "$site" -name "*.py" -type f -exec chmod 644 {} +
    # Libraries are loaded, not run. binutils' strip breaks those that were patched for a
    # wheel; elfutils' leaves their segments where they are.
    find "$site" -name '*.so*' -type f -exec eu-strip {} \; -exec chmod 644 {} \;
    "$system_python" -m compileall -q -j 2 --invalidation-mode unchecked-hash -s "$destdir" -p / "$site"
}
files() { (cd "$destdir$home" && find . ! -type d | sort); }
add "$extras"
files >"$work/base"
add lab
if [ -n "$lab" ]; then
    mkdir -p "$lab$home"
    files | comm -13 "$work/base" - |
        tar -C "$destdir$home" --remove-files --files-from=- -cf - | tar -C "$lab$home" -xf -
    find "$destdir$home" -type d -empty -delete
fi
rm -f "$site"/*.dist-info/direct_url.json
sed -i "1s|.*|#!$home/bin/python3|" "$destdir$home/bin/traverse"
sed -i '/^command = /d' "$destdir$home/pyvenv.cfg"

place() { install -D -m 644 "$checkout/deploy/$1" "$destdir$2"; }
mkdir -p "$destdir/usr/bin"
ln -sf ../lib/traverse/bin/traverse "$destdir/usr/bin/traverse"
for unit in traverse@.service traverse-page@.service traverse-gateway@.service; do
    place "systemd/$unit" "/usr/lib/systemd/system/$unit"
done
place systemd/traverse.sysusers /usr/lib/sysusers.d/traverse.conf
place systemd/traverse.tmpfiles /usr/lib/tmpfiles.d/traverse.conf
place udev/70-traverse.rules /usr/lib/udev/rules.d/70-traverse.rules
place systemd/environment /etc/traverse/environment
for file in systemd/journald.conf networkd/80-can0.network networkd/80-vcan0.netdev \
    networkd/80-vcan0.network mosquitto/traverse.conf mosquitto/acl; do
    [ ! -f "$checkout/deploy/$file" ] || place "$file" "/usr/share/doc/traverse/examples/$file"
done
for file in examples/traverse.toml examples/simulator.toml; do
    place "package/$file" "/usr/share/doc/traverse/$file"
done
install -m 644 "$checkout/cli/demo_data/arm.toml" "$destdir/usr/share/doc/traverse/examples/arm.toml"
(cd "$checkout" && find docs -name '*.md' -exec install -D -m 644 {} "$destdir/usr/share/doc/traverse/{}" \;)
install -D -m 644 -t "$destdir/usr/share/doc/traverse/file-schemas" "$checkout"/docs/reference/file-schemas/*.json
install -m 644 "$checkout/LICENSE" "$checkout/CHANGELOG.md" "$destdir/usr/share/doc/traverse/"

# Compiled parts can be loaded.
"$destdir$home/bin/python3" -c 'import numpy, msgpack, pydantic, traverse.kinematics.kernel.compiled'

# What the command line says of itself.
as_installed() { env -u PYTHONPATH HOME=/nonexistent COLUMNS=400 "$@"; }
python="$destdir$home/bin/python3"
man="$destdir/usr/share/man/man1/traverse.1"
mkdir -p "${man%/*}"
as_installed "$python" "$here/man_page.py" >"$man"
gzip -9nf "$man"
complete() {
    mkdir -p "$destdir$(dirname "$2")"
    as_installed "_TRAVERSE_COMPLETE=source_$1" "$python" "$destdir$home/bin/traverse" >"$destdir$2"
}
complete bash /usr/share/bash-completion/completions/traverse
complete zsh /usr/share/zsh/vendor-completions/_traverse
complete fish /usr/share/fish/vendor_completions.d/traverse.fish
