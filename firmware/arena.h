// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>

namespace forcegrid::firmware {

/// The memory that `new` gives out: a static array of FORCEGRID_ARENA_BYTES, set for each image.
/// What is given out is never taken back. After seal_arena() there is none, and whoever asks stops
/// the device (stop_device()), unless with std::nothrow: that gets null.

/// From now on nothing is given out. Call it when all methods have been made.
void seal_arena() noexcept;
/// Bytes given out, with what alignment took.
std::size_t arena_bytes_used() noexcept;

}  // namespace forcegrid::firmware
