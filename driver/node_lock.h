// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>
#include <string>

namespace forcegrid::driver {

/// Keeps a device node to one program at a time while it lives: the kernel lets any number open a
/// hidraw node, and two loops would push the same motors. The lock is advisory (flock); it holds
/// among programs that use this class, and it ends with the process whatever happens to that. Of
/// other programs the constructor looks who has the node open.
class NodeLock {
 public:
  /// @param share   a program that has the node open without a lock is no obstacle.
  /// @param notice  gets a sentence when it can't be seen who has the node open. May be empty.
  /// @throws DeviceError when the node cannot be opened, when another program holds the lock, or
  ///         has the node open; it names the process where that can be seen.
  explicit NodeLock(const std::string& node, bool share = false,
                    const std::function<void(const std::string&)>& notice = {});
  ~NodeLock();
  NodeLock(const NodeLock&) = delete;
  NodeLock& operator=(const NodeLock&) = delete;

 private:
  int descriptor_ = -1;
};

}  // namespace forcegrid::driver
