// SPDX-License-Identifier: Apache-2.0
#include "simulator/rivals/two_rates_method.h"

#include <cmath>

#include "simulator/mesh/error.h"
#include "simulator/solver/direct_method.h"

namespace forcegrid::simulator {
namespace {

constexpr double kMethodBorderTolerance = 1e-3;  // TwoRatesOptions' own

TwoRatesOptions two_rates_options(const TwoRatesMethodOptions& asked) {
  check_positive(asked.patch_radius_m, "two-rates: patch_radius_m");
  check_positive(asked.most_vertices, "two-rates: most_vertices");
  TwoRatesOptions options;
  options.near = DirectOptions{}.solver;
  options.near.border_tolerance = kMethodBorderTolerance;
  options.near.most_vertices = asked.most_vertices;
  options.own_thread = false;
  return options;
}

}  // namespace

TwoRatesMethod::TwoRatesMethod(const SpringMesh& mesh, const TwoRatesMethodOptions& options)
    : options_(options), object_(mesh, two_rates_options(options)) {}

std::size_t TwoRatesMethod::memory_bytes() const noexcept {
  return sizeof *this - sizeof object_ + object_.memory_bytes();
}

void TwoRatesMethod::take_sample(const Sample& /*sample*/) noexcept {}

void TwoRatesMethod::contact_made(std::uint32_t /*epoch*/,
                                  const Eigen::Vector3d& point_W) noexcept {
  object_.release();
  point_W_ = point_W;
  solved_ = false;
  contact_ = Contact::kHeld;
  if (point_W.allFinite()) {
    try {
      static_cast<void>(object_.grab(point_W, options_.patch_radius_m));
    } catch (...) {
      object_.release();  // out of memory: the force's status says so
    }
  }
}

void TwoRatesMethod::contact_lost() noexcept {
  object_.release();
  contact_ = Contact::kFree;
  solved_ = false;
}

void TwoRatesMethod::observe(double /*time_s*/, const Eigen::Vector3d& position_W) noexcept {
  if (object_.grabbed() && position_W.allFinite()) {
    equilibrium_ = object_.move_to(position_W - point_W_);
    observed_W_ = point_W_ + equilibrium_.displacement_W;
    solved_ = true;
  }
}

int TwoRatesMethod::work(int /*budget*/) noexcept {
  if (object_.whole_is_due()) {
    object_.solve_whole();
    object_.hand_over();
  }
  return 0;
}

ForceEstimate TwoRatesMethod::force(double time_s,
                                    const Eigen::Vector3d& position_W) const noexcept {
  ForceEstimate estimate;
  if (!std::isfinite(time_s) || !position_W.allFinite()) {
    estimate.status = EstimateStatus::kNotFinite;
  } else if (contact_ == Contact::kFree) {
    estimate.status = EstimateStatus::kOk;
  } else if (solved_) {
    const Eigen::Vector3d force_W =
        equilibrium_.force_W + equilibrium_.stiffness_W * (position_W - observed_W_);
    const bool finite = force_W.allFinite();
    estimate.status = finite ? EstimateStatus::kOk : EstimateStatus::kNotFinite;
    if (finite) {
      estimate.force_W = force_W;
    }
  }
  return estimate;
}

}  // namespace forcegrid::simulator
