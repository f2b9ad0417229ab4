// SPDX-License-Identifier: Apache-2.0
#include "device_session/device_session.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <Eigen/Core>
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <functional>
#include <nlohmann/json.hpp>
#include <thread>

#include "device_emulator/emulator_server.h"
#include "rt/thread.h"
#include "rt/vectors.h"
#include "servo_loop/degradation_ladder.h"
#include "tests/support/program.h"

namespace forcegrid::session {
namespace {

using namespace std::chrono_literals;
using ::testing::HasSubstr;

constexpr char kProfile[] = "woodenhaptics_v2015";
constexpr rt::Duration kPatience = 20s;
#ifdef FORCEGRID_SANITIZED
constexpr int kOpenings = 500;
#else
constexpr int kOpenings = 10;
#endif

// One emulated arm in this process, whose motors are the witness.
class Arm {
 public:
  explicit Arm(emulator::MotionKind motion = emulator::MotionKind::kStill,
               const std::vector<std::string>& faults = {}) {
    emulator::DeviceOptions device;
    device.profile = profiles::load_device_profile(kProfile);
    device.operator_script.motion = motion;
    device.operator_script.calibrated = true;
    for (const std::string& fault : faults) {
      device.faults.push_back(emulator::parse_fault(fault));
    }
    server_ = std::make_unique<emulator::EmulatorServer>(
        emulator::ServerOptions{.listen = "127.0.0.1:0", .devices = {device}});
    server_->start();
  }
  SessionOptions options() const {
    SessionOptions options;
    options.device = "usbip://" + server_->address() + "/1-1";
    options.calibrated = true;
    return options;
  }
  emulator::EmulatorReport report() const { return server_->report(0); }

