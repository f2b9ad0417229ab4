// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>

#include "forcegrid/core/force_method.h"

namespace forcegrid::simulator {

/// A method whose force is a function of the tool's displacement d since the contact, and which
/// knows that function from a model of the object: samples and requests are not used.
///
///   F(P) = response(P - P_contact)
///
/// Status: kUnknown before the first contact_made() and for a contact that the model does not
/// cover; kOk without force out of contact. The uncertainty is unknown.
/// Real-time: everything after construction; what hold() costs is said where it is overridden.
class ModelMethod : public ForceMethod {
 public:
  /// Does nothing: the force comes from the model.
  void take_sample(const Sample& sample) noexcept final;
  void contact_made(std::uint32_t epoch, const Eigen::Vector3d& point_W) noexcept final;
  void contact_lost() noexcept final;
  int work(int budget) noexcept final;
  [[nodiscard]] ForceEstimate force(double time_s,
                                    const Eigen::Vector3d& position_W) const noexcept final;

 private:
  enum class Contact { kNeverHeard, kFree, kNotCovered, kHeld };

  /// Prepares response_N() for a tool that touched at `point_W` [m], finite.
  /// @returns false if the model does not cover a contact there.
  virtual bool hold(const Eigen::Vector3d& point_W) noexcept = 0;
  /// [N] The object's force on a tool at `displacement_W` [m], finite, from the contact.
  [[nodiscard]] virtual Eigen::Vector3d response_N(
      const Eigen::Vector3d& displacement_W) const noexcept = 0;

  Contact contact_ = Contact::kNeverHeard;
  Eigen::Vector3d point_W_ = Eigen::Vector3d::Zero();
};

}  // namespace forcegrid::simulator
