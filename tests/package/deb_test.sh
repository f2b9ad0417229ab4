#!/bin/bash
# SPDX-License-Identifier: Apache-2.0
# Tries build/deb/*.deb in a new, minimal Debian 12: installs and uses them, upgrades them, removes
# them. Prints how long the way from `apt install` to the end of the first run took, which is for
# people: nothing depends on it. As root, with the package archive that this machine uses.
set -euo pipefail
cd "$(dirname "$0")/../.."
here=$PWD/tests/package
fail() {
  echo "deb_test.sh: $*" >&2
  exit 1
}
[ "$(id -u)" -eq 0 ] || fail "only root can make a new Debian; call it with sudo"
shopt -s nullglob
debs=(build/deb/*.deb)
[ ${#debs[@]} -eq 10 ] || fail "ten packages expected in build/deb; 'make deb' makes them"

lintian --fail-on error,warning build/deb/*.changes || fail "lintian has findings, see above"
if grep "dpkg-shlibdeps: warning" build/deb/log.txt; then
  fail "a program is linked with a library that it does not use, see above"
fi
for library in libgmsh libbullet; do
  ! dpkg-deb -f build/deb/forcegrid_*.deb Depends | grep -q $library ||
    fail "the package forcegrid depends on $library"
done

for library in libusb libhidapi libspdlog "forcegrid "; do
  ! dpkg-deb -f build/deb/libforcegrid-methods0.2_*.deb Depends | grep -q "$library" ||
    fail "the package of the force methods depends on $library"
done

work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
mkdir -p "$work/now" "$work/next"
cp "${debs[@]}" "$work/now/"
# The same packages as a later version.
for deb in "${debs[@]}"; do
  dpkg-deb -R "$deb" "$work/unpacked"
  version=$(dpkg-deb -f "$deb" Version)
  sed -i "s/$version/99.0/g" "$work/unpacked/DEBIAN/control"
  name=$(basename "$deb")
  dpkg-deb -b "$work/unpacked" "$work/next/${name%%_*}_99.0_all.deb" >/dev/null
  rm -r "$work/unpacked"
done

# Debian's own sources of this machine, and its settings of apt.
sources=()
for file in /etc/apt/sources.list /etc/apt/sources.list.d/*; do
  grep -qE '(debian\.org|/debian)' "$file" 2>/dev/null && sources+=("$file")
done
[ ${#sources[@]} -gt 0 ] || fail "no Debian archive in /etc/apt/sources.list*"
settings=()
for file in /etc/apt/apt.conf /etc/apt/apt.conf.d/*proxy*; do
  [ -f "$file" ] && settings+=("--aptopt=$file")
done
mmdebstrap --quiet --variant=apt --format=null "${settings[@]}" \
  --customize-hook="copy-in $work/now $work/next $here/deb_test_inside.sh /root" \
  --customize-hook='chroot "$1" sh /root/deb_test_inside.sh' \
  bookworm /dev/null "${sources[@]}" || fail "see above"
echo "deb_test.sh: installed, used, upgraded and removed"
