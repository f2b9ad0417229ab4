// SPDX-License-Identifier: Apache-2.0
#include "stability/chart_cases.h"

#include <algorithm>
#include <cstdio>
#include <set>
#include <stdexcept>

#include "forcegrid/methods.h"
#include "stability/scenes.h"

namespace forcegrid::stability {
namespace {

struct Rate {
  double servo_rate_Hz;
  const char* timing;
};

const std::vector<Rate>& rates() {
  static const std::vector<Rate> all = {
      {500.0, "ideal"},  {500.0, "w2_full_speed"},  {1000.0, "ideal"}, {1000.0, "w2_full_speed"},
      {2000.0, "ideal"}, {2000.0, "w2_high_speed"}, {4000.0, "ideal"}, {4000.0, "w2_high_speed"}};
  return all;
}

// Methods that are designed for contacts, charted where contacts change.
constexpr const char* kContactMethods[] = {"kriging-contact", "kriging-hinge", "kriging-store"};

bool is_exact(const StabilityCase& cell) { return cell.method == kExact; }

class Cases {
 public:
  explicit Cases(const CaseSelection& selection)
      : quick_(selection.quick), parts_(selection.parts), hands_(selection.hands) {
    for (const std::string& hand : hands_) {
      hand_of(hand);
    }
    for (const std::string& each : parts_) {
      check_part(each);
    }
    methods_ = selection.methods.empty() ? chart_methods() : selection.methods;
    for (const std::string& needed : {std::string(kExact), selection.default_method}) {
      if (std::find(methods_.begin(), methods_.end(), needed) == methods_.end()) {
        methods_.push_back(needed);
      }
    }
    default_method_ = selection.default_method;
    all_methods_ = selection.methods.empty();
  }

  std::vector<StabilityCase> all() {
    map();
    linear();
    plane();
    scenes_in_loops();
    guard();
    guarded_map();
    guarded_scenes();
    requests();
    stress();
    on_board();
    std::stable_partition(cells_.begin(), cells_.end(), is_exact);
    return cells_;
  }

 private:
  static void check_part(const std::string& name) {
    std::string known;
    for (const std::string& each : chart_parts()) {
      if (each == name) {
        return;
      }
      known += (known.empty() ? "" : ", ") + each;
    }
    throw std::invalid_argument("part '" + name + "' is not known; use one of " + known);
  }

  // Whether `names` selects `name`; an empty list selects everything.
  static bool wanted(const std::vector<std::string>& list, const std::string& name) {
    return list.empty() || std::find(list.begin(), list.end(), name) != list.end();
  }

  void add(StabilityCase cell) {
    // Nobody holds the tool in the open loop, so the selection of hands does not apply.
    if (!wanted(parts_, cell.part) || (cell.part != part::kOpen && !wanted(hands_, cell.hand))) {
      return;
    }
    if (is_exact(cell)) {  // depends on neither simulator nor network
      cell.simulator_rate_Hz = 0.0;
      cell.delay_s = 0.0;
      cell.loss = 0.0;
      cell.requests_per_s = 0.0;
      cell.sees_contacts = false;
    }
    if (texts_.insert(cell.text()).second) {
      cells_.push_back(std::move(cell));
    }
  }

  void map() {
    for (const std::string& method : methods_) {
      for (const Hand& hand : hands()) {
        for (const Rate& rate : rates()) {
          if (quick_ && (rate.servo_rate_Hz > 1000.0 || hand.name == "arm")) {
            continue;
          }
          networks({.part = part::kMap,
                    .method = method,
                    .hand = hand.name,
                    .timing = rate.timing,
                    .servo_rate_Hz = rate.servo_rate_Hz});
        }
      }
    }
  }