 private:
  std::unique_ptr<emulator::EmulatorServer> server_;
};

bool wait_until(const std::function<bool()>& done) {
  const rt::TimePoint give_up = rt::Clock::now() + kPatience;
  while (rt::Clock::now() < give_up) {
    if (done()) {
      return true;
    }
    std::this_thread::sleep_for(1ms);
  }
  return done();
}

double force_N(const DeviceSession& session) {
  return rt::to_vector(session.newest_state().commanded_force_D_N).norm();
}

// The hand has brought the tool to where it then holds it.
void wait_for_hand(const DeviceSession& session) {
  ASSERT_TRUE(wait_until([&] {
    const ToolState state = session.newest_state();
    return rt::to_vector(state.position_D_m).norm() < 0.002 &&
           rt::to_vector(state.velocity_D_m_per_s).norm() < 0.002;
  }));
}

TEST(DeviceSession, StartsAnEmulatorOfItsOwnWhoseSummaryShowsItsForceAndTellsItsTimes) {
  const std::string folder = testing::fresh_folder("session");
  ::setenv("FORCEGRID_PROGRAM", FORCEGRID_PROGRAM, 1);
  SessionOptions options;
  options.emulator_summary = folder + "/summary.json";
  options.timing_file = folder + "/timing.json";
  std::uint64_t cycles = 0;
  {
    const auto session = DeviceSession::open(options);
    EXPECT_EQ(session->profile().name, kProfile);
    EXPECT_THAT(session->url(), HasSubstr("usbip://127.0.0.1:"));
    EXPECT_GE(session->newest_state().cycle, 1U);
    wait_for_hand(*session);
    session->enable_force(true);
    ASSERT_TRUE(wait_until([&] {
      EXPECT_TRUE(session->command_force({0.0, 0.0, 2.0}, 100ms));
      return force_N(*session) > 1.99;
    }));
    EXPECT_TRUE(session->close());
    EXPECT_EQ(session->health(), SessionHealth::kClosed);
    cycles = session->newest_state().cycle;
  }
  const auto timing = nlohmann::json::parse(testing::text_of(options.timing_file));
  EXPECT_EQ(timing.at("cycles"), cycles);
  EXPECT_GT(timing.at("period_us").at("p50"), 100.0);
  EXPECT_GT(timing.at("compute_us").at("p50"), 0.0);
  EXPECT_LE(timing.at("wakeup_us").at("p50"), timing.at("wakeup_us").at("max"));
  const auto json = nlohmann::json::parse(testing::text_of(options.emulator_summary));
  const nlohmann::json& arm = json.is_array()            ? json.at(0)
                              : json.contains("devices") ? json.at("devices").at(0)
                                                         : json;
  EXPECT_EQ(arm.at("final_current_mA"), (nlohmann::json{0.0, 0.0, 0.0}));
  EXPECT_GT(arm.at("max_abs_current_mA").at(1).get<double>(), 50.0);
}

// A hand of 400 N/m: 2 N move it by 5 mm, less what friction holds (0.1 N or so either way).
TEST(DeviceSession, AForceMovesTheHandAsFarAsItsSpringSays) {
  const Arm arm;
  const auto session = DeviceSession::open(arm.options());
  wait_for_hand(*session);
  const double before_m = session->newest_state().position_D_m[2];
  session->enable_force(true);
  const auto push = [&](double force_z_N) {
    return wait_until([&] {
      session->command_force({0.0, 0.0, force_z_N}, 500ms);
      return std::abs(session->newest_state().commanded_force_D_N[2] - force_z_N) < 0.01;
    });
  };
  ASSERT_TRUE(push(2.0));
  EXPECT_TRUE(wait_until([&] {
    session->command_force({0.0, 0.0, 2.0}, 500ms);
    return std::abs(session->newest_state().position_D_m[2] - before_m - 0.005) < 0.001;
  }));
}

// Through the life of one session, since each begins with three seconds of an arm that wakes up and
// a hand that comes.
TEST(DeviceSession, ForcesAreSwitchedHeldShortenedAndTakenFromACallbackThatLasts) {
  const Arm arm;
  const auto session = DeviceSession::open(arm.options());
  wait_for_hand(*session);
  const auto push = [&](const std::array<double, 3>& force_D_N, rt::Duration hold) {
    const double wanted_N = std::min(rt::to_vector(force_D_N).norm(), 5.0);
    return wait_until([&] {
      EXPECT_TRUE(session->command_force(force_D_N, hold));
      return force_N(*session) > 0.99 * wanted_N;
    });
  };

  for (int k = 0; k < 50; ++k) {
    session->command_force({0.0, 0.0, 3.0}, 1s);
    std::this_thread::sleep_for(2ms);
  }
  EXPECT_EQ(arm.report().max_abs_current_mA, (std::array<double, 3>{}))
      << "switched off, not even a check";

  session->enable_force(true);
  ASSERT_TRUE(push({0.0, 0.0, 3.0}, 1s));
  const std::uint64_t cycle = session->newest_state().cycle;
  session->enable_force(false);
  // The cycle that is under way may have read the switch before.
  ASSERT_TRUE(wait_until([&] { return session->newest_state().cycle >= cycle + 3; }));
  EXPECT_EQ(force_N(*session), 0.0);
  EXPECT_EQ(session->newest_state().current_A, (std::array<double, 3>{}));

  session->enable_force(true);
  ASSERT_TRUE(push({0.0, 1.5, 0.0}, 100ms));
  const rt::TimePoint newest = rt::Clock::now();
  session->command_force({0.0, 1.5, 0.0}, 200ms);
  ASSERT_TRUE(wait_until([&] { return force_N(*session) == 0.0; }));
  EXPECT_GE(rt::Clock::now() - newest, 290ms) << "100 ms of fading after 200 ms";

  ASSERT_TRUE(push({0.0, -40.0, 30.0}, 500ms));
  const Eigen::Vector3d force_D = rt::to_vector(session->newest_state().commanded_force_D_N);
  EXPECT_LE(force_D.norm(), 5.0 + 1e-9);
  EXPECT_NEAR(force_D.normalized().y(), -0.8, 1e-6);
  EXPECT_NEAR(force_D.normalized().z(), 0.6, 1e-6);
  EXPECT_FALSE(session->command_force({0.0, std::nan(""), 0.0}, 100ms));
  EXPECT_FALSE(session->push_sample(0, {}, {})) << "without a method";

  ASSERT_TRUE(push({0.0, 0.0, 2.0}, 20s));
  session->busy();
  ASSERT_TRUE(wait_until([&] { return force_N(*session) == 0.0; }));
  session->idle();
  std::this_thread::sleep_for(50ms);
  EXPECT_EQ(force_N(*session), 0.0) << "until the next command";
  EXPECT_TRUE(push({0.0, 0.0, 2.0}, 20s));
}

// Nothing is left of a session: no descriptor, no thread; a sanitizer sees no leak and no race.
// $FORCEGRID_TEST_OPENINGS changes how often.
TEST(DeviceSession, OpensAndClosesWithoutLeavingAnything) {
  const Arm arm;
  const char* asked = std::getenv("FORCEGRID_TEST_OPENINGS");
  const int openings = asked != nullptr ? std::atoi(asked) : kOpenings;
  const auto count = [](const char* folder) {
    return std::distance(std::filesystem::directory_iterator(folder),
                         std::filesystem::directory_iterator());
  };
  std::ptrdiff_t descriptors = 0;
  for (int k = 0; k < openings; ++k) {
    const auto session = DeviceSession::open(arm.options());
    session->enable_force(true);
    session->command_force({0.0, 0.0, 1.0}, 100ms);
    EXPECT_TRUE(session->close());
    if (k == 0) {
      descriptors = count("/proc/self/fd");
    }
  }
  // The server may not have closed its end of the last connection yet.
  EXPECT_TRUE(wait_until([&] { return count("/proc/self/fd") <= descriptors; }));
  EXPECT_TRUE(wait_until([&] { return count("/proc/self/task") <= 3; }))
      << "this one, the emulator's, and what watches the cores";
}

TEST(DeviceSession, ASecondOneIsToldThatTheDeviceIsInUse) {
  const Arm arm;
  const auto session = DeviceSession::open(arm.options());
  try {
    const auto second = DeviceSession::open(arm.options());
    ADD_FAILURE() << "two sessions on one arm";
  } catch (const SessionError& error) {
    EXPECT_EQ(error.reason(), SessionError::Reason::kInUse) << error.what();
  }
  EXPECT_EQ(session->health(), SessionHealth::kRunning);
}

TEST(DeviceSession, NamesWhatCannotBeOpened) {
  const auto reason_of = [](const std::function<void(SessionOptions&)>& change) {
    ::setenv("FORCEGRID_PROGRAM", FORCEGRID_PROGRAM, 1);
    SessionOptions options;
    change(options);
    try {
      DeviceSession::open(options);
    } catch (const SessionError& error) {
      EXPECT_FALSE(std::string(error.what()).empty());
      return error.reason();
    }
    ADD_FAILURE() << "opened";
    return SessionError::Reason::kInUse;
  };
  using Reason = SessionError::Reason;
  EXPECT_EQ(reason_of([](auto& o) { o.device = "emulated:nonesuch"; }), Reason::kUnusable);
  EXPECT_EQ(reason_of([](auto& o) { o.device = "usbip://127.0.0.1:1/1-1"; }), Reason::kAbsent);
  EXPECT_EQ(reason_of([](auto& o) { o.rate_Hz = 7.0; }), Reason::kUnusable);
  EXPECT_EQ(reason_of([](auto& o) { o.method = "atuo"; }), Reason::kUnusable);
  EXPECT_EQ(reason_of([](auto& o) { o.timing_file = "/nonesuch/times.json"; }), Reason::kUnusable);
}

TEST(DeviceSession, GoesOnWithoutForceWhenTheConnectionIsBack) {
  const Arm arm(emulator::MotionKind::kStill, {"connection-closed:when=motors,ms=20"});
  const auto session = DeviceSession::open(arm.options());
  wait_for_hand(*session);
  session->enable_force(true);
  ASSERT_TRUE(wait_until([&] {
    session->command_force({0.0, 0.0, 1.0}, 100ms);
    return session->health() == SessionHealth::kLost;
  }));
  EXPECT_FALSE(session->failure().empty());
  EXPECT_FALSE(session->force_enabled());
  EXPECT_EQ(session->newest_state().velocity_D_m_per_s, (std::array<double, 3>{}));
  ASSERT_TRUE(wait_until([&] { return session->health() != SessionHealth::kLost; }));
  ASSERT_EQ(session->health(), SessionHealth::kRunning) << session->failure();
  const std::uint64_t cycle = session->newest_state().cycle;
  ASSERT_TRUE(wait_until([&] {
    session->command_force({0.0, 0.0, 1.0}, 100ms);
    return session->newest_state().cycle > cycle + 100;
  }));
  EXPECT_EQ(force_N(*session), 0.0);
  session->enable_force(true);
  EXPECT_TRUE(wait_until([&] {
    session->command_force({0.0, 0.0, 1.0}, 100ms);
    return force_N(*session) > 0.9;
  }));
}

// Forces of a spring at 60 Hz, felt at 1 kHz: `auto` follows the spring between samples.
TEST(DeviceSession, AMethodRendersASlowProgramsForces) {
  constexpr double kStiffness_N_per_m = 120.0;
  const Arm arm(emulator::MotionKind::kLissajous);
  SessionOptions options = arm.options();
  options.method = "auto";
  const auto session = DeviceSession::open(options);
  EXPECT_FALSE(session->command_force({0.0, 0.0, 1.0}, 100ms)) << "the method renders";
  session->enable_force(true);
  double error2 = 0.0;
  double held2 = 0.0;
  double force2 = 0.0;
  Eigen::Vector3d held = Eigen::Vector3d::Zero();
  rt::TimePoint next = rt::Clock::now();
  std::uint64_t cycle = 0;
  double touched_at_s = -1.0;
  int scored = 0;
  const rt::TimePoint give_up = rt::Clock::now() + kPatience;
  while (scored < 2000 && rt::Clock::now() < give_up) {
    session->wait_for_cycle(cycle, rt::Clock::now() + 20ms);
    const ToolState state = session->newest_state();
    cycle = state.cycle;
    const Eigen::Vector3d exact = -kStiffness_N_per_m * rt::to_vector(state.position_D_m);
    touched_at_s = exact.norm() < 0.1 && touched_at_s < 0.0
                       ? 1e-9 * static_cast<double>(state.time_ns)
                       : touched_at_s;
    if (state.force_gain >= 1.0 && state.limits_acted == 0 && touched_at_s > 0.0 &&
        1e-9 * static_cast<double>(state.time_ns) >
            touched_at_s + 1.0) {  // the hand has come from far away
      error2 += (rt::to_vector(state.commanded_force_D_N) - exact).squaredNorm();
      held2 += (held - exact).squaredNorm();
      force2 += exact.squaredNorm();
      ++scored;
    }
    if (rt::Clock::now() >= next) {
      next += 16667us;
      session->push_sample(state.time_ns, state.position_D_m, rt::to_array(exact));
      held = exact;
    }
  }
  ASSERT_EQ(scored, 2000);
  EXPECT_LT(std::sqrt(error2 / force2), 0.5 * std::sqrt(held2 / force2))
      << "no better than holding: " << std::sqrt(error2 / force2);

  // The program stands still: the force fades. Then it ramps in, and the passivity guard lets it
  // come back as the hand's motion pays for it; in the end it is the whole force again.
  EXPECT_TRUE(wait_until([&] { return session->newest_state().force_gain < 0.5; }));
  int whole = 0;
  EXPECT_TRUE(wait_until([&] {
    const ToolState state = session->newest_state();
    const Eigen::Vector3d exact = -kStiffness_N_per_m * rt::to_vector(state.position_D_m);
    if (rt::Clock::now() >= next) {
      next = rt::Clock::now() + 16667us;
      session->push_sample(state.time_ns, state.position_D_m, rt::to_array(exact));
    }
    const double error_N = (rt::to_vector(state.commanded_force_D_N) - exact).norm();
    whole = state.force_gain >= 1.0 && error_N < 0.1 * exact.norm() ? whole + 1 : 0;
    return whole == 100;
  }));

  // A callback that lasts: zero at once, although samples are young enough to go on from.
  session->busy();
  ASSERT_TRUE(wait_until([&] {
    const ToolState state = session->newest_state();
    session->push_sample(state.time_ns, state.position_D_m, {0.0, 0.0, 1.0});
    return state.held_back == static_cast<std::uint8_t>(servo::HeldBack::kDeadMan);
  }));
  EXPECT_EQ(force_N(*session), 0.0);
  EXPECT_TRUE(session->force_enabled());
  session->idle();
  EXPECT_TRUE(wait_until([&] {
    const ToolState state = session->newest_state();
    session->push_sample(state.time_ns, state.position_D_m, {0.0, 0.0, 1.0});
    std::this_thread::sleep_for(10ms);
    return force_N(*session) > 0.5;
  })) << "and back when it has returned";
}

}  // namespace
}  // namespace forcegrid::session
