// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

namespace forcegrid::driver {

/// Keeps a device node to one program at a time while it lives: the kernel lets any number open a
/// hidraw node, and two loops would push the same motors. The lock is advisory (flock); it holds
/// among programs that use this class, and it ends with the process whatever happens to that.
class NodeLock {
 public:
  /// @throws DeviceError when the node cannot be opened, or another program holds it.
  explicit NodeLock(const std::string& node);
  ~NodeLock();
  NodeLock(const NodeLock&) = delete;
  NodeLock& operator=(const NodeLock&) = delete;

 private:
  int descriptor_ = -1;
};

}  // namespace forcegrid::driver
