// SPDX-License-Identifier: Apache-2.0
#include "cli/charts/evaluate_output.h"

#include <algorithm>
#include <nlohmann/json.hpp>

#include "cli/common/progress_line.h"
#include "evaluation/files/text_file.h"
#include "log/log.h"

namespace forcegrid::cli {

using nlohmann::ordered_json;

ordered_json evaluate_each(const std::vector<std::string>& methods,
                           const std::function<ordered_json(std::size_t)>& evaluate) {
  ProgressLine line;
  ordered_json all;
  for (std::size_t i = 0; i < methods.size(); ++i) {
    line.show("Evaluating", static_cast<double>(i) / static_cast<double>(methods.size()));
    all[methods[i]] = evaluate(i);
  }
  line.clear();
  return methods.size() == 1 ? all.front() : all;
}

void add_cycle_costs(ordered_json& json, const evaluation::MethodCosts& costs) {
  json["cycle_ns"] = costs.cycle_ns;
  json["cycle_ns_median"] = costs.cycle_ns_median;
  json["cycle_ns_p99"] = costs.cycle_ns_p99;
  json["cycle_ns_p999"] = costs.cycle_ns_p999;
  json["timer_floor_ns"] = costs.timer_floor_ns;
}

void add_counters(ordered_json& json, std::span<const NamedCounter> counters,
                  const std::array<std::size_t, 5>& cycles) {
  json["counters"] = ordered_json::object();
  for (const NamedCounter& counter : counters) {
    json["counters"][counter.name] = counter.value;
  }
  const auto add = [&](const char* key, EstimateStatus status) {
    json[key] = cycles[static_cast<std::size_t>(status)];
  };
  add("cycles_known", EstimateStatus::kOk);
  add("cycles_partly_known", EstimateStatus::kPartlyKnown);
  add("cycles_unknown", EstimateStatus::kUnknown);
  add("cycles_outside_workspace", EstimateStatus::kOutside);
  add("cycles_not_finite", EstimateStatus::kNotFinite);
}

ordered_json json_of_workspace(const GridGeometry& grid) {
  return {grid.min_W.x(), grid.min_W.y(), grid.min_W.z(),
          grid.max_W.x(), grid.max_W.y(), grid.max_W.z()};
}

void note_of_evaluation(const std::string& text) { log::info("evaluation", "Note: " + text); }

void write_force_columns(const std::string& file, const ForceColumns& columns,
                         const std::vector<std::string>& methods, std::size_t rows,
                         const std::function<void(std::size_t, std::vector<double>&)>& row) {
  evaluation::TextWriter writer(file);
  std::string line = "t_s";
  const auto add_names = [&](std::string_view before, std::string_view after) {
    for (const std::string_view component : columns.components) {
      line += ',';
      line += before;
      line += component;
      line += after;
    }
  };
  add_names(columns.position, "_m");
  add_names("offline_", "_N");
  for (std::string name : methods) {
    std::replace(name.begin(), name.end(), ',', ' ');
    add_names(name + "_", "_N");
  }
  writer.write(line + "\n");
  std::vector<double> numbers;
  for (std::size_t i = 0; i < rows; ++i) {
    numbers.clear();
    row(i, numbers);
    line.clear();
    for (const double number : numbers) {
      line += line.empty() ? "" : ",";
      evaluation::append_number(line, number);
    }
    writer.write(line + "\n");
  }
  writer.finish();
}

}  // namespace forcegrid::cli
