#!/bin/sh
# Puts Traverse into place: programs, units, rules, man page, completions, examples.
# Usage: install.sh DESTDIR [LABDIR FLEETDIR]
# DESTDIR may be empty: then it is this system, and needs root. Nothing is started.
# LABDIR and FLEETDIR get what only the lab and the store of all arms need; without them
# that goes to DESTDIR too. MACHINE: another one than this, as `uname -m` calls it.
# The programs have an environment of their own in /usr/lib/traverse, which uses the
# system's Python and the versions of requirements.lock.
set -eu
umask 022
destdir="${1%/}"
labdir="${2:-$destdir}"
fleetdir="${3:-$destdir}"
here="$(cd "$(dirname "$0")" && pwd)"
checkout="$(cd "$here/../.." && pwd)"
pip="$checkout/.venv/bin/pip"
export PIP_QUIET=2 PIP_DISABLE_PIP_VERSION_CHECK=1
work="$checkout/build/package"
system_python="${SYSTEM_PYTHON:-/usr/bin/python3}"
machine="${MACHINE:-$(uname -m)}"
home=/usr/lib/traverse
. "$here/wheel.sh"

copy_sources --cached --others --exclude-standard
rm -rf "$work/wheel"
build_wheel "$machine"
wheel="$(ls "$work"/wheel/traverse_cmm-*.whl)"

# The environment. Its programs look for it where it will be, not where it is made.
rm -rf "$destdir$home"
"$system_python" -m venv --without-pip "$destdir$home"
python="$destdir$home/bin/python3"
site="$(echo "$destdir$home"/lib/python3*/site-packages)"
for_this_machine() { [ "$machine" = "$(uname -m)" ]; }
options="--no-compile"
if ! for_this_machine; then
    # Libraries of which there are no wheels are compiled here.
    suffix="$("$python" -c 'import sysconfig; print(sysconfig.get_config_var("EXT_SUFFIX"))' | sed "s/$(uname -m)/$machine/")"
    SETUPTOOLS_EXT_SUFFIX="$suffix" for_machine "$machine" "$pip" --python "$python" wheel --no-deps \
        --constraint "$checkout/requirements.lock" --wheel-dir "$work/wheel" cobs
    options="--target $site --only-binary :all: --find-links $work/wheel"
    for number in $(seq 17 "$(ldd --version | sed -n '1s/.*\.//p')"); do
        options="$options --platform manylinux_2_${number}_$machine"
    done
fi
add() {
    "$pip" --python "$python" install $options --constraint "$checkout/requirements.lock" "$wheel[$1]"
    [ ! -f "$site/bin/traverse" ] || mv "$site/bin/traverse" "$destdir$home/bin/"
    rm -rf "$site/bin"
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
# layer FOLDER EXTRAS: what they need more than the layers before, moved there.
layer() {
    files >"$work/before"
    add "$2"
    [ "$1" != "$destdir" ] || return 0
    mkdir -p "$1$home"
    files | comm -13 "$work/before" - | tar -C "$destdir$home" --files-from=- -cf - | tar -C "$1$home" -xf -
    files | comm -13 "$work/before" - >"$work/$(basename "$1").moved"
}
add daemon,can,modbus,gpio,page,demo,signed,live,opcua
layer "$labdir" lab,certificate,ros
layer "$fleetdir" fleet,parquet
cat "$work"/*.moved 2>/dev/null | (cd "$destdir$home" && xargs -rd '\n' rm -f)
find "$destdir$home" -type d -empty -delete
rm -f "$work"/*.moved "$site"/*.dist-info/direct_url.json
sed -i "1s|.*|#!$home/bin/python3|" "$destdir$home/bin/traverse"
sed -i '/^command = /d' "$destdir$home/pyvenv.cfg"

place() { install -D -m 644 "$checkout/deploy/$1" "${3:-$destdir}$2"; }
mkdir -p "$destdir/usr/bin"
ln -sf ../lib/traverse/bin/traverse "$destdir/usr/bin/traverse"
for unit in traverse@.service traverse-page@.service traverse-gateway@.service; do
    place "systemd/$unit" "/usr/lib/systemd/system/$unit"
done
place systemd/traverse-store@.service /usr/lib/systemd/system/traverse-store@.service "$fleetdir"
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

# Compiled parts can be loaded; those of another machine are all for it.
if for_this_machine; then
    "$python" -c 'import numpy, msgpack, pydantic, traverse.kinematics.kernel.compiled'
fi
machines="$(find "$destdir$home" "$labdir$home" "$fleetdir$home" -name '*.so*' -exec eu-readelf -h {} + | grep Machine: | sort -u)"
[ "$(echo "$machines" | wc -l)" = 1 ] || { echo "$0: compiled parts are for: $machines" >&2; exit 1; }

# What the command line says of itself, as a program of the checkout says it too.
as_installed() { env -u PYTHONPATH HOME=/nonexistent COLUMNS=400 "$@"; }
man="$destdir/usr/share/man/man1/traverse.1"
mkdir -p "${man%/*}"
as_installed "$checkout/.venv/bin/python" "$here/man_page.py" >"$man"
gzip -9nf "$man"
complete() {
    mkdir -p "$destdir$(dirname "$2")"
    as_installed "_TRAVERSE_COMPLETE=source_$1" "$checkout/.venv/bin/traverse" >"$destdir$2"
}
complete bash /usr/share/bash-completion/completions/traverse
complete zsh /usr/share/zsh/vendor-completions/_traverse
complete fish /usr/share/fish/vendor_completions.d/traverse.fish
