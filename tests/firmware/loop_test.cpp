// SPDX-License-Identifier: Apache-2.0
// examples/firmware/main.cpp on an emulated Cortex-M7, between an arm and a simulator that this
// test plays at the other ends of its serial lines. The datagrams are read and written by link/.
#include <gtest/gtest.h>
#include <poll.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstring>
#include <filesystem>
#include <memory>
#include <numbers>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "driver/kinematics.h"
#include "examples/firmware/arm_link.h"
#include "examples/firmware/serial_frames.h"
#include "forcegrid/core/force_method.h"
#include "link/wire.h"
#include "profiles/device_profile.h"
#include "tests/support/program.h"

namespace forcegrid::firmware {
namespace {

using std::chrono::milliseconds;
using Clock = std::chrono::steady_clock;

std::string image_of(const std::string& method) {
  return FORCEGRID_SOURCE_DIR "/build/firmware/firmware_" + method + ".elf";
}

/// A serial line of the emulator, a socket of the file system.
class SerialLine {
 public:
  explicit SerialLine(const std::string& file) : socket_(socket(AF_UNIX, SOCK_STREAM, 0)) {
    sockaddr_un address{};
    address.sun_family = AF_UNIX;
    file.copy(address.sun_path, sizeof address.sun_path - 1);
    const auto deadline = Clock::now() + std::chrono::seconds(10);
    while (connect(socket_, reinterpret_cast<const sockaddr*>(&address), sizeof address) != 0) {
      if (Clock::now() > deadline) {
        ADD_FAILURE() << "the emulator does not open " << file;
        break;
      }
      std::this_thread::sleep_for(milliseconds(5));
    }
  }
  ~SerialLine() { close(socket_); }
  SerialLine(const SerialLine&) = delete;
  SerialLine& operator=(const SerialLine&) = delete;

  void write_bytes(std::span<const std::uint8_t> bytes) {
    ASSERT_EQ(send(socket_, bytes.data(), bytes.size(), MSG_NOSIGNAL),
              static_cast<ssize_t>(bytes.size()));
  }
  void write_frame(std::span<const std::uint8_t> frame) {
    FrameWriter writer;
    ASSERT_TRUE(writer.put(frame));
    std::vector<std::uint8_t> bytes;
    for (; writer.next(); writer.pop()) {
      bytes.push_back(*writer.next());
    }
    write_bytes(bytes);
  }
  /// Calls `use` with each frame that comes within `wait`, until it returns true.
  template <typename Use>
  bool read_frames(milliseconds wait, Use use) {
    const auto deadline = Clock::now() + wait;
    do {
      const auto left = std::chrono::duration_cast<milliseconds>(deadline - Clock::now());
      pollfd readable{socket_, POLLIN, 0};
      std::array<std::uint8_t, 256> bytes;
      if (poll(&readable, 1, static_cast<int>(std::max<std::int64_t>(left.count(), 0))) > 0) {
        const ssize_t size = recv(socket_, bytes.data(), bytes.size(), 0);
        for (ssize_t i = 0; i < size; ++i) {
          const auto frame = reader_.take(bytes[static_cast<std::size_t>(i)]);
          if (!frame.empty() && use(frame)) {
            return true;
          }
        }
      }
    } while (Clock::now() < deadline);
    return false;
  }

 private:
  int socket_;
  FrameReader reader_;
};

std::vector<std::uint8_t> bytes_of_state(std::uint32_t number,
                                         const std::array<std::int32_t, 6>& counts) {
  std::vector<std::uint8_t> bytes(ArmState::kBytes);
  put(bytes, 0, number);
  put(bytes, 4, counts);
  put(bytes, 28, crc32(std::span(bytes).first(28)));
  return bytes;
}

/// The device between an arm and a spring: F = -k (P - P0) once it is touched.
class Loop {
 public:
  static constexpr double kStiffness_N_per_m = 150.0;