  // The quick selection's rates are charted in all networks, the others in the usual one.
  void networks(StabilityCase cell) {
    const bool usual_only = cell.servo_rate_Hz > 1000.0;
    const bool for_goals = cell.method == default_method_;
    for (const double rate_Hz : {10.0, 30.0, 60.0}) {
      for (const double delay_s : {0.0, 0.02, 0.1, 0.15}) {
        for (const double loss : {0.0, 0.2}) {
          const bool usual = rate_Hz == 30.0 && delay_s == 0.0 && loss == 0.0;
          const bool ends = loss == 0.0 && delay_s != 0.02 && rate_Hz == 30.0;
          if ((usual_only && !usual) || (delay_s == 0.15 && !for_goals) ||
              (quick_ && !(ends && (usual || cell.timing != "ideal")))) {
            continue;
          }
          cell.simulator_rate_Hz = rate_Hz;
          cell.delay_s = delay_s;
          cell.loss = loss;
          add(cell);
        }
      }
    }
  }

  void linear() {
    for (const Hand& hand : hands()) {
      for (const Rate& rate : rates()) {
        if (quick_ && rate.servo_rate_Hz > 1000.0) {
          continue;
        }
        StabilityCase cell{.part = part::kLinear,
                           .scene = "spring",
                           .method = kExact,
                           .device = device::kLinear,
                           .hand = hand.name,
                           .timing = rate.timing,
                           .servo_rate_Hz = rate.servo_rate_Hz};
        add(cell);
        if (rate.servo_rate_Hz > 500.0) {
          continue;
        }
        cell.method = "hold";
        // Periods of whole numbers of cycles, for which the eigenvalues are computed.
        for (const double rate_Hz : {10.0, 25.0, 50.0}) {
          for (const double delay_s : {0.0, 0.02, 0.1}) {
            cell.simulator_rate_Hz = rate_Hz;
            cell.delay_s = delay_s;
            add(cell);
          }
        }
      }
    }
  }

  void plane() {
    for (const std::string& method : {std::string(kExact), default_method_}) {
      for (const char* const kind : {device::kLinear, device::kStudy, device::kFriction}) {
        for (const char* const hand : {"none", "light"}) {
          for (const double damping : {0.0, 0.25, 0.5, 1.0, 1.5, 2.0, 3.0, 4.0, 6.0, 8.0, 12.0}) {
            if (quick_ && (hand == std::string("none") || method != kExact)) {
              continue;
            }
            add({.part = part::kPlane,
                 .scene = "spring",
                 .method = method,
                 .device = kind,
                 .hand = hand,
                 .timing = "ideal",
                 .virtual_damping_N_s_per_m = damping});
          }
        }
      }
    }
  }

  void scenes_in_loops() {
    std::vector<std::string> methods = methods_;
    if (all_methods_) {
      methods.insert(methods.end(), std::begin(kContactMethods), std::end(kContactMethods));
    }
    for (const Scene& scene : scenes()) {
      for (const std::string& method : methods) {
        StabilityCase cell{.part = part::kOpen,
                           .scene = scene.name,
                           .method = method,
                           .hand = "none",
                           .timing = "ideal",
                           .find_limit = false};
        add(cell);
        cell.part = part::kScene;
        for (const char* const hand : {"light", "firm"}) {
          for (const char* const timing : {"ideal", "w2_full_speed"}) {
            if (quick_ && (hand == std::string("firm") || timing == std::string("ideal"))) {
              continue;
            }
            cell.hand = hand;
            cell.timing = timing;
            cell.find_limit = !quick_ || method == default_method_ || method == kExact;
            cell.stiffness_N_per_m = 200.0;
            add(cell);
            if (scene.name == "second_contact") {
              cell.find_limit = false;
              for (const double stiffness : {25.0, 50.0, 100.0}) {
                cell.stiffness_N_per_m = stiffness;
                add(cell);
              }
            }
          }
        }
      }
    }
  }

