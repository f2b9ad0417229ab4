#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# run_fuzzers.sh BUILD_FOLDER SECONDS: every fuzzer for SECONDS, as many at once as there are cores.
set -eu
build=$1
seconds=$2
here=$(dirname "$0")
mkdir -p "$build/faults"

fuzz_one() {
  program=$1
  target=${program##*/fuzz_}
  mkdir -p "$build/corpus/$target"
  log=$build/$target.log
  dictionary=
  if [ -f "$here/$target.dict" ]; then
    dictionary=-dict=$here/$target.dict
  fi
  if "$program" -max_total_time="$seconds" -timeout=10 -rss_limit_mb=2048 -max_len=8192 \
      -print_final_stats=1 -artifact_prefix="$build/faults/$target-" $dictionary \
      "$build/corpus/$target" "$here/corpus/$target" >"$log" 2>&1; then
    runs=$(sed -n 's/^stat::number_of_executed_units: *//p' "$log")
    coverage=$(sed -n 's/.* cov: \([0-9]*\) .*/\1/p' "$log" | tail -1)
    echo "$target: no fault in $runs inputs, coverage $coverage"
  else
    echo "$target: FAULT; the input is in $build/faults, the story in $log:"
    grep -v '^#' "$log" | tail -30
    return 1
  fi
}

if [ "${3-}" ]; then
  fuzz_one "$3"
  exit
fi
ls "$build"/bin/fuzz_* | xargs -P "$(nproc)" -n 1 "$0" "$build" "$seconds"
