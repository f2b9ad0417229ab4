// SPDX-License-Identifier: Apache-2.0
#include "tools/tuning_search.h"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>
#include <stdexcept>

#include "evaluation/judge/judge.h"
#include "forcegrid/method_variant.h"
#include "forcegrid/methods.h"
#include "stability/search.h"

namespace forcegrid::tools {
namespace {

constexpr int kHighSpeedFrame_us = 125;
constexpr int kRepeats = 3;  // the fastest counts; other work of the computer slows the others down

std::unique_ptr<ForceMethod> made(const MethodOptions& base, const TuningRow& row) {
  const MethodVariant variant = parse_method_variant(row.method, base);
  return make_force_method(variant.name, variant.options);
}

}  // namespace

evaluation::Trace at_rate(const evaluation::Trace& trace, double rate_Hz) {
  evaluation::Trace slower = trace;
  slower.servo.clear();
  const double first_s = trace.servo.front().time_s;
  double before_s = first_s;
  for (const evaluation::ServoInstant& instant : trace.servo) {
    // The next instant of the recording is as far away as the previous one.
    const double slack_s = 0.5 * (instant.time_s - before_s);
    const auto cycle = static_cast<double>(slower.servo.size());
    if (instant.time_s >= first_s + cycle / rate_Hz - slack_s) {
      slower.servo.push_back(instant);
    }
    before_s = instant.time_s;
  }
  return slower;
}

double stiffest_N_per_m(const evaluation::Trace& trace) {
  double stiffest = std::nan("");
  for (const evaluation::DeliveredSample& row : trace.samples) {
    if (row.sample.has_stiffness) {
      const Eigen::Matrix3d stiffness_W =
          -0.5 * (row.sample.stiffness_W + row.sample.stiffness_W.transpose());
      const double largest =
          Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d>(stiffness_W, Eigen::EigenvaluesOnly)
              .eigenvalues()
              .maxCoeff();
      stiffest = std::isnan(stiffest) ? largest : std::max(stiffest, largest);
    }
  }
  return stiffest;
}

void judge_on_path(const evaluation::Trace& trace, const MethodOptions& base, TuningRow& row) {
  try {
    const evaluation::Trace path = at_rate(trace, row.rate_Hz);
    row.method_us = std::numeric_limits<double>::infinity();
    row.timer_floor_us = 0.0;
    evaluation::JudgeOptions judging;
    judging.work_budget = row.fill_budget;
    for (int i = 0; i < kRepeats; ++i) {
      const std::unique_ptr<ForceMethod> method = made(base, row);
      if (method->needs().requests) {
        row.problem =
            "it requests forces at positions that it chooses, which a recorded path can't answer";
        return;
      }
      const evaluation::Verdict verdict = evaluation::judge(*method, path, judging);
      row.path_error_percent = verdict.rms_error_percent_after_1s;
      row.method_us = std::min(row.method_us, 1e-3 * verdict.cycle_ns);
      row.timer_floor_us = std::max(row.timer_floor_us, 1e-3 * verdict.timer_floor_ns);
    }
  } catch (const std::invalid_argument& error) {
    row.problem = error.what();
  }
}

double stability_margin(const MarginLoop& loop, const MethodOptions& base, const TuningRow& row) {
  stability::LoopSetup setup;
  setup.servo_rate_Hz = row.rate_Hz;
  setup.timing = stability::device_timing(
      loop.frame_period_us <= kHighSpeedFrame_us ? "w2_high_speed" : "w2_full_speed");
  setup.hand = stability::hand_of(loop.hand);
  setup.network.simulator_rate_Hz = loop.simulator_rate_Hz;
  setup.network.stiffness = true;
  setup.fill_budget = row.fill_budget;
  setup.contact_point_W = 0.5 * (base.grid.min_W + base.grid.max_W);  // grids have no force outside
  const stability::StiffnessLimit limit = stability::find_limit([&](double stiffness_N_per_m) {
    stability::LinearObject spring(stiffness_N_per_m, setup.contact_point_W);
    const std::unique_ptr<ForceMethod> method = made(base, row);
    return stability::run_closed_loop(setup, spring, method.get()).behaviour;
  });
  return limit.largest_stable_N_per_m / loop.stiffest_N_per_m;
}

}  // namespace forcegrid::tools
