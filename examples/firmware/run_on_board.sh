#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# Feels a scene through an emulated arm whose own processor, emulated too, has the force method. The
# host's loop only watches: its reports keep the motors on, and its forces are not applied.
# usage: run_on_board.sh METHOD SCENE FORCEGRID run [ARGUMENT...]     METHOD: grid, rls or kriging
set -eu
here=$(dirname "$0")
method=$1 scene=$2 program=$3
shift 2
folder=$(mktemp -d)
started=
trap 'for each in $started; do kill "$each" 2>/dev/null || true; done; rm -rf "$folder"' EXIT
trap 'exit 130' INT TERM

line() { echo "unix:$folder/$1,server=on,wait=off"; }
qemu-system-arm -M mps2-an500 -display none -monitor none -serial "$(line simulator)" \
  -serial "$(line arm)" -kernel "build/firmware/firmware_$method.elf" &
started="$started $!"
mkfifo "$folder/said"
"$program" simulate --scene "$scene" --listen 127.0.0.1:0 >"$folder/said" &
started="$started $!"
exec 3<"$folder/said"
address=
while [ -z "$address" ]; do
  if ! read -r said <&3; then
    echo "run_on_board.sh: the simulator of the device ended without saying where it listens" >&2
    exit 1
  fi
  address=$(echo "$said" | sed -n 's/^listening.* \([0-9.]*:[0-9]*\).*/\1/p')
done
cat <&3 >/dev/null &
started="$started $!"
tries=0
until [ -S "$folder/arm" ] && [ -S "$folder/simulator" ]; do
  tries=$((tries + 1))
  if [ "$tries" -gt 100 ]; then
    echo "run_on_board.sh: qemu-system-arm does not start; 'make firmware' installs it" >&2
    exit 1
  fi
  sleep 0.1
done
"$here/serial_bridge.py" "unix:$folder/simulator" "$address" &
started="$started $!"
# A push by the host's check of the motors would move nothing.
"$@" --no-motor-check --scene "$scene" --core "$folder/arm"
