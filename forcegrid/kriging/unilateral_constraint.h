#pragma once

#include <Eigen/Core>
#include <array>
#include <span>

#include "forcegrid/kriging/kriging_field.h"

namespace forcegrid::kriging {

/// The shape of a second object that the tool may be pushed against: a plane or a ball, hard or
/// with a soft edge. Positions in the workspace frame W, in metres.
///
///   s(p) = (1 - |w|) / c,  w = n - c (p - a),   a = t - depth n;   n.(p - a) where c = 0
///   grad s = w / |w|,   phi = e ln(1 + exp(s/e))
///
/// n is the surface's normal into the object where it is nearest to the anchor t, c the curvature,
/// positive of a ball, negative of the inside of one. Turning n turns the surface about t.
struct UnilateralConstraint {
  Eigen::Vector3d anchor_W = Eigen::Vector3d::Zero();   ///< t
  Eigen::Vector3d normal_W = Eigen::Vector3d::UnitZ();  ///< n
  double depth_m = 0.0;                                 ///< s(t)
  double curvature_per_m = 0.0;                         ///< c
  double softness_m = 5e-5;                             ///< e, above zero

  struct At {
    double depth_m;            ///< s
    double penetration_m;      ///< phi
    Eigen::Vector3d inward_W;  ///< grad s
  };
  At at(const Eigen::Vector3d& position_W) const noexcept;
};

/// A smooth field and up to two second objects, found in the samples: for the kink in the force
/// where the tool that holds an object comes up against another.
///
///   F(p) = sum_i K(p, p_i) alpha_i + sum_h (k1 phi_h + k2 phi_h^2) grad s_h
///
/// with k1 ~ N(0, (1000 N/m)^2) and k2 ~ N(0, (3e4 N/m^2)^2). These are linear, columns U of a
/// covariance K + U U^T, and are solved with the field: with L the factor without them,
///
///   X = L^-1 U,  G = I + X^T X,  beta = G^-1 X^T y,  alpha = L^-T (y - X beta).
///
/// Shapes are what the samples speak for by
///
///   gain = y^T X beta / (2 s2) - 1/2 ln|G| - 1/2 (c / (40 /m))^2 - 1/2 (ln(e / 50 um) / 1.5)^2,
///
/// s2 being the scale of the data before the surprise, and at least one.
///
/// Search. A sample that surprises is taken for a constraint where one explains it. Weighed, by k1
/// alone, are planes and balls against the innovation and planes across the lattice directions near
/// it, with surfaces between the samples sorted along them; the best of each kind is refined. The
/// best of these is accepted if it gains 15 nats over the constraints that were there, refined.
/// With two in use it has to replace one. What is not explained is doubted, as in DictionaryField;
/// a constraint that the samples then speak for with less than 3 nats is dropped. After four
/// surprises in a row that no constraint explained only every fourth is looked into. Without
/// constraints the field is DictionaryField.
///
/// Refinement: Newton steps with the Gauss-Newton matrix of |y - X beta|^2, beta being eliminated
/// (variable projection), in n, depth, c and e, damped until the gain rises.
///
/// A constraint never pulls: k1 <= 0 and k1 + k2 phi <= 0 at the deepest sample; k2 is left out
/// where it would, and a shape that pulls all the same is refused. Read beyond, the force stops at
/// zero.
///
/// Contacts: constraints are fixed in the workspace. At a new contact the smooth field moves along
/// with the contact point, constraints stay where they are, and the factor that earlier contacts
/// are scaled by is that of the smooth part of their forces.
///
/// The six samples that a constraint rests on are the last to leave the dictionary.
///
/// Cost beyond DictionaryField: a sample up to two Newton steps a constraint, each six triangular
/// solves with three right-hand sides; a surprise up to two factorisations and some 200 such
/// solves; a read one exponential and one logarithm a constraint that is near.
///
/// Failure: alone, it is dangerous where surprises have other causes: viscosity, relaxation, cuts,
/// noise. Use it as a member of a bank. Friction on a wall is not part of the model.
/// Source: docs/kriging.md; variable projection: Golub and Pereyra, 2003; evidence: Rasmussen and
/// Williams, 2006, sections 2.7 and 5.4.
/// Real-time: as Field. Threads: one.
template <typename Real>
class UnilateralConstraintField final : public DictionaryField<Real, 48, 0> {
 public:
  static constexpr int kMaxConstraints = 2;

  /// @param settings as DictionaryField's; samples <= 47, no stiffness and no history.
  explicit UnilateralConstraintField(const FieldSettings& settings) noexcept;

  std::size_t memory_bytes() const noexcept override { return sizeof(*this); }
  Innovation take(const Observation& observation) noexcept override;
  Reading read(const Eigen::Vector3d& position_m, const History& history) const noexcept override;
  Eigen::Matrix3d stiffness_N_per_m(const Eigen::Vector3d& position_m,
                                    const History& history) const noexcept override;

