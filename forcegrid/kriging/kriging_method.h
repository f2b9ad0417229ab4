// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>

#include "forcegrid/core/force_method.h"
#include "forcegrid/core/method_options.h"
#include "forcegrid/kriging/contact_state.h"
#include "forcegrid/kriging/field_rendering.h"
#include "forcegrid/kriging/field_requests.h"
#include "forcegrid/kriging/kriging_field.h"
#include "forcegrid/kriging/kriging_store.h"
#include "forcegrid/kriging/sample_queue.h"
#include "forcegrid/kriging/store_follower.h"
#include "forcegrid/kriging/tool_motion.h"

namespace forcegrid {

/// One conservative force field, learnt from the samples (kriging, Gaussian process regression):
///
///   F(P) = sum_i K(P - c, p_i) alpha_i,   p_i = P_i - c_i relative to the contact point c_i
///
///   name              field                                                 needs
///   kriging           kriging::DictionaryField, 32 samples                  force
///   kriging-tangent   the same, and the stiffness of the 4 newest samples   force, stiffness
///   kriging-hinge     as kriging, and up to two one-sided constraints       force
///   kriging-store     kriging::StoreField, the 32 best of up to 8192        force
///   kriging-contact   kriging::ContactIndexedField, tells contacts apart    force, contact point
///
/// `kriging-tangent` takes samples without stiffness as well. `kriging-hinge` is risky alone where
/// surprises have other causes than constraints; EnsembleMethod uses it as a candidate.
/// `kriging-contact` asks for forces before an expected contact; where a contact point is not
/// finite, the first sample's position stands for it.
///
/// Contacts: what was learnt is kept from one contact to the next, relative to the contact point.
/// force(): see kriging::FieldRendering. Requests: see kriging::FieldRequests.
///
/// Work: a sample costs one piece, a change of some rows of the field's factor and its weights. A
/// piece is done in one call of work() and counts as half the square of the field's rows. Until
/// then the field's answers do not change. A store adds pieces, see kriging::StoreFollower.
///
/// Options used: nugget, samples, spacing_m, spacing_N.
/// Failure: the first two sample periods of the first contact; kinks; see DictionaryField.
/// Cost, memory and tuning: docs/kriging.md. Source: Rasmussen and Williams, Gaussian Processes for
/// Machine Learning, 2006, chapter 2. Real-time: as ForceMethod.
class KrigingMethod final : public ForceMethod {
 public:
  enum class Kind { kForceOnly, kTangent, kUnilateralConstraint, kStore, kContact };

  /// @param options nugget, spacings and samples must be usable: make_force_method() checks.
  KrigingMethod(Kind kind, const MethodOptions& options);
  /// With a field of one's own.
  /// @param least_uncertainty_N [N] see kriging::least_uncertainty_N().
  /// @param field of the given kind. @param store that `field` reads, of kStore; else null.
  KrigingMethod(Kind kind, double least_uncertainty_N, std::unique_ptr<kriging::Field> field,
                std::unique_ptr<kriging::SampleStore> store = nullptr) noexcept;

  const char* name() const noexcept override;
  MethodNeeds needs() const noexcept override;
  std::size_t memory_bytes() const noexcept override;
  /// Queues the sample. Samples out of contact, not finite, or older than the newest are ignored;
  /// answers to queries may come in any order. A stiffness that is not finite is left out.
  void take_sample(const Sample& sample) noexcept override;
  void observe(double time_s, const Eigen::Vector3d& position_W) noexcept override;
  void contact_made(std::uint32_t epoch, const Eigen::Vector3d& point_W) noexcept override;
  void contact_lost() noexcept override;
  void expect_contact(double time_s, const Eigen::Vector3d& point_W) noexcept override;
  int work(int budget) noexcept override;
  bool plan_request(double time_s, const Eigen::Vector3d& position_W,
                    Eigen::Vector3d& wanted_W) noexcept override;
  [[nodiscard]] ForceEstimate force(double time_s,
                                    const Eigen::Vector3d& position_W) const noexcept override;
  /// `samples_passed_over`: samples that came while kriging::SampleQueue::kLongestBacklog others
  /// still waited; the oldest of these are never taken.
  std::span<const NamedCounter> counters() const noexcept override { return {&passed_over_, 1}; }
  std::uint64_t samples_passed_over() const noexcept { return passed_over_.value; }

  const kriging::Field& field() const noexcept { return *field_; }
  /// The samples of `kriging-store`; null for the others.
  const kriging::SampleStore* store() const noexcept { return store_.get(); }
  /// False if there was not enough memory for the store; the method then must not be used.
  bool allocated() const noexcept { return store_ == nullptr || store_->allocated(); }

  // For a method that reads the field in its own way.

  /// The contact point, or null if there is no contact or the point is unknown.
  const Eigen::Vector3d* origin_W() const noexcept {
    return contact_.in_contact() && contact_.has_origin() && field_->sample_count() > 0
               ? &contact_.origin_W()
               : nullptr;
  }
  /// Where the tool will be half a sample period from now.
  Eigen::Vector3d soon_W() const noexcept {
    return tool_W() + 0.5 * motion_.sample_period_s() * motion_.velocity_W();
  }
  /// How often the field has changed, and the last of these changes at which it was surprised or
  /// found another scale for earlier contacts.
  std::uint64_t fits() const noexcept { return fits_; }
  std::uint64_t surprised_fit() const noexcept { return surprised_fit_; }
  /// Adds uncertainty and status to a force of the field within kFade_m of a sample.
  void add_uncertainty(const Eigen::Vector3d& position_W, ForceEstimate& estimate) const noexcept {
    rendering_.add_uncertainty(position_W, least_uncertainty_N_, estimate);
  }
  /// See kriging::FieldRequests::ask_on_lattice().
  void ask_on_lattice(const Eigen::Vector3d& corner_m, double spacing_m) noexcept {
    requests_.ask_on_lattice(corner_m, spacing_m);
  }
  /// [m] Beyond this distance from every sample the force fades.
  static constexpr double kFade_m = kriging::FieldRendering::kFade_m;

 private:
  void make_field(const MethodOptions& options);
  void enter_contact(const Eigen::Vector3d& point_W) noexcept;
  int take_next() noexcept;
  int prepare(int budget) noexcept;
  bool may_follow() const noexcept;
  int follow() noexcept;
  int piece_units() const noexcept;
  void update_uncertainty() noexcept;
  double deviation_N(const Eigen::Vector3d& position_W) const noexcept;
  /// Where the tool was last observed or, without observations, last sampled.
  const Eigen::Vector3d& tool_W() const noexcept {
    return motion_.observed() ? motion_.position_W() : queue_.newest_W();
  }

  Kind kind_;
  std::unique_ptr<kriging::SampleStore> store_;
  std::unique_ptr<kriging::Field> field_;
  double least_uncertainty_N_ = 0.0;

  kriging::ToolMotion motion_;
  kriging::ContactState contact_;
  kriging::SampleQueue queue_;
  std::uint64_t next_ = 0;  ///< number of the sample that the field takes next
  NamedCounter passed_over_{"samples_passed_over", 0};
  kriging::StoreFollower follower_;
  kriging::FieldRequests requests_;
  kriging::FieldRendering rendering_;
  std::uint64_t fits_ = 0;
  std::uint64_t surprised_fit_ = 0;
};

}  // namespace forcegrid