  /// @param simulates false: the simulator's line is for another program.
  explicit Loop(const std::string& method, bool simulates = true)
      : folder_(testing::fresh_folder("loop_" + method)),
        device_({"qemu-system-arm", "-M", "mps2-an500", "-display", "none", "-serial",
                 "unix:" + folder_ + "/simulator,server=on,wait=" + (simulates ? "on" : "off"),
                 "-serial", "unix:" + folder_ + "/arm,server=on,wait=on", "-monitor",
                 "unix:" + folder_ + "/monitor,server=on,wait=off", "-kernel", image_of(method)}),
        simulator_(simulates ? std::make_unique<SerialLine>(folder_ + "/simulator") : nullptr),
        arm_(folder_ + "/arm"),
        kinematics_(profiles::load_device_profile("woodenhaptics_v2015")) {
    EXPECT_TRUE(arm_.read_frames(std::chrono::seconds(10), [](const auto& frame) {
      return frame.size() == ArmCommand::kBytes && get<std::uint32_t>(frame, 0) == 0;
    })) << "it does not say that it is ready";
  }

  SerialLine& arm() { return arm_; }
  SerialLine& simulator() { return *simulator_; }
  std::string simulator_file() const { return folder_ + "/simulator"; }
  const driver::ArmKinematics& kinematics() const { return kinematics_; }
  int tool_states() const { return tool_states_; }

  std::array<std::int32_t, 6> counts_at(const Eigen::Vector3d& position_D) const {
    const Eigen::Vector3d counts = kinematics_.inverse(position_D).counts;
    return {static_cast<std::int32_t>(std::lround(counts[0])),
            static_cast<std::int32_t>(std::lround(counts[1])),
            static_cast<std::int32_t>(std::lround(counts[2]))};
  }

  /// One cycle of the arm: sends counters, and returns the answer, if one comes within half a
  /// second.
  std::optional<ArmCommand> cycle(const std::array<std::int32_t, 6>& counts) {
    arm_.write_frame(bytes_of_state(++number_, counts));
    std::optional<ArmCommand> command;
    arm_.read_frames(milliseconds(500), [&](std::span<const std::uint8_t> frame) {
      if (frame.size() == ArmCommand::kBytes &&
          get<std::uint32_t>(frame, 12) == crc32(frame.first(12))) {
        command = ArmCommand{get<std::uint32_t>(frame, 0),
                             get<std::array<std::int16_t, 3>>(frame, 4), frame[10], frame[11]};
      }
      return command.has_value();
    });
    if (command) {
      EXPECT_EQ(command->number, number_);
    }
    return command;
  }

  /// Answers the newest tool state that has come, if any, 30 times a second.
  void simulate() {
    std::optional<link::ToolState> newest;
    std::uint64_t session = 0;
    if (Clock::now() < next_answer_) {
      return;
    }
    simulator_->read_frames(milliseconds(0), [&](std::span<const std::uint8_t> frame) {
      const link::Decoded decoded = link::decode(std::as_bytes(frame));
      EXPECT_EQ(decoded.status, link::WireStatus::kOk) << to_string(decoded.status);
      if (const auto* state = std::get_if<link::ToolState>(&decoded.message)) {
        EXPECT_GT(state->sequence, last_state_);
        last_state_ = state->sequence;
        ++tool_states_;
        newest = *state;
        session = decoded.session_id;
      }
      return false;
    });
    if (!newest) {
      return;
    }
    next_answer_ = Clock::now() + milliseconds(33);
    link::ForceSample sample;
    sample.sequence = ++answers_;
    sample.echo_sequence = newest->sequence;
    sample.echo_servo_time_ns = newest->servo_time_ns;
    sample.contact_epoch = 1;
    sample.in_contact = sample.converged = true;
    sample.position_W_m = newest->position_W_m;
    for (std::size_t axis = 0; axis < 3; ++axis) {
      sample.force_W_N[axis] = -kStiffness_N_per_m * newest->position_W_m[axis];
    }
    std::array<std::byte, link::kForceSampleBytes> bytes{};
    ASSERT_EQ(link::encode(sample, session, bytes).status, link::WireStatus::kOk);
    simulator_->write_frame({reinterpret_cast<const std::uint8_t*>(bytes.data()), bytes.size()});
  }

