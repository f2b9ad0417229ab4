#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# Configures build/release, and turns on what it is to build besides the program. What was turned on
# before stays on.
# usage: setup/configure.sh [OPTION...]    OPTION: TOOLS, VIEW, EXAMPLES, BINDINGS, PYTHON, TESTS or BENCH
set -eu
cd "$(dirname "$0")/.."
folder=build/release
cache=$folder/CMakeCache.txt
value() { sed -n "s/^$1:[^=]*=//p" "$cache"; }
if [ -f "$cache" ]; then
  made_for=$(value CMAKE_HOME_DIRECTORY)
  if [ "$made_for" != "$PWD" ]; then
    echo "setup/configure.sh: $folder was made for the sources in $made_for, and these are in $PWD;" \
      "'make clean' removes it, then repeat the command" >&2
    exit 1
  fi
  generator=$(value CMAKE_GENERATOR)
  if [ "$generator" != Ninja ]; then
    echo "setup/configure.sh: $folder was made for the generator '$generator', and this needs Ninja;" \
      "'make clean' removes it, then repeat the command" >&2
    exit 1
  fi
fi
new=""
for option in "$@"; do
  if [ ! -f "$cache" ] || [ "$(value "FORCEGRID_BUILD_$option")" != ON ]; then
    new="$new -DFORCEGRID_BUILD_$option=ON"
  fi
done
# build.ninja is missing after a configuration that failed.
if [ -n "$new" ] || [ ! -f $folder/build.ninja ] || [ CMakePresets.json -nt $folder/build.ninja ]; then
  # shellcheck disable=SC2086
  cmake --preset release $new
fi
