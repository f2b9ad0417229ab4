// SPDX-License-Identifier: Apache-2.0
#include "driver/node_lock.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <string>

#include "driver/device.h"

namespace forcegrid::driver {
namespace {

using testing::HasSubstr;

// A lock is the same on a file as on a device node.
class NodeLockTest : public testing::Test {
 public:
  ~NodeLockTest() override { std::filesystem::remove(node_); }

 protected:
  NodeLockTest() { std::ofstream(node_) << "node"; }

  static std::string error_of(const std::string& node, bool share = false) {
    try {
      const NodeLock lock(node, share);
    } catch (const DeviceError& error) {
      return error.what();
    }
    return "locked";
  }

  const std::string node_ = testing::TempDir() + "forcegrid_node_" + std::to_string(::getpid());
};

TEST_F(NodeLockTest, RefusesASecondHolderUntilTheFirstIsGone) {
  {
    const NodeLock first(node_);
    EXPECT_THAT(error_of(node_), HasSubstr("open " + node_ + ": another program drives this"));
    EXPECT_NE(error_of(node_, true), "locked");  // two loops never share
  }
  EXPECT_EQ(error_of(node_), "locked");
}

TEST_F(NodeLockTest, NamesANodeThatIsNotThere) {
  EXPECT_THAT(error_of(node_ + "0"), HasSubstr("No such file or directory; plug the device in"));
}

}  // namespace
}  // namespace forcegrid::driver
