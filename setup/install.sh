#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# Installs what is missing of the packages in setup/packages.txt. For Debian 12, as root or with sudo.
# usage: setup/install.sh [GROUP...]    without a group: all of them
set -eu
list=$(dirname "$0")/packages.txt
groups=$(sed -n 's/^\[\(.*\)\]$/\1/p' "$list")
for group in "$@"; do
  echo "$groups" | grep -qx "$group" || {
    echo "setup/install.sh: no group '$group' in $list; there are: $(echo $groups)" >&2
    exit 2
  }
done
wanted=$(awk -v groups="${*:-$groups}" '
  BEGIN { n = split(groups, names); for (i = 1; i <= n; ++i) in_groups[names[i]] = 1 }
  /^#/ || NF == 0 { next }
  /^\[/ { keep = substr($1, 2, length($1) - 2) in in_groups; next }
  keep { print $1 }' "$list")
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
  echo "setup/install.sh: neither root nor sudo; ask an administrator for: apt-get install$missing" >&2
  exit 1
fi
# The groups of one `make` come one after the other; one look at the archive does for all.
looked="$(dirname "$0")/../build/.archive-looked-at"
if [ -z "$(find "$looked" -mmin -60 2>/dev/null)" ]; then
  $root apt-get update -qq
  mkdir -p "${looked%/*}" && touch "$looked"
fi
# A package that this system's sources do not have: said with what it is for, before anything is
# downloaded.
absent=""
for package in $missing; do
  apt-cache policy "$package" 2>/dev/null | grep -q 'Candidate: [^(]' || {
    absent="$absent $package"
    echo "setup/install.sh: no package '$package' ($(awk -v name="$package" \
      '$1 == name { sub("^[^ ]+ +", ""); print; exit }' "$list")); this is for Debian 12 with its" \
      "main archive, see /etc/apt/sources.list" >&2
  }
done
[ -z "$absent" ] || exit 1
# shellcheck disable=SC2086
$root env DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends $missing
