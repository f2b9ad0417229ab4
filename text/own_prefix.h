// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

namespace forcegrid::text {

/// The folder that the shared library or program with this code was installed to: what stands
/// before its last folder named bin, lib or lib64, e.g. /usr of /usr/lib/python3/x.so; empty if it
/// is in none. Real-time: no. Threads: any.
std::string own_prefix();

/// The shared library or program with this code, an absolute path. Real-time: no. Threads: any.
std::string own_file();

}  // namespace forcegrid::text
