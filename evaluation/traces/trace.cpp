// SPDX-License-Identifier: Apache-2.0
#include "evaluation/traces/trace.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <string_view>

#include "evaluation/files/text_file.h"
#include "evaluation/traces/trace_columns.h"

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

class TraceReader {
 public:
  explicit TraceReader(const std::string& file)
      : file_(file), rows_(file, kNames, kStiffness, kHeaderForm) {
    rows_.all_or_none(kStiffness, kResidual, "nine");
  }

  Trace read() {
    while (rows_.next()) {
      read_row();
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
  void read_row() {
    const std::string_view kind = rows_.field(kKind);
    if (kind == "sample") {
      read_sample();
    } else if (kind == "servo") {
      read_servo();
    } else if (kind == "contact" || kind == "release") {
      read_event(kind == "contact");
    } else {
      rows_.refuse(kKind,
                   "expected sample, servo, contact or release, found '" + std::string(kind) + "'");
    }
    // Fields that the kind does not use may be empty, but must not be invalid.
    for (std::size_t column = kTime; column < kColumnCount; ++column) {
      rows_.optional_number(column);
    }
  }

  void read_sample() {
    DeliveredSample row;
    row.sample.time_s = rows_.number(kTime);
    row.delivered_s =
        rows_.not_before(kDelivered, kTime, ", the time that the force was computed for");
    row.sample.position_W = rows_.vector(kX);
    row.sample.force_W = rows_.vector(kForceX);
    Eigen::MatrixXd stiffness_W(3, 3);
    row.sample.has_stiffness = rows_.stiffness(kStiffness, stiffness_W, "nine");
    if (row.sample.has_stiffness) {
      row.sample.stiffness_W = stiffness_W;
    }
    row.sample.relative_residual = rows_.zero_or_more(kResidual);
    trace_.samples.push_back(row);
  }

  void read_servo() {
    ServoInstant row;
    row.time_s = rows_.time_after(kTime, last_time_s(trace_.servo), "servo");
    row.position_W = rows_.vector(kX);
    row.force_W = rows_.vector(kForceX);
    trace_.servo.push_back(row);
  }

  void read_event(bool made) {
    ContactEvent event;
    event.time_s = rows_.number(kTime);
    event.made = made;
    const double before_s = trace_.events.empty() ? kNoTime : trace_.events.back().time_s;
    if (event.time_s < before_s) {
      rows_.refuse(kTime, "expected " + number_text(before_s) +
                              " s or more, the time of the contact or release row before, found " +
                              std::string(rows_.field(kTime)));
    }
    if (!rows_.empty(kDelivered)) {
      event.delivered_s = rows_.not_before(kDelivered, kTime, "");
    }
    if (made) {
      event.point_W = rows_.vector(kX);
    }
    trace_.events.push_back(event);
  }

  std::string file_;
  TraceColumns rows_;
  Trace trace_;
};

// Rejects a trace that read_trace() would reject.
void check(const std::string& file, const Trace& trace) {
  TraceCheck rows(file, trace.servo.size());
  for (const ServoInstant& row : trace.servo) {
    rows.servo_instant(row.time_s, row.position_W.allFinite() && row.force_W.allFinite());
  }
  for (std::size_t i = 0; i < trace.samples.size(); ++i) {
    const DeliveredSample& row = trace.samples[i];
    const Sample& sample = row.sample;
    if (!std::isfinite(sample.time_s) || !std::isfinite(row.delivered_s) ||
        !sample.position_W.allFinite() || !sample.force_W.allFinite() ||
        (sample.has_stiffness && !sample.stiffness_W.allFinite()) ||
        !std::isfinite(sample.relative_residual)) {
      rows.refuse("sample", i, "is not finite");
    }
    if (row.delivered_s < sample.time_s || sample.relative_residual < 0.0) {
      rows.refuse("sample", i, "arrives before its own time or has a negative residual");
    }
  }
  double before_s = kNoTime;
  double before_arrival_s = kNoTime;
  for (std::size_t i = 0; i < trace.events.size(); ++i) {
    const ContactEvent& row = trace.events[i];
    if (!std::isfinite(row.time_s) || !row.point_W.allFinite() ||
        !std::isfinite(row.delivered_s.value_or(row.time_s))) {
      rows.refuse("contact event", i, "is not finite");
    }
    const double arrival_s = row.delivered_s.value_or(row.time_s);
    if (arrival_s < row.time_s || row.time_s < before_s || arrival_s < before_arrival_s) {
      rows.refuse("contact event", i, "is out of order");
    }
    before_s = row.time_s;
    before_arrival_s = arrival_s;
  }
}

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

  TraceRow text(kStiffness + (stiffness ? 9 : 0) + (residual ? 1 : 0));
  for (const TraceRowPlace& row :
       rows_in_order(arrivals_of(trace.events, trace.samples, trace.servo))) {
    if (row.kind == TraceRowPlace::Kind::kContact) {
      const ContactEvent& event = trace.events[row.index];
      text.start(event.made ? "contact" : "release", event.time_s, event.delivered_s);
      if (event.made) {
        text.add(event.point_W);
      }
    } else if (row.kind == TraceRowPlace::Kind::kSample) {
      const Sample& sample = trace.samples[row.index].sample;
      text.start("sample", sample.time_s, trace.samples[row.index].delivered_s);
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
      text.start("servo", instant.time_s, std::nullopt);
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