  // `run` uses the guard, so the default method is charted with it in all networks of the map.
  void guarded_map() {
    for (const Hand& hand : hands()) {
      for (const Rate& rate : rates()) {
        if (!quick_ && rate.servo_rate_Hz <= 1000.0) {
          networks({.part = part::kGuard,
                    .method = default_method_,
                    .hand = hand.name,
                    .timing = rate.timing,
                    .servo_rate_Hz = rate.servo_rate_Hz,
                    .guard = true});
        }
      }
    }
  }

  // An object that moves by itself can shake at the first contact; in `run` the guard damps this.
  void guarded_scenes() {
    for (const char* const scene : {"dynamic_5ms", "dynamic_20ms", "dynamic_100ms"}) {
      for (const char* const hand : {"light", "firm"}) {
        for (const char* const timing : {"ideal", "w2_full_speed"}) {
          if (quick_ && timing == std::string("ideal")) {
            continue;
          }
          add({.part = part::kGuard,
               .scene = scene,
               .method = default_method_,
               .hand = hand,
               .timing = timing,
               .guard = true,
               .find_limit = false});
        }
      }
    }
  }

  void guard() {
    for (const std::string& method : methods_) {
      for (const char* const hand : {"none", "light", "firm"}) {
        for (const Rate& rate : rates()) {
          if (rate.servo_rate_Hz > 1000.0 || rate.timing == std::string("ideal") ||
              (quick_ && method != default_method_ && method != "hold" && method != kExact)) {
            continue;
          }
          StabilityCase cell{.part = part::kGuard,
                             .method = method,
                             .hand = hand,
                             .timing = rate.timing,
                             .servo_rate_Hz = rate.servo_rate_Hz};
          for (const bool acts : {false, true}) {
            cell.guard = acts;
            add(cell);
          }
        }
      }
    }
  }

  // First touches with and without requests before contact, for the methods that make them.
  void requests() {
    std::vector<std::string> methods{kExact, default_method_};
    if (all_methods_) {
      methods.emplace_back("kriging-contact");
    }
    for (const std::string& method : methods) {
      for (const char* const hand : {"light", "firm"}) {
        for (const double delay_s : {0.0, 0.1}) {
          for (const bool sees_contacts : {false, true}) {
            for (const double rate_per_s : {0.0, 30.0, 60.0, 120.0}) {
              add({.part = part::kRequests,
                   .scene = "touching",
                   .method = method,
                   .hand = hand,
                   .timing = "w2_full_speed",
                   .delay_s = delay_s,
                   .requests_per_s = rate_per_s,
                   .sees_contacts = sees_contacts,
                   .find_limit = false});
            }
          }
        }
      }
    }
  }

  void stress() {
    for (const std::string& method : methods_) {
      if (method == kExact) {
        continue;
      }
      for (const Hand& hand : hands()) {
        for (const bool acts : {false, true}) {
          add({.part = part::kStress,
               .method = method,
               .hand = hand.name,
               .timing = "w2_full_speed",
               .delay_s = 0.2,
               .loss = 0.3,
               .guard = acts,
               .find_limit = false});
        }
      }
    }
  }

  // The same loop at 500 Hz in the host and on the device's own processor.
  void on_board() {
    static const std::vector<std::string> all = {kExact, "rls", "kriging samples=16",
                                                 "forcegrid storage=blocks cells=32,24,24 r=15mm"};
    for (const std::string& method : all_methods_ ? all : methods_) {
      for (const Hand& hand : hands()) {
        for (const char* const timing : {"w2_full_speed", "on_board"}) {
          for (const double delay_s : {0.0, 0.1}) {
            if (quick_ && (delay_s > 0.0 || hand.name == "arm" || hand.name == "none")) {
              continue;
            }
            add({.part = part::kOnBoard,
                 .method = method,
                 .hand = hand.name,
                 .timing = timing,
                 .delay_s = delay_s});
          }
        }
      }
    }
  }

