// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "forcegrid/core/pair_force_method.h"

namespace forcegrid::evaluation {

/// A simulator's answer for both tools with its time of arrival.
struct DeliveredPairSample {
  PairSample sample;         ///< `time_s`: time that its forces were computed for
  double delivered_s = 0.0;  ///< >= sample.time_s
};

/// One cycle of both servos.
struct PairInstant {
  double time_s = 0.0;
  PairVector positions_W = PairVector::Zero();  ///< [m]
  PairVector forces_W = PairVector::Zero();     ///< [N] F_o, for evaluation only
};

/// Both tools hold the object from `time_s` on, in a new contact epoch.
struct PairContact {
  double time_s = 0.0;
  PairVector points_W = PairVector::Zero();          ///< [m] where each touched
  std::optional<double> delivered_s = std::nullopt;  ///< when the servos learnt of it
};

/// A recorded or synthetic trace of two tools that hold one object throughout. Times are in seconds
/// of one clock. Without contacts the whole trace is one contact, made at its first sample.
struct PairTrace {
  std::vector<DeliveredPairSample> samples;  ///< in order of delivery
  std::vector<PairInstant> servo;            ///< times strictly rising; never empty
  std::vector<PairContact> contacts;         ///< times rising
};

/// Whether the file's header names a column of two-tool traces, p1x_m to f2z_N. False for a file
/// that can't be read, which the reader of the trace then says.
bool is_pair_trace(const std::string& file);

/// Reads CSV, gzipped if the name ends in .gz, with the header
/// `kind,t_s,delivered_s,p1x_m,p1y_m,p1z_m,p2x_m,...,p2z_m,f1x_N,...,f2z_N[,j00_N_per_m,...,
/// j55_N_per_m][,residual]`. Kinds: sample, servo and contact. The format is in docs/traces.md.
/// @throws TraceError naming file, line, column and what was expected.
PairTrace read_pair_trace(const std::string& file);

/// Writes such a file with rows in order of arrival. Every number reads back exactly. The file
/// appears under its name only when complete.
/// @throws TraceError, e.g. for a full disk, or for a trace that is not finite.
void write_pair_trace(const std::string& file, const PairTrace& trace);

}  // namespace forcegrid::evaluation
