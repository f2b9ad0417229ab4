// SPDX-License-Identifier: Apache-2.0
// One libFuzzer program a target: FUZZ_TARGET names it.
#include "tests/fuzz/fuzz_targets.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  forcegrid::fuzz::FUZZ_TARGET({data, size});
  return 0;
}
