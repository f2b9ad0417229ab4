// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "forcegrid/core/force_method.h"
#include "forcegrid/core/method_options.h"

namespace forcegrid {
#pragma GCC visibility push(default)

/// The method that is rendered unless another one is requested.
inline constexpr char kDefaultMethod[] = "auto";

/// Names that make_force_method knows, in the order in which to present them.
const std::vector<std::string>& method_names();

/// "known methods: forcegrid, hold, ..." for messages.
std::string known_methods();

/// @throws std::invalid_argument naming `name` and the known ones unless it is one of them.
void check_method_name(const std::string& name);

/// Makes a method by its name on the command line.
/// @throws std::invalid_argument for an unknown name (listing the known ones) or unusable options.
std::unique_ptr<ForceMethod> make_force_method(const std::string& name,
                                               const MethodOptions& options);

#pragma GCC visibility pop
}  // namespace forcegrid
