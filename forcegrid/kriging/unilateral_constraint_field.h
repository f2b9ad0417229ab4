// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstddef>
#include <cstdint>
#include <span>

#include "forcegrid/kriging/constraint_fit.h"
#include "forcegrid/kriging/constraint_search.h"
#include "forcegrid/kriging/kriging_field.h"
#include "forcegrid/kriging/unilateral_constraint.h"

namespace forcegrid::kriging {

/// A smooth field and up to two one-sided constraints, found in the samples: for the kink in the
/// force where the tool, holding an object, meets another one. See ConstraintFit for the model and
/// ConstraintSearch for how constraints are found.
///
/// If a constraint explains a surprising sample, it is added. Samples that are not explained are
/// doubted, as in DictionaryField; a constraint that the samples then support with less than 3 nats
/// is dropped. After four surprises in a row that no constraint explained, only every fourth is
/// searched. Without constraints the field is DictionaryField.
///
/// Contacts: constraints are fixed in the workspace. At a new contact the smooth field moves with
/// the contact point, but constraints stay where they are. The factor that scales earlier contacts
/// applies to the smooth part of their forces.
///
/// The six samples that a constraint rests on are the last to be removed from the dictionary.
///
/// The search takes many times as long as a sample. It is done by prepare(), in pieces; until it is
/// over, take() is unfinished, and read() answers as before.
///
/// A sample refines the constraints by up to two Newton steps each, which prepare() makes one by
/// one; until then read() answers with their shapes from before, fitted to the sample.
///
/// Cost beyond DictionaryField: these steps; per surprise up to two factorisations and a search;
/// per read() one exponential and one logarithm for each constraint nearby.
/// Failure: alone, it is dangerous where surprises have other causes: viscosity, relaxation, cuts,
/// noise. Use it as a candidate of an ensemble. Friction on a wall is not part of the model.
/// Real-time: as Field. Threads: one.
template <typename Real>
class UnilateralConstraintField final
    : public DictionaryField<Real, ConstraintFit::kMaxSamples, 0> {
 public:
  /// @param settings as DictionaryField's; samples <= 47, no stiffness and no history.
  explicit UnilateralConstraintField(const FieldSettings& settings) noexcept;

  std::size_t memory_bytes() const noexcept override { return sizeof(*this); }
  Innovation take(const Observation& observation) noexcept override;
  Innovation taken() const noexcept override { return taken_; }
  bool prepare() noexcept override;
  bool ready() const noexcept override {
    return seeking_ == Seeking::kNothing && refined_ == kNoneRefined && Base::ready();
  }
  /// Does not put the weights off: with them it refines and drops constraints.
  void expect_reads(bool /*expected*/) noexcept override {}
  Reading read(const Eigen::Vector3d& position_m, const History& history) const noexcept override;
  Eigen::Matrix3d stiffness_N_per_m(const Eigen::Vector3d& position_m,
                                    const History& history) const noexcept override;

  bool knows_walls() const noexcept override { return wall_count_ > 0; }
  int constraint_count() const noexcept { return wall_count_; }
  const UnilateralConstraint& constraint(int index) const noexcept {
    return walls_[static_cast<std::size_t>(index)].shape;
  }
  /// k1 [N/m] and k2 [N/m^2], negative where the wall pushes.
  Eigen::Vector2d constraint_stiffness(int index) const noexcept {
    return walls_[static_cast<std::size_t>(index)].stiffness;
  }
  /// [nats] How much more the samples support a constraint than none.
  double constraint_gain(int index) const noexcept { return fit_.gain_of(index); }

  /// Replaces the constraints by up to ConstraintFit::kMaxConstraints others, which stay unchanged
  /// until the next sample refines them.
  void set_constraints(std::span<const UnilateralConstraint> constraints) noexcept;

  /// Also ends a search.
  bool begin_with(std::span<const Observation> observations) noexcept override;

 private:
  using Base = DictionaryField<Real, ConstraintFit::kMaxSamples, 0>;
  using Factor = typename Base::Factor;
  using Stored = typename Base::Stored;
  enum class Seeking : std::uint8_t { kNothing, kBegins, kFactorises, kSearches };
  /// A constraint as read() uses it, whatever a search tries.
  struct Wall {
    UnilateralConstraint shape;
    Eigen::Vector2d stiffness = Eigen::Vector2d::Zero();
  };

  void leave_doubts_out() noexcept;
  void begin_search() noexcept;
  void restore_walls() noexcept;
  void end_search() noexcept;
  bool refine_once() noexcept;
  void update_data_scale() noexcept;
  void solve_weights() noexcept override;
  void add_features(const Eigen::Vector3d& p, const Eigen::Vector3d& origin_W,
                    const typename Factor::Columns& x, Eigen::Vector3d& mean_N,
                    Eigen::Matrix3d& covariance_N2) const noexcept override;
  Eigen::Vector3d feature_force_N(const Stored& sample) const noexcept override;
  double explained_squares() const noexcept override {
    return seeking_ == Seeking::kNothing ? fit_.solution().explained : 0.0;
  }
  bool seeks_explanation(const Observation& observation, const Eigen::Vector3d& error_N,
                         const Innovation& innovation) noexcept override;
  bool features_need(int slot) const noexcept override;
  void set_rows() noexcept;

  static constexpr int kNoneRefined = -1;
  bool refines_ = false;        ///< once the weights are solved for
  int refined_ = kNoneRefined;  ///< constraint that prepare() improves next
  bool scale_due_ = false;      ///< once they are refined
  int failures_ = 0;            ///< surprises in a row that no constraint explained
  ConstraintFit fit_;
  std::array<Wall, ConstraintFit::kMaxConstraints> walls_;
  int wall_count_ = 0;

  // Of the sample that is not finished.
  ConstraintSearch search_;
  Seeking seeking_ = Seeking::kNothing;
  Observation sought_;
  Eigen::Vector3d error_N_ = Eigen::Vector3d::Zero();
  Innovation taken_;
  std::array<double, Base::kMaxSamplesHeld> doubts_N2_{};  ///< left out by the search
  int slot_ = 0;                                           ///< of the sample while it is searched
};

}  // namespace forcegrid::kriging
