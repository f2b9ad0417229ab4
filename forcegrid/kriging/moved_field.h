// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <span>

#include "forcegrid/kriging/kriging_field.h"

namespace forcegrid::kriging {

/// The same object, but moved or weaker: for one that slides away under the tool, or that is cut.
///
///   F(P, t) = s f(P - d(t)),   d(t) = d_k + v (t - t_k)
///
/// f is a DictionaryField. A sample that does not surprise it teaches f, and d, v and the strength
/// s stay. A sample that surprises it has one of two causes, the likelier of
///
///   s' = (1 + a) s, a ~ N(0, kWeaker^2):       e ~ N(0, V + kWeaker^2 f f^T)
///   d' = d + b,     b ~ N(0, kOpen_m^2 I):     e ~ N(0, V + kOpen_m^2 J J^T),
///
/// with the innovation e = F / s - f, its predicted covariance V and the stiffness J of f there. A
/// strength only falls: what adds to a force is another object (UnilateralConstraintField). If the
/// simulator's stiffness is data and surprises, both tell s, and a shift by kOpen_m or 1 N over a
/// third of a kernel length must explain them clearly worse: the force may still be small. From a
/// shift on, an extended Kalman filter follows d and v, iterated for d, until the object rests,
/// also from one contact to the next. It expects v to change the less the longer it has not. As
/// long as it is open, a sample teaches f only where f is less certain than d, or if it has the
/// simulator's stiffness: then with the variance J P J^T of the force as noise, P the covariance of
/// d.
///
/// So f never forgets what a change has not made wrong. But some shift explains any surprise: use
/// it only as a candidate that has to prove itself.
///
/// Asleep, it keeps samples by remember(): its dictionary without a factor, as far apart from each
/// other as possible, and those of other contacts at the scale of this one
/// (scale_earlier_contacts()). begin_with() factorises that.
///
/// Positions are relative to the contact point, and d is as well. Failure: turns; a part of an
/// object that moves against the rest; one that recovers, which f then learns anew.
/// Cost: as DictionaryField; while it is open half as much more. Real-time: as Field. Threads: one.
/// Source: Jazwinski, Stochastic Processes and Filtering Theory (1970), section 8.3, for the
/// iterated filter; docs/kriging.md, "Moved or weaker".
class MovedField final : public DictionaryField<float, 32, 4> {
 public:
  static constexpr double kWeaker = 0.5;
  static constexpr double kLeastStrength = 0.02;
  static constexpr double kOpen_m = 1e-3;
  static constexpr double kOpen_m_per_s = 0.03;
  /// Change of the velocity from sample to sample: at first and from an unlikely sample on ...
  static constexpr double kUnsteady_m_per_s = 0.7e-3;
  static constexpr double kUnlikely = 3.0;   ///< ... with this normalised square, see Innovation
  static constexpr double kSteadier = 0.85;  ///< share that is left after every other sample ...
  static constexpr double kSteady_m_per_s = 0.2e-3;  ///< ... down to this
  static constexpr double kRests_m_per_s = 0.3e-3;   ///< below that, and
  static constexpr double kKnown_m = 0.05e-3;        ///< with d known as well, it is closed
  static constexpr double kFurthest_m = 5e-3;        ///< from one sample to the next
  static constexpr double kLongest_s = 0.2;  ///< between samples of an object that moves steadily,
                                             ///< and of what read() foresees within a contact
  /// Between two samples, of two contacts, too: after longer it is closed.
  static constexpr double kLongestUnseen_s = 2.0;

  explicit MovedField(const FieldSettings& settings) noexcept;

