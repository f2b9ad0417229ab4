// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>

#include "forcegrid/kriging/kriging_field.h"
#include "forcegrid/kriging/tool_motion.h"

namespace forcegrid::kriging {

/// Decides when a StoreField exchanges samples for those around where the tool will be 50 ms later:
/// after each sample, and after each 3 mm of motion beyond the place that it was prepared for. Each
/// time it does at most kMostPieces pieces, fewer once a piece finds no better sample, or where the
/// field knows the force well enough.
/// Real-time: nothing allocates, locks or throws.
class StoreFollower {
 public:
  static constexpr int kMostPieces = 4;
  static constexpr double kAhead_s = 0.050;
  static constexpr double kFurther_m = 0.003;

  void sample_taken() noexcept { pieces_left_ = kMostPieces; }
  void tool_moved(const ToolMotion& motion) noexcept {
    if ((motion.position_W() + kAhead_s * motion.velocity_W() - ahead_W_).norm() > kFurther_m) {
      pieces_left_ = kMostPieces;
    }
  }
  /// Whether there may be samples to exchange.
  bool due() const noexcept { return pieces_left_ > 0; }
  /// Does one piece. @param tool_W where the tool is. @param fine_N if the field deviates by less
  /// where the tool is going, nothing is exchanged until the next sample, or the next 3 mm.
  /// @returns whether the field's answers have changed.
  bool step(Field& field, const Eigen::Vector3d& tool_W, const Eigen::Vector3d& origin_W,
            const ToolMotion& motion, double fine_N = 0.0) noexcept {
    ahead_W_ = tool_W + kAhead_s * motion.velocity_W();
    const Eigen::Vector3d ahead_m = ahead_W_ - origin_W;
    if (fine_N > 0.0 && field.deviation_N(ahead_m, History::Zero()) < fine_N) {
      pieces_left_ = 0;
      return false;
    }
    const Followed followed = field.follow(tool_W - origin_W, ahead_m);
    pieces_left_ = followed.more ? pieces_left_ - 1 : 0;
    return followed.changed;
  }
  /// Where the field was last prepared for.
  const Eigen::Vector3d& ahead_W() const noexcept { return ahead_W_; }

 private:
  int pieces_left_ = 0;
  Eigen::Vector3d ahead_W_ = Eigen::Vector3d::Zero();
};

}  // namespace forcegrid::kriging
