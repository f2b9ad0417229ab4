#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# What deb_test.sh does in the new Debian, as its root.
set -eu
export DEBIAN_FRONTEND=noninteractive LC_ALL=C.UTF-8 HOME=/root
cd /root
fail() {
  echo "deb_test_inside.sh: $*" >&2
  exit 1
}
install() {
  apt-get install -y -qq --no-install-recommends "$@" >/root/apt.log 2>&1 || {
    cat /root/apt.log >&2
    fail "apt-get install $* failed"
  }
}
# Packages and files, except where apt, dpkg and the system keep notes of their own.
state() {
  dpkg-query -W -f='${Package} ${db:Status-Status}\n' | grep -v ' not-installed$'
  find / -xdev \( -path /proc -o -path /sys -o -path /dev -o -path /run -o -path /tmp -o -path /root \
    -o -path /var/cache -o -path /var/log -o -path /var/lib/apt -o -path /var/lib/dpkg \) -prune \
    -o -print | sort
}
now_ms() { echo $(($(date +%s%N) / 1000000)); }

state >before

begin=$(now_ms)
install ./now/forcegrid_*.deb
installed=$(now_ms)
# It is a run in real time: on a machine that stands still for 0.1 s its device counts as silent.
for attempt in 1 2 3; do
  begin_of_run=$(now_ms)
  status=0
  forcegrid run --device emulated:woodenhaptics_v2015 --scene small --seconds 5 --json=run.json \
    >run.txt 2>&1 || status=$?
  [ $status -ne 0 ] && grep -q "FAULT: The device stopped sending" run.txt || break
done
[ $status -eq 0 ] || {
  cat run.txt >&2
  fail "forcegrid run exits $status"
}
end=$(now_ms)
grep -q "first cycle is over" run.txt || fail "the run says nothing of its first cycle"
echo "deb_install_s $(((installed - begin + 500) / 1000))"
echo "deb_install_and_run_s $(((end - begin_of_run + installed - begin + 500) / 1000))"

# What a package without the tools says.
forcegrid chart accuracy >chart.txt 2>&1 && fail "a chart without forcegrid-tools"
grep -q "install the package forcegrid-tools" chart.txt || {
  cat chart.txt >&2
  fail "it does not say which package has charts"
}
install ./now/*.deb
forcegrid evaluate --help >evaluate.txt 2>&1 || fail "forcegrid evaluate --help"
python3 -c 'import forcegrid; assert "falcon" in forcegrid.profile_names(); forcegrid.Kinematics("vintage")' ||
  fail "the Python package does not work"
python3 -c 'import ctypes; ctypes.CDLL("libforcegrid-servo.so.0.2")' ||
  fail "the shared libraries do not load"
forcegrid-view --until-stdin-closes </dev/null >view.txt 2>&1 || {
  cat view.txt >&2
  fail "the live view does not start"
}
grep -q "^listening 127.0.0.1:" view.txt || fail "the live view does not listen"
[ -f /usr/lib/udev/rules.d/10-forcegrid.rules ] || fail "no udev rule"
forcegrid completion bash >completion.txt || fail "no completion"

# An upgrade keeps what people wrote.
printf '[run]\nrate = 777.0\n' >/etc/forcegrid/config.toml
mkdir -p .config/forcegrid/devices
echo "# measured" >.config/forcegrid/devices/unit.toml
install ./next/*.deb
[ "$(dpkg-query -W -f='${Version}' forcegrid)" = 99.0 ] || fail "not upgraded"
forcegrid config run.rate | grep -q 777 || fail "the upgrade lost the configuration"
[ "$(cat .config/forcegrid/devices/unit.toml)" = "# measured" ] ||
  fail "the upgrade lost a calibration"

# Removal keeps the configuration, purging leaves nothing, calibrations are the person's.
apt-get remove -y -qq forcegrid >/dev/null 2>&1
[ -f /etc/forcegrid/config.toml ] || fail "removal took the configuration"
# What removal took whole, as the libraries that need forcegrid, apt does not know any more.
# shellcheck disable=SC2046
apt-get purge -y -qq $(dpkg-query -W -f='${Package} ' '*forcegrid*') >/dev/null 2>&1
apt-get autoremove --purge -y -qq >/dev/null 2>&1
state >after
diff before after >left.txt || {
  cat left.txt >&2
  fail "purging leaves the above"
}
[ -f .config/forcegrid/devices/unit.toml ] || fail "purging took a calibration"
