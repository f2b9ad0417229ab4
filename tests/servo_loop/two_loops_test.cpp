// SPDX-License-Identifier: Apache-2.0
// Two loops in one process, each with a link of its own to one simulator: what they share is the
// stop, where their tools are, and each other's samples. Also for ThreadSanitizer, which sees
// whatever else they share.
#include <gtest/gtest.h>

#include <array>
#include <atomic>
#include <chrono>
#include <memory>
#include <thread>

#include "forcegrid/methods.h"
#include "forcegrid/pair_methods.h"
#include "link/simulator_endpoint.h"
#include "servo_loop/link_thread.h"
#include "servo_loop/pair_half.h"
#include "servo_loop/servo_loop.h"
#include "servo_loop/watched_run.h"
#include "tests/servo_loop/scripted_device.h"

namespace forcegrid::servo {
namespace {

using namespace std::chrono_literals;

constexpr auto kPatience = 60s;
constexpr double kOffset_m = 0.02;
constexpr double kRadius_m = 0.03;  // spheres that overlap by 20 mm

/// Counts the samples, and those that are another tool's; renders nothing.
class CountingMethod final : public ForceMethod {
 public:
  explicit CountingMethod(double own_N) : own_N_(own_N) {}

  const char* name() const noexcept override { return "counting"; }
  std::size_t memory_bytes() const noexcept override { return sizeof(*this); }
  void take_sample(const Sample& sample) noexcept override {
    strange += sample.force_W.x() == own_N_ ? 0 : 1;
    ++samples;
  }
  void contact_made(std::uint32_t, const Eigen::Vector3d&) noexcept override {}
  void contact_lost() noexcept override {}
  int work(int) noexcept override { return 0; }
  ForceEstimate force(double, const Eigen::Vector3d&) const noexcept override {
    ForceEstimate estimate;
    estimate.status = EstimateStatus::kOk;
    return estimate;
  }

  std::atomic<int> samples{0};
  std::atomic<int> strange{0};

 private:
  double own_N_;
};

/// One device with everything that is its own.
struct Arm {
  Arm(const std::string& simulator, link::ToolId tool, ToolExchange& exchange, PairExchange& pair)
      : profile(profiles::load_device_profile("woodenhaptics_v2015")),
        device(profile),
        method(tool),
        half(make_pair_force_method("auto-6d", {}), make_force_method("hold", {}), pair, tool - 1U),
        link(simulator, ports, {}, tool) {
    ServoOptions options;
    options.check_motors = false;
    options.watch_encoders = false;
    options.report_timeout = 600s;  // the device's one report lasts for the test
    options.workspace.W_origin_D = {0.0, tool == 1 ? kOffset_m : -kOffset_m, 0.0};
    options.tool_touch = {.exchange = &exchange,
                          .tool = tool - 1U,
                          .stiffness_N_per_m = 10.0,
                          .shape = contact::ToolShape::sphere(kRadius_m)};
    device.show(Eigen::Vector3d::Zero(), rt::Clock::now());
    loop = std::make_unique<ServoLoop>(device, profile, std::vector<ForceMethod*>{&method, &half},
                                       ports, options);
  }

