// SPDX-License-Identifier: Apache-2.0
#include "stability/pair_loop.h"

#include <algorithm>
#include <cmath>
#include <deque>
#include <stdexcept>
#include <utility>
#include <vector>

#include "evaluation/motions/pair_motions.h"
#include "servo_loop/pair_half.h"
#include "stability/settling.h"

namespace forcegrid::stability {
namespace {

using Eigen::Vector3d;

constexpr std::size_t kSides = 2;
constexpr double kErrorsFrom_s = 1.0;
constexpr double kLongest_s = 1.0;  // of a delay

PairVector contact_points_W() { return evaluation::PairMotion::contact_points_W(); }

Vector3d of_tool(const PairVector& both, std::size_t tool) {
  return both.segment<3>(static_cast<Eigen::Index>(3 * tool));
}

Vector3d target_W(std::size_t tool, double time_s) {
  const Vector3d first_W = StatedRun::target_W(time_s);
  return of_tool(contact_points_W(), tool) +
         (tool == 0 ? first_W : Vector3d(-first_W.y(), -first_W.x(), first_W.z()));
}

class PairRun {
 public:
  PairRun(const PairLoopSetup& setup, double stiffness_N_per_m, const PairMethodMaker& make_method)
      : setup_(setup) {
    check();
    object_ = setup.object(stiffness_N_per_m);
    for (std::size_t tool = 0; tool < kSides; ++tool) {
      Side& side =
          sides_.emplace_back(Plant(setup.device, setup.hand, of_tool(contact_points_W(), tool)));
      side.sampled_W = side.plant.position_W();
      side.method = make_method();
      if (side.method != nullptr) {
        side.method->contacts_made(1, contact_points_W());
      } else if (age(tool) > 0) {
        side.exact = setup.object(stiffness_N_per_m);
      }
    }
  }

  PairLoopResult run() {
    const double all_s = StatedRun::kMotion_s + setup_.hold_s;
    const auto cycles = static_cast<std::int64_t>(std::llround(all_s * setup_.servo_rate_Hz));
    std::int64_t cycle = 0;
    for (; cycle < cycles && !diverged(); ++cycle) {
      one_cycle(cycle);
    }
    return result(cycle);
  }

 private:
  struct Arriving {
    double arrives_s;
    PairSample sample;
  };
  struct Side {
    explicit Side(Plant device_and_hand) : plant(std::move(device_and_hand)) {}

    Plant plant;
    std::unique_ptr<PairForceMethod> method;
    // Without a method: of what this side knows, which is a path of its own where places are old.
    std::unique_ptr<PairObject> exact;
    std::deque<Arriving> under_way;
    std::deque<Vector3d> told_W;            // its places, the newest last
    Vector3d sampled_W = Vector3d::Zero();  // where the counts of the next cycle were taken
    Vector3d force_W = Vector3d::Zero();    // presently acting
    std::vector<Vector3d> held_W;
  };

  void check() const {
    if (!(setup_.servo_rate_Hz >= 50.0 && setup_.servo_rate_Hz <= 20000.0)) {
      throw std::invalid_argument("servo rate: use 50 to 20000 Hz");
    }
    if (!(setup_.simulator_rate_Hz > 0.0)) {
      throw std::invalid_argument("simulator rate: use more than 0 Hz");
    }
    for (const double delay_s :
         {setup_.delay_s[0], setup_.delay_s[1], setup_.other_age_s[0], setup_.other_age_s[1]}) {
      if (!(delay_s >= 0.0 && delay_s <= kLongest_s)) {
        throw std::invalid_argument("delay of a side: use 0 to 1 s");
      }
    }
    if (!(setup_.hold_s >= StatedRun::kJudged_s)) {
      throw std::invalid_argument("hold: use at least the 2 s that the criterion covers");
    }
    if (setup_.timing.count_age_s + setup_.timing.actuation_delay_s > 1.0 / setup_.servo_rate_Hz) {
      throw std::invalid_argument("device timing " + setup_.timing.name +
                                  ": age of the counts and delay of the force take longer than a "
                                  "cycle; use a lower servo rate or a quicker bus");
    }
  }

  std::int64_t cycle_ns(std::int64_t cycle) const {
    return std::llround(1e9 * static_cast<double>(cycle) / setup_.servo_rate_Hz);
  }

