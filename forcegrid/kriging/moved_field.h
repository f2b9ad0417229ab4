// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstddef>
#include <cstdint>
#include <span>

#include "forcegrid/kriging/kriging_field.h"
#include "forcegrid/kriging/steady_motion.h"

namespace forcegrid::kriging {

/// The same object, but moved or weaker: for one that slides away under the tool, or that is cut.
///
///   F(P, t) = s f(P - d(t)),   d(t) = d_c + v (t - t_c)
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
/// third of a kernel length must explain them clearly worse: the force may still be small.
///
/// From a shift on, and until the object rests, f, d_c and v are learned together, from the same
/// samples (SteadyMotion). Each is taken where d is most likely to have been (iterated). A velocity
/// is constant until a change by N(0, kChange_m_per_s^2) since the sample before explains one
/// better by kChange_nats. Then, in each new contact and where nothing was seen for long, another
/// motion begins: the samples go to where they are now thought to have been, with what is
/// uncertain of that as noise.
///
/// So f never forgets what a change has not made wrong. But some shift explains any surprise: use
/// it only as a candidate that has to prove itself.
///
/// Asleep, it keeps samples by remember(): its dictionary without a factor, as far apart from each
/// other as possible, and those of other contacts at the scale of this one
/// (scale_earlier_contacts()). begin_with() factorises that.
///
/// Positions are relative to the contact point, and d is as well. Failure: turns; a part of an
/// object that moves against the rest; one that recovers, which f then learns anew; noise that
/// hides from each single sample that a slow object has come to rest.
/// Cost: as DictionaryField; while it is open twice as much, and a factorisation where a motion
/// begins or ends, each in a piece of its own. Real-time: as Field. Threads: one.
/// Source: Jazwinski, Stochastic Processes and Filtering Theory (1970), section 8.3, for the
/// iteration; docs/kriging.md, "Moved or weaker".
class MovedField final : public DictionaryField<float, 32, 4, kMotionTerms> {
 public:
  static constexpr double kWeaker = 0.5;
  static constexpr double kLeastStrength = 0.02;
  static constexpr double kOpen_m = 1e-3;
  static constexpr double kOpen_m_per_s = 0.03;
  static constexpr double kChange_m_per_s = 3e-3;
  static constexpr double kChange_nats = 3.0;
  /// Mean square of what is left of the samples from which on it is no shift.
  static constexpr double kBroken = 100.0;
  static constexpr double kRests_m_per_s = 0.3e-3;  ///< below that, and
  static constexpr double kKnown_m = 0.05e-3;       ///< with d known as well, it is closed
  static constexpr double kFurthest_m = 5e-3;       ///< from one sample to the next
  static constexpr double kLongest_s = 0.2;  ///< between samples of an object that moves steadily,
                                             ///< and of what read() foresees within a contact
  /// Between two samples, of two contacts, too: after longer it is closed.
  static constexpr double kLongestUnseen_s = 2.0;

  explicit MovedField(const FieldSettings& settings) noexcept;

  std::size_t memory_bytes() const noexcept override { return sizeof(*this); }
  void enter_contact(std::uint64_t contact, const Eigen::Vector3d& point_W) noexcept override;
  /// Innovation::explained: it is weaker now, and nothing else is as likely. What a sample that
  /// shows another motion, or surprises, needs besides is left to prepare(), in up to eight pieces.
  /// If a motion ends with it, f's samples go to where the object is thought to have been with the
  /// first of them.
  Innovation take(const Observation& observation) noexcept override;
  bool prepare() noexcept override;
  bool ready() const noexcept override { return left_ == Left::kNothing && Base::ready(); }
  Innovation taken() const noexcept override { return taken_; }
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

  const Eigen::Vector3d& shift_m() const noexcept { return shift_m_; }  ///< at the last sample
  const Eigen::Vector3d& velocity_m_per_s() const noexcept { return velocity_m_per_s_; }
  double strength() const noexcept { return strength_; }  ///< s
  bool open() const noexcept { return open_; }
  /// Whether the object ever moved or got weaker; else this is one more DictionaryField.
  bool has_changed() const noexcept { return open_ || strength_ < 1.0 || !shift_m_.isZero(); }

