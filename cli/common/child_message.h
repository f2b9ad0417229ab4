// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <string>

#include "log/message.h"

namespace forcegrid::cli {

/// Reads a line that a child process with environment_of_child() has written.
/// @returns nothing if it is no message of the log.
std::optional<log::Message> read_child_message(const std::string& line);

}  // namespace forcegrid::cli
