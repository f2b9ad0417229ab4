// SPDX-License-Identifier: Apache-2.0
#include "evaluation/pair_trace.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <string_view>

#include "evaluation/text_file.h"
#include "evaluation/trace.h"
#include "evaluation/trace_columns.h"

namespace forcegrid::evaluation {
namespace {

enum Column : std::size_t {
  kKind,
  kTime,
  kDelivered,
  kPosition,
  kForce = kPosition + 6,
  kResidual = kForce + 6,
  kColumnCount,
};

constexpr std::array<std::string_view, kColumnCount> kNames = {
    "kind",  "t_s",   "delivered_s", "p1x_m", "p1y_m", "p1z_m", "p2x_m", "p2y_m",
    "p2z_m", "f1x_N", "f1y_N",       "f1z_N", "f2x_N", "f2y_N", "f2z_N", "residual"};

constexpr char kHeaderForm[] =
    "kind,t_s,delivered_s,p1x_m,p1y_m,p1z_m,p2x_m,p2y_m,p2z_m,f1x_N,f1y_N,f1z_N,f2x_N,f2y_N,f2z_N"
    "[,residual]";

class PairTraceReader {
 public:
  explicit PairTraceReader(const std::string& file)
      : file_(file), rows_(file, kNames, kResidual, kHeaderForm) {}

  PairTrace read() {
    while (rows_.next()) {
      read_row();
    }
    if (trace_.servo.empty()) {
      throw TraceError(file_ + ": has no 'servo' row; evaluation needs the reference forces");
    }
    std::stable_sort(trace_.samples.begin(), trace_.samples.end(),
                     [](const auto& a, const auto& b) { return a.delivered_s < b.delivered_s; });
    return std::move(trace_);
  }

 private:
  void read_row() {
    const std::string_view kind = rows_.field(kKind);
    if (kind == "sample") {
      read_sample();
    } else if (kind == "servo") {
      read_servo();
    } else if (kind == "contact") {
      read_contact();
    } else if (kind == "release") {
      rows_.refuse(kKind, "a trace of two tools ends where one of them lets go; cut it there");
    } else {
      rows_.refuse(kKind, "expected sample, servo or contact, found '" + std::string(kind) + "'");
    }
    // Fields that the kind does not use may be empty, but must not be invalid.
    for (std::size_t column = kTime; column < kColumnCount; ++column) {
      rows_.optional_number(column);
    }
  }

  PairVector six(std::size_t first) const {
    PairVector both;
    both << rows_.vector(first), rows_.vector(first + 3);
    return both;
  }

  // Rises from row to row of its kind.
  template <typename Rows>
  double rising_time(const Rows& before, std::string_view kind) const {
    const double time_s = rows_.number(kTime);
    if (!before.empty() && time_s <= before.back().time_s) {
      rows_.refuse(kTime, "expected more than " + number_text(before.back().time_s) +
                              " s, the time of the " + std::string(kind) + " row before, found " +
                              std::string(rows_.field(kTime)));
    }
    return time_s;
  }

  void check_delivery(double time_s, double delivered_s) const {
    if (delivered_s < time_s) {
      rows_.refuse(kDelivered, "expected " + std::string(rows_.field(kTime)) +
                                   " s or later, the row's time, found " +
                                   std::string(rows_.field(kDelivered)));
    }
  }

  void read_sample() {
    DeliveredPairSample row;
    row.sample.time_s = rows_.number(kTime);
    row.delivered_s = rows_.number(kDelivered);
    check_delivery(row.sample.time_s, row.delivered_s);
    row.sample.positions_W = six(kPosition);
    row.sample.forces_W = six(kForce);
    row.sample.relative_residual = rows_.optional_number(kResidual).value_or(0.0);
    if (row.sample.relative_residual < 0.0) {
      rows_.refuse(kResidual,
                   "expected zero or more, found " + std::string(rows_.field(kResidual)));
    }
    trace_.samples.push_back(row);
  }

  void read_servo() {
    PairInstant row;
    row.time_s = rising_time(trace_.servo, "servo");
    row.positions_W = six(kPosition);
    row.forces_W = six(kForce);
    trace_.servo.push_back(row);
  }

  void read_contact() {
    PairContact row;
    row.time_s = rising_time(trace_.contacts, "contact");
    row.delivered_s = rows_.optional_number(kDelivered);
    if (row.delivered_s) {
      check_delivery(row.time_s, *row.delivered_s);
    }
    row.points_W = six(kPosition);
    trace_.contacts.push_back(row);
  }

