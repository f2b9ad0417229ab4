// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <fcntl.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <cerrno>
#include <cstring>
#include <string>

namespace forcegrid::hil {

/// A device node that this process has open, as somebody else's program would.
class OpenNode {
 public:
  explicit OpenNode(const std::string& node)
      : descriptor_(::open(node.c_str(), O_RDWR | O_CLOEXEC)) {
    EXPECT_GE(descriptor_, 0) << node << ": " << std::strerror(errno);
  }
  ~OpenNode() { ::close(descriptor_); }
  OpenNode(const OpenNode&) = delete;
  OpenNode& operator=(const OpenNode&) = delete;
  int get() const { return descriptor_; }

 private:
  int descriptor_;
};

}  // namespace forcegrid::hil
