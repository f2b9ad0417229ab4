// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <functional>
#include <string>

#include "calibration/rig.h"
#include "calibration/rigid_body.h"

namespace forcegrid::calibration {

/// How far a person moved the tip [m], in the device frame D.
struct GuidedMove {
  const char* where = "";  ///< "to your right"
  int axis = 0;            ///< of D, along which the person was asked to move it
  Eigen::Vector3d moved_D = Eigen::Vector3d::Zero();

  /// Far enough, and more along that axis than along any other.
  [[nodiscard]] bool as_asked() const noexcept;
};

/// [m] The least distance by which a person must move the tip.
inline constexpr double kLeastGuidedMove_m = 0.03;

/// Has a person move the tip to the right, up and toward themselves, with the motors at zero
/// current. If a joint's motor and encoder are both reversed, the joint passes the pushes, and the
/// stops too if they are equally far to either side, but it moves the tool the wrong way.
/// @param ask   a sentence for the person, with what ends the move.
/// @param done  asked once per step: whether they have ended it.
/// @throws what Rig::step() throws.
std::array<GuidedMove, 3> guide_moves(Rig& rig, RigidBody& body,
                                      const std::function<void(const std::string&)>& ask,
                                      const std::function<bool()>& done);

}  // namespace forcegrid::calibration