  std::string file_;
  TraceColumns rows_;
  PairTrace trace_;
};

// Rejects what read_pair_trace() would reject.
void check(const std::string& file, const PairTrace& trace) {
  const auto refuse = [&](const std::string& what) {
    throw TraceError(file + ": not written; " + what);
  };
  if (trace.servo.empty()) {
    refuse("the trace has no servo instant");
  }
  for (std::size_t i = 0; i < trace.servo.size(); ++i) {
    const PairInstant& row = trace.servo[i];
    if (!std::isfinite(row.time_s) || !row.positions_W.allFinite() || !row.forces_W.allFinite()) {
      refuse("servo instant " + std::to_string(i) + " is not finite");
    }
    if (i > 0 && row.time_s <= trace.servo[i - 1].time_s) {
      refuse("servo instant " + std::to_string(i) + " is not later than the one before");
    }
  }
  for (std::size_t i = 0; i < trace.samples.size(); ++i) {
    const auto& [sample, delivered_s] = trace.samples[i];
    if (!std::isfinite(sample.time_s) || !std::isfinite(delivered_s) ||
        !sample.positions_W.allFinite() || !sample.forces_W.allFinite() ||
        !(sample.relative_residual >= 0.0) || !(delivered_s >= sample.time_s)) {
      refuse("sample " + std::to_string(i) +
             " is not finite, arrives before its own time or has a negative residual");
    }
  }
  for (std::size_t i = 0; i < trace.contacts.size(); ++i) {
    const PairContact& row = trace.contacts[i];
    const double arrival_s = row.delivered_s.value_or(row.time_s);
    if (!std::isfinite(arrival_s) || !row.points_W.allFinite() || !(arrival_s >= row.time_s) ||
        (i > 0 && row.time_s <= trace.contacts[i - 1].time_s)) {
      refuse("contact " + std::to_string(i) + " is not finite or out of order");
    }
  }
}

void add(TraceRow& text, const PairVector& both) {
  text.add(Eigen::Vector3d(both.head<3>()));
  text.add(Eigen::Vector3d(both.tail<3>()));
}

struct Row {
  double arrival_s;
  int rank;  ///< order of rows that arrive at the same time: contacts, samples, servo instant
  std::size_t index;
};

std::vector<Row> rows_in_order(const PairTrace& trace) {
  std::vector<Row> rows;
  for (std::size_t i = 0; i < trace.contacts.size(); ++i) {
    rows.push_back({trace.contacts[i].delivered_s.value_or(trace.contacts[i].time_s), 0, i});
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
  return rows;
}

const std::string& text_of(const Row& row, const PairTrace& trace, TraceRow& text) {
  if (row.rank == 0) {
    const PairContact& contact = trace.contacts[row.index];
    text.start("contact");
    text.add(contact.time_s);
    contact.delivered_s ? text.add(*contact.delivered_s) : text.skip();
    add(text, contact.points_W);
  } else if (row.rank == 1) {
    const auto& [sample, delivered_s] = trace.samples[row.index];
    text.start("sample");
    text.add(sample.time_s);
    text.add(delivered_s);
    add(text, sample.positions_W);
    add(text, sample.forces_W);
    text.add(sample.relative_residual);
  } else {
    const PairInstant& instant = trace.servo[row.index];
    text.start("servo");
    text.add(instant.time_s);
    text.skip();
    add(text, instant.positions_W);
    add(text, instant.forces_W);
  }
  return text.finish();
}

}  // namespace

bool is_pair_trace(const std::string& file) {
  try {
    LineReader lines(file);
    std::string_view header;
    return lines.next(header) && std::any_of(kNames.begin() + kPosition, kNames.begin() + kResidual,
                                             [&](std::string_view name) {
                                               return header.find(name) != std::string_view::npos;
                                             });
  } catch (const FileError&) {
    return false;
  }
}

PairTrace read_pair_trace(const std::string& file) {
  try {
    return PairTraceReader(file).read();
  } catch (const FileError& error) {
    throw TraceError(error.what());
  }
}

void write_pair_trace(const std::string& file, const PairTrace& trace) {
  check(file, trace);
  try {
    TextWriter writer(file);
    std::string header;
    for (const std::string_view name : kNames) {
      header += header.empty() ? "" : ",";
      header += name;
    }
    writer.write(header + "\n");
    TraceRow text(kColumnCount);
    for (const Row& row : rows_in_order(trace)) {
      writer.write(text_of(row, trace, text));
    }
    writer.finish();
  } catch (const FileError& error) {
    throw TraceError(error.what());
  }
}

}  // namespace forcegrid::evaluation
