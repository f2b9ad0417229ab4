// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <functional>
#include <limits>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "evaluation/judge/judge.h"
#include "evaluation/motions/trajectories.h"
#include "evaluation/objects/force_table.h"
#include "evaluation/traces/trace.h"
#include "forcegrid/core/force_method.h"

namespace forcegrid::evaluation {

/// The object of a force table with stiffness and orientation that vary smoothly over its surface,
/// as on an organ. The force on a tool that touched at c and moved by d is
///
///   F(d; c) = a(c) R(theta(c)) F_table(R(theta(c))^T d),   R the rotation about z
///   a = 1 + 0.3 sin(x / 15 mm + phi_1) cos(y / 20 mm + phi_2)
///   theta = 0.6 rad sin(x / 20 mm + phi_3) cos(y / 15 mm + phi_4)
///
/// with (x, y, .) = c - first_contact_point_W() and seeded phases phi.
/// Source: the method study gives the ranges and lengths; the functions were chosen here.
/// Threads: const after construction. `table` must outlive it.
class VariedObject {
 public:
  VariedObject(const ForceTable& table, std::uint64_t seed);

  double stiffness_factor(const Eigen::Vector3d& point_W) const noexcept;
  double turn_rad(const Eigen::Vector3d& point_W) const noexcept;
  /// @throws ChartError for a displacement that the table does not cover.
  ForceTable::Value at(const Eigen::Vector3d& point_W, const Eigen::Vector3d& displacement_W) const;

 private:
  const ForceTable& table_;
  double phase_rad_[4];
};

/// A tool that visits nine places of a surface, 20 mm apart, and then all of them again. At each
/// place it makes five contacts of 1 s, scattered by up to +-4 mm. Before each contact it spends
/// 0.8 s in the air, the last 0.3 s straight down at 50 mm/s. It returns to a place after 81 s. In
/// contact it moves like `random`, times 1 - exp(-t / 0.25 s) and limited smoothly to 20 mm
/// sideways of the contact point.
/// Threads: const after construction.
class Visits {
 public:
  static constexpr int kPlaces = 9;
  static constexpr int kContactsAPlace = 5;
  static constexpr int kTours = 2;
  static constexpr double kContact_s = 1.0;
  static constexpr double kAir_s = 0.8;

  explicit Visits(std::uint64_t seed);

  double duration_s() const noexcept;
  const std::vector<ContactSpan>& contacts() const noexcept { return contacts_; }
  /// The index in contacts() of the contact at `time_s`, or of the next one. @param begun set to
  /// whether that contact has begun.
  std::size_t contact_from(double time_s, bool& begun) const noexcept;
  Eigen::Vector3d position_W(double time_s) const noexcept;
  /// Predicted contact point: where a tool that keeps its direction touches the surface within 0.3
  /// s; empty if it does not.
  std::optional<Eigen::Vector3d> expected_point_W(const Eigen::Vector3d& position_W,
                                                  const Eigen::Vector3d& velocity_W) const noexcept;

 private:
  Eigen::Vector3d held_W(double time_s, const ContactSpan& span) const noexcept;

  Trajectory motion_;
  std::vector<ContactSpan> contacts_;
};

/// RMS errors in % of the RMS of |F_o| in contact, pooled over contacts, in windows that start at
/// contact. NaN if there is nothing to measure.
struct ContactErrors {
  static constexpr double kNothing = std::numeric_limits<double>::quiet_NaN();
  double first_67ms_percent = kNothing;
  double first_250ms_percent = kNothing;
  double first_500ms_percent = kNothing;
  double later_percent = kNothing;  ///< from 500 ms on
};

struct VisitErrors {
  ContactErrors first_contact;   ///< the very first
  ContactErrors unknown_places;  ///< the first contact at each of the other places
  ContactErrors first_tour;      ///< all contacts but the very first
  ContactErrors returns;         ///< the first contact at each place after 81 s
  ContactErrors second_tour;     ///< all contacts
};

/// Errors and costs of a method on Visits.
struct VisitsVerdict {
  VisitErrors errors;
  Verdict verdict;  ///< over all instants, including those in the air; without forces
};

struct VisitsOptions {
  double servo_rate_Hz = 500.0;
  double simulator_rate_Hz = 30.0;
  double requests_per_s = 0.0;  ///< answered one request period later, also before contact
  bool stiffness = false;       ///< the method gets dF/dP with each sample
  std::uint64_t seed = 1;
};

/// Plays Visits on the VariedObject of `table` to `method`, as make_trace() and judge() do.
/// @throws ChartError for a motion that leaves the table.
VisitsVerdict judge_visits(ForceMethod& method, const ForceTable& table,
                           const VisitsOptions& options);

}  // namespace forcegrid::evaluation
