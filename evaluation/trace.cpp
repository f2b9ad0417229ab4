// SPDX-License-Identifier: Apache-2.0
#include "evaluation/trace.h"

#include <algorithm>
#include <array>
#include <charconv>
#include <cmath>
#include <limits>
#include <string_view>
#include <system_error>

#include "evaluation/text_file.h"

namespace forcegrid::evaluation {
namespace {

enum Column : std::size_t {
  kKind,
  kTime,
  kDelivered,
  kX,
  kForceX = kX + 3,
  kStiffness = kForceX + 3,
  kResidual = kStiffness + 9,
  kColumnCount,
};

constexpr std::array<std::string_view, kColumnCount> kNames = {
    "kind",        "t_s",         "delivered_s", "x_m",         "y_m",
    "z_m",         "fx_N",        "fy_N",        "fz_N",        "j00_N_per_m",
    "j01_N_per_m", "j02_N_per_m", "j10_N_per_m", "j11_N_per_m", "j12_N_per_m",
    "j20_N_per_m", "j21_N_per_m", "j22_N_per_m", "residual"};

constexpr char kHeaderForm[] =
    "kind,t_s,delivered_s,x_m,y_m,z_m,fx_N,fy_N,fz_N[,j00_N_per_m,...,j22_N_per_m][,residual]";

constexpr double kNoTime = -std::numeric_limits<double>::infinity();

std::string_view trimmed(std::string_view text) {
  const auto first = text.find_first_not_of(" \t");
  if (first == std::string_view::npos) {
    return {};
  }
  return text.substr(first, text.find_last_not_of(" \t") - first + 1);
}

std::string number_text(double value) {
  std::string text;
  append_number(text, value);
  return text;
}

class TraceReader {
 public:
  explicit TraceReader(const std::string& file) : file_(file), lines_(file) {}

  Trace read() {
    std::string_view line;
    if (!lines_.next(line)) {
      throw TraceError(file_ + ": is empty; expected the header " + kHeaderForm);
    }
    read_header(line);
    while (lines_.next(line)) {
      if (!trimmed(line).empty()) {
        read_row(line);
      }
    }
    if (trace_.servo.empty()) {
      throw TraceError(file_ + ": has no 'servo' row; evaluation needs the reference forces");
    }
    std::stable_sort(trace_.samples.begin(), trace_.samples.end(),
                     [](const DeliveredSample& a, const DeliveredSample& b) {
                       return a.delivered_s < b.delivered_s;
                     });
    return std::move(trace_);
  }

 private:
  [[noreturn]] void refuse(const std::string& what) const {
    throw TraceError(file_ + ", line " + std::to_string(lines_.line_number()) + ": " + what);
  }
  [[noreturn]] void refuse(std::size_t column, const std::string& what) const {
    refuse("column '" + std::string(kNames[column]) + "': " + what);
  }

  // Cuts `line` at its commas and calls take(index, field).
  template <typename Take>
  static std::size_t split(std::string_view line, const Take& take) {
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

  void read_header(std::string_view line) {
    if (line.substr(0, 3) == "\xEF\xBB\xBF") {
      line.remove_prefix(3);  // a byte order mark, which spreadsheets write
    }
    std::array<bool, kColumnCount> seen{};
    split(line, [&](std::size_t index, std::string_view name) {
      const auto known = std::find(kNames.begin(), kNames.end(), name);
      if (known == kNames.end()) {
        refuse("column " + std::to_string(index + 1) + " of the header is '" + std::string(name) +
               "'; expected " + kHeaderForm);
      }
      const auto column = static_cast<std::size_t>(known - kNames.begin());
      if (seen[column]) {
        refuse(column, "appears twice");
      }
      seen[column] = true;
      columns_.push_back(column);
    });
    for (std::size_t column = 0; column < kStiffness; ++column) {
      if (!seen[column]) {
        refuse(column, std::string("is missing from the header; expected ") + kHeaderForm);
      }
    }
    const bool any_stiffness =
        std::any_of(&seen[kStiffness], &seen[kResidual], [](bool s) { return s; });
    for (std::size_t column = kStiffness; column < kResidual; ++column) {
      if (any_stiffness && !seen[column]) {
        refuse(column,
               "is missing from the header; give all nine columns of the stiffness or none");
      }
    }
  }

  void read_row(std::string_view line) {
    fields_.fill({});
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
             std::string(kNames[columns_.back()]) + "', found " + std::to_string(count));
    }
    const std::string_view kind = fields_[kKind];
    if (kind == "sample") {
      read_sample();
    } else if (kind == "servo") {
      read_servo();
    } else if (kind == "contact" || kind == "release") {
      read_event(kind == "contact");
    } else {
      refuse(kKind,
             "expected sample, servo, contact or release, found '" + std::string(kind) + "'");
    }
    // Fields that the kind does not use may be empty, but must not be invalid.
    for (std::size_t column = kTime; column < kColumnCount; ++column) {
      optional_number(column);
    }
  }

