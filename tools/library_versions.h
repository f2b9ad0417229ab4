#pragma once

#include <string>
#include <utility>
#include <vector>

namespace forcegrid::tools {

/// A part that the program stands on, and its version.
struct PartVersion {
  std::string name;     ///< "libusb"
  std::string version;  ///< "1.0.26"
  bool loaded = true;   ///< asked of the library that this process loaded; false: compiled in
};

/// The libraries in use, the compiler and the kernel: those that are loaded first. What is part of
/// the program itself (headers) has the version that it was compiled with.
/// Real-time: no. Threads: any.
std::vector<PartVersion> library_versions();

}  // namespace forcegrid::tools