  bool knows_walls() const noexcept override { return constraint_count_ > 0; }
  int constraint_count() const noexcept { return constraint_count_; }
  const UnilateralConstraint& constraint(int index) const noexcept {
    return constraints_[static_cast<std::size_t>(index)];
  }
  /// k1 [N/m] and k2 [N/m^2], negative where the wall pushes.
  Eigen::Vector2d constraint_stiffness(int index) const noexcept;
  /// [nats] What the samples speak for a constraint more than for none.
  double constraint_gain(int index) const noexcept {
    return gains_[static_cast<std::size_t>(index)];
  }

  /// Replaces the constraints by up to kMaxConstraints others, which stay as they are until the
  /// next sample refines them.
  void set_constraints(std::span<const UnilateralConstraint> constraints) noexcept;

 private:
  using Base = DictionaryField<Real, 48, 0>;
  using Factor = typename Base::Factor;
  using Stored = typename Base::Stored;
  using Weights = Eigen::Matrix<double, 2 * kMaxConstraints, 1>;
  using Inverse = Eigen::Matrix<double, 2 * kMaxConstraints, 2 * kMaxConstraints>;
  static constexpr int kParameters = 5;  // two of n, depth, c, ln e

  using Column = std::array<double, Factor::kStride>;
  /// X of a constraint: of k1 and k2 in units of their prior deviation.
  struct Columns {
    alignas(64) std::array<Column, 3> x{};
    double deepest_m = 0.0;  ///< phi of the deepest sample
    int active = 0;          ///< samples beyond the surface
  };
  struct Fit {
    Inverse inverse = Inverse::Identity();  ///< G^-1
    Weights weight = Weights::Zero();       ///< beta
    double explained = 0.0;                 ///< y^T X beta
    double gain = 0.0;                      ///< [nats] without the priors of the shapes
    bool pushes = true;
  };
  struct Candidate {
    UnilateralConstraint constraint;
    double nats = 0.0;
  };
  using Candidates = std::array<UnilateralConstraint, 3>;
  using Set = std::array<const Columns*, kMaxConstraints>;  ///< nullptr: no constraint

  void solve_weights() noexcept override;
  void add_features(const Eigen::Vector3d& p, const Eigen::Vector3d& origin_W,
                    const typename Factor::Columns& x, Eigen::Vector3d& mean_N,
                    Eigen::Matrix3d& covariance_N2) const noexcept override;
  Eigen::Vector3d feature_force_N(const Stored& sample) const noexcept override;
  double explained_squares() const noexcept override { return fit_.explained; }
  bool explain(const Observation& observation, const Eigen::Vector3d& error_N) noexcept override;
  bool features_need(int slot) const noexcept override;

  Eigen::Vector3d push_N(int constraint, const Eigen::Vector3d& position_W) const noexcept;
  Eigen::Matrix3d push_stiffness_N_per_m(int constraint,
                                         const Eigen::Vector3d& position_W) const noexcept;
  Eigen::Vector3d position_of_block(int block) const noexcept;
  void solve_columns(const UnilateralConstraint& constraint, Columns& columns) const noexcept;
  Fit fit(const Set& set) const noexcept;
  double gain(const Fit& fit) const noexcept;
  void leave_over(const Fit& fit) noexcept;
  void refit() noexcept;
  double refine(int index, int steps) noexcept;
  void refine_anew(int index) noexcept;
  bool derive(int index, const Fit& fit, Eigen::Matrix<double, kParameters, 1>& slope,
              Eigen::Matrix<double, kParameters, kParameters>& curvature) noexcept;
  void weigh(std::span<const UnilateralConstraint> shapes, Candidate& best) noexcept;
  void weigh_behind(const UnilateralConstraint& through, int gaps, std::span<const double> parts,
                    Candidate& best) noexcept;
  int search(const Observation& observation, const Eigen::Vector3d& error_N,
             Candidates& found) noexcept;
  bool pursue(const Observation& observation, const Eigen::Vector3d& error_N) noexcept;
  bool explained_by(const Fit& fit) noexcept;
  void drop_unneeded() noexcept;

  std::array<UnilateralConstraint, kMaxConstraints> constraints_;
  std::array<double, kMaxConstraints> gains_{};
  int constraint_count_ = 0;
  int refinements_due_ = 0;
  int failures_ = 0;           ///< surprises in a row that no constraint explained
  double scale_before_ = 1.0;  ///< s2 of the last state that was not surprised
  std::array<Columns, kMaxConstraints> columns_;
  Fit fit_;
  Columns trial_;
  std::array<Columns, kParameters> derivatives_;
  Column residual_{};
};

}  // namespace forcegrid::kriging
