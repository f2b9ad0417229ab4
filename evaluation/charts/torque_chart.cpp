// SPDX-License-Identifier: Apache-2.0
#include "evaluation/charts/torque_chart.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "evaluation/files/error.h"
#include "evaluation/judge/judge.h"
#include "evaluation/traces/trace.h"
#include "evaluation/traces/trace_workspace.h"
#include "forcegrid/method_variant.h"
#include "forcegrid/methods.h"
#include "rt/checkpoint.h"
#include "servo_loop/tool_torque.h"
#include "simulator/mesh/scene.h"
#include "simulator/solver/elastic_object.h"

namespace forcegrid::evaluation {
namespace {

constexpr double kAfter_s = 1.0;
constexpr double kExactResidual = 1e-7;
// Bounds that no torque here reaches: what is measured are the ways, not the limits.
constexpr servo::ToolTorqueOptions kUnbounded = {
    .max_torque_Nm = 100.0, .max_lever_m = 1.0, .max_shift_m = 1.0};

/// What the simulator has sent for one of its ticks.
struct SentWrench {
  double delivered_s = 0.0;
  servo::ToolTorque::Wrench wrench;
};

/// A motion as it was solved.
struct SolvedTwist {
  Trace trace;                       // forces, as the method gets them
  std::vector<SentWrench> wrenches;  // in order of delivery
  std::vector<TorqueInstant> instants;
};

void check(const TorqueChartOptions& options) {
  const auto usable = [](double value) { return std::isfinite(value) && value > 0.0; };
  if (!usable(options.servo_rate_Hz) || !usable(options.simulator_rate_Hz)) {
    throw ChartError("chart wrist: rates must be finite and above 0 Hz");
  }
  if (!std::isfinite(options.seconds) || options.seconds <= kAfter_s) {
    throw ChartError("chart wrist: a motion of " + std::to_string(options.seconds) +
                     " s; errors count from " + std::to_string(kAfter_s) + " s on, so give more");
  }
}

simulator::SolverOptions exactly() {
  simulator::SolverOptions options;
  options.relative_tolerance = kExactResidual;
  options.max_iterations = 4000;
  return options;
}

template <typename Real>
simulator::ElasticObject<Real> held(const simulator::Scene& scene,
                                    const simulator::SolverOptions& options) {
  simulator::ElasticObject<Real> object(scene.mesh, options);
  object.turn(scene.mesh);
  if (object.grab(scene.mesh.top_W, scene.patch_radius_m) == 0) {
    throw ChartError("chart wrist: scene " + scene.name +
                     " has nothing to hold at its top; choose another scene");
  }
  return object;
}

SentWrench wrench_of(const simulator::Equilibrium& found, const Eigen::Vector3d& position_W,
                     double delivered_s) {
  SentWrench sent;
  sent.delivered_s = delivered_s;
  sent.wrench.position_W = position_W;
  sent.wrench.force_W = found.force_W;
  sent.wrench.torque_W_Nm = found.torque_W_Nm;
  sent.wrench.orientation_WT = found.turn_W;  // upright when it took hold
  sent.wrench.has_rotational_stiffness = true;
  sent.wrench.rotational_stiffness_W_Nm_per_rad = found.rotational_stiffness_W_Nm_per_rad;
  sent.wrench.has_gradient = true;
  sent.wrench.gradient_W_N = found.torque_gradient_W_N;
  sent.wrench.stiffness_W_N_per_m = found.stiffness_W;
  return sent;
}

SolvedTwist solve(const TorqueChartOptions& options, const simulator::Scene& scene,
                  const TwistMotion& motion, const std::function<void(double)>& progress) {
  auto exact = held<double>(scene, exactly());
  auto simulated = held<float>(scene, simulator::SolverOptions{});
  const Eigen::Vector3d& point_W = scene.mesh.top_W;
  const auto cycles =
      static_cast<std::size_t>(std::lround(options.seconds * options.servo_rate_Hz));
  const double period_s = 1.0 / options.simulator_rate_Hz;
  SolvedTwist solved;
  std::size_t tick = 0;
  for (std::size_t cycle = 0; cycle < cycles; ++cycle) {
    rt::checkpoint();
    const double time_s = static_cast<double>(cycle) / options.servo_rate_Hz;
    TorqueInstant instant;
    instant.time_s = time_s;
    instant.pose = motion.pose(time_s);
    const auto& [displacement_W, turn_W] = instant.pose;
    const simulator::Equilibrium found = exact.move_to(displacement_W, turn_W);
    if (!found.converged || !found.reached || !found.torque_known) {
      throw ChartError("chart wrist: scene " + scene.name + " has no exact torque at " +
                       std::to_string(time_s) + " s of motion " + motion.name() +
                       "; choose another scene or motion");
    }
    instant.exact_W_Nm = found.torque_W_Nm;
    const Eigen::Vector3d position_W = point_W + displacement_W;
    solved.trace.servo.push_back({time_s, position_W, found.force_W});
    if (time_s >= static_cast<double>(tick) * period_s) {
      const simulator::Equilibrium sampled = simulated.move_to(displacement_W, turn_W);
      Sample sample;
      sample.time_s = time_s;
      sample.position_W = point_W + sampled.displacement_W;
      sample.force_W = sampled.force_W;
      sample.contact_epoch = 1;
      sample.contact_point_W = point_W;
      sample.relative_residual = sampled.relative_residual;
      sample.converged = sampled.converged;
      solved.trace.samples.push_back({sample, time_s + period_s});
      solved.wrenches.push_back(wrench_of(sampled, sample.position_W, time_s + period_s));
      ++tick;
    }
    solved.instants.push_back(instant);
    progress(static_cast<double>(cycle + 1) / static_cast<double>(cycles));
  }
  return solved;
}

// Fills in what each way renders, with the force that the method renders.
void render(const std::vector<Eigen::Vector3d>& forces_W, SolvedTwist& solved) {
  servo::ToolTorque with_gradient(kUnbounded);
  servo::ToolTorque with_stiffness(kUnbounded);
  servo::ToolTorque in_tool_frame(kUnbounded);
  Eigen::Vector3d held_W_Nm = Eigen::Vector3d::Zero();
  std::size_t next = 0;
  for (std::size_t cycle = 0; cycle < solved.instants.size(); ++cycle) {
    TorqueInstant& instant = solved.instants[cycle];
    for (; next < solved.wrenches.size() && solved.wrenches[next].delivered_s <= instant.time_s;
         ++next) {
      servo::ToolTorque::Wrench wrench = solved.wrenches[next].wrench;
      with_gradient.take(wrench);
      wrench.has_gradient = false;
      with_stiffness.take(wrench);
      wrench.has_rotational_stiffness = false;
      in_tool_frame.take(wrench);
      held_W_Nm = wrench.torque_W_Nm;
    }
    const Eigen::Vector3d& position_W = solved.trace.servo[cycle].position_W;
    const Eigen::Quaterniond& turn_W = instant.pose.turn_W;
    const Eigen::Vector3d& force_W = forces_W[cycle];
    const auto put = [&instant](TorqueWay way, const Eigen::Vector3d& torque_W_Nm) {
      instant.rendered_W_Nm[static_cast<std::size_t>(way)] = torque_W_Nm;
    };
    put(TorqueWay::kHeld, held_W_Nm);
    put(TorqueWay::kLever, with_stiffness.lever_W().cross(force_W));
    put(TorqueWay::kToolFrame, in_tool_frame.torque_W_Nm(position_W, turn_W, force_W, 1.0));
    put(TorqueWay::kStiffness, with_stiffness.torque_W_Nm(position_W, turn_W, force_W, 1.0));
    put(TorqueWay::kGradient, with_gradient.torque_W_Nm(position_W, turn_W, force_W, 1.0));
  }
}

TorqueRow judged(const std::string& motion, const std::vector<Eigen::Vector3d>& forces_W,
                 SolvedTwist solved) {
  TorqueRow row;
  row.motion = motion;
  double torque_squared = 0.0;
  double force_squared = 0.0;
  double force_error_squared = 0.0;
  std::array<double, kTorqueWays.size()> error_squared{};
  std::array<double, kTorqueWays.size()> largest{};
  std::size_t count = 0;
  for (std::size_t cycle = 0; cycle < solved.instants.size(); ++cycle) {
    const TorqueInstant& instant = solved.instants[cycle];
    if (instant.time_s < kAfter_s) {
      continue;
    }
    ++count;
    torque_squared += instant.exact_W_Nm.squaredNorm();
    const Eigen::Vector3d& exact_W_N = solved.trace.servo[cycle].force_W;
    force_squared += exact_W_N.squaredNorm();
    force_error_squared += (forces_W[cycle] - exact_W_N).squaredNorm();
    for (std::size_t way = 0; way < kTorqueWays.size(); ++way) {
      const double error_Nm = (instant.rendered_W_Nm[way] - instant.exact_W_Nm).norm();
      error_squared[way] += error_Nm * error_Nm;
      largest[way] = std::max(largest[way], error_Nm);
    }
  }
  const auto rms = [count](double squared) {
    return std::sqrt(squared / static_cast<double>(count));
  };
  row.torque_rms_Nm = rms(torque_squared);
  row.force_rms_N = rms(force_squared);
  row.force_error_percent = 100.0 * rms(force_error_squared) / row.force_rms_N;
  for (std::size_t way = 0; way < kTorqueWays.size(); ++way) {
    row.rms_error_percent[way] = 100.0 * rms(error_squared[way]) / row.torque_rms_Nm;
    row.max_error_percent[way] = 100.0 * largest[way] / row.torque_rms_Nm;
  }
  row.instants = std::move(solved.instants);
  return row;
}

}  // namespace

const char* to_string(TorqueWay way) noexcept {
  switch (way) {
    case TorqueWay::kHeld:
      return "held";
    case TorqueWay::kLever:
      return "lever";
    case TorqueWay::kToolFrame:
      return "tool_frame";
    case TorqueWay::kStiffness:
      return "stiffness";
    case TorqueWay::kGradient:
      return "gradient";
  }
  return "unknown way";
}

std::vector<TorqueRow> measure_torques(const TorqueChartOptions& options) {
  check(options);
  std::vector<TwistMotion> motions;
  for (const std::string& name : options.motions) {
    motions.emplace_back(name, options.seed);
  }
  static_cast<void>(parse_method_variant(options.method, {}));  // before the work
  const simulator::Scene scene = simulator::make_scene(options.scene);
  std::vector<TorqueRow> rows;
  for (const TwistMotion& motion : motions) {
    const auto progress = [&](double done) {
      if (options.progress) {
        options.progress((static_cast<double>(rows.size()) + done) /
                         static_cast<double>(motions.size()));
      }
    };
    SolvedTwist solved = solve(options, scene, motion, progress);
    MethodOptions base;
    base.grid = box_around(solved.trace);
    const MethodVariant variant = parse_method_variant(options.method, base);
    const auto method = make_force_method(variant.name, variant.options);
    JudgeOptions judging;
    judging.work_budget = kServoWorkBudget;
    judging.stiffness_to_method = false;
    judging.keep_forces = true;
    const std::vector<Eigen::Vector3d> forces_W = judge(*method, solved.trace, judging).forces_W;
    render(forces_W, solved);
    rows.push_back(judged(motion.name(), forces_W, std::move(solved)));
  }
  return rows;
}

}  // namespace forcegrid::evaluation