  bool moves(std::size_t tool) const { return tool == 0 || setup_.together; }

  bool diverged() const {
    return (setup_.stopping && setup_.stopping()) ||
           std::any_of(sides_.begin(), sides_.end(), [](const Side& side) {
             const Vector3d away_W = side.plant.position_W() - side.plant.target_W();
             return !away_W.allFinite() || !side.force_W.allFinite() ||
                    away_W.norm() > StatedRun::kDivergence_m;
           });
  }

  static PairVector forces_N(PairObject& object, const PairVector& positions_W) {
    return object.forces_N(positions_W - contact_points_W());
  }

  void publish(double now_s, const PairVector& measured_W) {
    while (static_cast<double>(tick_) / setup_.simulator_rate_Hz <= now_s + 1e-9) {
      const double tick_s = static_cast<double>(tick_++) / setup_.simulator_rate_Hz;
      PairSample sample;
      sample.time_s = now_s;
      sample.positions_W = measured_W;
      sample.forces_W = forces_N(*object_, measured_W);
      const auto stiffness_W = setup_.stiffness ? object_->stiffness_N_per_m() : std::nullopt;
      sample.has_stiffness = stiffness_W.has_value();
      sample.stiffness_W = stiffness_W.value_or(PairMatrix::Zero());
      sample.contact_epoch = 1;
      sample.contact_points_W = contact_points_W();
      for (std::size_t tool = 0; tool < kSides; ++tool) {
        sides_[tool].under_way.push_back(
            {tick_s + 1.0 / setup_.simulator_rate_Hz + setup_.delay_s[tool], sample});
      }
    }
  }

  // Both positions as a side knows them.
  PairVector known_to(std::size_t tool, const PairVector& measured_W) const {
    const std::deque<Vector3d>& told_W = sides_[1 - tool].told_W;
    const std::size_t newest = told_W.size() - 1 - std::min(told_W.size() - 1, age(tool));
    Vector3d other_W = told_W[newest];
    if (setup_.moved_on && newest > 1) {
      const double most = servo::PairHalf::kMostAhead_s * setup_.servo_rate_Hz;
      const Vector3d a_cycle_W = servo::end_velocity(told_W[newest] - told_W[newest - 1], 1.0,
                                                     told_W[newest - 1] - told_W[newest - 2], 1.0);
      other_W += std::min(static_cast<double>(age(tool)), most) * a_cycle_W;
    }
    PairVector known_W = measured_W;
    known_W.segment<3>(static_cast<Eigen::Index>(3 * (1 - tool))) = other_W;
    return known_W;
  }

  // [cycles] Of the other tool's place, where `tool` renders.
  std::size_t age(std::size_t tool) const {
    return static_cast<std::size_t>(std::llround(setup_.other_age_s[tool] * setup_.servo_rate_Hz));
  }

  void tell_places(const PairVector& measured_W) {
    for (std::size_t tool = 0; tool < kSides; ++tool) {
      std::deque<Vector3d>& told_W = sides_[tool].told_W;
      told_W.push_back(of_tool(measured_W, tool));
      if (told_W.size() > 3 + age(1 - tool)) {
        told_W.pop_front();
      }
    }
  }

  Vector3d rendered_W(std::size_t tool, double now_s, const PairVector& measured_W) {
    Side& side = sides_[tool];
    const PairVector known_W = known_to(tool, measured_W);
    PairVector both_N;
    if (side.method == nullptr) {
      both_N = forces_N(side.exact != nullptr ? *side.exact : *object_, known_W);
    } else {
      while (!side.under_way.empty() && side.under_way.front().arrives_s <= now_s + 1e-9) {
        side.method->take_sample(side.under_way.front().sample);
        side.under_way.pop_front();
      }
      side.method->observe(now_s, known_W);
      both_N = side.method->forces(now_s, known_W).forces_W;
    }
    return of_tool(both_N, tool);
  }

  void judge(double now_s, const PairVector& rendered_W, const PairVector& measured_W) {
    if (setup_.judged && now_s >= kErrorsFrom_s) {
      const PairVector exact_W = forces_N(*object_, measured_W);
      for (std::size_t tool = 0; tool < kSides; ++tool) {
        if (moves(tool)) {
          error_N2_ += (of_tool(rendered_W, tool) - of_tool(exact_W, tool)).squaredNorm();
          reference_N2_ += of_tool(exact_W, tool).squaredNorm();
        }
      }
    }
  }

