#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# Starts a simulator that prints "listening ... ADDR:PORT", runs forcegrid with it, and ends it.
# usage: run_with_simulator.sh "SIMULATOR [ARGUMENT...]" FORCEGRID run [ARGUMENT...]
set -eu
command=$1
shift
folder=$(mktemp -d)
simulator=
trap 'test -z "$simulator" || kill "$simulator" 2>/dev/null || true; rm -rf "$folder"' EXIT
trap 'exit 130' INT TERM
mkfifo "$folder/said"
$command >"$folder/said" &
simulator=$!
exec 3<"$folder/said"
if ! read -r said <&3; then
  echo "run_with_simulator.sh: '$command' ended without saying where it listens" >&2
  exit 1
fi
"$@" --simulator "${said##* }"
