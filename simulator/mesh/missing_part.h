// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "simulator/mesh/error.h"

namespace forcegrid::simulator {

/// make_scene()'s Error where what the scene needs is not on this machine: its mesh file, or the
/// library that reads it.
class MissingPart : public Error {
 public:
  using Error::Error;
};

}  // namespace forcegrid::simulator