  profiles::DeviceProfile profile;
  ScriptedDevice device;
  CountingMethod method;
  PairHalf half;
  ServoPorts ports;
  LinkThread link;
  std::unique_ptr<ServoLoop> loop;
  ServoOutcome outcome;
};

// What a loop tells the other ones of how much its hand gets.
double told_gain(const Eigen::Vector3d& position_D) {
  const auto profile = profiles::load_device_profile("woodenhaptics_v2015");
  ScriptedDevice device(profile);
  CountingMethod method(1.0);
  ServoPorts ports;
  ToolExchange exchange(2);
  ServoOptions options;
  options.check_motors = false;
  options.needs_samples = false;
  options.tool_touch = {.exchange = &exchange, .tool = 0, .stiffness_N_per_m = 10.0};
  ServoLoop loop(device, profile, {&method}, ports, options);
  rt::TimePoint now(10s);
  for (int i = 0; i < 500; ++i) {
    now += 2ms;
    device.show(position_D, now);
    EXPECT_EQ(loop.run_cycle(now, now + 2ms), Fault::kNone);
    for (CycleRecord record; ports.records.pop(record);) {
    }
  }
  ToolPlace place;
  EXPECT_TRUE(exchange.fetch(1, 0, place));
  EXPECT_NEAR(place.position_W_m[2], position_D.z(), 1e-4);
  return place.gain;
}

TEST(ToolsOfLoops, AHandBeyondItsBoxGetsNoForceAndSaysSo) {
  EXPECT_EQ(told_gain(Eigen::Vector3d::Zero()), 1.0);
  EXPECT_EQ(told_gain({0.0, 0.0, 0.061}), 0.0) << "the box ends at 60 mm";
}

TEST(TwoLoops, EachFeelsItsOwnToolAndOneStopEndsBothAtZeroCurrent) {
  link::SimulatorEndpoint endpoint("127.0.0.1:0", 1h, {}, 2);
  std::atomic<bool> simulated{true};
  std::array<std::atomic<double>, 2> y_m{};
  std::jthread simulator([&] {
    for (int tick = 1; simulated; ++tick) {
      std::this_thread::sleep_for(5ms);  // so that both are answered by one solution
      const auto news = endpoint.receive_all(0ms);
      for (std::size_t place = 0; place < 2; ++place) {
        if (news[place].tool_state) {
          link::ForceSample sample = link::answer_to(*news[place].tool_state);
          sample.force_W_N[0] = endpoint.tool(place);
          sample.converged = true;
          sample.in_contact = true;
          sample.contact_epoch = 1;
          sample.solve_time_s = 1e-6 * tick;
          endpoint.send(sample, place);
          y_m[endpoint.tool(place) - 1U] = sample.position_W_m[1];
        }
      }
    }
  });
  const std::string address = link::to_string(endpoint.address());
  ToolExchange exchange(2);
  PairExchange pair;
  std::array<std::unique_ptr<Arm>, 2> arms = {std::make_unique<Arm>(address, 1, exchange, pair),
                                              std::make_unique<Arm>(address, 2, exchange, pair)};
  std::atomic<bool> stop{false};
  const auto give_up = rt::Clock::now() + kPatience;
  {
    std::vector<std::jthread> threads;
    for (const auto& arm : arms) {
      arm->link.start();
      threads.emplace_back([&] {
        arm->outcome = run_watched(
            *arm->loop, stop, 0.0, [&] { stop = true; },
            [&] {
              std::this_thread::sleep_for(2ms);
              if ((arms[0]->method.samples >= 60 && arms[1]->method.samples >= 60) ||
                  rt::Clock::now() > give_up) {
                stop = true;
              }
            });
      });
    }
  }
  for (const auto& arm : arms) {
    arm->link.stop();
  }
  simulated = false;
  simulator.join();
  for (const auto& arm : arms) {
    EXPECT_GE(arm->method.samples, 60);
    EXPECT_GT(arm->half.counters()[5].value, 10U) << arm->half.counters()[5].name;
    EXPECT_EQ(arm->method.strange, 0) << "a sample of the other tool";
    EXPECT_GT(arm->outcome.cycles_touching_tools, 0U);
    EXPECT_LE(arm->outcome.largest_tool_force_N, 10.0 * 0.02 + 1e-3);
    EXPECT_EQ(arm->outcome.fault, Fault::kNone);
    EXPECT_TRUE(arm->outcome.zero_current_delivered);
    EXPECT_TRUE(arm->device.stopped);
  }
  // The same pose of both arms, at two places of the scene.
  EXPECT_NEAR(y_m[0], -kOffset_m, 1e-4);
  EXPECT_NEAR(y_m[1], kOffset_m, 1e-4);
}

}  // namespace
}  // namespace forcegrid::servo
