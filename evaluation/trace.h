#pragma once

#include <Eigen/Core>
#include <optional>
#include <stdexcept>
#include <string>
#include <vector>

#include "forcegrid/core/force_method.h"

namespace forcegrid::evaluation {

/// What a simulator returned: the sample, and when it arrived.
struct DeliveredSample {
  Sample sample;             ///< `time_s`: the time its force was computed for
  double delivered_s = 0.0;  ///< >= sample.time_s
};

/// One cycle of a servo: where the tool was and the true force there.
struct ServoInstant {
  double time_s = 0.0;
  Eigen::Vector3d position_W = Eigen::Vector3d::Zero();  ///< [m]
  Eigen::Vector3d force_W = Eigen::Vector3d::Zero();     ///< [N] F_o, for judging only
};

/// A contact that begins (with the point that was touched) or ends. Samples belong to the contact
/// during which they were computed.
struct ContactEvent {
  double time_s = 0.0;
  bool made = false;
  Eigen::Vector3d point_W = Eigen::Vector3d::Zero();  ///< [m]; zero when it ends
  /// When the servo got to know, at the latest with the first sample of a new contact; nothing: at
  /// `time_s`. Not before it.
  std::optional<double> delivered_s = std::nullopt;
};

/// A recording, or a made-up one, to judge force methods with. Times in seconds of one clock, W the
/// workspace frame. Without events the whole trace is one contact, made at its first sample; if the
/// first event is a release, so is the part before it.
struct Trace {
  std::vector<DeliveredSample> samples;  ///< in order of delivery
  std::vector<ServoInstant> servo;       ///< times strictly rising; never empty
  std::vector<ContactEvent> events;      ///< times rising
};

/// A trace file can't be read or written. `what()` names the file, and for a malformed row its line
/// and column, and what was expected.
class TraceError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

/// Reads CSV, gzipped if the name ends in .gz, with the header
/// `kind,t_s,delivered_s,x_m,y_m,z_m,fx_N,fy_N,fz_N[,j00_N_per_m..j22_N_per_m][,residual]`.
/// Kinds: sample (stiffness and residual may be empty), servo, contact and release. The format is
/// in docs/traces.md. Samples may stand in any order and are put in that of delivery.
/// @throws TraceError.
Trace read_trace(const std::string& file);

/// Writes such a file, rows in order of arrival, every number so that it reads back exactly; it
/// appears under its name only when it is complete.
/// @throws TraceError, e.g. for a full disk, or a trace that read_trace() would refuse.
void write_trace(const std::string& file, const Trace& trace);

}  // namespace forcegrid::evaluation
