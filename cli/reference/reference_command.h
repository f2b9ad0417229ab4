// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>
#include <string>

#include "cli/common/options.h"

namespace forcegrid::cli {

struct ReferenceOptions {
  std::string shell;
  std::string folder;
};

/// Adds `completion SHELL` and `man-pages DIR`, which write what the option tables of all of
/// `program`'s commands say. Both objects outlive the program.
void add_reference(Command& program, ReferenceOptions& options, std::function<int()>& action);

}  // namespace forcegrid::cli
