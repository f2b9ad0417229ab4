// SPDX-License-Identifier: Apache-2.0
#include "firmware/on_board_method.h"
#include "forcegrid/simple/rls_method.h"

namespace forcegrid::firmware {

ForceMethod& make_method() noexcept { return *new RlsMethod; }

}  // namespace forcegrid::firmware
