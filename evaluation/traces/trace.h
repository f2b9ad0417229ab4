// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <optional>
#include <stdexcept>
#include <string>
#include <vector>

#include "forcegrid/core/force_method.h"

namespace forcegrid::evaluation {

/// A sample from a simulator with its time of arrival.
struct DeliveredSample {
  Sample sample;             ///< `time_s`: time that its force was computed for
  double delivered_s = 0.0;  ///< >= sample.time_s
};

/// One cycle of a servo: the tool's position and the reference force there.
struct ServoInstant {
  double time_s = 0.0;
  Eigen::Vector3d position_W = Eigen::Vector3d::Zero();  ///< [m]
  Eigen::Vector3d force_W = Eigen::Vector3d::Zero();     ///< [N] F_o, for evaluation only
};

/// A contact that begins (with the point that was touched) or ends. Samples belong to the contact
/// during which they were computed.
struct ContactEvent {
  double time_s = 0.0;
  bool made = false;
  Eigen::Vector3d point_W = Eigen::Vector3d::Zero();  ///< [m]; zero when it ends
  /// Time at which the servo learned of it, at the latest with the first sample of a new contact;
  /// not before `time_s`. Empty: at `time_s`.
  std::optional<double> delivered_s = std::nullopt;
};

/// A recorded or synthetic trace to evaluate force methods with. Times are in seconds of one clock;
/// W is the workspace frame. Without events the whole trace is one contact, made at its first
/// sample. If the first event is a release, the part before it is one contact.
struct Trace {
  std::vector<DeliveredSample> samples;  ///< in order of delivery
  std::vector<ServoInstant> servo;       ///< times strictly rising; never empty
  std::vector<ContactEvent> events;      ///< times rising
};

/// A trace file can't be read or written. `what()` names the file and, for a malformed row, its
/// line, its column and the expected content.
class TraceError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

/// Reads CSV, gzipped if the name ends in .gz, with the header
/// `kind,t_s,delivered_s,x_m,y_m,z_m,fx_N,fy_N,fz_N[,j00_N_per_m..j22_N_per_m][,residual]`.
/// Kinds: sample (stiffness and residual may be empty), servo, contact and release. The format is
/// in docs/traces.md. Samples may be in any order and are sorted by delivery.
/// @throws TraceError.
Trace read_trace(const std::string& file);

/// Writes such a file with rows in order of arrival. Every number reads back exactly. The file
/// appears under its name only when complete.
/// @throws TraceError, e.g. for a full disk or a trace that read_trace() would reject.
void write_trace(const std::string& file, const Trace& trace);

}  // namespace forcegrid::evaluation
