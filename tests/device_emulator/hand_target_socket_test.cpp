// SPDX-License-Identifier: Apache-2.0
#include "device_emulator/hand_target_socket.h"

#include <gtest/gtest.h>
#include <sys/stat.h>

#include <array>
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <limits>
#include <string>
#include <vector>

#include "device_emulator/listen_socket.h"
#include "hand_pointer.h"
#include "rt/local_datagrams.h"

namespace forcegrid::emulator {
namespace {

using Eigen::Vector3d;
const double kNan = std::numeric_limits<double>::quiet_NaN();
const double kInfinity = std::numeric_limits<double>::infinity();

class HandTargetSocketTest : public testing::Test {
 public:
  ~HandTargetSocketTest() override { std::filesystem::remove_all(folder_); }

 protected:
  HandTargetSocketTest() {
    char folder[] = "/tmp/forcegrid_hand_XXXXXX";
    EXPECT_NE(::mkdtemp(folder), nullptr);
    folder_ = folder;
  }

  std::string path() const { return folder_ + "/hand"; }

  std::string folder_;
};

TEST_F(HandTargetSocketTest, TakesTheNewestTargetAndLetsGoOnNan) {
  HandTargetSocket socket(path());
  EXPECT_FALSE(socket.receive());
  EXPECT_FALSE(socket.target_D());
  const HandPointer pointer(path());
  pointer.send({0.01, 0.02, 0.03});
  pointer.send({-0.01, 0.0, 0.05});
  EXPECT_TRUE(socket.receive());
  EXPECT_EQ(socket.target_D(), Vector3d(-0.01, 0.0, 0.05));
  EXPECT_FALSE(socket.receive());
  EXPECT_EQ(socket.target_D(), Vector3d(-0.01, 0.0, 0.05)) << "a pointer that keeps still";
  pointer.send({kNan, kNan, kNan});
  EXPECT_TRUE(socket.receive());
  EXPECT_FALSE(socket.target_D());
  EXPECT_EQ(socket.use().taken, 3U);
  EXPECT_EQ(socket.use().malformed, 0U);
}

TEST_F(HandTargetSocketTest, GarbageIsDroppedAndCounted) {
  HandTargetSocket socket(path());
  const HandPointer pointer(path());
  pointer.send({0.01, 0.02, 0.03});
  pointer.send_bytes(0);
  pointer.send_bytes(23);
  pointer.send_bytes(25);
  pointer.send_bytes(2000);
  pointer.send({0.0, 0.0, kInfinity});
  pointer.send({0.0, kNan, 0.0});
  EXPECT_TRUE(socket.receive());
  EXPECT_EQ(socket.target_D(), Vector3d(0.01, 0.02, 0.03));
  EXPECT_EQ(socket.use().taken, 1U);
  EXPECT_EQ(socket.use().malformed, 6U);
}

TEST_F(HandTargetSocketTest, TakesAnotherHandAndSaysSo) {
  HandTargetSocket socket(path());
  EXPECT_FALSE(socket.hand());
  rt::LocalDatagrams person(folder_ + "/person");
  const auto say = [&](const std::string& text) {
    const std::vector<std::uint8_t> bytes(text.begin(), text.end());
    ASSERT_TRUE(person.send(path(), bytes));
  };
  const auto answer = [&]() -> std::string {
    std::array<std::uint8_t, 64> bytes{};
    const auto size = person.receive(bytes);
    return size < 0 ? "" : std::string(bytes.begin(), bytes.begin() + size);
  };
  for (const HandKind hand : {HandKind::kLight, HandKind::kFirm, HandKind::kArm, HandKind::kNone}) {
    const std::string text = std::string("hand ") + to_string(hand);
    say(text);
    EXPECT_TRUE(socket.receive());
    EXPECT_EQ(socket.hand(), hand);
    EXPECT_EQ(answer(), text);
  }
  for (const char* wrong : {"hand", "hand ", "hand iron", "firm", "hand firm "}) {
    say(wrong);
    EXPECT_FALSE(socket.receive()) << wrong;
    EXPECT_EQ(answer(), "") << wrong;
  }
  EXPECT_EQ(socket.hand(), HandKind::kNone);
  EXPECT_EQ(socket.use().taken, 4U);
  EXPECT_EQ(socket.use().malformed, 5U);
}

TEST_F(HandTargetSocketTest, OnlyItsUserMayPointAndItsFileIsRemovedAtTheEnd) {
  {
    const HandTargetSocket socket(path());
    struct stat status {};
    ASSERT_EQ(::stat(path().c_str(), &status), 0);
    EXPECT_EQ(status.st_mode & 0777U, 0600U);
  }
  EXPECT_FALSE(std::filesystem::exists(path()));
}

TEST_F(HandTargetSocketTest, APathThatCannotBeBoundIsAnErrorThatNamesIt) {
  const HandTargetSocket first(path());
  for (const std::string& wrong : {path(), folder_ + "/none/hand", std::string(200, 'x')}) {
    try {
      const HandTargetSocket second(wrong);
      ADD_FAILURE() << wrong;
    } catch (const EmulatorError& error) {
      EXPECT_NE(std::string(error.what()).find(wrong), std::string::npos) << error.what();
    }
  }
  EXPECT_TRUE(std::filesystem::exists(path())) << "the first one's file stays";
}

}  // namespace
}  // namespace forcegrid::emulator
