// SPDX-License-Identifier: Apache-2.0
#include <dlfcn.h>
#include <forcegrid/device.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <array>
#include <atomic>
#include <cmath>
#include <csignal>
#include <cstring>
#include <limits>
#include <nlohmann/json.hpp>
#include <stdexcept>
#include <string>
#include <thread>

#include "tests/support/program.h"

namespace forcegrid {
namespace {

using namespace std::chrono_literals;
using ::testing::ContainsRegex;
using ::testing::HasSubstr;
using testing::Program;

constexpr char kArm[] = "emulated:woodenhaptics_v2015";
constexpr auto kPatience = 20s;

forcegrid_options default_options() {
  forcegrid_options options;
  forcegrid_options_init(&options, sizeof options);
  options.device = kArm;
  return options;
}

// A device that is closed with the test.
class Opened {
 public:
  explicit Opened(const forcegrid_options& options = default_options()) {
    EXPECT_EQ(forcegrid_open(&options, &device_), FORCEGRID_OK) << forcegrid_last_error();
  }
  ~Opened() { forcegrid_close(device_); }
  Opened(const Opened&) = delete;
  Opened& operator=(const Opened&) = delete;
  forcegrid_device* get() const { return device_; }
  forcegrid_state state() const {
    forcegrid_state state{};
    state.size = sizeof state;
    EXPECT_EQ(forcegrid_read(device_, &state), FORCEGRID_OK);
    return state;
  }

