// SPDX-License-Identifier: Apache-2.0
#include "simulator/control_socket.h"

#include <gtest/gtest.h>

#include <array>
#include <bit>
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <limits>
#include <string>

namespace forcegrid::simulator {
namespace {

constexpr double kSame = std::numeric_limits<double>::quiet_NaN();
constexpr double kNone = std::numeric_limits<double>::infinity();

// As docs/view_protocol.md has it.
struct Datagram {
  std::uint64_t number;
  std::array<double, 6> value;  // rate Hz, delay ms, jitter ms, loss %, wall mm, cut
};

class ControlSocketTest : public testing::Test {
 public:
  ~ControlSocketTest() override { std::filesystem::remove_all(folder_); }

 protected:
  ControlSocketTest() {
    char folder[] = "/tmp/forcegrid_control_XXXXXX";
    EXPECT_NE(::mkdtemp(folder), nullptr);
    folder_ = folder;
  }

  // What the simulator answers; its number is 0 if nothing comes.
  Datagram ask(const Datagram& datagram) {
    const auto bytes = std::bit_cast<std::array<std::uint8_t, sizeof datagram>>(datagram);
    EXPECT_TRUE(person_->send(folder_ + "/simulator", bytes));
    changes_ = socket_->receive(controls_);
    std::array<std::uint8_t, sizeof datagram> answer{};
    return person_->receive(answer) == static_cast<ssize_t>(sizeof datagram)
               ? std::bit_cast<Datagram>(answer)
               : Datagram{};
  }

  void start() {
    socket_.emplace(folder_ + "/simulator",
                    [this](const SimulatorControls& wanted) { return admits_ || !wanted.cut; });
    person_.emplace(folder_ + "/person");
  }

  std::string folder_;
  SimulatorControls controls_;
  std::size_t changes_ = 0;
  bool admits_ = true;
  std::optional<ControlSocket> socket_;
  std::optional<rt::LocalDatagrams> person_;
};

TEST_F(ControlSocketTest, TakesWhatIsGivenAndAnswersWhatHolds) {
  start();
  const Datagram answer = ask({5, {10.0, 20.0, kSame, 25.0, 14.0, kSame}});
  EXPECT_EQ(changes_, 4U) << "rate, delay, loss and wall";
  EXPECT_EQ(answer.number, 5U);
  EXPECT_EQ(answer.value, (std::array<double, 6>{10.0, 20.0, 0.0, 25.0, 14.0, 0.0}));
  EXPECT_EQ(controls_.rate_Hz, 10.0);
  EXPECT_EQ(controls_.link.delay_s, 0.020);
  EXPECT_EQ(controls_.link.loss, 0.25);
  EXPECT_EQ(controls_.wall_m, 0.014);
  EXPECT_EQ(ask({6, {kSame, kSame, kSame, kSame, kNone, 1.0}}).value[4], kNone);
  EXPECT_TRUE(std::isinf(controls_.wall_m));
  EXPECT_TRUE(controls_.cut);
}

TEST_F(ControlSocketTest, CountsEachChangeOfThoseThatCameTogether) {
  start();
  const auto send = [this](const std::array<double, 6>& value) {
    const auto bytes =
        std::bit_cast<std::array<std::uint8_t, sizeof(Datagram)>>(Datagram{1, value});
    ASSERT_TRUE(person_->send(folder_ + "/simulator", bytes));
  };
  send({10.0, 20.0, kSame, kSame, kSame, kSame});     // 2
  send({10.0, kSame, kSame, kSame, kSame, kSame});    // it is so already
  send({kSame, 30.0, kSame, kSame, kSame, 1.0});      // 2
  send({2000.0, kSame, kSame, kSame, kSame, kSame});  // out of range
  send({kSame, 20.0, kSame, kSame, kNone, 0.0});      // 2, back again; there is no wall
  EXPECT_EQ(socket_->receive(controls_), 6U);
  EXPECT_EQ(controls_.rate_Hz, 10.0);
  EXPECT_EQ(controls_.link.delay_s, 0.020);
  EXPECT_FALSE(controls_.cut);
  EXPECT_EQ(socket_->receive(controls_), 0U);
}

TEST_F(ControlSocketTest, ChangesNothingForWhatIsOutOfRangeOrNotAdmitted) {
  start();
  for (const Datagram& wrong : {Datagram{1, {0.0, 20.0, kSame, kSame, kSame, kSame}},
                                Datagram{1, {1001.0, 20.0, kSame, kSame, kSame, kSame}},
                                Datagram{1, {10.0, -1.0, kSame, kSame, kSame, kSame}},
                                Datagram{1, {10.0, kSame, kSame, 101.0, kSame, kSame}}}) {
    const Datagram answer = ask(wrong);
    EXPECT_EQ(changes_, 0U);
    EXPECT_EQ(answer.number, 1U);
    EXPECT_EQ(answer.value[0], 30.0);
    EXPECT_EQ(answer.value[1], 0.0);
  }
  admits_ = false;
  EXPECT_EQ(ask({2, {10.0, kSame, kSame, kSame, kSame, 1.0}}).value[0], 30.0);
  EXPECT_EQ(changes_, 0U);
}

TEST_F(ControlSocketTest, DropsWhatIsNoDatagramOfIts) {
  start();
  for (const std::size_t size : {0U, 55U, 57U, 2000U}) {
    const std::vector<std::uint8_t> bytes(size, 1);
    ASSERT_TRUE(person_->send(folder_ + "/simulator", bytes));
    EXPECT_EQ(socket_->receive(controls_), 0U) << size;
    std::array<std::uint8_t, 64> answer{};
    EXPECT_EQ(person_->receive(answer), -1) << size;
  }
  EXPECT_EQ(controls_.rate_Hz, 30.0);
}

}  // namespace
}  // namespace forcegrid::simulator
