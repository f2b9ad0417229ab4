// SPDX-License-Identifier: Apache-2.0
// Servo loop, link and simulator together: an approaching tool's method asks for forces at the
// contact that is to come, and knows the object when it touches.

#include <gtest/gtest.h>

#include <atomic>
#include <chrono>
#include <future>
#include <sstream>
#include <string>
#include <thread>

#include "forcegrid/kriging/kriging_method.h"
#include "servo_loop/link_thread.h"
#include "servo_loop/servo_loop.h"
#include "simulator/mesh/scene.h"
#include "simulator/run_simulator.h"
#include "simulator/solver/elastic_object.h"
#include "simulator/touch/sticky_contact.h"
#include "tests/servo_loop/scripted_device.h"
#include "tests/support/flushed_text.h"

namespace forcegrid::servo {
namespace {

using Eigen::Vector3d;
using std::chrono::steady_clock;

constexpr auto kPatience = std::chrono::seconds(30);
constexpr rt::Duration kPeriod = std::chrono::milliseconds(2);
constexpr double kSpeed_m_per_s = 0.040;
constexpr double kLowest_m = 0.001;
constexpr double kHighest_m = 0.011;
const Vector3d kTop_W(0.01, -0.02, 0.03);

class Simulation {
 public:
  Simulation() {
    options_.scene = "small";
    options_.listen = "127.0.0.1:0";
    options_.top_centre_W = kTop_W;
    options_.send_stiffness = false;
    summary_ = std::async(std::launch::async, [this] {
      std::ostream out(&text_);
      return simulator::run_simulator(options_, out, stop_);
    });
  }
  ~Simulation() { stop_ = true; }

  std::string address() {
    const auto give_up = steady_clock::now() + kPatience;
    while (text_.flushed().empty() && steady_clock::now() < give_up) {
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
    }
    std::istringstream words(text_.flushed());
    std::string word;
    words >> word >> word;
    return word;
  }

 private:
  simulator::SimulatorOptions options_;
  std::atomic<bool> stop_{false};
  FlushedText text_;
  std::future<simulator::SimulatorSummary> summary_;
};

TEST(Approach, IsUsedToAskForTheForcesOfTheContactToCome) {
  Simulation simulation;
  const profiles::DeviceProfile profile = profiles::load_device_profile("woodenhaptics_v2015");
  ScriptedDevice device(profile);
  KrigingMethod method(KrigingMethod::Kind::kContact, {});
  ServoPorts ports;
  ServoOptions options;
  options.requests_per_s = 120.0;
  options.check_motors = false;  // a scripted device does not move by its commands
  options.watch_encoders = false;
  ServoLoop loop(device, profile, {&method}, ports, options);
  LinkThread link(simulation.address(), ports);
  link.start();

  // Down and up above the surface until enough is known, then down to it. So a slow machine takes
  // longer, but nothing else.
  double height_m = kHighest_m;
  double direction = -1.0;
  bool touched = false;
  bool knows = false;
  int known_before_contact = 0;
  const auto give_up = steady_clock::now() + kPatience;
  while (!touched && steady_clock::now() < give_up) {
    std::this_thread::sleep_for(kPeriod);
    height_m += direction * kSpeed_m_per_s * 0.002;
    knows = knows || method.field().sample_count() >= 8;
    if (height_m < kLowest_m && !knows) {
      direction = 1.0;
    } else if (height_m > kHighest_m) {
      direction = -1.0;
    }
    height_m = std::max(height_m, -0.0005);
    const rt::TimePoint now = rt::Clock::now();
    device.show(kTop_W + Vector3d(0.0, 0.0, height_m), now - std::chrono::microseconds(500));
    ASSERT_EQ(loop.run_cycle(now, now + kPeriod), Fault::kNone);
    for (CycleRecord record; ports.records.pop(record);) {
      touched = touched || record.in_contact;
      if (!record.in_contact) {
        known_before_contact = method.field().sample_count();
        EXPECT_EQ(record.method_force_W_N[0][2], 0.0) << "in the air";
      }
    }
  }
  link.stop();
  ASSERT_TRUE(knows) << "no answers";
  ASSERT_TRUE(touched);
  ASSERT_TRUE(link.first_contact().has_value());
  EXPECT_GE(known_before_contact, 8);

  // Samples of the contact itself were taken at its point or next to it, so they do not show the
  // object's stiffness.
  simulator::ElasticObject<double> object(simulator::make_scene("small", kTop_W).mesh, {});
  const Vector3d point_W = link.first_contact()->point_W;
  ASSERT_GT(object.grab(point_W, simulator::ContactOptions{}.patch_radius_m), 0U);
  const double time_s = rt::seconds(rt::Clock::now().time_since_epoch());
  for (const Vector3d& d_m :
       {Vector3d(0.0, 0.0, 0.006), Vector3d(0.003, 0.0, 0.008), Vector3d(0.0, -0.004, 0.010)}) {
    const Vector3d reference_W = object.move_to(d_m).force_W;
    EXPECT_GT(reference_W.norm(), 0.3);
    EXPECT_LT((method.force(time_s, point_W + d_m).force_W - reference_W).norm(),
              0.05 * reference_W.norm());
  }
}

}  // namespace
}  // namespace forcegrid::servo
