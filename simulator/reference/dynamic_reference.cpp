// SPDX-License-Identifier: Apache-2.0
#include "simulator/reference/dynamic_reference.h"

#include <algorithm>
#include <cmath>
#include <string>

#include "rt/clock.h"
#include "simulator/mesh/error.h"
#include "simulator/solver/dynamic_object.h"
#include "text/text.h"

namespace forcegrid::simulator {
namespace {

using Eigen::Vector3d;

const std::string kWho = "reference force: ";
constexpr double kStep_s = 0.5e-3;
constexpr std::size_t kCyclesAside = 2;
constexpr std::size_t kCyclesOfSpeed = 5;
constexpr double kLongestWayIn_s = 0.1;
constexpr int kMaxSteps = 10'000;
constexpr double kProgressPeriod_s = 0.1;

void check_path(const std::vector<Vector3d>& positions_W, const std::vector<double>& times_s,
                const ReferenceOptions& options) {
  if (positions_W.size() != times_s.size()) {
    throw Error(kWho + std::to_string(positions_W.size()) + " positions and " +
                std::to_string(times_s.size()) + " times; give one time per position");
  }
  if (options.first_contact_cycle >= positions_W.size()) {
    throw Error(kWho + "the first cycle with contact is " +
                std::to_string(options.first_contact_cycle) + " of a path of " +
                std::to_string(positions_W.size()) + "; give one on the path");
  }
  for (std::size_t i = 0; i < positions_W.size(); ++i) {
    if (!positions_W[i].allFinite() || !std::isfinite(times_s[i])) {
      throw Error(kWho + "position or time " + std::to_string(i) +
                  " is not finite; cut the path there");
    }
    if (i > 0 && !(times_s[i] > times_s[i - 1])) {
      throw Error(kWho + "time " + std::to_string(i) +
                  " is not after the one before; cut the path there");
    }
  }
}

// As many cycles before as after, so that the mean has no delay.
Vector3d smoothed_W(const std::vector<Vector3d>& positions_W, std::size_t first, std::size_t i) {
  const std::size_t aside = std::min({kCyclesAside, i - first, positions_W.size() - 1 - i});
  Vector3d sum_W = Vector3d::Zero();
  for (std::size_t k = i - aside; k <= i + aside; ++k) {
    sum_W += positions_W[k];
  }
  return sum_W / static_cast<double>(2 * aside + 1);
}

// Time from the touch to the first position at the speed of the first cycles, at least one cycle.
double way_in_s(const std::vector<Vector3d>& positions_W, const std::vector<double>& times_s,
                const ReferenceOptions& options) {
  const std::size_t first = options.first_contact_cycle;
  const std::size_t later = std::min(first + kCyclesOfSpeed, positions_W.size() - 1);
  const double cycle_s = first > 0       ? times_s[first] - times_s[first - 1]
                         : later > first ? times_s[first + 1] - times_s[first]
                                         : kStep_s;
  const double way_m = (positions_W[first] - options.contact_point_W).norm();
  const double shown_m = (positions_W[later] - positions_W[first]).norm();
  const double shown_s = times_s[later] - times_s[first];
  if (way_m * shown_s > kLongestWayIn_s * shown_m) {
    return std::max(cycle_s, kLongestWayIn_s);
  }
  return shown_m > 0.0 ? std::max(cycle_s, way_m * shown_s / shown_m) : cycle_s;
}

}  // namespace

ReferenceSolution simulate_dynamic_reference(const Scene& scene,
                                             const std::vector<Vector3d>& positions_W,
                                             const std::vector<double>& times_s,
                                             const ReferenceOptions& options) {
  check_path(positions_W, times_s, options);
  const rt::TimePoint start = rt::Clock::now();
  const auto elapsed_s = [start] { return rt::seconds(rt::Clock::now() - start); };
  DynamicObject object(scene.mesh, {.step_s = kStep_s,
                                    .max_steps = kMaxSteps,
                                    .relative_tolerance = options.relative_tolerance});
  if (object.grab(options.contact_point_W, scene.patch_radius_m) == 0) {
    throw Error(kWho + "no free vertex within " + text::number_text(scene.patch_radius_m) +
                " m of the contact point; give where the tool touched");
  }
  ReferenceSolution reference;
  reference.relative_tolerance = options.relative_tolerance;
  reference.threads = 1;
  reference.forces_W.assign(positions_W.size(), Vector3d::Zero());
  reference.known.assign(positions_W.size(), 0);
  const std::size_t first = options.first_contact_cycle;
  std::fill_n(reference.known.begin(), first, std::uint8_t{1});
  double said_s = 0.0;
  for (std::size_t i = first; i < positions_W.size(); ++i) {
    if (options.cancel != nullptr && options.cancel->load(std::memory_order_relaxed)) {
      reference.cancelled = true;
      break;
    }
    const double duration_s =
        i > first ? times_s[i] - times_s[i - 1] : way_in_s(positions_W, times_s, options);
    const Equilibrium state =
        object.advance(duration_s, smoothed_W(positions_W, first, i) - options.contact_point_W);
    reference.forces_W[i] = state.force_W;
    reference.known[i] = 1;
    reference.unconverged += state.converged ? 0 : 1;
    reference.worst_relative_residual =
        std::max(reference.worst_relative_residual, state.relative_residual);
    const double now_s = elapsed_s();
    if (options.progress && now_s > said_s + kProgressPeriod_s) {
      const double done =
          static_cast<double>(i + 1 - first) / static_cast<double>(positions_W.size() - first);
      options.progress(done, now_s * (1.0 - done) / done);
      said_s = now_s;
    }
  }
  reference.elapsed_s = elapsed_s();
  if (options.progress && !reference.cancelled) {
    options.progress(1.0, 0.0);
  }
  return reference;
}

}  // namespace forcegrid::simulator
