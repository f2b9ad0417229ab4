// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <array>
#include <cmath>
#include <cstdint>
#include <deque>
#include <functional>
#include <memory>
#include <string>
#include <utility>
#include <vector>

#include "forcegrid/methods.h"
#include "forcegrid/pair_methods.h"
#include "servo_loop/pair_half.h"
#include "stability/pair_object.h"

namespace forcegrid::servo {

/// Two servo loops that hold stability::SpringPair, in simulated time and on one thread. The
/// hands' paths are given; the loops' cycles are half a period apart. A simulator of 30 Hz solves
/// for both tools where they were in the newest cycle of each, and answers 33 ms later.
class TwoHalves {
 public:
  static constexpr double kPeriod_s = 0.002;
  static constexpr double kTick_s = 1.0 / 30.0;
  static constexpr double kStiffness_N_per_m = 400.0;

  using Path = std::function<Eigen::Vector3d(double time_s)>;  ///< from where the tool touched

  /// A cycle of one of the loops.
  struct Cycle {
    double time_s;
    ForceEstimate estimate;
    Eigen::Vector3d exact_W;  ///< with both tools where they are now
    /// Of one pair method that knows where both tools are now, and gets the same pairs of answers.
    Eigen::Vector3d ideal_W;
  };

  TwoHalves(const std::string& method, const std::string& alone, std::array<Path, 2> paths)
      : TwoHalves([&] { return make_pair_force_method(method, {}); },
                  [&] { return make_force_method(alone, {}); }, std::move(paths)) {}
  TwoHalves(const std::function<std::unique_ptr<PairForceMethod>()>& method,
            const std::function<std::unique_ptr<ForceMethod>()>& alone, std::array<Path, 2> paths)
      : paths_(std::move(paths)) {
    for (std::size_t tool = 0; tool < 2; ++tool) {
      halves[tool] = std::make_unique<PairHalf>(method(), alone(), exchange, tool);
    }
    ideal_ = method();
    PairVector points;
    points << point_W(0), point_W(1);
    ideal_->contacts_made(1, points);
  }

  /// [m] Where a tool touched, in W.
  static Eigen::Vector3d point_W(std::size_t tool) {
    return {0.01, tool == 0 ? -0.025 : 0.025, 0.03};
  }
  Eigen::Vector3d position_W(std::size_t tool, double time_s) const {
    return point_W(tool) + paths_[tool](time_s);
  }

  void run_until(double end_s) {
    for (; static_cast<double>(half_cycle_) * 0.5 * kPeriod_s < end_s; ++half_cycle_) {
      const double now_s = kStart_s + static_cast<double>(half_cycle_) * 0.5 * kPeriod_s;
      const std::size_t tool = half_cycle_ % 2;
      if (now_s - kStart_s >= static_cast<double>(tick_) * kTick_s) {
        solve(now_s);
        ++tick_;
      }
      if (runs[tool]) {
        cycle(tool, now_s);
      }
    }
  }

  std::uint64_t counted(std::size_t tool, const std::string& name) const {
    for (const NamedCounter& counter : halves[tool]->counters()) {
      if (counter.name == name) {
        return counter.value;
      }
    }
    return ~0ULL;
  }

  /// [%] RMS over the cycles from `from_s` on.
  double error_percent(std::size_t tool, double from_s, bool of_ideal = false) const {
    double error_N2 = 0.0;
    double exact_N2 = 0.0;
    for (const Cycle& cycle : cycles[tool]) {
      if (cycle.time_s >= kStart_s + from_s) {
        const Eigen::Vector3d& force_W = of_ideal ? cycle.ideal_W : cycle.estimate.force_W;
        error_N2 += (force_W - cycle.exact_W).squaredNorm();
        exact_N2 += cycle.exact_W.squaredNorm();
      }
    }
    return 100.0 * std::sqrt(error_N2 / exact_N2);
  }

  /// [N] Largest change of the force from cycle to cycle from `from_s` on.
  double largest_step_N(std::size_t tool, double from_s) const {
    double step_N = 0.0;
    for (std::size_t i = 1; i < cycles[tool].size(); ++i) {
      if (cycles[tool][i].time_s >= kStart_s + from_s) {
        step_N = std::max(
            step_N,
            (cycles[tool][i].estimate.force_W - cycles[tool][i - 1].estimate.force_W).norm());
      }
    }
    return step_N;
  }

  static constexpr double kStart_s = 100.0;  ///< the clock's time when a run begins
  PairExchange exchange;
  std::array<std::unique_ptr<PairHalf>, 2> halves;
  std::array<bool, 2> runs{true, true};
  std::array<bool, 2> holds{true, true};
  /// Whether the answer to this tool of this tick is lost on the way.
  std::function<bool(std::size_t tool, std::uint64_t tick)> lost = [](auto...) { return false; };
  bool tells_solution = true;
  bool tells_stiffness = false;
  /// What becomes of an answer with a stiffness on the way.
  std::function<void(std::size_t tool, std::uint64_t tick, Sample& sample)> change_answer =
      [](std::size_t, std::uint64_t, Sample&) {};
  std::array<std::vector<Cycle>, 2> cycles;

 private:
  struct Answer {
    double arrives_s;
    bool in_contact;
    Sample sample;
  };

  static Eigen::Vector3d of_tool(const PairVector& both, std::size_t tool) {
    return both.segment<3>(static_cast<Eigen::Index>(3 * tool));
  }

