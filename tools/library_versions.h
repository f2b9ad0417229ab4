// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <utility>
#include <vector>

namespace forcegrid::tools {

/// A component that the program depends on, and its version.
struct PartVersion {
  std::string name;     ///< "libusb"
  std::string version;  ///< "1.0.26"
  /// Version of the library that this process loaded; false: of the one compiled in.
  bool loaded = true;
};

/// Returns the libraries in use, the compiler and the kernel; loaded libraries come first.
/// Header-only libraries have the version that the program was compiled with.
/// Real-time: no. Threads: any.
std::vector<PartVersion> library_versions();

}  // namespace forcegrid::tools