  /// Bytes of the stack that were used, out of how many: the part that no longer holds what it was
  /// filled with at start.
  std::pair<std::size_t, std::size_t> stack_used(const std::string& method) {
    const std::string symbols = folder_ + "/symbols", dump = folder_ + "/stack";
    testing::Program nm({"arm-none-eabi-nm", image_of(method)});
    EXPECT_EQ(nm.wait(), 0);
    std::size_t begin = 0, end = 0;
    std::istringstream lines(nm.standard_output());
    for (std::string value, kind, name; lines >> value >> kind >> name;) {
      if (name == "stack_begin") {
        begin = std::stoul(value, nullptr, 16);
      } else if (name == "stack_end") {
        end = std::stoul(value, nullptr, 16);
      }
    }
    SerialLine monitor(folder_ + "/monitor");
    const std::string command = "pmemsave " + std::to_string(begin) + " " +
                                std::to_string(end - begin) + " \"" + dump + "\"\n";
    monitor.write_bytes({reinterpret_cast<const std::uint8_t*>(command.data()), command.size()});
    for (int i = 0; i < 400 && testing::text_of(dump).size() < end - begin; ++i) {
      std::this_thread::sleep_for(milliseconds(5));
    }
    const std::string stack = testing::text_of(dump);
    std::size_t unused = 0;
    while (unused + 4 <= stack.size() && stack.compare(unused, 4, "\xef\xbe\xad\xde") == 0) {
      unused += 4;
    }
    EXPECT_GT(unused, 0U);
    return {stack.size() - unused, end - begin};
  }

