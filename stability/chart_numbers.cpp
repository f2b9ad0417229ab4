// SPDX-License-Identifier: Apache-2.0
#include "stability/chart_numbers.h"

#include <algorithm>
#include <cmath>
#include <cstdio>

namespace forcegrid::stability {
namespace {

// Figures of one kind, of which the worst counts.
class Worst {
 public:
  Worst(std::string name, double goal, bool at_least, std::string unit) {
    number_.name = std::move(name);
    number_.goal = goal;
    number_.at_least = at_least;
    number_.unit = std::move(unit);
  }
  // A figure that could not be measured counts as the worst.
  void add(double value, const StabilityCase& cell) {
    const double hopeless = number_.at_least ? -1.0 : 1.0;
    value = std::isnan(value) ? hopeless * std::numeric_limits<double>::infinity() : value;
    if (!number_.known() ||
        (number_.at_least ? value < number_.measured : value > number_.measured)) {
      number_.measured = value;
      number_.worst = place_of(cell);
    }
  }
  const StabilityNumber& number() const { return number_; }

 private:
  static std::string place_of(const StabilityCase& cell) {
    char text[200];
    std::snprintf(text, sizeof text, "%s, %s hand, %s at %g Hz", cell.scene.c_str(),
                  cell.hand.c_str(), cell.timing.c_str(), cell.servo_rate_Hz);
    std::string place = text;
    if (cell.method != kExact) {
      std::snprintf(text, sizeof text, "; simulator %g Hz, delay %g ms, loss %g %%",
                    cell.simulator_rate_Hz, 1e3 * cell.delay_s, 100.0 * cell.loss);
      place += text;
    }
    std::snprintf(text, sizeof text, "; K %g N/m", cell.stiffness_N_per_m);
    return cell.method + ": " + place + (cell.find_limit ? "" : text);
  }
  StabilityNumber number_;
};

class Numbers {
 public:
  Numbers(const StabilityChart& chart, const std::string& default_method)
      : rows_(chart.rows), swept_(chart.swept), default_(default_method) {}

  std::vector<StabilityNumber> all() {
    linear();
    map();
    open_loop();
    second_contact();
    light_hand();
    guard();
    guarded_map();
    guarded_scenes();
    stress();
    sweep();
    return numbers_;
  }

 private:
  // The row of the exact force in the same loop.
  const StabilityRow* exact_of(const StabilityCase& cell) const {
    return find([&](const StabilityCase& each) {
      return each.method == kExact && each.part == cell.part && each.scene == cell.scene &&
             each.device == cell.device && each.hand == cell.hand && each.timing == cell.timing &&
             each.servo_rate_Hz == cell.servo_rate_Hz && each.guard == cell.guard &&
             each.find_limit == cell.find_limit && each.stiffness_N_per_m == cell.stiffness_N_per_m;
    });
  }
  template <typename Wanted>
  const StabilityRow* find(const Wanted& wanted) const {
    const auto found = std::find_if(rows_.begin(), rows_.end(),
                                    [&](const StabilityRow& row) { return wanted(row.cell); });
    return found == rows_.end() ? nullptr : &*found;
  }
  template <typename Visit>
  void each(const char* wanted_part, const Visit& visit) const {
    for (const StabilityRow& row : rows_) {
      if (row.cell.part == wanted_part) {
        visit(row);
      }
    }
  }
  template <typename Visit>
  void each_default(const char* wanted_part, const Visit& visit) const {
    each(wanted_part, [&](const StabilityRow& row) {
      if (row.cell.method == default_) {
        visit(row);
      }
    });
  }
  void put(const Worst& worst) { numbers_.push_back(worst.number()); }

  void sweep() {
    StabilityNumber force;
    force.name = "fault sweep: runs with a force above the limit";
    StabilityNumber energy;
    energy.name = "fault sweep: runs with more than 1 mJ after the fault";
    if (!swept_.empty()) {
      force.measured = energy.measured = 0.0;
    }
    for (const SweepLine& line : swept_) {
      force.measured += line.force_above_limit;
      energy.measured += line.energy_after_fault;
      const std::string where = line.device + ": " + to_string(line.fault);
      if (line.force_above_limit > 0) {
        force.worst += (force.worst.empty() ? "" : ", ") + where;
      }
      if (line.energy_after_fault > 0) {
        energy.worst += (energy.worst.empty() ? "" : ", ") + where;
      }
    }
    numbers_.push_back(force);
    numbers_.push_back(energy);
  }

