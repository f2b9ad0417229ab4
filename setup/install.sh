#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# Installs the packages of setup/packages.txt that are missing. For Debian 12, as root or with sudo.
set -eu
list=$(dirname "$0")/packages.txt
wanted=$(sed -e 's/#.*//' "$list" | tr '\n' ' ')
missing=""
for package in $wanted; do
  dpkg-query -W -f='${db:Status-Status}' "$package" 2>/dev/null | grep -qx installed ||
    missing="$missing $package"
done
[ -n "$missing" ] || exit 0
echo "Installing:$missing"
if [ "$(id -u)" -eq 0 ]; then
  root=""
elif command -v sudo >/dev/null; then
  root="sudo"
else
  echo "setup/install.sh: these packages are missing, and there is neither root nor sudo to install them:$missing" >&2
  echo "Ask an administrator to run: apt-get install$missing" >&2
  exit 1
fi
$root apt-get update -qq
# shellcheck disable=SC2086
$root env DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends $missing
