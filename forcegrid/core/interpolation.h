// SPDX-License-Identifier: Apache-2.0
#pragma once

namespace forcegrid {

/// How a grid is read. Names: trilinear, tricubic.
enum class Interpolation { kTrilinear, kTricubic };

}  // namespace forcegrid
