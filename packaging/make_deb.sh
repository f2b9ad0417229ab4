#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# Packages what build/release holds: build/deb/*.deb. The version is that of CMakeLists.txt; between
# two releases it ends in the number of commits and the commit, and sorts before the next release.
# usage: packaging/make_deb.sh [VERSION]
set -eu
cd "$(dirname "$0")/.."
build=$PWD/build/release
for file in bin/forcegrid bin/forcegrid-tools bin/forcegrid-view reference/forcegrid.zsh; do
  [ -e "$build/$file" ] || {
    echo "packaging/make_deb.sh: $build/$file is missing; 'make deb' builds it first" >&2
    exit 1
  }
done
release=$(sed -n 's/^project(forcegrid VERSION \([0-9.]*\).*/\1/p' CMakeLists.txt)
version=${1:-$release}
time=$(git log -1 --format=%ct 2>/dev/null || stat -c %Y CMakeLists.txt)
if [ $# -eq 0 ] && git rev-parse HEAD >/dev/null 2>&1 &&
  ! git describe --exact-match --match "v$release" >/dev/null 2>&1; then
  version="$release~$(git rev-list --count HEAD).g$(git rev-parse --short=8 HEAD)"
fi
rm -rf build/deb
mkdir -p build/deb/stage
cp -R packaging/debian build/deb/stage/debian
cp CHANGELOG.md build/deb/stage/
cat >build/deb/stage/debian/changelog <<END
forcegrid ($version) unstable; urgency=medium

  * What changed is in CHANGELOG.md.

 -- The Forcegrid developers <developers@forcegrid.invalid>  $(date -uR -d "@$time")
END
(
  cd build/deb/stage
  FORCEGRID_BUILD=$build SOURCE_DATE_EPOCH=$time dpkg-buildpackage -b -us -uc
) >build/deb/log.txt 2>&1 || {
  tail -n 30 build/deb/log.txt >&2
  echo "packaging/make_deb.sh: no packages; all of it is in build/deb/log.txt" >&2
  exit 1
}
rm -rf build/deb/stage
ls build/deb/*.deb
