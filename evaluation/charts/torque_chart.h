// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <nlohmann/json_fwd.hpp>
#include <string>
#include <vector>

#include "evaluation/motions/twist_motions.h"

namespace forcegrid::evaluation {

/// Ways to render a torque at servo rate from samples at the simulator's rate.
enum class TorqueWay : std::uint8_t {
  kHeld,       ///< the newest sample's torque, constant in W
  kLever,      ///< the lever arm of its central axis, with the force that the method renders
  kToolFrame,  ///< servo::ToolTorque without a stiffness: lever arm and couple turn with the tool
  kStiffness,  ///< servo::ToolTorque with the sample's rotational stiffness
  kGradient,   ///< with its d(torque)/dP, too: what the loop renders
};
inline constexpr std::array<TorqueWay, 5> kTorqueWays = {
    TorqueWay::kHeld, TorqueWay::kLever, TorqueWay::kToolFrame, TorqueWay::kStiffness,
    TorqueWay::kGradient};
/// "held", "lever", "tool_frame", "stiffness", "gradient": as in files.
const char* to_string(TorqueWay way) noexcept;

struct TorqueChartOptions {
  std::string scene = "small";
  std::vector<std::string> motions = twist_motion_names();
  std::string method = "auto";  ///< that renders the force, as parse_method_variant() takes it
  double servo_rate_Hz = 500.0;
  double simulator_rate_Hz = 30.0;  ///< a sample arrives one of its periods after its time
  double seconds = TwistMotion::kDuration_s;  ///< of each motion; above 1
  std::uint64_t seed = 1;
  /// Is told the fraction that is done; may be empty.
  std::function<void(double done)> progress;
};

/// One cycle. Torques [N m] about the tool's position, in W.
struct TorqueInstant {
  double time_s = 0.0;
  TwistPose pose;
  Eigen::Vector3d exact_W_Nm = Eigen::Vector3d::Zero();
  std::array<Eigen::Vector3d, kTorqueWays.size()> rendered_W_Nm{};
};

/// Errors on one motion, after its first second. Percentages are of the RMS of the exact vector.
struct TorqueRow {
  std::string motion;
  double torque_rms_Nm = 0.0;
  double force_rms_N = 0.0;
  double force_error_percent = 0.0;  ///< RMS, of the method: it knows positions alone
  std::array<double, kTorqueWays.size()> rms_error_percent{};
  std::array<double, kTorqueWays.size()> max_error_percent{};
  std::vector<TorqueInstant> instants;  ///< all, from 0 on
};

/// Turns a grasp on the scene's object and renders its torque in five ways.
///
/// The tool holds the patch at the scene's top. The exact torque is solved at every cycle by
/// ElasticObject in double precision to a residual of 1e-7. Samples are those of the simulator:
/// ElasticObject in single precision with its default options, which moves from sample to sample.
/// A sample is taken at each of the simulator's ticks, for the pose of the first cycle at or after
/// it, and arrives one period after that. The method gets its force, without dF/dP.
/// @throws ChartError for a motion that is unknown, a scene without anything to hold, a duration of
///   at most 1 s, or rates that are not finite and above 0; simulator::Error for an unknown scene;
///   std::invalid_argument for an unknown method.
std::vector<TorqueRow> measure_torques(const TorqueChartOptions& options);

/// Without the instants; keys include the units.
nlohmann::ordered_json to_json(const TorqueChartOptions& options,
                               const std::vector<TorqueRow>& rows);

/// Creates `folder` and writes wrist.json, wrist_MOTION.csv (every cycle) and wrist.svg.
/// @returns the files, the picture last.
/// @throws FileError or ChartError, with the remedy.
std::vector<std::filesystem::path> write_torque_chart(const std::filesystem::path& folder,
                                                      const TorqueChartOptions& options,
                                                      const std::vector<TorqueRow>& rows);

}  // namespace forcegrid::evaluation
