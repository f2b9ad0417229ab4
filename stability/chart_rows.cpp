// SPDX-License-Identifier: Apache-2.0
#include "stability/chart_rows.h"

#include <cmath>
#include <nlohmann/json.hpp>

namespace forcegrid::stability {
namespace {

using nlohmann::ordered_json;

// One list for reading and writing: calls take(name, value) for every value of a row.
template <typename Row, typename Take>
void each_entry(Row& row, const Take& take) {
  auto& c = row.cell;
  take("part", c.part);
  take("scene", c.scene);
  take("method", c.method);
  take("device", c.device);
  take("hand", c.hand);
  take("timing", c.timing);
  take("servo_rate_Hz", c.servo_rate_Hz);
  take("simulator_rate_Hz", c.simulator_rate_Hz);
  take("delay_s", c.delay_s);
  take("loss", c.loss);
  take("requests_per_s", c.requests_per_s);
  take("sees_contacts", c.sees_contacts);
  take("guard", c.guard);
  take("virtual_damping_N_s_per_m", c.virtual_damping_N_s_per_m);
  take("find_limit", c.find_limit);
  take("largest_stable_N_per_m", row.limit.largest_stable_N_per_m);
  take("beyond_scan", row.limit.beyond_scan);
  take("smallest_unstable_N_per_m", row.limit.smallest_unstable_N_per_m);
  take("failure", row.limit.failure);
  take("stiffness_N_per_m", c.stiffness_N_per_m);
  auto& r = row.run;
  take("behaviour", r.behaviour);
  take("hold_peak_to_peak_m", r.hold_peak_to_peak_m);
  take("force_error_percent", r.force_error_percent);
  take("truth_rms_N", r.reference_rms_N);
  take("energy_generated_J", r.energy_generated_J);
  take("most_energy_generated_J", r.most_energy_generated_J);
  take("most_energy_to_hand_J", r.most_energy_to_hand_J);
  take("damped_energy_J", r.damped_energy_J);
  take("rattle_N", r.rattle_N);
  take("largest_force_N", r.largest_force_N);
  take("end_s", r.end_s);
  take("samples_taken", r.samples_taken);
  take("samples_lost", r.samples_lost);
  take("first_67ms_error_percent", r.first_67ms_error_percent);
  take("first_250ms_error_percent", r.first_250ms_error_percent);
  take("touches", r.touches);
  take("requests_made", r.requests_made);
  take("answers_taken", r.answers_taken);
  take("answers_before", r.answers_before);
}

constexpr Behaviour kBehaviours[] = {Behaviour::kStable, Behaviour::kDivergence,
                                     Behaviour::kLimitCycle, Behaviour::kCreep};

ordered_json json_of(Behaviour value) { return to_string(value); }
ordered_json json_of(double value) {
  return std::isfinite(value) ? ordered_json(value) : ordered_json(nullptr);
}
template <typename Value>
ordered_json json_of(const Value& value) {
  return value;
}

void read(const ordered_json& json, Behaviour& value) {
  const auto text = json.get<std::string>();
  for (const Behaviour behaviour : kBehaviours) {
    if (text == to_string(behaviour)) {
      value = behaviour;
      return;
    }
  }
  throw ordered_json::other_error::create(501, "no behaviour", &json);
}
void read(const ordered_json& json, double& value) {
  value = json.is_null() ? std::nan("") : json.get<double>();
}
template <typename Value>
void read(const ordered_json& json, Value& value) {
  value = json.get<Value>();
}

}  // namespace

ordered_json to_json(const StabilityRow& row) {
  ordered_json json;
  each_entry(row, [&json](const char* name, const auto& value) { json[name] = json_of(value); });
  return json;
}

StabilityRow row_from_json(const ordered_json& json) {
  StabilityRow row;
  each_entry(row, [&json](const char* name, auto& value) { read(json.at(name), value); });
  return row;
}

}  // namespace forcegrid::stability
