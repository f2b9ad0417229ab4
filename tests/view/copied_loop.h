// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <gtest/gtest.h>

#include <chrono>
#include <cmath>
#include <deque>
#include <memory>
#include <numbers>
#include <string>
#include <utility>
#include <vector>

#include "cli/run/view_feed.h"
#include "forcegrid/method_variant.h"
#include "forcegrid/methods.h"
#include "rt/vectors.h"
#include "servo_loop/servo_loop.h"
#include "tests/servo_loop/scripted_device.h"
#include "view/method_copies.h"

namespace forcegrid::view {

inline MethodOptions options_of_methods() {
  MethodOptions options;
  options.grid.min_W = Eigen::Vector3d::Constant(-0.05);
  options.grid.max_W = Eigen::Vector3d::Constant(0.05);
  options.grid.cells = {24, 24, 24};
  return options;
}

// A stiffening spring below z = 0.
inline servo::ArrivedSample answer(const Eigen::Vector3d& position_W, double time_s,
                                   bool requested) {
  servo::ArrivedSample arrived;
  arrived.sample.time_s = time_s;
  arrived.sample.position_W = position_W;
  arrived.sample.from_query = requested;
  arrived.in_contact = requested || position_W.z() < 0.0;
  arrived.sample.contact_point_W = Eigen::Vector3d(position_W.x(), position_W.y(), 0.0);
  if (arrived.in_contact) {
    const Eigen::Vector3d moved(0.3 * position_W.x(), 0.2 * position_W.y(), position_W.z());
    arrived.sample.force_W = -(120.0 + 4000.0 * moved.norm()) * moved;
  }
  return arrived;
}

class CopiedLoop : public testing::Test {
 protected:
  // A loop with these methods, whose tool presses, slides about and leaves the object. Each
  // arrival and each record goes to `take`, as over the feed.
  template <typename Take>
  void run(int cycles, const Take& take) {
    servo::ServoOptions options;
    options.check_motors = false;
    options.watch_encoders = false;
    options.requests_per_s = kRequests_per_s;
    options.fill_budget = kFillBudget;
    servo::ServoLoop loop(device_, profile_, methods_, ports_, options);
    std::uint32_t epoch = 0;
    bool touching = false;
    std::deque<std::pair<Eigen::Vector3d, rt::TimePoint>> path;
    std::deque<std::pair<int, servo::ArrivedSample>> answers;
    for (int i = 0; i < cycles; ++i) {
      now_ += kPeriod;
      const double phase = 2.0 * std::numbers::pi * 1e-3 * i;
      const Eigen::Vector3d position(0.012 * std::sin(1.7 * phase), 0.009 * std::sin(2.3 * phase),
                                     0.004 - 0.012 * std::sin(phase));
      device_.show(position, now_ - std::chrono::milliseconds(1));
      path.emplace_back(position, now_);
      const auto arrive = [&](servo::ArrivedSample arrived) {
        arrived.sample.contact_epoch = epoch;
        arrived.arrived = now_;
        ASSERT_TRUE(ports_.samples.push(arrived));
        arrives(arrived);
        take(cli::sample_of(arrived));
      };
      if (path.size() > kLate && i % kCyclesPerSample == 0) {
        const auto& [then_W, when] = path[path.size() - 1 - kLate];
        const servo::ArrivedSample sample = answer(then_W, servo::servo_time_s(when), false);
        epoch += sample.in_contact && !touching ? 1 : 0;
        touching = sample.in_contact;
        arrive(sample);
      }
      while (!answers.empty() && answers.front().first <= i) {
        arrive(answers.front().second);
        answers.pop_front();
      }
      ASSERT_EQ(loop.run_cycle(now_, now_ + kPeriod), servo::Fault::kNone);
      link::Query query;
      while (ports_.queries.pop(query)) {
        answers.emplace_back(
            i + 15, answer(rt::to_vector(query.position_W_m), servo::servo_time_s(now_), true));
        ++requests_;
      }
      servo::CycleRecord record;
      while (ports_.records.pop(record)) {
        ends(record);
        take(cli::cycle_of(record));
      }
    }
  }

  // What a recorder would get, before `take` does.
  virtual void arrives(const servo::ArrivedSample& arrived) { static_cast<void>(arrived); }
  virtual void ends(const servo::CycleRecord& cycle) { static_cast<void>(cycle); }

  MethodCopies copies() const {
    return MethodCopies({.methods = names_,
                         .base = options_of_methods(),
                         .fill_budget = kFillBudget,
                         .requests_per_s = kRequests_per_s,
                         .max_force_N = profile_.limits.max_force_N});
  }

  void make_methods() {
    for (const std::string& name : names_) {
      const MethodVariant variant = parse_method_variant(name, options_of_methods());
      owned_.push_back(make_force_method(variant.name, variant.options));
      methods_.push_back(owned_.back().get());
    }
  }

  static constexpr std::chrono::milliseconds kPeriod{2};
  static constexpr int kCyclesPerSample = 16;
  static constexpr std::size_t kLate = 20;  // cycles from a tool state to its sample
  static constexpr double kRequests_per_s = 60.0;
  static constexpr int kFillBudget = 400;
  profiles::DeviceProfile profile_ = profiles::load_device_profile("woodenhaptics_v2015");
  servo::ScriptedDevice device_{profile_};
  std::vector<std::string> names_{"auto", "forcegrid", "kriging nug=1e-6"};
  std::vector<std::unique_ptr<ForceMethod>> owned_;
  std::vector<ForceMethod*> methods_;
  servo::ServoPorts ports_;
  rt::TimePoint now_{std::chrono::seconds(1000)};
  int requests_ = 0;
};

}  // namespace forcegrid::view