 private:
  forcegrid_device* device_ = nullptr;
};

template <typename Done>
bool wait_until(const Done& done) {
  const auto give_up = std::chrono::steady_clock::now() + kPatience;
  while (std::chrono::steady_clock::now() < give_up) {
    if (done()) {
      return true;
    }
    std::this_thread::sleep_for(1ms);
  }
  return done();
}

int push_up(const forcegrid_state* /*state*/, forcegrid_force* force, void* calls) {
  force->force_N[2] = 1.5;
  ++*static_cast<std::atomic<int>*>(calls);
  return 0;
}

TEST(CApi, ReadsTheOrientationOfAWristAndTheButtonOfItsStylus) {
  forcegrid_options options = default_options();
  options.device = "emulated:woodenhaptics_v2015_wrist";
  options.emulator_wrist = "turn";
  options.emulator_click_every_s = 0.5;
  const Opened arm(options);
  forcegrid_identity identity{};
  identity.size = sizeof identity;
  ASSERT_EQ(forcegrid_get_identity(arm.get(), &identity), FORCEGRID_OK);
  EXPECT_EQ(identity.degrees_of_freedom, 6U);
  bool pressed = false;
  bool turned = false;
  ASSERT_TRUE(wait_until([&] {
    const forcegrid_state state = arm.state();
    pressed = pressed || state.buttons == 1;
    turned = turned || std::abs(state.joint_angle_rad[3]) > 0.3;
    return pressed && turned;
  }));
  // The sheet's formula from the state's own counters: R_z(a) R_y(pi/2 - c) R_x(D) R_y(E) R_x(F).
  const forcegrid_state state = arm.state();
  const auto angle_rad = [&](int counter, double counts) {
    return 2.0 * M_PI * state.counts[counter] / counts;
  };
  const Eigen::Quaterniond expected =
      Eigen::AngleAxisd(angle_rad(0, 32000), Eigen::Vector3d::UnitZ()) *
      Eigen::AngleAxisd(M_PI / 2 - angle_rad(2, 24000), Eigen::Vector3d::UnitY()) *
      Eigen::AngleAxisd(angle_rad(5, 1024), Eigen::Vector3d::UnitX()) *
      Eigen::AngleAxisd(angle_rad(4, 1024), Eigen::Vector3d::UnitY()) *
      Eigen::AngleAxisd(angle_rad(3, 1024), Eigen::Vector3d::UnitX());
  const Eigen::Quaterniond given(state.orientation[0], state.orientation[1], state.orientation[2],
                                 state.orientation[3]);
  EXPECT_NEAR(given.norm(), 1.0, 1e-12);
  EXPECT_NEAR(given.angularDistance(expected), 0.0, 1e-7);
  EXPECT_NEAR(state.joint_angle_rad[3], angle_rad(5, 1024), 1e-12);
  EXPECT_NEAR(state.joint_angle_rad[5], angle_rad(3, 1024), 1e-12);
  const double* const w = state.angular_velocity_rad_per_s;
  EXPECT_GT(std::hypot(w[0], w[1], w[2]), 0.0);
  EXPECT_LT(std::hypot(w[0], w[1], w[2]), 10.0);
}

TEST(CApi, ExertsATorqueWithMotorsInTheWrist) {
  const std::string summary = testing::fresh_folder("c_torque") + "/emulator.json";
  forcegrid_options options = default_options();
  options.device = "emulated:emulated_6dof";
  options.emulator_summary = summary.c_str();
  options.check_motors = 0;
  forcegrid_device* device = nullptr;
  ASSERT_EQ(forcegrid_open(&options, &device), FORCEGRID_OK) << forcegrid_last_error();
  forcegrid_limits limits{};
  limits.size = sizeof limits;
  ASSERT_EQ(forcegrid_get_limits(device, &limits), FORCEGRID_OK);
  EXPECT_EQ(limits.max_torque_Nm, 0.188);
  forcegrid_state state{};
  state.size = sizeof state;
  ASSERT_TRUE(wait_until([&] {  // outside of the workspace, where it begins, there is no torque
    return forcegrid_read(device, &state) == FORCEGRID_OK && std::abs(state.position_m[2]) < 0.002;
  }));
  ASSERT_EQ(forcegrid_enable(device, 1), FORCEGRID_OK);
  forcegrid_force force{};
  forcegrid_force_init(&force, sizeof force);
  force.torque_Nm[1] = 0.06;
  force.hold_s = 30.0;
  ASSERT_EQ(forcegrid_command(device, &force), FORCEGRID_OK);
  ASSERT_TRUE(wait_until([&] {
    return forcegrid_read(device, &state) == FORCEGRID_OK &&
           std::abs(state.torque_Nm[1] - 0.06) < 1e-3;
  }));
  // The hand's 0.8 N m/rad give way by 75 mrad.
  EXPECT_TRUE(wait_until([&] {
    return forcegrid_read(device, &state) == FORCEGRID_OK &&
           std::abs(state.joint_angle_rad[4] - 0.06 / 0.8) < 0.01;
  })) << state.joint_angle_rad[4];
  force.torque_Nm[1] = std::nan("");
  EXPECT_EQ(forcegrid_command(device, &force), FORCEGRID_BAD_ARGUMENT);
  EXPECT_EQ(forcegrid_close(device), FORCEGRID_OK);
  const auto report = nlohmann::json::parse(testing::text_of(summary));
  EXPECT_EQ(report.at("wrist").at("final_current_mA"), (std::vector<double>{0, 0, 0}));
  EXPECT_GT(report.at("wrist").at("max_abs_current_mA").at(1), 200.0);
}

TEST(CApi, GivesTheIdentityForAnArmWithoutAWrist) {
  const Opened arm;
  const forcegrid_state state = arm.state();
  EXPECT_THAT(state.orientation, ::testing::ElementsAre(1.0, 0.0, 0.0, 0.0));
  EXPECT_THAT(state.angular_velocity_rad_per_s, ::testing::Each(0.0));
  EXPECT_EQ(state.joint_angle_rad[3], 0.0);
  forcegrid_identity identity{};
  identity.size = sizeof identity;
  ASSERT_EQ(forcegrid_get_identity(arm.get(), &identity), FORCEGRID_OK);
  EXPECT_EQ(identity.degrees_of_freedom, 3U);
}

TEST(CApi, ReadsTheArmThroughEveryVersionOfAState) {
  const Opened arm;
  const forcegrid_state state = arm.state();
  EXPECT_GE(state.cycle, 1U);
  EXPECT_EQ(state.status, FORCEGRID_OK);
  EXPECT_EQ(state.orientation[0], 1.0);
  // A later program's longer struct gets its rest untouched.
  struct Longer {
    forcegrid_state state;
    double later;
  } longer{};
  longer.later = 7.0;
  longer.state.size = sizeof longer;
  ASSERT_EQ(forcegrid_read(arm.get(), &longer.state), FORCEGRID_OK);
  EXPECT_EQ(longer.later, 7.0);
  EXPECT_EQ(longer.state.size, sizeof longer);

  forcegrid_limits limits{};
  limits.size = sizeof limits;
  ASSERT_EQ(forcegrid_get_limits(arm.get(), &limits), FORCEGRID_OK);
  EXPECT_EQ(limits.max_force_N, 5.0);  // of profiles/woodenhaptics_v2015.toml, as the next
  EXPECT_EQ(limits.workspace_max_m[1], 0.080);
  EXPECT_EQ(limits.rate_Hz, 1000.0);
  forcegrid_identity identity{};
  identity.size = sizeof identity;
  ASSERT_EQ(forcegrid_get_identity(arm.get(), &identity), FORCEGRID_OK);
  EXPECT_STREQ(identity.profile, "woodenhaptics_v2015");
  EXPECT_STREQ(identity.serial, "0123456789");
}

TEST(CApi, CallsBackOnceACycleAndRendersWhatItIsGiven) {
  const Opened arm;
  std::atomic<int> calls{0};
  ASSERT_EQ(forcegrid_start(arm.get(), push_up, &calls), FORCEGRID_OK);
  EXPECT_EQ(forcegrid_start(arm.get(), push_up, &calls), FORCEGRID_REFUSED);
  ASSERT_EQ(forcegrid_enable(arm.get(), 1), FORCEGRID_OK);
  ASSERT_TRUE(wait_until([&] { return arm.state().force_N[2] > 1.49; }));
  const forcegrid_state begin = arm.state();
  const int before = calls;
  ASSERT_TRUE(wait_until([&] { return arm.state().cycle >= begin.cycle + 500; }));
  const auto cycles = static_cast<int>(arm.state().cycle - begin.cycle);
  // A cycle whose state was overtaken by the next has no call of its own.
  EXPECT_LE(calls - before, cycles + 5);
  EXPECT_GT(calls - before, cycles / 2);
  EXPECT_EQ(forcegrid_stop(arm.get()), FORCEGRID_OK);
  const int after = calls;
  EXPECT_TRUE(wait_until([&] { return arm.state().force_N[2] == 0.0; }));
  EXPECT_EQ(calls, after);
}

// Each state says which force its cycle commanded; each call gives a force of its own.
TEST(CApi, ACallbacksForceGoesOutInTheNextCycle) {
  static const auto force_of = [](std::uint64_t cycle) {
    return 1.0 + 1e-3 * static_cast<double>(cycle % 256);
  };
  static std::array<std::atomic<int>, 4> seen_after{};  // so many cycles; [0]: never
  for (auto& count : seen_after) {
    count = 0;
  }
  const Opened arm;
  ASSERT_EQ(forcegrid_start(
                arm.get(),
                [](const forcegrid_state* state, forcegrid_force* force, void*) {
                  force->force_N[2] = force_of(state->cycle);
                  if (state->force_gain == 1.0 && state->limits == 0) {
                    std::size_t lag = 0;
                    for (std::size_t k = 1; k < seen_after.size(); ++k) {
                      lag =
                          std::abs(state->force_N[2] - force_of(state->cycle - k)) < 1e-9 ? k : lag;
                    }
                    ++seen_after[lag];
                  }
                  return 0;
                },
                nullptr),
            FORCEGRID_OK);
  forcegrid_enable(arm.get(), 1);
  ASSERT_TRUE(wait_until([] { return seen_after[1] > 300; }));
  // On a busy machine the callback's thread now and then comes too late for a cycle.
  EXPECT_GT(seen_after[1], seen_after[0] + seen_after[2] + seen_after[3]);
  EXPECT_EQ(forcegrid_stop(arm.get()), FORCEGRID_OK);
}

TEST(CApi, ACallbackThatNeverReturnsGetsZeroForceAndDoesNotHoldUpTheEnd) {
  static std::atomic<bool> hang{false};
  static std::atomic<bool> let_go{false};
  forcegrid_options options = default_options();
  forcegrid_device* device = nullptr;
  ASSERT_EQ(forcegrid_open(&options, &device), FORCEGRID_OK) << forcegrid_last_error();
  ASSERT_EQ(forcegrid_start(
                device,
                [](const forcegrid_state*, forcegrid_force* force, void*) {
                  force->force_N[2] = 1.5;
                  while (hang && !let_go) {
                    std::this_thread::sleep_for(1ms);
                  }
                  return 0;
                },
                nullptr),
            FORCEGRID_OK);
  forcegrid_enable(device, 1);
  forcegrid_state state{};
  state.size = sizeof state;
  const auto force_z = [&] {
    forcegrid_read(device, &state);
    return state.force_N[2];
  };
  ASSERT_TRUE(wait_until([&] { return force_z() > 1.49; }));
  hang = true;
  EXPECT_TRUE(wait_until([&] { return force_z() == 0.0; }));
  EXPECT_EQ(forcegrid_close(device), FORCEGRID_TIMEOUT);
  EXPECT_THAT(forcegrid_last_error(), HasSubstr("callback has not returned"));
  let_go = true;
  std::this_thread::sleep_for(50ms);
}

TEST(CApi, ACallbackThatThrowsOrSaysStopEndsWithZeroForce) {
  for (const bool throws : {false, true}) {
    const Opened arm;
    static std::atomic<bool> now{false};
    static std::atomic<bool> by_throwing{false};
    now = false;
    by_throwing = throws;
    ASSERT_EQ(forcegrid_start(
                  arm.get(),
                  [](const forcegrid_state*, forcegrid_force* force, void*) {
                    force->force_N[2] = 1.5;
                    if (now && by_throwing) {
                      throw std::runtime_error("on purpose");
                    }
                    return now ? 1 : 0;
                  },
                  nullptr),
              FORCEGRID_OK);
    forcegrid_enable(arm.get(), 1);
    ASSERT_TRUE(wait_until([&] { return arm.state().force_N[2] > 1.49; }));
    now = true;
    EXPECT_TRUE(wait_until([&] { return arm.state().force_N[2] == 0.0; }));
    EXPECT_EQ(forcegrid_health(arm.get()), throws ? FORCEGRID_THREW : FORCEGRID_OK);
    EXPECT_EQ(forcegrid_stop(arm.get()), throws ? FORCEGRID_THREW : FORCEGRID_OK);
  }
}

TEST(CApi, TellsBadArgumentsApart) {
  forcegrid_options options = default_options();
  forcegrid_device* device = nullptr;
  EXPECT_EQ(forcegrid_open(nullptr, &device), FORCEGRID_BAD_ARGUMENT);
  EXPECT_EQ(forcegrid_open(&options, nullptr), FORCEGRID_BAD_ARGUMENT);
  options.device = "emulated:nonesuch";
  EXPECT_EQ(forcegrid_open(&options, &device), FORCEGRID_UNUSABLE);
  EXPECT_THAT(forcegrid_last_error(), HasSubstr("nonesuch"));
  options.device = "usbip://127.0.0.1:1/1-1";
  EXPECT_EQ(forcegrid_open(&options, &device), FORCEGRID_NOT_FOUND);
  EXPECT_EQ(device, nullptr);
  EXPECT_EQ(forcegrid_close(nullptr), FORCEGRID_OK);
  EXPECT_EQ(forcegrid_read(nullptr, nullptr), FORCEGRID_BAD_ARGUMENT);
  for (int status = FORCEGRID_OK; status <= FORCEGRID_THREW; ++status) {
    EXPECT_GT(std::strlen(forcegrid_status_text(static_cast<forcegrid_status>(status))), 5U);
  }
  const Opened arm;
  forcegrid_force force;
  forcegrid_force_init(&force, sizeof force);
  force.force_N[1] = std::numeric_limits<double>::quiet_NaN();
  EXPECT_EQ(forcegrid_command(arm.get(), &force), FORCEGRID_BAD_ARGUMENT);
  const double place_m[3] = {0.0, 0.0, 0.0};
  EXPECT_EQ(forcegrid_add_sample(arm.get(), 0, place_m, place_m), FORCEGRID_REFUSED);
  forcegrid_state state{};  // without its size
  EXPECT_EQ(forcegrid_read(arm.get(), &state), FORCEGRID_BAD_ARGUMENT);
}

// A program that dies in mid-force: the emulated firmware's watchdog, and its emulator's report.
TEST(CApi, AKilledProgramLeavesZeroCurrent) {
  const std::string folder = testing::fresh_folder("killed");
  const std::string summary = folder + "/summary.json";
  ::setenv("FORCEGRID_EMULATOR_SUMMARY", summary.c_str(), 1);
  Program wall({std::string(FORCEGRID_EXAMPLES) + "/04_servo_loop", kArm, "60"});
  ::unsetenv("FORCEGRID_EMULATOR_SUMMARY");
  std::this_thread::sleep_for(4s);
  wall.send_signal(SIGKILL);
  EXPECT_EQ(wall.wait(), 128 + SIGKILL) << wall.standard_error();
  ASSERT_TRUE(wait_until([&] {
    const std::string text = testing::text_of(summary);
    return !text.empty() && nlohmann::json::accept(text);
  })) << "the emulator has written no summary";
  const std::string text = nlohmann::json::parse(testing::text_of(summary)).dump();
  EXPECT_THAT(text, HasSubstr("\"final_current_mA\":[0.0,0.0,0.0]"));
  EXPECT_THAT(text, HasSubstr("\"watchdog_trips\":1"));
  EXPECT_THAT(text, ::testing::Not(HasSubstr("\"max_abs_current_mA\":[0.0,0.0,0.0]")));
}

// In C, and in C++ beside it: four at a time, which mostly wait.
TEST(CApi, TheNumberedExamplesRun) {
  const std::string in_c = FORCEGRID_EXAMPLES;
  const std::string in_cpp = in_c + "/..";
  {
    Program read_c({in_c + "/01_read_position", kArm, "1"});
    Program read_cpp({in_cpp + "/01_read_position", kArm, "1"});
    Program wall_c({in_c + "/02_virtual_wall", kArm, "5"});
    Program wall_cpp({in_cpp + "/02_virtual_wall", kArm, "5"});
    for (Program* read : {&read_c, &read_cpp}) {
      EXPECT_EQ(read->wait(), 0) << read->standard_error();
      EXPECT_THAT(read->standard_output(),
                  ContainsRegex("x +-?[0-9.]+  y +-?[0-9.]+  z +-?[0-9.]+ mm"));
    }
    for (Program* wall : {&wall_c, &wall_cpp}) {
      EXPECT_EQ(wall->wait(), 0) << wall->standard_error();
      EXPECT_THAT(wall->standard_output(), ContainsRegex("deepest [0-9.]+ mm"));
    }
  }
  Program method_c({in_c + "/03_force_method", kArm, "6"});
  Program method_cpp({in_cpp + "/03_force_method", kArm, "6"});
  Program loop_c({in_c + "/04_servo_loop", kArm, "2"});
  Program loop_cpp({in_cpp + "/04_servo_loop", "", "2"});
  for (Program* method : {&method_c, &method_cpp}) {
    EXPECT_EQ(method->wait(), 0) << method->standard_error();
    double error_percent = 100.0;
    EXPECT_EQ(std::sscanf(method->standard_output().c_str(), "force error %lf", &error_percent), 1);
    EXPECT_LT(error_percent, 5.0);
  }
  for (Program* loop : {&loop_c, &loop_cpp}) {
    EXPECT_EQ(loop->wait(), 0) << loop->standard_error();
  }
}

TEST(CApi, CanBeLoadedAtRunTime) {
  void* library = ::dlopen(FORCEGRID_C_LIBRARY, RTLD_NOW | RTLD_LOCAL);
  ASSERT_NE(library, nullptr) << ::dlerror();
  const auto version = reinterpret_cast<const char* (*)()>(::dlsym(library, "forcegrid_version"));
  ASSERT_NE(version, nullptr);
  EXPECT_STREQ(version(), forcegrid_version());
}

}  // namespace
}  // namespace forcegrid
