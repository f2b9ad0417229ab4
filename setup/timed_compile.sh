#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# Calls the compiler and leaves the processor time that it took beside the object, as OBJECT.times, for
# setup/build_report.py.
# usage: setup/timed_compile.sh COMPILER ARGUMENT...
"$@"
status=$?
while [ $# -gt 1 ]; do
  if [ "$1" = -o ]; then
    times >"$2.times"
    break
  fi
  shift
done
exit $status
