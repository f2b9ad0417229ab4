// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>

#include "view/method_copies.h"
#include "view_link/frame.h"

namespace forcegrid::view {

/// More blocks of all methods together are counted, but not sent.
inline constexpr std::size_t kMostBlocks = 2048;

/// The binary message 7 of docs/view_protocol.md: the blocks of storage that the copies of the
/// methods have in use. Real-time: no.
view_link::Bytes blocks_message(const MethodCopies& copies);

}  // namespace forcegrid::view
