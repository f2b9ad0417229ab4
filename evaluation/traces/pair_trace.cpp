// SPDX-License-Identifier: Apache-2.0
#include "evaluation/traces/pair_trace.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <string_view>

#include "evaluation/files/text_file.h"
#include "evaluation/traces/trace.h"
#include "evaluation/traces/trace_columns.h"

namespace forcegrid::evaluation {
namespace {

enum Column : std::size_t {
  kKind,
  kTime,
  kDelivered,
  kPosition,
  kForce = kPosition + 6,
  kStiffness = kForce + 6,
  kResidual = kStiffness + 36,
  kColumnCount,
};

constexpr std::array<std::string_view, kColumnCount> kNames = {
    "kind",        "t_s",         "delivered_s", "p1x_m",       "p1y_m",       "p1z_m",
    "p2x_m",       "p2y_m",       "p2z_m",       "f1x_N",       "f1y_N",       "f1z_N",
    "f2x_N",       "f2y_N",       "f2z_N",       "j00_N_per_m", "j01_N_per_m", "j02_N_per_m",
    "j03_N_per_m", "j04_N_per_m", "j05_N_per_m", "j10_N_per_m", "j11_N_per_m", "j12_N_per_m",
    "j13_N_per_m", "j14_N_per_m", "j15_N_per_m", "j20_N_per_m", "j21_N_per_m", "j22_N_per_m",
    "j23_N_per_m", "j24_N_per_m", "j25_N_per_m", "j30_N_per_m", "j31_N_per_m", "j32_N_per_m",
    "j33_N_per_m", "j34_N_per_m", "j35_N_per_m", "j40_N_per_m", "j41_N_per_m", "j42_N_per_m",
    "j43_N_per_m", "j44_N_per_m", "j45_N_per_m", "j50_N_per_m", "j51_N_per_m", "j52_N_per_m",
    "j53_N_per_m", "j54_N_per_m", "j55_N_per_m", "residual"};

constexpr char kHeaderForm[] =
    "kind,t_s,delivered_s,p1x_m,p1y_m,p1z_m,p2x_m,p2y_m,p2z_m,f1x_N,f1y_N,f1z_N,f2x_N,f2y_N,f2z_N"
    "[,j00_N_per_m,...,j55_N_per_m][,residual]";

constexpr std::string_view kRowTime = ", the row's time";

class PairTraceReader {
 public:
  explicit PairTraceReader(const std::string& file)
      : file_(file), rows_(file, kNames, kStiffness, kHeaderForm) {
    rows_.all_or_none(kStiffness, kResidual, "36");
  }

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

  void read_sample() {
    DeliveredPairSample row;
    row.sample.time_s = rows_.number(kTime);
    row.delivered_s = rows_.not_before(kDelivered, kTime, kRowTime);
    row.sample.positions_W = six(kPosition);
    row.sample.forces_W = six(kForce);
    Eigen::MatrixXd stiffness_W(6, 6);
    row.sample.has_stiffness = rows_.stiffness(kStiffness, stiffness_W, "36");
    if (row.sample.has_stiffness) {
      row.sample.stiffness_W = stiffness_W;
    }
    row.sample.relative_residual = rows_.zero_or_more(kResidual);
    trace_.samples.push_back(row);
  }

  void read_servo() {
    PairInstant row;
    row.time_s = rows_.time_after(kTime, last_time_s(trace_.servo), "servo");
    row.positions_W = six(kPosition);
    row.forces_W = six(kForce);
    trace_.servo.push_back(row);
  }

  void read_contact() {
    PairContact row;
    row.time_s = rows_.time_after(kTime, last_time_s(trace_.contacts), "contact");
    if (!rows_.empty(kDelivered)) {
      row.delivered_s = rows_.not_before(kDelivered, kTime, kRowTime);
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
  TraceCheck rows(file, trace.servo.size());
  for (const PairInstant& row : trace.servo) {
    rows.servo_instant(row.time_s, row.positions_W.allFinite() && row.forces_W.allFinite());
  }
  for (std::size_t i = 0; i < trace.samples.size(); ++i) {
    const auto& [sample, delivered_s] = trace.samples[i];
    if (!std::isfinite(sample.time_s) || !std::isfinite(delivered_s) ||
        !sample.positions_W.allFinite() || !sample.forces_W.allFinite() ||
        (sample.has_stiffness && !sample.stiffness_W.allFinite()) ||
        !(sample.relative_residual >= 0.0) || !(delivered_s >= sample.time_s)) {
      rows.refuse("sample", i,
                  "is not finite, arrives before its own time or has a negative residual");
    }
  }
  for (std::size_t i = 0; i < trace.contacts.size(); ++i) {
    const PairContact& row = trace.contacts[i];
    const double arrival_s = row.delivered_s.value_or(row.time_s);
    if (!std::isfinite(arrival_s) || !row.points_W.allFinite() || !(arrival_s >= row.time_s) ||
        (i > 0 && row.time_s <= trace.contacts[i - 1].time_s)) {
      rows.refuse("contact", i, "is not finite or out of order");
    }
  }
}

void add(TraceRow& text, const PairVector& both) {
  text.add(Eigen::Vector3d(both.head<3>()));
  text.add(Eigen::Vector3d(both.tail<3>()));
}

// @param stiffness  whether the file has its columns
const std::string& text_of(const TraceRowPlace& row, const PairTrace& trace, bool stiffness,
                           TraceRow& text) {
  if (row.kind == TraceRowPlace::Kind::kContact) {
    const PairContact& contact = trace.contacts[row.index];
    text.start("contact", contact.time_s, contact.delivered_s);
    add(text, contact.points_W);
  } else if (row.kind == TraceRowPlace::Kind::kSample) {
    const auto& [sample, delivered_s] = trace.samples[row.index];
    text.start("sample", sample.time_s, delivered_s);
    add(text, sample.positions_W);
    add(text, sample.forces_W);
    for (Eigen::Index i = 0; stiffness && i < 36; ++i) {
      sample.has_stiffness ? text.add(sample.stiffness_W(i / 6, i % 6)) : text.skip();
    }
    text.add(sample.relative_residual);
  } else {
    const PairInstant& instant = trace.servo[row.index];
    text.start("servo", instant.time_s, std::nullopt);
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
    return lines.next(header) &&
           std::any_of(
               kNames.begin() + kPosition, kNames.begin() + kStiffness,
               [&](std::string_view name) { return header.find(name) != std::string_view::npos; });
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
    const bool stiffness = std::any_of(trace.samples.begin(), trace.samples.end(),
                                       [](const auto& row) { return row.sample.has_stiffness; });
    std::string header;
    for (std::size_t column = 0; column < kColumnCount; ++column) {
      if (stiffness || column < kStiffness || column >= kResidual) {
        header += header.empty() ? "" : ",";
        header += kNames[column];
      }
    }
    writer.write(header + "\n");
    TraceRow text(stiffness ? kColumnCount : kColumnCount - 36);
    for (const TraceRowPlace& row :
         rows_in_order(arrivals_of(trace.contacts, trace.samples, trace.servo))) {
      writer.write(text_of(row, trace, stiffness, text));
    }
    writer.finish();
  } catch (const FileError& error) {
    throw TraceError(error.what());
  }
}

}  // namespace forcegrid::evaluation
