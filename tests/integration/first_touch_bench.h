// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <gtest/gtest.h>

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <functional>
#include <optional>

#include "forcegrid/kriging/kriging_method.h"
#include "servo_loop/first_touch.h"
#include "simulator/touch/local_surface.h"
#include "simulator/touch/tool_contact.h"

namespace forcegrid::servo {

/// How a hand comes down: straight until the touch, then along the surface as it likes and more
/// and more slowly to kDepth_m.
struct Approach {
  static constexpr double kDepth_m = 0.004;

  Eigen::Vector3d velocity_W_m_per_s{0.01, 0.0, -0.05};
  Eigen::Vector3d along_W_m_per_s{0.01, 0.0, 0.0};  ///< from the touch on; no prediction knows it

  Eigen::Vector3d position_W(const Eigen::Vector3d& touch_W, double since_touch_s) const {
    if (since_touch_s < 0.0) {
      return touch_W + since_touch_s * velocity_W_m_per_s;
    }
    const double speed_m_per_s = -velocity_W_m_per_s.z();
    const double depth_m = kDepth_m * std::tanh(speed_m_per_s * since_touch_s / kDepth_m);
    return touch_W + since_touch_s * along_W_m_per_s - Eigen::Vector3d(0.0, 0.0, depth_m);
  }
};

/// What was felt of one touch, and what would have been felt without the servo's own surface.
struct TouchErrors {
  double with_percent = 0.0;  ///< in the first 67 ms, of the RMS force of the contact
  double without_percent = 0.0;
  double unanswered_percent = 0.0;  ///< until the first answer, of the RMS force until then
  int unanswered_cycles = 0;
  int cycles_to_force = -1;  ///< from the one that is inside first; 0 is that one itself
  int cycles_to_force_without = -1;
};

/// A servo and a simulator in simulated time, without processes or link: one approach to a place
/// that nobody has touched before.
class FirstTouchBench {
 public:
  static constexpr double kCycle_s = 0.002;
  static constexpr int kCyclesPerTick = 17;   // 29.4 answers a second
  static constexpr int kLatencyCycles = 5;    // 10 ms from a tool state to its sample
  static constexpr double kWindow_s = 0.067;  // as the method study has it
  static constexpr int kCyclesInAir = 40;
  static constexpr int kCycles = 50;

  simulator::ToolContact& tool;       ///< the simulator's
  simulator::ToolContact& reference;  ///< steps with every cycle
  simulator::LocalSurface& surface;
  /// Fills in what is felt of a touch that is expected there.
  std::function<void(const Eigen::Vector3d& expected_W, link::SurfacePatch& patch)> foretell;

  /// @param phase  the tick comes so many cycles after the touch.
  TouchErrors touch_at(const Eigen::Vector3d& touch_W, const Approach& approach, int phase) {
    KrigingMethod method(KrigingMethod::Kind::kContact, {});
    FirstTouch touch(10.0);
    std::optional<Message> on_its_way;
    Sums sums;
    TouchErrors errors;
    for (int i = -kCyclesInAir; i < kCycles; ++i) {
      const double time_s = 10.0 + kCycle_s * i;
      // The touch itself lies within the cycle before the first one inside.
      const double since_touch_s = kCycle_s * (i + 0.4);
      const Eigen::Vector3d position_W = approach.position_W(touch_W, since_touch_s);
      if (on_its_way && on_its_way->due == i) {
        deliver(*on_its_way, time_s, method, touch);
        on_its_way.reset();
      }
      tool.was_at(time_s, position_W);
      if ((i + 102 - phase) % kCyclesPerTick == 0) {
        on_its_way = tick(time_s, position_W, approach);
        on_its_way->due = i + kLatencyCycles;
      }
      method.observe(time_s, position_W);
      const Eigen::Vector3d alone_W = method.force(time_s, position_W).force_W;
      const Eigen::Vector3d felt_W = touch.force_W(time_s, position_W, alone_W);
      method.work(1'000'000);
      reference.tell_time(time_s);
      const Eigen::Vector3d reference_W = reference.step(position_W).equilibrium.force_W;
      if (i < 0) {
        EXPECT_EQ(felt_W, Eigen::Vector3d::Zero()) << "in the air";
        continue;
      }
      const auto first = [i](int known, const Eigen::Vector3d& force_W) {
        return known < 0 && force_W.norm() > 0.0 ? i : known;
      };
      errors.cycles_to_force = first(errors.cycles_to_force, felt_W);
      errors.cycles_to_force_without = first(errors.cycles_to_force_without, alone_W);
      sums.add(felt_W, alone_W, reference_W, touch.counts().answered == 0,
               since_touch_s < kWindow_s);
    }
    EXPECT_EQ(touch.counts().touches, 1U);
    EXPECT_EQ(touch.counts().answered, 1U);
    sums.tell(errors);
    return errors;
  }