  bool quick_;
  std::vector<std::string> parts_;
  std::vector<std::string> hands_;
  bool all_methods_;
  std::vector<std::string> methods_;
  std::string default_method_;
  std::vector<StabilityCase> cells_;
  std::set<std::string> texts_;  // of cells_
};

}  // namespace

std::string StabilityCase::text() const {
  char numbers[160];
  std::snprintf(numbers, sizeof numbers, "%g/%g/%g/%g/%d/%g/%g/%d", servo_rate_Hz,
                simulator_rate_Hz, delay_s, loss, guard ? 1 : 0, virtual_damping_N_s_per_m,
                stiffness_N_per_m, find_limit ? 1 : 0);
  return part + '/' + scene + '/' + method + '/' + device + '/' + hand + '/' + timing + '/' +
         numbers + (requests_per_s > 0.0 ? "/requests" + std::to_string(requests_per_s) : "") +
         (sees_contacts ? "/sees" : "");
}

LoopSetup setup_of(const StabilityCase& cell, bool stiffness, std::uint64_t seed) {
  LoopSetup setup;
  setup.servo_rate_Hz = cell.servo_rate_Hz;
  setup.timing = device_timing(cell.timing);
  setup.hand = hand_of(cell.hand);
  setup.network.simulator_rate_Hz = cell.method == kExact ? 30.0 : cell.simulator_rate_Hz;
  setup.network.delay_s = cell.delay_s;
  setup.network.loss = cell.loss;
  setup.network.requests_per_s = cell.requests_per_s;
  setup.sees_contacts = cell.sees_contacts;
  setup.network.stiffness = stiffness;
  setup.virtual_damping_N_s_per_m = cell.virtual_damping_N_s_per_m;
  setup.seed = seed;
  setup.longest_settling_s = kLongestSettling_s;
  if (cell.guard) {
    setup.passivity.mode = servo::PassivityMode::kControl;
  }
  if (cell.device == device::kLinear) {
    setup.device.position_step_m = 0.0;
    setup.device.max_force_N = std::numeric_limits<double>::infinity();
    setup.hold_s = kLinearHold_s;
    setup.longest_settling_s = 0.0;
  } else if (cell.device == device::kFriction) {
    setup.device.coulomb_friction_N = 0.1;
  }
  if (cell.scene != "spring") {
    const Scene& scene = scene_of(cell.scene);
    setup.fault = scene.fault;
    setup.network.noise_N = scene.noise_N;
    if (cell.scene == "second_contact") {
      setup.errors_from_s = kWallKnown_s;
    }
  }
  return setup;
}

const std::vector<std::string>& chart_methods() {
  static const std::vector<std::string> names = {
      kExact,      "hold",          "linear",  "broyden",      "rls",         "tangent",
      "forcegrid", "forcegrid-mls", "kriging", "kriging-bank", kDefaultMethod};
  return names;
}

const std::vector<std::string>& chart_parts() {
  static const std::vector<std::string> names = {
      part::kMap,   part::kLinear,   part::kPlane,  part::kScene,   part::kOpen,
      part::kGuard, part::kRequests, part::kStress, part::kOnBoard, part::kSweep};
  return names;
}

std::vector<StabilityCase> stiffness_cells(const std::vector<std::string>& methods) {
  StabilityCase cell{
      .part = part::kMap, .method = kExact, .hand = "light", .timing = "w2_full_speed"};
  cell.simulator_rate_Hz = 0.0;
  std::vector<StabilityCase> cells{cell};
  cell.simulator_rate_Hz = 30.0;
  for (const std::string& method : methods) {
    for (const double delay_s : {0.0, 0.02, 0.1, 0.15}) {
      cell.method = method;
      cell.delay_s = delay_s;
      if (method != kExact) {
        cells.push_back(cell);
      }
    }
  }
  return cells;
}

std::vector<StabilityCase> chart_cases(const CaseSelection& selection) {
  return Cases(selection).all();
}

}  // namespace forcegrid::stability