  void linear() {
    Worst worst("linear plant: boundary of exact and hold from the eigenvalues", 10.0, false, "%");
    each(part::kLinear, [&](const StabilityRow& row) {
      const double expected = eigenvalue_limit_of(row.cell);
      if (expected > 1.1 * StiffnessScan::kLeast_N_per_m &&
          expected < 0.95 * StiffnessScan::kMost_N_per_m) {
        worst.add(100.0 * std::abs(row.limit.largest_stable_N_per_m / expected - 1.0), row.cell);
      }
    });
    put(worst);
  }

  void map() {
    Worst ratio("largest stable stiffness over the exact force's, in every hand", 0.95, true, "");
    Worst unheld("largest stable stiffness over the exact force's, nobody holding", 0.95, true, "");
    Worst error("closed-loop force error at 200 N/m, light and firm, 30 Hz, no delay", 0.3, false,
                "%");
    each_default(part::kMap, [&](const StabilityRow& row) {
      if (row.cell.servo_rate_Hz > 1000.0 || row.cell.loss > 0.0) {
        return;
      }
      if (const StabilityRow* exact = exact_of(row.cell)) {
        (row.cell.hand == "none" ? unheld : ratio)
            .add(row.limit.largest_stable_N_per_m / exact->limit.largest_stable_N_per_m, row.cell);
      }
      if (row.cell.simulator_rate_Hz == 30.0 && row.cell.delay_s == 0.0 &&
          (row.cell.hand == "light" || row.cell.hand == "firm")) {
        error.add(
            row.run.behaviour == Behaviour::kStable ? row.run.force_error_percent : std::nan(""),
            row.cell);
      }
    });
    put(ratio);
    put(unheld);
    put(error);
  }

  void open_loop() {
    for (const auto& [scene, goal] :
         {std::pair{"cut", 3.5}, std::pair{"slide", 2.0}, std::pair{"relaxation", 2.5},
          std::pair{"kelvin_voigt_5ms", 2.0}, std::pair{"kelvin_voigt_20ms", 2.5},
          std::pair{"kelvin_voigt_100ms", 8.0}, std::pair{"dynamic_5ms", 2.0},
          std::pair{"dynamic_20ms", 2.5}, std::pair{"dynamic_100ms", 8.0}}) {
      Worst error(std::string("open loop, ") + scene + ", after 1 s", goal, false, "%");
      each_default(part::kOpen, [&, wanted = std::string(scene)](const StabilityRow& row) {
        if (row.cell.scene == wanted) {
          error.add(row.run.force_error_percent, row.cell);
        }
      });
      put(error);
    }
  }

  void second_contact() {
    Worst error("second contact, closed loop, light hand, 25-200 N/m", 0.5, false, "%");
    Worst wander("second contact, the same: peak to peak at rest", 0.3, false, "mm");
    each_default(part::kScene, [&](const StabilityRow& row) {
      if (row.cell.scene == "second_contact" && row.cell.hand == "light") {
        error.add(row.run.force_error_percent, row.cell);
        wander.add(1e3 * row.run.hold_peak_to_peak_m, row.cell);
      }
    });
    put(error);
    put(wander);
  }

  void light_hand() {
    for (const auto& [scene, goal_percent] :
         {std::pair{"viscous", 1.0}, std::pair{"relaxation", 2.0}, std::pair{"cut", 4.0}}) {
      const std::string name = std::string("light hand, ") + scene;
      Worst ratio(name + ": largest stable stiffness over the exact force's", 0.6, true, "");
      Worst ideal(name + ": largest stable stiffness, ideal device", 1600.0, true, "N/m");
      Worst error(name + ": force error at 200 N/m", goal_percent, false, "%");
      each_default(part::kScene, [&, wanted = std::string(scene)](const StabilityRow& row) {
        if (row.cell.scene != wanted || row.cell.hand != "light") {
          return;
        }
        error.add(row.run.force_error_percent, row.cell);
        const StabilityRow* exact = exact_of(row.cell);
        if (row.cell.find_limit && exact != nullptr) {
          ratio.add(row.limit.largest_stable_N_per_m / exact->limit.largest_stable_N_per_m,
                    row.cell);
        }
        if (row.cell.find_limit && row.cell.timing == "ideal") {
          ideal.add(row.limit.largest_stable_N_per_m, row.cell);
        }
      });
      put(ratio);
      put(ideal);
      put(error);
    }
  }

