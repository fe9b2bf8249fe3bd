# Installs the package in the guest, has it checked, and takes it away again.
# What it leaves in $TRAVERSE_VM_OUT is read outside.
out="$TRAVERSE_VM_OUT"
here=/opt/check/tests/vm/system
doc=/usr/share/doc/traverse/examples
export PYTHONPATH=/opt/check
echo "$(cut -d' ' -f1 /proc/uptime) s: Debian $(cat /etc/debian_version) is up, PID 1 is $(cat /proc/1/comm)"

# Everything on the disk, to be compared with what is there after the removal.
files() { find / -xdev \( -path /tmp -o -path /var/log -o -path /var/lib/dpkg/info \) -prune -o -print | sort; }
files >/run/before
dpkg -i "$out/traverse.deb" >/run/installed 2>&1 || cat /run/installed
echo "$(cut -d' ' -f1 /proc/uptime) s: the package is installed"

# As an administrator would, from the examples of the package.
cp $doc/networkd/80-vcan0.* /etc/systemd/network/
systemctl --quiet enable --now systemd-networkd
/usr/lib/traverse/bin/python3 -m tests.vm.system.preparation
systemctl restart mosquitto arm-simulator
systemctl --quiet enable traverse@bench-7
/usr/lib/traverse/bin/python3 -m tests.vm.system
echo $? >/run/status

cp -r /var/lib/traverse "$out/state" 2>/dev/null
journalctl --no-pager --output=short-precise >"$out/journal.txt"
cp /var/log/mosquitto/mosquitto.log "$out/" 2>/dev/null
systemctl --quiet stop arm-simulator mosquitto
rm -rf /etc/udev/rules.d/71-check.rules /etc/systemd/network/80-vcan0.* /etc/mosquitto/conf.d/traverse.conf \
    /etc/mosquitto/traverse.* /etc/systemd/system/arm-simulator.service /srv/arm
systemctl daemon-reload
systemctl --quiet disable --now systemd-networkd
export PYTHONDONTWRITEBYTECODE=1
/usr/bin/python3 -m tests.vm.system.removal
[ $? = 0 ] || echo 1 >/run/status
cat "$out/table.txt"
cp /run/status "$out/status"
sync