  std::size_t memory_bytes() const noexcept override { return sizeof(*this); }
  void enter_contact(std::uint64_t contact, const Eigen::Vector3d& point_W) noexcept override;
  /// Innovation::explained: it is weaker now, and nothing else is as likely.
  Innovation take(const Observation& observation) noexcept override;
  void remember(const Observation& observation) noexcept override;
  /// Begins with what it remembers; the observations are among that.
  bool begin_with(std::span<const Observation> observations) noexcept override;
  Reading read(const Eigen::Vector3d& position_m, const History& history) const noexcept override;
  Eigen::Matrix3d stiffness_N_per_m(const Eigen::Vector3d& position_m,
                                    const History& history) const noexcept override;
  double deviation_N(const Eigen::Vector3d& position_m,
                     const History& history) const noexcept override;

  /// The noise of a sample's force from now on, at first that of the settings. The factor is made
  /// anew with it at the next sample. @param nugget_N2 variance per axis, positive.
  void expect_noise(double nugget_N2) noexcept;
  /// Asleep: what another field has found out in `contact` about those before it. Does nothing
  /// unless that is sure.
  void scale_earlier_contacts(std::uint64_t contact, const ContactScale& scale) noexcept;
  /// The present time, for read().
  void set_time(double time_s) noexcept;

  const Eigen::Vector3d& shift_m() const noexcept { return shift_m_; }  ///< d_k
  const Eigen::Vector3d& velocity_m_per_s() const noexcept { return velocity_m_per_s_; }
  double strength() const noexcept { return strength_; }  ///< s
  bool open() const noexcept { return open_; }
  /// Whether the object ever moved or got weaker; else this is one more DictionaryField.
  bool has_changed() const noexcept { return open_ || strength_ < 1.0 || !shift_m_.isZero(); }

 private:
  using Base = DictionaryField<float, 32, 4>;
  using Covariance = Eigen::Matrix<double, 6, 6>;  ///< of d and v
  struct Prediction {
    Eigen::Vector3d mean_N, error_N;  ///< of f
    Eigen::Matrix3d variance_N2;
    Eigen::Matrix3d slope_N_per_m;
  };
  /// What is left of a sample for f to learn.
  struct Lesson {
    Observation own;  ///< in f's frame
    bool teaches = true;
    bool corrected = false;  ///< whether the shift was
  };

  Observation in_own_frame(const Observation& observation) const noexcept;
  bool seeks_explanation(const Observation& observation, const Eigen::Vector3d& error_N,
                         const Innovation& innovation) noexcept override;
  bool weakened_by_stiffness(const Observation& observation) noexcept;
  Innovation take_open(const Observation& observation) noexcept;
  void explain(const Observation& observation, const Prediction& prediction,
               Innovation& innovation) noexcept;
  Prediction predict(const Observation& own) noexcept;
  bool moves_on(const Observation& observation) noexcept;
  Lesson correct_shift(const Observation& observation, const Prediction& prediction) noexcept;
  void expect_steadiness(double normalised) noexcept;
  void close_if_at_rest() noexcept;
  void close() noexcept;
  void find_nearest_pair() noexcept;

  Eigen::Vector3d shift_m_ = Eigen::Vector3d::Zero();
  Eigen::Vector3d velocity_m_per_s_ = Eigen::Vector3d::Zero();
  double unsteady_m_per_s_ = kUnsteady_m_per_s;  ///< deviation of its change at the next sample
  double strength_ = 1.0;
  bool open_ = false;
  Covariance covariance_ = Covariance::Zero();
  double time_s_ = 0.0;                                ///< of d_k
  std::uint64_t moved_contact_ = 0;                    ///< of d_k
  std::uint64_t entered_contact_ = 0;                  ///< at present
  Eigen::Vector3d ahead_m_ = Eigen::Vector3d::Zero();  ///< d at present
  double nearest_pair_m2_ = -1.0;   ///< of the samples that are remembered; negative: not known
  int nearest_pair_ = 0;            ///< slot of the older one
  std::uint64_t scaled_since_ = 0;  ///< contact before which all was scaled, last
  double scaled_by_ = 1.0;          ///< since it began
  bool seeks_ = true;
};

}  // namespace forcegrid::kriging
