// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

namespace forcegrid::view {

/// A new folder that only this account may enter, in $XDG_RUNTIME_DIR or else in /tmp. It is
/// removed with all that is in it. Real-time: no. Threads: one.
class PrivateFolder {
 public:
  /// @throws ViewError naming the folder and the system's reason.
  PrivateFolder();
  ~PrivateFolder();
  PrivateFolder(const PrivateFolder&) = delete;
  PrivateFolder& operator=(const PrivateFolder&) = delete;

  const std::string& path() const noexcept { return path_; }

 private:
  std::string path_;
};

}  // namespace forcegrid::view
