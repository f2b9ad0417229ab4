// SPDX-License-Identifier: Apache-2.0
#include "calibration/guided_moves.h"

namespace forcegrid::calibration {

bool GuidedMove::as_asked() const noexcept {
  return moved_D[axis] > kLeastGuidedMove_m && moved_D[axis] >= moved_D.cwiseAbs().maxCoeff();
}

std::array<GuidedMove, 3> guide_moves(Rig& rig, RigidBody& body,
                                      const std::function<void(const std::string&)>& ask,
                                      const std::function<bool()>& done) {
  std::array<GuidedMove, 3> moves = {
      {{.where = "to your right", .axis = 1}, {.where = "up", .axis = 2}, {.where = "toward you"}}};
  for (GuidedMove& move : moves) {
    const Eigen::Vector3d from_D = body.pose(rig.step({}).counts).position_D;
    if (ask) {
      ask(std::string("Move the tip a few centimetres ") + move.where + ", then press Enter.");
    }
    Eigen::Vector3d to_D = from_D;
    do {
      to_D = body.pose(rig.step({}).counts).position_D;
    } while (!done());
    move.moved_D = to_D - from_D;
  }
  return moves;
}

}  // namespace forcegrid::calibration
