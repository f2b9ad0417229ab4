// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

namespace forcegrid::text {

/// Why `path` can't be read as a file: "no such file", "a folder, not a file", "a device, not a
/// file", "a pipe, not a file", "a socket, not a file", or the system's reason, e.g. "Permission
/// denied". Empty: it is a regular file. Real-time: no. Threads: any.
std::string why_no_file(const std::string& path);

}  // namespace forcegrid::text