 private:
  using Base = DictionaryField<float, 32, 4, kMotionTerms>;
  using Covariance = SteadyMotion::Covariance;  ///< of d and v
  static_assert(SteadyMotion::kTerms == kMotionTerms);
  struct Prediction {
    Eigen::Vector3d mean_N, error_N;
    Eigen::Matrix3d variance_N2;     ///< of f and the noise
    SteadyMotion::Columns motion_N;  ///< how the force depends on what is unknown of the motion
    Eigen::Matrix3d slope_N_per_m;
  };
  /// What a take() has left to do.
  enum class Left : std::uint8_t {
    kNothing,
    kTakeMoving,     ///< a motion has begun, for another contact
    kChange,         ///< the sample shows another velocity
    kTakeChanged,    ///< which has begun
    kExplain,        ///< the sample surprises
    kTakeExplained,  ///< a motion that may explain it has begun
    kClose,          ///< no motion explains it
    kTeach,          ///< so f takes it
    kEnd,            ///< the motion, which does not fit
    kLeave,          ///< the motion, which is too far from the one before
    kTeachAlone,     ///< f takes the sample then
  };
  /// What take_moving() has found.
  enum class Found : std::uint8_t {
    kFits,      ///< the sample is taken
    kSurprise,  ///< nothing is
    kChange,    ///< of the velocity; nothing is taken
    kTooFar,    ///< from where the object was before; nothing is taken
    kBroken,    ///< the sample is taken, and the motion does not fit the samples
  };
  /// What a sample is linear about.
  struct Linear {
    double time_s = 0.0;
    SteadyMotion::Vector eta = SteadyMotion::Vector::Zero();
  };

  Observation in_own_frame(const Observation& observation) const noexcept;
  bool seeks_explanation(const Observation& observation, const Eigen::Vector3d& error_N,
                         const Innovation& innovation) noexcept override;
  bool weakened_by_stiffness(const Observation& observation) noexcept;
  /// Does what a take() has left.
  void settle() noexcept {
    while (left_ != Left::kNothing) {
      prepare();
    }
  }
  Left left_of_motion() noexcept;
  void begin_change() noexcept;
  void take_explained() noexcept;
  void complete() noexcept;
  void learn(const Innovation& innovation) noexcept;
  Innovation take_moving(const Observation& observation, bool may_change) noexcept;
  Innovation teach(const Observation& own) noexcept;
  void begin_explanation() noexcept;
  Eigen::Matrix3d slope_N_per_m(const Observation& own) noexcept;
  Prediction predict(const Observation& own) noexcept;
  bool moves_on(const Observation& observation) noexcept;
  void begin_motion(double time_s, const Covariance& opened) noexcept;
  void go_to(double time_s) noexcept;
  void end_motion() noexcept;

  Terms terms_of(const Observation& observation, int slot) noexcept override;
  bool carries_terms() const noexcept override { return open_; }
  void solve_weights() noexcept override;
  void add_features(const Eigen::Vector3d& p, const Eigen::Vector3d& origin_W,
                    const typename Factor::Columns& x, Eigen::Vector3d& mean_N,
                    Eigen::Matrix3d& covariance_N2) const noexcept override;
  SteadyMotion::Columns add_motion(const Factor::Columns& x,
                                   Eigen::Vector3d& mean_N) const noexcept;
  double explained_squares() const noexcept override {
    return open_ ? motion_.explained_squares() : 0.0;
  }

  void close_if_at_rest() noexcept;
  void close() noexcept;
  void find_nearest_pair() noexcept;

  Eigen::Vector3d shift_m_ = Eigen::Vector3d::Zero();
  Eigen::Vector3d velocity_m_per_s_ = Eigen::Vector3d::Zero();
  double strength_ = 1.0;
  bool open_ = false;
  Covariance covariance_ = Covariance::Zero();         ///< of shift and velocity
  double time_s_ = 0.0;                                ///< of the shift: of the last sample
  std::uint64_t moved_contact_ = 0;                    ///< of the shift
  std::uint64_t entered_contact_ = 0;                  ///< at present
  Eigen::Vector3d ahead_m_ = Eigen::Vector3d::Zero();  ///< d at present
  double nearest_pair_m2_ = -1.0;   ///< of the samples that are remembered; negative: not known
  int nearest_pair_ = 0;            ///< slot of the older one
  std::uint64_t scaled_since_ = 0;  ///< contact before which all was scaled, last
  double scaled_by_ = 1.0;          ///< since it began
  bool seeks_ = true;

  Left left_ = Left::kNothing;
  Observation taking_;        ///< the sample that it is left of
  double taking_to_s_ = 0.0;  ///< the time of its motion
  bool weaker_by_stiffness_ = false;
  bool clearly_weaker_ = false;
  Innovation taken_;

  SteadyMotion motion_;  ///< while it is open
  Found found_ = Found::kFits;
  bool explains_ = false;  ///< the sample that is being taken surprised
  bool began_ = false;     ///< the motion begins with that sample
  double ahead_s_ = 0.0;   ///< of ahead_m_
  Linear next_;            ///< for the sample that is being taken
  mutable Terms next_terms_N_ = Terms::Zero();
  std::array<Linear, kMaxSamplesHeld> linear_{};  ///< by slot
};

}  // namespace forcegrid::kriging