  bool empty(std::size_t column) const { return fields_[column].empty(); }

  double number(std::size_t column) const {
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

  std::optional<double> optional_number(std::size_t column) const {
    return empty(column) ? std::nullopt : std::optional<double>(number(column));
  }

  Eigen::Vector3d vector(std::size_t first) const {
    return {number(first), number(first + 1), number(first + 2)};
  }

  void read_sample() {
    DeliveredSample row;
    row.sample.time_s = number(kTime);
    row.delivered_s = number(kDelivered);
    if (row.delivered_s < row.sample.time_s) {
      refuse(kDelivered, "expected " + std::string(fields_[kTime]) +
                             " s or later, the time that the force was computed for, found " +
                             std::string(fields_[kDelivered]));
    }
    row.sample.position_W = vector(kX);
    row.sample.force_W = vector(kForceX);
    const auto nine_begin = fields_.begin() + kStiffness;
    const auto nine_end = fields_.begin() + kResidual;
    row.sample.has_stiffness =
        std::any_of(nine_begin, nine_end, [](std::string_view field) { return !field.empty(); });
    if (row.sample.has_stiffness) {
      for (std::size_t i = 0; i < 9; ++i) {
        const std::size_t column = kStiffness + i;
        if (empty(column)) {
          refuse(column, "is empty; give all nine entries of a stiffness or none");
        }
        row.sample.stiffness_W(static_cast<Eigen::Index>(i / 3), static_cast<Eigen::Index>(i % 3)) =
            number(column);
      }
    }
    row.sample.relative_residual = optional_number(kResidual).value_or(0.0);
    if (row.sample.relative_residual < 0.0) {
      refuse(kResidual, "expected zero or more, found " + std::string(fields_[kResidual]));
    }
    trace_.samples.push_back(row);
  }

  void read_servo() {
    ServoInstant row;
    row.time_s = number(kTime);
    if (!trace_.servo.empty() && row.time_s <= trace_.servo.back().time_s) {
      refuse(kTime, "expected more than " + number_text(trace_.servo.back().time_s) +
                        " s, the time of the servo row before, found " +
                        std::string(fields_[kTime]));
    }
    row.position_W = vector(kX);
    row.force_W = vector(kForceX);
    trace_.servo.push_back(row);
  }

  void read_event(bool made) {
    ContactEvent event;
    event.time_s = number(kTime);
    event.made = made;
    const double before_s = trace_.events.empty() ? kNoTime : trace_.events.back().time_s;
    if (event.time_s < before_s) {
      refuse(kTime, "expected " + number_text(before_s) +
                        " s or more, the time of the contact or release row before, found " +
                        std::string(fields_[kTime]));
    }
    event.delivered_s = optional_number(kDelivered);
    if (event.delivered_s && *event.delivered_s < event.time_s) {
      refuse(kDelivered, "expected " + std::string(fields_[kTime]) + " s or later, found " +
                             std::string(fields_[kDelivered]));
    }
    if (made) {
      event.point_W = vector(kX);
    }
    trace_.events.push_back(event);
  }

  std::string file_;
  LineReader lines_;
  std::vector<std::size_t> columns_;  ///< column of each field
  std::array<std::string_view, kColumnCount> fields_;
  Trace trace_;
};

// Rejects a trace that read_trace() would reject.
void check(const std::string& file, const Trace& trace) {
  const auto refuse = [&](const std::string& kind, std::size_t index, const std::string& what) {
    throw TraceError(file + ": not written; " + kind + " " + std::to_string(index) + " " + what);
  };
  if (trace.servo.empty()) {
    throw TraceError(file + ": not written; the trace has no servo instant");
  }
  for (std::size_t i = 0; i < trace.servo.size(); ++i) {
    const ServoInstant& row = trace.servo[i];
    if (!std::isfinite(row.time_s) || !row.position_W.allFinite() || !row.force_W.allFinite()) {
      refuse("servo instant", i, "is not finite");
    }
    if (i > 0 && row.time_s <= trace.servo[i - 1].time_s) {
      refuse("servo instant", i, "is not later than the one before");
    }
  }
  for (std::size_t i = 0; i < trace.samples.size(); ++i) {
    const DeliveredSample& row = trace.samples[i];
    const Sample& sample = row.sample;
    if (!std::isfinite(sample.time_s) || !std::isfinite(row.delivered_s) ||
        !sample.position_W.allFinite() || !sample.force_W.allFinite() ||
        (sample.has_stiffness && !sample.stiffness_W.allFinite()) ||
        !std::isfinite(sample.relative_residual)) {
      refuse("sample", i, "is not finite");
    }
    if (row.delivered_s < sample.time_s || sample.relative_residual < 0.0) {
      refuse("sample", i, "arrives before its own time or has a negative residual");
    }
  }
  double before_s = kNoTime;
  double before_arrival_s = kNoTime;
  for (std::size_t i = 0; i < trace.events.size(); ++i) {
    const ContactEvent& row = trace.events[i];
    if (!std::isfinite(row.time_s) || !row.point_W.allFinite() ||
        !std::isfinite(row.delivered_s.value_or(row.time_s))) {
      refuse("contact event", i, "is not finite");
    }
    const double arrival_s = row.delivered_s.value_or(row.time_s);
    if (arrival_s < row.time_s || row.time_s < before_s || arrival_s < before_arrival_s) {
      refuse("contact event", i, "is out of order");
    }
    before_s = row.time_s;
    before_arrival_s = arrival_s;
  }
}

struct Row {
  double arrival_s;
  int rank;  ///< order of rows that arrive at the same time: events, samples, servo instant
  std::size_t index;
};

class RowText {
 public:
  explicit RowText(std::size_t column_count) : column_count_(column_count) {}

