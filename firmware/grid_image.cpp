// SPDX-License-Identifier: Apache-2.0
#include <memory>

#include "firmware/board.h"
#include "firmware/on_board_method.h"
#include "firmware/profile.h"
#include "firmware/small_grid.h"
#include "forcegrid/grid/grid_instances.h"

namespace forcegrid::firmware {

ForceMethod& make_method() noexcept {
  ForceMethod* const method = make_half_block_grid(small_grid(kLimits)).release();
  if (method == nullptr) {
    stop_device();
  }
  return *method;
}

}  // namespace forcegrid::firmware
