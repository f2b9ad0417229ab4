// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <cstdint>

namespace forcegrid::servo {

/// What the guard does with what it observes.
enum class PassivityMode : std::uint8_t {
  kObserve,  ///< counts the energy, changes no force
  kControl,  ///< damps and, if that is not enough, scales the force down
};

struct PassivityOptions {
  PassivityMode mode = PassivityMode::kControl;
  /// Keeps one energy account per axis of W and damps each axis alone, instead of one account for
  /// the whole force. An object whose force across the motion depends on the motion moves energy
  /// from one axis to another without giving any, and is then damped for nothing.
  bool each_axis = false;
  /// [J] Below this the controller does nothing: even a harmless sampled spring leaks a little
  /// energy.
  double allowance_J = 0.3e-3;
  /// [J] The force is shortened where it would take the energy beyond this. Above allowance_J.
  double bound_J = 0.6e-3;
  double max_damping_N_s_per_m = 10.0;
  /// Damping that the arm itself is trusted to have, which dissipates part of the energy that
  /// sampling adds. The value is of the method study's arm, without a hand.
  double arm_damping_N_s_per_m = 0.3;
  /// [s] Age of the counts that a cycle uses plus the delay until its force acts.
  double transport_delay_s = 0.0;
  /// Mass that a force can accelerate at once: arm and a light hand together.
  double moving_mass_kg = 0.1;
  /// Time constant of the low-pass filter of the velocity that is damped.
  double velocity_time_constant_s = 0.010;
  /// See without_trembling_counts(); from 1.0 on, a count that comes and goes has no effect.
  double dead_band_counts = 1.0;
};

/// Time-domain passivity: observes the energy that the rendered force gives to the hand, and damps
/// only as much as necessary.
///
/// Observer, where F_k is the force rendered from cycle k on and P_k the position read in cycle k:
///
///   E_k = E_{k-1} + F_{k-1} . (P_k - P_{k-1}) + c_k . (W_k - W_{k-1}) / 2          (given: E > 0)
///
/// E is the energy that the hand has received. Compressing a spring makes it negative, and a spring
/// that gives everything back ends at zero. E > 0 is energy that the hand has not put in. W is the
/// wanted force.
///
/// The last term removes what quantisation adds. Positions of resolution q make F_{k-1} . dP count
/// K q^2 / 2 for every count that a resting tool trembles across, and up to K q^2 / 8 per cycle in
/// motion. c = clamp(dP - v T, -q, q) is the part of the step that is rounding and not motion,
/// twice the expected rounding error of P_k. Summation by parts turns sum F . d(error) into the
/// last term. It vanishes for q = 0.
///
/// The controller acts on an account: E, without the part of the sampling's own energy that the
/// arm's own damping b_0 turns into heat. Sampling gives -(dP - c) . dW / 2 per cycle, for a spring
/// a power of K v^2 T / 2. All of it is left out while K <= 2 b_0 / T (Colgate and Schenkel's
/// condition), none of it from twice that K on. Otherwise the account would grow without end on any
/// lossless object, which would then be damped. A jump of the force does not count as a stiffness:
/// none of its energy is left out.
///
/// This holds for slow motion, low-passed with kSlow_s. Only a hand moves so, and a hand damps as
/// well. Faster motion is how a loop swings by itself, and the arm may then be the only damper.
/// There the transport delay t_d, which no position shows, makes a spring give
/// K v^2 (T / 2 + t_d) T per cycle. The account gets the difference, and less is left out: all of
/// it while K (1.1 T / 2 + 1.5 t_d) <= b_0, none from 1.25 times that K on.
///
/// Controller, after Hannaford and Ryu (IEEE Trans. Robotics and Automation 18(1), 2002), with an
/// energy allowance E0, a low-passed velocity v and a dead band. Without these a lossless object is
/// damped, and raw quantised velocity rattles at up to 1 N:
///
///   F = s W - b u,  u = v max(0, 1 - v_0 / |v|),  v_0 = dead_band_counts q / tau
///   b = min(b_max, (A - E0) / (T u . v)) where A > E0, else 0        (A: the account)
///
/// Damping is not always enough: a force that is 50 ms old or more needs more of it than a sampled
/// loop can give. Then s scales the wanted force down, so that the energy that it gives within
/// h = kBoundCycles T + t_d stays within the account. That includes the acceleration of the moving
/// mass m by the force itself:
///
///   s W . v h + (s |W| h)^2 / 2m <= E_bound - A
///
/// s falls at once. It rises within kRecovery_s, but only so far that the account covers the energy
/// stored before the tool. A force that grows under a tool at rest pushes it out with energy that
/// nobody put in, like an object that appears around the tool. With the stiffness k that the wanted
/// force shows along the motion, over the last kSlow_s of it,
///
///   s U <= E_bound - A,   U = min(|W|^2 / 2k, |W| kReach_m),   k = -sum dW . dP / sum |dP|^2
///
/// (U = |W| kReach_m for k <= 0). While s < 1, A + U replaces A in the damping above: motion pays
/// the debt off, and then the whole force is back. An object that keeps giving energy fades.
///
/// Time comes as dt, not from a clock. Real-time: no allocation, lock or throw. Threads: one.
class PassivityGuard {
 public:
  static constexpr double kBoundCycles = 2.0;
  static constexpr double kSlow_s = 0.05;
  static constexpr double kRecovery_s = 0.05;
  /// [m] Assumed travel of a tool under a force that hardly depends on the position.
  static constexpr double kReach_m = 0.02;

