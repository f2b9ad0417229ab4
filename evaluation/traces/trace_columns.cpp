// SPDX-License-Identifier: Apache-2.0
#include "evaluation/traces/trace_columns.h"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <system_error>
#include <utility>

#include "evaluation/traces/trace.h"

namespace forcegrid::evaluation {
namespace {

std::string_view trimmed(std::string_view text) {
  const auto first = text.find_first_not_of(" \t");
  if (first == std::string_view::npos) {
    return {};
  }
  return text.substr(first, text.find_last_not_of(" \t") - first + 1);
}

// Cuts `line` at its commas and calls take(index, field).
template <typename Take>
std::size_t split(std::string_view line, const Take& take) {
  std::size_t count = 0;
  for (;;) {
    const std::size_t comma = line.find(',');
    take(count++, trimmed(line.substr(0, comma)));
    if (comma == std::string_view::npos) {
      return count;
    }
    line.remove_prefix(comma + 1);
  }
}

}  // namespace

std::string number_text(double value) {
  std::string text;
  append_number(text, value);
  return text;
}

TraceColumns::TraceColumns(const std::string& file, std::span<const std::string_view> names,
                           std::size_t required, const std::string& header_form)
    : file_(file), names_(names), lines_(file), seen_(names.size()), fields_(names.size()) {
  std::string_view line;
  if (!lines_.next(line)) {
    throw TraceError(file_ + ": is empty; expected the header " + header_form);
  }
  read_header(line, required, header_form);
}

void TraceColumns::refuse(const std::string& what) const {
  throw TraceError(file_ + ", line " + std::to_string(lines_.line_number()) + ": " + what);
}

void TraceColumns::refuse(std::size_t column, const std::string& what) const {
  refuse("column '" + std::string(names_[column]) + "': " + what);
}

void TraceColumns::all_or_none(std::size_t first, std::size_t end,
                               const std::string& how_many) const {
  bool any = false;
  for (std::size_t column = first; column < end; ++column) {
    any = any || has(column);
  }
  for (std::size_t column = first; column < end; ++column) {
    if (any && !has(column)) {
      refuse(column, "is missing from the header; give all " + how_many +
                         " columns of the stiffness or none");
    }
  }
}

bool TraceColumns::stiffness(std::size_t first, Eigen::Ref<Eigen::MatrixXd> entries,
                             const std::string& how_many) const {
  const auto count = static_cast<std::size_t>(entries.size());
  bool any = false;
  for (std::size_t i = 0; i < count; ++i) {
    any = any || !empty(first + i);
  }
  for (std::size_t i = 0; any && i < count; ++i) {
    if (empty(first + i)) {
      refuse(first + i, "is empty; give all " + how_many + " entries of a stiffness or none");
    }
    const auto at = static_cast<Eigen::Index>(i);
    entries(at / entries.cols(), at % entries.cols()) = number(first + i);
  }
  return any;
}

void TraceColumns::read_header(std::string_view line, std::size_t required,
                               const std::string& header_form) {
  if (line.substr(0, 3) == "\xEF\xBB\xBF") {
    line.remove_prefix(3);  // a byte order mark, which spreadsheets write
  }
  split(line, [&](std::size_t index, std::string_view name) {
    const auto known = std::find(names_.begin(), names_.end(), name);
    if (known == names_.end()) {
      refuse("column " + std::to_string(index + 1) + " of the header is '" + std::string(name) +
             "'; expected " + header_form);
    }
    const auto column = static_cast<std::size_t>(known - names_.begin());
    if (seen_[column]) {
      refuse(column, "appears twice");
    }
    seen_[column] = true;
    columns_.push_back(column);
  });
  for (std::size_t column = 0; column < required; ++column) {
    if (!seen_[column]) {
      refuse(column, "is missing from the header; expected " + header_form);
    }
  }
}

bool TraceColumns::next() {
  std::string_view line;
  while (lines_.next(line)) {
    if (!trimmed(line).empty()) {
      read_fields(line);
      return true;
    }
  }
  return false;
}

void TraceColumns::read_fields(std::string_view line) {
  std::fill(fields_.begin(), fields_.end(), std::string_view());
  const std::size_t count = split(line, [&](std::size_t index, std::string_view field) {
    if (index < columns_.size()) {
      fields_[columns_[index]] = field;
    }
  });
  if (count < columns_.size()) {
    refuse(columns_[count], "is missing; expected " + std::to_string(columns_.size()) +
                                " fields, found " + std::to_string(count));
  }
  if (count > columns_.size()) {
    refuse("expected " + std::to_string(columns_.size()) + " fields, the last being column '" +
           std::string(names_[columns_.back()]) + "', found " + std::to_string(count));
  }
}

double TraceColumns::number(std::size_t column) const {
  std::string_view text = fields_[column];
  if (text.empty()) {
    refuse(column, "is empty; expected a number");
  }
  if (text.front() == '+' && text.size() > 1 && text[1] != '-') {
    text.remove_prefix(1);
  }
  double value = 0.0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error == std::errc::result_out_of_range) {
    refuse(column, "expected a number in the range of a double, found '" +
                       std::string(fields_[column]) + "'");
  }
  if (error != std::errc() || end != text.data() + text.size()) {
    refuse(column, "expected a number, found '" + std::string(fields_[column]) + "'");
  }
  if (!std::isfinite(value)) {
    refuse(column, "expected a finite number, found '" + std::string(fields_[column]) + "'");
  }
  return value;
}