  void one_cycle(std::int64_t cycle) {
    const std::int64_t now_ns = cycle_ns(cycle);
    const double now_s = 1e-9 * static_cast<double>(now_ns);
    PairVector measured_W;
    measured_W << sides_[0].plant.measured_W(sides_[0].sampled_W),
        sides_[1].plant.measured_W(sides_[1].sampled_W);
    publish(now_s, measured_W);
    tell_places(measured_W);
    PairVector wanted_W;
    wanted_W << rendered_W(0, now_s, measured_W), rendered_W(1, now_s, measured_W);
    judge(now_s, wanted_W, measured_W);
    for (std::size_t tool = 0; tool < kSides; ++tool) {
      if (sides_[tool].method != nullptr) {
        sides_[tool].method->work(setup_.fill_budget);
      }
      if (moves(tool)) {
        move(tool, cycle, limited(of_tool(wanted_W, tool)));
      }
    }
  }

  Vector3d limited(const Vector3d& wanted_W) const {
    const double size_N = wanted_W.norm();
    return size_N > setup_.device.max_force_N
               ? Vector3d(setup_.device.max_force_N / size_N * wanted_W)
               : wanted_W;
  }

  // To the next cycle: the force acts after the actuation's delay, the counts are taken before the
  // end by their age.
  void move(std::size_t tool, std::int64_t cycle, const Vector3d& wanted_W) {
    Side& side = sides_[tool];
    const std::int64_t now_ns = cycle_ns(cycle);
    const std::int64_t next_ns = cycle_ns(cycle + 1);
    const std::int64_t acts_ns = now_ns + std::llround(1e9 * setup_.timing.actuation_delay_s);
    const std::int64_t counted_ns = next_ns - std::llround(1e9 * setup_.timing.count_age_s);
    advance(tool, now_ns, acts_ns);
    side.force_W = wanted_W;
    advance(tool, acts_ns, counted_ns);
    side.sampled_W = side.plant.position_W();
    advance(tool, counted_ns, next_ns);
    const double held_from_s = StatedRun::kMotion_s + setup_.hold_s - StatedRun::kJudged_s;
    if (1e-9 * static_cast<double>(now_ns) >= held_from_s) {
      side.held_W.push_back(side.plant.position_W());
    }
  }

  void advance(std::size_t tool, std::int64_t from_ns, std::int64_t to_ns) {
    Side& side = sides_[tool];
    side.plant.advance(to_ns - from_ns, side.force_W,
                       target_W(tool, 1e-9 * static_cast<double>(to_ns)));
  }

  PairLoopResult result(std::int64_t cycle) const {
    PairLoopResult result;
    result.end_s = 1e-9 * static_cast<double>(cycle_ns(cycle));
    result.force_error_percent =
        reference_N2_ > 0.0 ? 100.0 * std::sqrt(error_N2_ / reference_N2_) : std::nan("");
    if (diverged()) {
      result.behaviour = Behaviour::kDivergence;
      result.hold_peak_to_peak_m = std::nan("");
      return result;
    }
    for (std::size_t tool = 0; tool < kSides; ++tool) {
      if (!moves(tool)) {
        continue;
      }
      const Settling settling = judge_settling(sides_[tool].held_W);
      result.hold_peak_to_peak_m = std::max(result.hold_peak_to_peak_m, settling.peak_to_peak_m);
      if (result.behaviour == Behaviour::kStable) {
        result.behaviour = settling.behaviour;
      }
    }
    return result;
  }

  const PairLoopSetup& setup_;
  std::unique_ptr<PairObject> object_;  // in the simulator, and for the judge
  std::vector<Side> sides_;
  std::int64_t tick_ = 0;
  double error_N2_ = 0.0;
  double reference_N2_ = 0.0;
};

}  // namespace

PairLoopResult run_pair_loop(const PairLoopSetup& setup, double stiffness_N_per_m,
                             const PairMethodMaker& make_method) {
  return PairRun(setup, stiffness_N_per_m, make_method).run();
}

}  // namespace forcegrid::stability
