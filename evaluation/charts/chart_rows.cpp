// SPDX-License-Identifier: Apache-2.0
#include "evaluation/charts/chart_rows.h"

#include <cmath>
#include <nlohmann/json.hpp>

namespace forcegrid::evaluation {
namespace {

using nlohmann::ordered_json;

// One list for reading and writing: calls take(name, value) for every figure that is a plain
// number.
template <typename Row, typename Take>
void each_figure(Row& row, const Take& take) {
  auto& v = row.verdict;
  take("rms_error_percent_first_1s", v.rms_error_percent_first_1s);
  take("p95_error_percent_first_1s", v.p95_error_percent_first_1s);
  take("max_error_percent_first_1s", v.max_error_percent_first_1s);
  take("rms_error_percent_after_1s", v.rms_error_percent_after_1s);
  take("p95_error_percent_after_1s", v.p95_error_percent_after_1s);
  take("max_error_percent_after_1s", v.max_error_percent_after_1s);
  take("adaptation_s", v.adaptation_s);
  take("largest_step_N", v.largest_step_N);
  take("loop_work_percent", row.loop_work_percent);
  take("worst_loop_work_percent", row.worst_loop_work_percent);
  take("return_33ms_percent", row.returns.first_33ms_percent);
  take("return_100ms_percent", row.returns.to_100ms_percent);
  take("return_500ms_percent", row.returns.to_500ms_percent);
  take("return_1s_percent", row.returns.to_1s_percent);
  take("second_half_percent", row.returns.second_half_percent);
  take("after_touch_percent", row.after_touch_percent);
  take("blind_limit_percent", row.blind_limit.after_1s_percent);
  take("blind_limit_first_1s_percent", row.blind_limit.first_1s_percent);
  take("first_contact_67ms_percent", row.visits.first_contact.first_67ms_percent);
  take("unknown_place_67ms_percent", row.visits.unknown_places.first_67ms_percent);
  take("unknown_place_500ms_percent", row.visits.unknown_places.first_500ms_percent);
  take("known_place_67ms_percent", row.visits.returns.first_67ms_percent);
  take("known_place_500ms_percent", row.visits.returns.first_500ms_percent);
  take("first_tour_later_percent", row.visits.first_tour.later_percent);
  take("second_tour_later_percent", row.visits.second_tour.later_percent);
  take("query_ns_median", v.query_ns_median);
  take("query_ns_p99", v.query_ns_p99);
  take("sample_us_median", v.sample_us_median);
  take("sample_us_p99", v.sample_us_p99);
  take("cycle_ns_mean", v.cycle_ns);
  take("cycle_ns_median", v.cycle_ns_median);
  take("cycle_ns_p99", v.cycle_ns_p99);
  take("split_cycle_ns_mean", row.split.cycle_ns_mean);
  take("split_cycle_ns_p99", row.split.cycle_ns_p99);
  take("split_cycle_ns_p999", row.split.cycle_ns_p999);
  take("split_rms_error_percent_after_1s", row.split.rms_error_percent_after_1s);
  take("memory_bytes", v.memory_bytes);
  take("samples_taken", v.samples_taken);
  take("requests_answered", v.requests_answered);
  take("truth_rms_N", v.reference_rms_N);
  take("precompute_s", row.precompute_s);
}

}  // namespace

std::vector<RowFigure> figures_of(const ChartRow& row) {
  std::vector<RowFigure> figures;
  each_figure(row, [&figures](const char* name, const auto& value) {
    figures.emplace_back(name, static_cast<double>(value));
  });
  return figures;
}

ordered_json to_json(const ChartRow& row) {
  ordered_json json{{"key", row.key},
                    {"scene", row.scene},
                    {"trajectory", row.trajectory},
                    {"condition", row.condition},
                    {"method", row.method}};
  each_figure(row, [&json](const char* name, const auto& value) {
    if (std::isfinite(static_cast<double>(value))) {
      json[name] = value;
    } else {
      json[name] = nullptr;
    }
  });
  return json;
}

ChartRow row_from_json(const ordered_json& json) {
  ChartRow row;
  row.key = json.at("key").get<std::string>();
  row.scene = json.at("scene").get<std::string>();
  row.trajectory = json.at("trajectory").get<std::string>();
  row.condition = json.at("condition").get<std::string>();
  row.method = json.at("method").get<std::string>();
  each_figure(row, [&json](const char* name, auto& value) {
    using Value = std::remove_reference_t<decltype(value)>;
    const ordered_json& figure = json.at(name);
    if (std::is_floating_point_v<Value> && figure.is_null()) {
      value = std::numeric_limits<Value>::quiet_NaN();
    } else {
      value = figure.get<Value>();
    }
  });
  return row;
}

RowStore::RowStore(const std::filesystem::path& folder, const std::string& program)
    : file_(folder, program, [this](const ordered_json& json) {
        ChartRow row = row_from_json(json);
        rows_[row.key] = std::move(row);
      }) {}

const ChartRow* RowStore::find(const std::string& key) const {
  const auto found = rows_.find(key);
  return found == rows_.end() ? nullptr : &found->second;
}

void RowStore::keep(const ChartRow& row) {
  file_.keep(to_json(row));
  rows_[row.key] = row;
}

}  // namespace forcegrid::evaluation