  void guard() {
    Worst error("passivity guard: force error added at 200 N/m", 0.3, false, "points");
    Worst rattle("passivity guard: rattle at rest, encoders of 23 um", 1.0, false, "mN");
    Worst stiffness("passivity guard: largest stable stiffness over that without", 1.0, true, "");
    each_default(part::kGuard, [&](const StabilityRow& on) {
      if (!on.cell.guard || on.cell.hand == "none") {
        return;
      }
      StabilityCase wanted = on.cell;
      wanted.guard = false;
      const std::string text = wanted.text();
      const StabilityRow* off =
          find([&](const StabilityCase& each) { return each.text() == text; });
      if (off != nullptr) {
        error.add(on.run.force_error_percent - off->run.force_error_percent, on.cell);
        rattle.add(1e3 * on.run.rattle_N, on.cell);
        stiffness.add(on.limit.largest_stable_N_per_m / off->limit.largest_stable_N_per_m, on.cell);
      }
    });
    put(error);
    put(rattle);
    put(stiffness);
  }

  // As in `run`, compared with the exact force without a guard.
  void guarded_map() {
    Worst ratio("with the guard: largest stable stiffness over the bare exact force's, every hand",
                0.95, true, "");
    Worst unheld("the same, nobody holding", 0.95, true, "");
    each_default(part::kGuard, [&](const StabilityRow& row) {
      if (!row.cell.guard || row.cell.loss > 0.0) {
        return;
      }
      StabilityCase bare = row.cell;
      bare.part = part::kMap;
      bare.guard = false;
      if (const StabilityRow* exact = exact_of(bare)) {
        (row.cell.hand == "none" ? unheld : ratio)
            .add(row.limit.largest_stable_N_per_m / exact->limit.largest_stable_N_per_m, row.cell);
      }
    });
    put(ratio);
    put(unheld);
  }

  void guarded_scenes() {
    for (const auto& [scene, goal_percent] :
         {std::pair{"dynamic_5ms", 2.0}, std::pair{"dynamic_20ms", 2.5},
          std::pair{"dynamic_100ms", 8.0}}) {
      Worst error(std::string("with the guard: closed-loop force error at 200 N/m, ") + scene,
                  goal_percent, false, "%");
      each_default(part::kGuard, [&, wanted = std::string(scene)](const StabilityRow& row) {
        if (row.cell.guard && row.cell.scene == wanted) {
          error.add(
              row.run.behaviour == Behaviour::kStable ? row.run.force_error_percent : std::nan(""),
              row.cell);
        }
      });
      put(error);
    }
  }

  void stress() {
    Worst energy("30 % loss and 200 ms, any method, guard on: energy to the hand at 200 N/m", 1.0,
                 false, "mJ");
    Worst unheld("the same, nobody holding", 1.0, false, "mJ");
    Worst force("30 % loss and 200 ms, any method, guard on: largest force", 7.9, false, "N");
    each(part::kStress, [&](const StabilityRow& row) {
      if (row.cell.guard) {
        (row.cell.hand == "none" ? unheld : energy)
            .add(1e3 * row.run.most_energy_to_hand_J, row.cell);
        // The limit itself may be exceeded by rounding.
        force.add(std::floor(1e6 * row.run.largest_force_N + 0.5) * 1e-6, row.cell);
      }
    });
    put(energy);
    put(unheld);
    put(force);
  }

  const std::vector<StabilityRow>& rows_;
  const std::vector<SweepLine>& swept_;
  std::string default_;
  std::vector<StabilityNumber> numbers_;
};

}  // namespace

std::vector<StabilityNumber> numbers_of(const StabilityChart& chart,
                                        const std::string& default_method) {
  return Numbers(chart, default_method).all();
}

}  // namespace forcegrid::stability