 private:
  std::string folder_;
  testing::Program device_;
  std::unique_ptr<SerialLine> simulator_;
  SerialLine arm_;
  driver::ArmKinematics kinematics_;
  std::uint32_t number_ = 0, answers_ = 0;
  int tool_states_ = 0;
  std::uint32_t last_state_ = 0;
  Clock::time_point next_answer_{};
};

Eigen::Vector3d path_D(double time_s) {
  const double w = 2.0 * std::numbers::pi * 0.6;
  return {0.010 * std::sin(w * time_s), 0.012 * std::sin(1.3 * w * time_s),
          0.008 * std::sin(0.7 * w * time_s)};
}

class FirmwareLoop : public ::testing::TestWithParam<std::string> {
 protected:
  void SetUp() override {
    if (!std::filesystem::exists(image_of(GetParam())) ||
        !std::filesystem::exists("/usr/bin/qemu-system-arm")) {
      GTEST_SKIP() << "no images or no qemu-system-arm: `make firmware` installs and builds them";
    }
  }
};

TEST_P(FirmwareLoop, RendersTheSimulatorsSpringThroughTheArmsMotors) {
  Loop loop(GetParam());
  const driver::ArmKinematics& kinematics = loop.kinematics();
  double error_mA2 = 0.0, expected_mA2 = 0.0;
  int compared = 0;
  const auto began = Clock::now();
  for (double time_s = 0.0; time_s < 2.0;) {
    const auto counts = loop.counts_at(path_D(time_s));
    const auto command = loop.cycle(counts);
    ASSERT_TRUE(command) << "no answer at " << time_s << " s";
    ASSERT_EQ(command->pose_status, static_cast<std::uint8_t>(driver::KinematicsStatus::kOk));
    loop.simulate();
    if (time_s > 1.0) {
      const driver::ArmPose pose = kinematics.forward(counts);
      const Eigen::Vector3d force_N = -Loop::kStiffness_N_per_m * pose.position_D;
      const auto expected = kinematics.report_current(
          kinematics.motor_current_A(driver::ArmKinematics::joint_torque(pose, force_N)));
      for (std::size_t motor = 0; motor < 3; ++motor) {
        error_mA2 += std::pow(command->current_mA[motor] - expected.current_mA[motor], 2);
        expected_mA2 += std::pow(expected.current_mA[motor], 2);
      }
      ++compared;
    }
    time_s += 0.002;
    std::this_thread::sleep_until(began + std::chrono::duration<double>(time_s));
  }
  EXPECT_GT(compared, 400);
  EXPECT_GT(loop.tool_states(), 100);
  const double error = std::sqrt(error_mA2 / expected_mA2);
  std::cout << "error_percent " << 100.0 * error << "\n";
  // A grid averages: it is as far off as in any loop.
  EXPECT_LT(error, GetParam() == "grid" ? 0.6 : 0.02);
  const auto [used, all] = loop.stack_used(GetParam());
  std::cout << "stack_bytes_used " << used << "\nstack_bytes " << all << "\n";
  EXPECT_LT(used, all);
}

TEST_P(FirmwareLoop, IsSilentToABrokenFrameAndFreeBeyondTheStopsAndWithoutASimulator) {
  Loop loop(GetParam());
  const auto counts = loop.counts_at({0.005, 0.0, 0.0});
  // It starts without a simulator: no force.
  const auto first = loop.cycle(counts);
  ASSERT_TRUE(first);
  EXPECT_EQ(first->current_mA, (std::array<std::int16_t, 3>{}));
  // In contact: a force.
  const auto until = Clock::now() + milliseconds(400);
  std::optional<ArmCommand> command;
  while (Clock::now() < until) {
    command = loop.cycle(counts);
    ASSERT_TRUE(command);
    loop.simulate();
    std::this_thread::sleep_for(milliseconds(2));
  }
  EXPECT_NE(command->current_mA, (std::array<std::int16_t, 3>{}));
  // Broken frames of the arm get no answer; bytes without meaning on the other line do no harm.
  auto broken = bytes_of_state(7, counts);
  broken[5] ^= 1;
  loop.arm().write_frame(broken);
  EXPECT_FALSE(loop.arm().read_frames(milliseconds(50), [](const auto&) { return true; }));
  loop.simulator().write_bytes(std::vector<std::uint8_t>(3000, 0xDB));
  // A pose that the arm cannot have: no current.
  command = loop.cycle({0, 0, 30000, 0, 0, 0});
  ASSERT_TRUE(command);
  EXPECT_EQ(command->pose_status, static_cast<std::uint8_t>(driver::KinematicsStatus::kOutOfRange));
  EXPECT_EQ(command->current_mA, (std::array<std::int16_t, 3>{}));
  command = loop.cycle(counts);
  ASSERT_TRUE(command);
  EXPECT_NE(command->current_mA, (std::array<std::int16_t, 3>{}));
  // The simulator falls silent.
  std::this_thread::sleep_for(milliseconds(700));
  command = loop.cycle(counts);
  ASSERT_TRUE(command);
  EXPECT_EQ(command->current_mA, (std::array<std::int16_t, 3>{}));
}

// examples/firmware/serial_bridge.py and a simulator of examples/ at the other end.
TEST(FirmwareBridge, JoinsTheLineToAnySimulatorOfTheLink) {
  if (!std::filesystem::exists(image_of("rls")) ||
      !std::filesystem::exists("/usr/bin/qemu-system-arm")) {
    GTEST_SKIP() << "no images or no qemu-system-arm: `make firmware` installs and builds them";
  }
  const std::string examples = FORCEGRID_SOURCE_DIR "/examples/";
  testing::Program spring({"/usr/bin/python3", examples + "spring_simulator.py", "0", "150"});
  const std::string listening = spring.wait_for_line("listening on ");
  ASSERT_FALSE(listening.empty());
  Loop loop("rls", false);
  testing::Program bridge({"/usr/bin/python3", examples + "firmware/serial_bridge.py",
                           "unix:" + loop.simulator_file(),
                           listening.substr(std::string("listening on ").size())});
  // The spring catches the tool at the origin, or near it when the bridge is there; then the tool
  // stands still elsewhere.
  const auto origin = loop.counts_at(Eigen::Vector3d::Zero());
  const auto away = loop.counts_at({0.01, 0.004, -0.006});
  const Eigen::Vector3d force_N = -150.0 * (loop.kinematics().forward(away).position_D -
                                            loop.kinematics().forward(origin).position_D);
  const auto expected = loop.kinematics().report_current(loop.kinematics().motor_current_A(
      driver::ArmKinematics::joint_torque(loop.kinematics().forward(away), force_N)));
  const auto began = Clock::now();
  bool reached = false;
  for (int cycle = 0; !reached && Clock::now() < began + std::chrono::seconds(8); ++cycle) {
    const bool caught = Clock::now() > began + milliseconds(1500);
    const auto command = loop.cycle(caught ? away : origin);
    ASSERT_TRUE(command);
    reached = caught;
    for (std::size_t motor = 0; motor < 3; ++motor) {
      reached = reached && std::abs(command->current_mA[motor] - expected.current_mA[motor]) <= 2;
    }
    std::this_thread::sleep_for(milliseconds(2));
  }
  EXPECT_TRUE(reached) << bridge.standard_error();
}

INSTANTIATE_TEST_SUITE_P(Methods, FirmwareLoop, ::testing::Values("grid", "rls", "kriging"),
                         [](const auto& one) { return one.param; });

}  // namespace
}  // namespace forcegrid::firmware
