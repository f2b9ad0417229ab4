// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

namespace forcegrid::view {

/// Prints "forcegrid-view: TEXT" on standard error. At most 20 lines a second, so that peers cannot
/// fill a disk; the next line says how many were left out. Control characters become '?'.
/// Real-time: no. Threads: one.
void log_line(const std::string& text);

}  // namespace forcegrid::view