  void start(std::string_view kind) {
    text_ = kind;
    fields_ = 1;
  }
  void add(double value) {
    text_ += ',';
    append_number(text_, value);
    ++fields_;
  }
  void add(const Eigen::Vector3d& values) {
    add(values.x());
    add(values.y());
    add(values.z());
  }
  void skip() {
    text_ += ',';
    ++fields_;
  }
  const std::string& finish() {
    while (fields_ < column_count_) {
      skip();
    }
    text_ += '\n';
    return text_;
  }

 private:
  std::size_t column_count_;
  std::string text_;
  std::size_t fields_ = 0;
};

void write_rows(TextWriter& writer, const Trace& trace) {
  const auto any_sample = [&](auto&& test) {
    return std::any_of(trace.samples.begin(), trace.samples.end(), test);
  };
  const bool stiffness = any_sample([](const auto& row) { return row.sample.has_stiffness; });
  const bool residual =
      any_sample([](const auto& row) { return row.sample.relative_residual > 0; });

  std::string header;
  for (std::size_t column = 0; column < kColumnCount; ++column) {
    if (column == kResidual ? residual : column < kStiffness || stiffness) {
      header += (header.empty() ? "" : ",") + std::string(kNames[column]);
    }
  }
  writer.write(header + "\n");

  std::vector<Row> rows;
  rows.reserve(trace.servo.size() + trace.samples.size() + trace.events.size());
  for (std::size_t i = 0; i < trace.events.size(); ++i) {
    rows.push_back({trace.events[i].delivered_s.value_or(trace.events[i].time_s), 0, i});
  }
  for (std::size_t i = 0; i < trace.samples.size(); ++i) {
    rows.push_back({trace.samples[i].delivered_s, 1, i});
  }
  for (std::size_t i = 0; i < trace.servo.size(); ++i) {
    rows.push_back({trace.servo[i].time_s, 2, i});
  }
  std::stable_sort(rows.begin(), rows.end(), [](const Row& a, const Row& b) {
    return a.arrival_s != b.arrival_s ? a.arrival_s < b.arrival_s : a.rank < b.rank;
  });

  RowText text(kStiffness + (stiffness ? 9 : 0) + (residual ? 1 : 0));
  for (const Row& row : rows) {
    if (row.rank == 0) {
      const ContactEvent& event = trace.events[row.index];
      text.start(event.made ? "contact" : "release");
      text.add(event.time_s);
      event.delivered_s ? text.add(*event.delivered_s) : text.skip();
      if (event.made) {
        text.add(event.point_W);
      }
    } else if (row.rank == 1) {
      const Sample& sample = trace.samples[row.index].sample;
      text.start("sample");
      text.add(sample.time_s);
      text.add(trace.samples[row.index].delivered_s);
      text.add(sample.position_W);
      text.add(sample.force_W);
      for (int i = 0; stiffness && i < 9; ++i) {
        sample.has_stiffness ? text.add(sample.stiffness_W(i / 3, i % 3)) : text.skip();
      }
      if (residual) {
        text.add(sample.relative_residual);
      }
    } else {
      const ServoInstant& instant = trace.servo[row.index];
      text.start("servo");
      text.add(instant.time_s);
      text.skip();
      text.add(instant.position_W);
      text.add(instant.force_W);
    }
    writer.write(text.finish());
  }
}

}  // namespace

Trace read_trace(const std::string& file) {
  try {
    return TraceReader(file).read();
  } catch (const FileError& error) {
    throw TraceError(error.what());
  }
}

void write_trace(const std::string& file, const Trace& trace) {
  check(file, trace);
  try {
    TextWriter writer(file);
    write_rows(writer, trace);
    writer.finish();
  } catch (const FileError& error) {
    throw TraceError(error.what());
  }
}

}  // namespace forcegrid::evaluation