std::optional<double> TraceColumns::optional_number(std::size_t column) const {
  return empty(column) ? std::nullopt : std::optional<double>(number(column));
}

Eigen::Vector3d TraceColumns::vector(std::size_t first) const {
  return {number(first), number(first + 1), number(first + 2)};
}

double TraceColumns::zero_or_more(std::size_t column) const {
  const double value = optional_number(column).value_or(0.0);
  if (value < 0.0) {
    refuse(column, "expected zero or more, found " + std::string(field(column)));
  }
  return value;
}

double TraceColumns::time_after(std::size_t column, std::optional<double> before_s,
                                std::string_view kind) const {
  const double time_s = number(column);
  if (before_s && time_s <= *before_s) {
    refuse(column, "expected more than " + number_text(*before_s) + " s, the time of the " +
                       std::string(kind) + " row before, found " + std::string(field(column)));
  }
  return time_s;
}

double TraceColumns::not_before(std::size_t column, std::size_t since,
                                std::string_view what) const {
  const double time_s = number(column);
  if (time_s < number(since)) {
    refuse(column, "expected " + std::string(field(since)) + " s or later" + std::string(what) +
                       ", found " + std::string(field(column)));
  }
  return time_s;
}

void TraceRow::start(std::string_view kind, double time_s, std::optional<double> delivered_s) {
  text_ = kind;
  fields_ = 1;
  add(time_s);
  delivered_s ? add(*delivered_s) : skip();
}

void TraceRow::add(double value) {
  text_ += ',';
  append_number(text_, value);
  ++fields_;
}

void TraceRow::add(const Eigen::Vector3d& values) {
  add(values.x());
  add(values.y());
  add(values.z());
}

void TraceRow::skip() {
  text_ += ',';
  ++fields_;
}

const std::string& TraceRow::finish() {
  while (fields_ < column_count_) {
    skip();
  }
  text_ += '\n';
  return text_;
}

TraceCheck::TraceCheck(std::string file, std::size_t servo_instants) : file_(std::move(file)) {
  if (servo_instants == 0) {
    throw TraceError(file_ + ": not written; the trace has no servo instant");
  }
}

void TraceCheck::servo_instant(double time_s, bool finite) {
  if (!std::isfinite(time_s) || !finite) {
    refuse("servo instant", instants_, "is not finite");
  }
  if (instants_ > 0 && time_s <= before_s_) {
    refuse("servo instant", instants_, "is not later than the one before");
  }
  before_s_ = time_s;
  ++instants_;
}

void TraceCheck::refuse(const char* kind, std::size_t index, const char* what) const {
  throw TraceError(file_ + ": not written; " + kind + " " + std::to_string(index) + " " + what);
}

std::vector<TraceRowPlace> rows_in_order(const TraceArrivals& arrivals) {
  std::vector<TraceRowPlace> rows;
  rows.reserve(arrivals.contacts_s.size() + arrivals.samples_s.size() + arrivals.servo_s.size());
  const auto add = [&rows](TraceRowPlace::Kind kind, const std::vector<double>& arrivals_s) {
    for (std::size_t i = 0; i < arrivals_s.size(); ++i) {
      rows.push_back({arrivals_s[i], kind, i});
    }
  };
  add(TraceRowPlace::Kind::kContact, arrivals.contacts_s);
  add(TraceRowPlace::Kind::kSample, arrivals.samples_s);
  add(TraceRowPlace::Kind::kServo, arrivals.servo_s);
  std::stable_sort(rows.begin(), rows.end(), [](const TraceRowPlace& a, const TraceRowPlace& b) {
    return a.arrival_s != b.arrival_s ? a.arrival_s < b.arrival_s : a.kind < b.kind;
  });
  return rows;
}

}  // namespace forcegrid::evaluation
