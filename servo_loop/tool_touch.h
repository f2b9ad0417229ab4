// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <optional>

#include "contact/tool_shape.h"
#include "profiles/device_profile.h"
#include "rt/clock.h"
#include "servo_loop/tool_exchange.h"

namespace forcegrid::servo {

/// How the tools of one program's devices touch each other.
struct ToolTouchOptions {
  /// [m] Radius of the ball that a tool without a shape counts as.
  static constexpr double kPointRadius_m = 0.003;

  ToolExchange* exchange = nullptr;  ///< null: they pass through each other. It outlives the loop
  std::size_t tool = 0;              ///< place of this loop's tool in it
  double transport_delay_s = 0.0;    ///< until a force acts on the hand
  double stiffness_N_per_m = 0.0;    ///< at most largest_tool_stiffness_N_per_m() of every device
  std::optional<contact::ToolShape> shape;  ///< of every tool; nothing: a ball of kPointRadius_m
};

/// [N/m] Up to which stiffness a sampled spring between the hands of two such devices is passive.
///
/// Both loops run at T. What one tells reaches the other at most T late, and a force its motor
/// t_d = one bus frame late. One loop computes the force from its own position and the other's, at
/// most T old, and the other one gets the force at most T later. In the distance between two hands
/// that damp b each, the spring is a wall with the damping b / 2, sampled at T and late by at most
/// t_d + T / 2 at one end and t_d + T / 2 + T at the other, so by t_d + T on average. Such a wall
/// is passive for b / 2 > K (T / 2 + t_d + T) (Colgate and Schenkel, Journal of Robotic Systems
/// 14(1), 1997), so
///
///   K <= b / (3 T + 2 t_d)
///
/// with b of the profile's light hand, the least damping that the profile expects.
double largest_tool_stiffness_N_per_m(const profiles::DeviceProfile& profile, double rate_Hz);

/// The force between this loop's tool and the others' of one program: a one-sided spring,
///
///   F = g g' s f p K max(0, -gap) n
///
/// with contact::nearest()'s gap and normal n. Of two tools the loop of the first one computes it,
/// and the other one takes its negative, so that both get the same, at most a cycle apart.
///
///   g', g   gain of the other tool's hand, and of this one (applied by ForceRenderer): a hand that
///           feels nothing is none that the other could lean on
///   f       fades from 1 to 0 while the other's place is kOld_s to kTooOld_s old: a loop that has
///           ended or failed is let go of
///   p       ramps in within kRampIn_s after the place was too old or unknown
///   s       falls from 1 to 0 while the energy E that the spring has given to both hands together
///           rises from kAllowance_J to kBound_J, and before that so far that what it gives within
///           h = 3 T + t_d, at the present opening speed of the gap, stays within kBound_J - E. A
///           spring gives nothing that was not put in.
///
/// The energy is counted at each hand, with the force that acts while it moves,
///
///   E_k = E_{k-1} + F . (P_k - P_{k-1}),   F = (t_d F_{k-2} + (T - t_d) F_{k-1}) / T
///
/// and with the share of F that the limits have left, and told to the other loop. Counts that
/// tremble seem to give some: while E > 0, kForgiven_W is taken off it. E begins anew after
/// kApart_s without overlap, so that a force which had to go comes back only once the tools have
/// parted.
///
/// Where two axes meet, the normal stays as it was before.
///
/// Real-time: no allocation, lock or throw after construction. Threads: one.
class ToolTouch {
 public:
  static constexpr double kOld_s = 0.010;
  static constexpr double kTooOld_s = 0.030;
  static constexpr double kRampIn_s = 0.2;
  static constexpr double kAllowance_J = 0.3e-3;
  static constexpr double kBound_J = 0.6e-3;
  static constexpr double kForgiven_W = 0.5e-3;
  static constexpr double kApart_s = 0.1;

  /// @throws std::invalid_argument naming the option that can't be used.
  explicit ToolTouch(const ToolTouchOptions& options);

  /// One cycle: tells the other loops where this tool is, and takes where theirs are.
  /// @param elapsed_s  since the last cycle, >= 0
  /// @param own_gain  of this hand now, 0..1
  /// @returns [N] the force on this tool, without own_gain; zero where nothing touches
  Eigen::Vector3d force_W(rt::TimePoint now, double elapsed_s, const Eigen::Vector3d& position_W,
                          double own_gain) noexcept;
  /// The share of the last force that the hand gets, 0..1.
  void set_share(double share) noexcept { share_ = share; }

  [[nodiscard]] std::uint64_t cycles_touching() const noexcept { return cycles_touching_; }
  [[nodiscard]] double largest_force_N() const noexcept { return largest_force_N_; }

 private:
  struct Other {
    ToolPlace place;
    bool known = false;
    bool overlaps = false;
    double presence = 0.0;  ///< p
    double gap_m = 0.0;     ///< of the last cycle
    double apart_s = 0.0;
    double given_J = 0.0;  ///< to this hand
    Eigen::Vector3d normal_W = Eigen::Vector3d::Zero();
    Eigen::Vector3d force_W = Eigen::Vector3d::Zero();
    Eigen::Vector3d force_before_W = Eigen::Vector3d::Zero();
  };

  Eigen::Vector3d between(Other& other, double age_s, double elapsed_s,
                          const Eigen::Vector3d& position_W, bool computes) noexcept;
  [[nodiscard]] double scale_for(double given_J, double opening_J, double elapsed_s) const noexcept;
  void account(Other& other, double elapsed_s, const Eigen::Vector3d& position_W) noexcept;

  ToolTouchOptions options_;
  contact::ToolShape shape_;
  std::array<Other, ToolExchange::kMostTools> others_;
  Eigen::Vector3d last_position_W_ = Eigen::Vector3d::Zero();
  bool has_position_ = false;
  double share_ = 0.0;
  std::uint64_t cycles_touching_ = 0;
  double largest_force_N_ = 0.0;
};

}  // namespace forcegrid::servo
