// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "forcegrid/core/force_method.h"

namespace forcegrid::firmware {

/// The force method of this image: grid_image.cpp, rls_image.cpp or kriging_image.cpp. It lives in
/// the arena. Call it once, at start. Stops the device if the arena is too small.
ForceMethod& make_method() noexcept;

}  // namespace forcegrid::firmware
