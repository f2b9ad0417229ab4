// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "forcegrid/core/method_options.h"
#include "forcegrid/core/pair_force_method.h"

namespace forcegrid {
#pragma GCC visibility push(default)

/// Names of the methods over the positions of two tools, in the order in which to present them.
const std::vector<std::string>& pair_method_names();

/// Whether `name` is one of them. Any other method is of one tool.
bool is_pair_method(const std::string& name);

/// "known methods: ...", those of two tools first, for messages.
std::string known_pair_methods();

/// @throws std::invalid_argument naming `name` and the known ones unless it is a pair method or a
/// method of one tool.
void check_pair_method_name(const std::string& name);

/// Makes the method for two tools: the pair method of this name, or for a method of one tool an
/// UncoupledPair of two.
/// @throws std::invalid_argument for an unknown name, unusable options, or a method of one tool
/// that needs requests, or stiffness, which not all samples of two tools have.
std::unique_ptr<PairForceMethod> make_pair_force_method(const std::string& name,
                                                        const MethodOptions& options);

#pragma GCC visibility pop
}  // namespace forcegrid
