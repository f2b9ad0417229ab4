// SPDX-License-Identifier: Apache-2.0
#include "view/storage_blocks.h"

#include <algorithm>
#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "forcegrid/core/storage_blocks.h"
#include "view/messages.h"
#include "view_link/little_endian.h"

namespace forcegrid::view {

view_link::Bytes blocks_message(const MethodCopies& copies) {
  std::vector<StorageBlock> boxes(kMostBlocks);
  view_link::Bytes body;
  std::size_t sent = 0;
  std::size_t in_use = 0;
  for (std::size_t method = 0; method < copies.size(); ++method) {
    const std::span<StorageBlock> room(boxes.data(), kMostBlocks - sent);
    const std::size_t count = copies.storage_blocks(method, room);
    in_use += count;
    for (const StorageBlock& box : room.first(std::min(count, room.size()))) {
      view_link::append(body, static_cast<std::uint32_t>(method));
      for (const Eigen::Vector3d& corner_W : {box.low_W, box.high_W}) {
        view_link::append(
            body, std::array{narrow(corner_W.x()), narrow(corner_W.y()), narrow(corner_W.z())});
      }
      ++sent;
    }
  }
  view_link::Bytes bytes = message_head(PageType::kBlocks, 0);
  bytes.resize(2);
  view_link::append(bytes, static_cast<std::uint16_t>(sent));
  view_link::append(bytes, static_cast<std::uint32_t>(in_use));
  view_link::append(bytes, std::span<const std::uint8_t>(body));
  return bytes;
}

}  // namespace forcegrid::view