  // On a tool that holds the object; the other one may be off it.
  Eigen::Vector3d force_W(std::size_t tool, const Eigen::Vector3d& own_W,
                          const Eigen::Vector3d& other_W) {
    if (!holds[1 - tool]) {
      return -kStiffness_N_per_m * (own_W - point_W(tool));  // softer or stiffer: another object
    }
    PairVector displacements;
    displacements.segment<3>(static_cast<Eigen::Index>(3 * tool)) = own_W - point_W(tool);
    displacements.segment<3>(static_cast<Eigen::Index>(3 * (1 - tool))) =
        other_W - point_W(1 - tool);
    return of_tool(object_.forces_N(displacements), tool);
  }

  PairMatrix stiffness_W() {
    PairVector at_m;
    at_m << seen_W_[0] - point_W(0), seen_W_[1] - point_W(1);
    object_.forces_N(at_m);
    return object_.stiffness_N_per_m().value();
  }

  // As SharedContact: when one tool's contact changes, the other one's epoch does, too.
  void solve(double now_s) {
    for (std::size_t tool = 0; tool < 2; ++tool) {
      if (held_[tool] != holds[tool]) {
        held_[tool] = holds[tool];
        ++epoch_[0];
        epoch_[1] += 3;
      }
    }
    for (std::size_t tool = 0; tool < 2; ++tool) {
      if (!runs[tool] || lost(tool, tick_) || !seen_[tool]) {
        continue;
      }
      Answer answer{now_s + kTick_s, holds[tool], {}};
      answer.sample.time_s = time_s_[tool];
      answer.sample.position_W = seen_W_[tool];
      answer.sample.force_W =
          holds[tool] ? force_W(tool, seen_W_[tool], seen_W_[1 - tool]) : Eigen::Vector3d::Zero();
      answer.sample.contact_epoch = epoch_[tool];
      answer.sample.contact_point_W = point_W(tool);
      answer.sample.converged = true;
      answer.sample.solution = tells_solution ? 1 + tick_ : 0;
      if (tells_stiffness && holds[0] && holds[1]) {
        const PairMatrix slope = stiffness_W();
        const auto own = static_cast<Eigen::Index>(3 * tool);
        const auto other = static_cast<Eigen::Index>(3 * (1 - tool));
        answer.sample.has_stiffness = answer.sample.has_influence = true;
        answer.sample.stiffness_W = slope.block<3, 3>(own, own);
        answer.sample.influence_W = slope.block<3, 3>(own, other);
        answer.sample.other_position_W = seen_W_[1 - tool];
        change_answer(tool, tick_, answer.sample);
      }
      under_way_[tool].push_back(answer);
    }
    if (!lost(0, tick_) && !lost(1, tick_) && seen_[0] && seen_[1]) {
      PairSample both;
      both.time_s = now_s;
      both.positions_W << seen_W_[0], seen_W_[1];
      both.forces_W << force_W(0, seen_W_[0], seen_W_[1]), force_W(1, seen_W_[1], seen_W_[0]);
      ideal_under_way_.push_back({now_s + kTick_s, both});
    }
  }

  Eigen::Vector3d ideal_W(std::size_t tool, double now_s) {
    while (!ideal_under_way_.empty() && ideal_under_way_.front().first <= now_s) {
      ideal_->take_sample(ideal_under_way_.front().second);
      ideal_under_way_.pop_front();
    }
    PairVector at_W;
    at_W << position_W(0, now_s - kStart_s), position_W(1, now_s - kStart_s);
    ideal_->observe(now_s, at_W);
    const PairVector both_W = ideal_->forces(now_s, at_W).forces_W;
    if (tool == 0) {
      ideal_->work(500);
    }
    return of_tool(both_W, tool);
  }

  // As SampleIntake and ServoLoop call a method.
  void cycle(std::size_t tool, double now_s) {
    PairHalf& half = *halves[tool];
    while (!under_way_[tool].empty() && under_way_[tool].front().arrives_s <= now_s) {
      const Answer& answer = under_way_[tool].front();
      if (answer.in_contact && answer.sample.contact_epoch != known_epoch_[tool]) {
        half.contact_made(answer.sample.contact_epoch, answer.sample.contact_point_W);
        known_epoch_[tool] = answer.sample.contact_epoch;
      } else if (!answer.in_contact && known_epoch_[tool] != 0) {
        half.contact_lost();
        known_epoch_[tool] = 0;
      }
      if (answer.in_contact) {
        half.take_sample(answer.sample);
      }
      under_way_[tool].pop_front();
    }
    const Eigen::Vector3d at_W = position_W(tool, now_s - kStart_s);
    half.observe(now_s, at_W);
    cycles[tool].push_back({now_s, half.force(now_s, at_W),
                            force_W(tool, at_W, position_W(1 - tool, now_s - kStart_s)),
                            ideal_W(tool, now_s)});
    half.work(1000);
    seen_W_[tool] = at_W;
    time_s_[tool] = now_s;
    seen_[tool] = true;
  }

  std::unique_ptr<PairForceMethod> ideal_;
  std::deque<std::pair<double, PairSample>> ideal_under_way_;  ///< with its time of arrival
  stability::SpringPair object_{kStiffness_N_per_m};
  std::array<Path, 2> paths_;
  std::uint64_t half_cycle_ = 0;
  std::uint64_t tick_ = 0;
  std::array<std::uint32_t, 2> epoch_{1, 1};
  std::array<std::uint32_t, 2> known_epoch_{0, 0};
  std::array<bool, 2> held_{true, true};
  std::array<bool, 2> seen_{false, false};
  std::array<double, 2> time_s_{};
  std::array<Eigen::Vector3d, 2> seen_W_{Eigen::Vector3d::Zero(), Eigen::Vector3d::Zero()};
  std::array<std::deque<Answer>, 2> under_way_;
};

}  // namespace forcegrid::servo