  /// @throws std::invalid_argument naming the option that can't be used.
  explicit PassivityGuard(const PassivityOptions& options = {});

  /// [m] By how much one encoder count moves the tool, by axis of W; zero (the default) for a
  /// position that is not quantised. May change with the pose.
  void set_resolution(const Eigen::Vector3d& resolution_W_m) noexcept {
    resolution_W_m_ = resolution_W_m;
  }

  /// One cycle. A position or force that is not finite is not counted and the force is returned as
  /// it is, for the limiter to find.
  /// @param dt_s [s] since the last call, for which the last force was rendered. 0: not at all.
  /// @param position_W [m] of the tool.
  /// @param wanted_W [N] force on the hand.
  /// @returns the force to render [N].
  [[nodiscard]] Eigen::Vector3d apply(double dt_s, const Eigen::Vector3d& position_W,
                                      const Eigen::Vector3d& wanted_W) noexcept;

  /// The force [N] that is really rendered, if a limit has shortened what apply() returned.
  void set_rendered(const Eigen::Vector3d& force_W) noexcept { rendered_W_ = force_W; }

  /// Begins again after a pause in which nothing was rendered and the tool may have moved.
  void restart() noexcept;

  /// Sets E and the account to zero, for a tool out of contact. Otherwise the energy that a lossy
  /// object has absorbed would be credit for an unstable one.
  void open_account() noexcept;

  /// Permits this much energy [J]: a positive account shrinks by it, down to zero. E still counts
  /// it.
  void grant(double energy_J) noexcept;

  /// [J] E since the account was opened; negative: the hand has put in more than it got.
  double energy_to_hand_J() const noexcept { return energy_W_J_.sum(); }
  /// [J] the same by axis of W.
  const Eigen::Vector3d& axis_energy_to_hand_J() const noexcept { return energy_W_J_; }
  /// [J] the largest energy_to_hand_J() since construction.
  double largest_energy_to_hand_J() const noexcept { return largest_J_; }
  /// [J] E since construction, over all accounts.
  double total_energy_to_hand_J() const noexcept { return total_J_; }
  /// [J] The account that the controller acts on.
  double account_J() const noexcept { return account_W_J_.sum(); }
  /// [J] Energy removed by damping, since construction.
  double damped_energy_J() const noexcept { return damped_J_; }

  /// [N s/m] of the last cycle; of the axis with most in mode each_axis.
  double damping_N_s_per_m() const noexcept { return damping_N_s_per_m_; }
  /// Part of the wanted force that is rendered, 0..1.
  double scale() const noexcept { return scale_; }
  /// [m/s] u.
  Eigen::Vector3d motion_W() const noexcept;

 private:
  void observe(double dt_s, const Eigen::Vector3d& step_W,
               const Eigen::Vector3d& wanted_W) noexcept;
  Eigen::Vector3d damp(double dt_s) noexcept;
  void shorten(double dt_s, const Eigen::Vector3d& step_W,
               const Eigen::Vector3d& wanted_W) noexcept;
  double allowed_scale(double dt_s, const Eigen::Vector3d& step_W, const Eigen::Vector3d& wanted_W,
                       double left_J) const noexcept;
  void find_stiffness(double dt_s, const Eigen::Vector3d& step_W,
                      const Eigen::Vector3d& wanted_W) noexcept;
  double energy_before_the_tool_J(const Eigen::Vector3d& wanted_W) const noexcept;

  PassivityOptions options_;
  Eigen::Vector3d resolution_W_m_ = Eigen::Vector3d::Zero();
  bool has_last_ = false;
  Eigen::Vector3d last_position_W_ = Eigen::Vector3d::Zero();
  Eigen::Vector3d last_wanted_W_ = Eigen::Vector3d::Zero();
  Eigen::Vector3d rendered_W_ = Eigen::Vector3d::Zero();
  Eigen::Vector3d velocity_W_ = Eigen::Vector3d::Zero();
  Eigen::Vector3d slow_velocity_W_ = Eigen::Vector3d::Zero();
  Eigen::Vector3d energy_W_J_ = Eigen::Vector3d::Zero();
  Eigen::Vector3d account_W_J_ = Eigen::Vector3d::Zero();
  double total_J_ = 0.0;
  double largest_J_ = 0.0;
  double damped_J_ = 0.0;
  double damping_N_s_per_m_ = 0.0;
  double scale_ = 1.0;
  // -dW . dP and |dP|^2, summed over the last motion: their ratio is the stiffness.
  double resisted_J_ = 0.0;
  double moved_m2_ = 0.0;
  double owed_J_ = 0.0;  // U while the force is shortened
};

}  // namespace forcegrid::servo