 private:
  struct Message {
    int due = 0;
    Sample sample;
    bool in_contact = false;
    std::optional<link::SurfacePatch> patch;
  };
  struct Sums {
    double felt = 0.0;
    double alone = 0.0;
    double unanswered = 0.0;
    double reference = 0.0;
    double reference_unanswered = 0.0;
    int window = 0;
    int unanswered_cycles = 0;

    void add(const Eigen::Vector3d& felt_W, const Eigen::Vector3d& alone_W,
             const Eigen::Vector3d& reference_W, bool is_unanswered, bool in_window) {
      reference += reference_W.squaredNorm();
      if (is_unanswered) {
        ++unanswered_cycles;
        unanswered += (felt_W - reference_W).squaredNorm();
        reference_unanswered += reference_W.squaredNorm();
      }
      if (in_window) {
        ++window;
        felt += (felt_W - reference_W).squaredNorm();
        alone += (alone_W - reference_W).squaredNorm();
      }
    }
    void tell(TouchErrors& errors) const {
      const double rms_N = std::sqrt(reference / kCycles);
      errors.with_percent = 100.0 * std::sqrt(felt / window) / rms_N;
      errors.without_percent = 100.0 * std::sqrt(alone / window) / rms_N;
      errors.unanswered_cycles = unanswered_cycles;
      errors.unanswered_percent = 100.0 * std::sqrt(unanswered / reference_unanswered);
    }
  };

  static void deliver(const Message& message, double time_s, KrigingMethod& method,
                      FirstTouch& touch) {
    if (message.in_contact) {
      if (touch.counts().answered == 0) {
        method.contact_made(message.sample.contact_epoch, message.sample.contact_point_W);
      }
      method.take_sample(message.sample);
    }
    touch.answer(time_s, message.sample.time_s, message.in_contact, message.sample.contact_epoch);
    if (message.patch) {
      const auto surface = near_surface(*message.patch);
      ASSERT_TRUE(surface);
      touch.take(*surface);
    }
  }

  Message tick(double time_s, const Eigen::Vector3d& position_W, const Approach& approach) {
    tool.tell_time(time_s);
    const auto answer = tool.step(position_W);
    Message message;
    message.sample.time_s = time_s;
    message.sample.position_W = answer.position_W;
    message.sample.force_W = answer.equilibrium.force_W;
    message.sample.has_stiffness = answer.in_contact && answer.stiffness_known;
    message.sample.stiffness_W = answer.equilibrium.stiffness_W;
    message.sample.contact_epoch = answer.epoch;
    message.sample.contact_point_W = answer.point_W;
    message.sample.converged = answer.equilibrium.converged;
    message.in_contact = answer.in_contact;
    const auto expected_W = tool.expected_touch(position_W, approach.velocity_W_m_per_s, 0.3);
    if (!answer.in_contact && expected_W) {
      link::SurfacePatch patch;
      patch.echo_servo_time_ns = std::llround(1e9 * time_s);
      patch.position_W_m = {position_W.x(), position_W.y(), position_W.z()};
      surface.cut(expected_W, patch);
      foretell(*expected_W, patch);
      message.patch = patch;
    }
    return message;
  }
};

}  // namespace forcegrid::servo
