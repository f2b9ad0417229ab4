// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <vector>

#include "rt/vectors.h"
#include "tests/servo_loop/loop_bench.h"

namespace forcegrid::servo {
namespace {

using Eigen::Vector3d;

class LoopLadder : public LoopBench {
 protected:
  // A tool that moves along y, to and fro at 50 mm/s.
  Fault move(bool with_samples) {
    y_m_ += towards_ * 0.0001;
    towards_ = y_m_ > 0.03 ? -1.0 : (y_m_ < -0.03 ? 1.0 : towards_);
    const Fault fault = cycle(Vector3d(0.0, y_m_, 0.0), with_samples);
    last_ = record();
    return fault;
  }

  double y_m_ = 0.0;
  double towards_ = 1.0;
  CycleRecord last_;
};

TEST_F(LoopLadder, StepsDownToDampingAndThenToZeroCurrentWhenSamplesStop) {
  method_.force_W = Vector3d(0.0, 0.0, -1.0);
  for (int i = 0; i < 200; ++i) {
    ASSERT_EQ(move(true), Fault::kNone);
  }
  ASSERT_EQ(last_.rung, Rung::kFresh);
  std::vector<Rung> rungs{last_.rung};
  for (int i = 0; i < 1300; ++i) {  // 2.6 s
    ASSERT_EQ(move(false), Fault::kNone);
    if (rungs.back() != last_.rung) {
      rungs.push_back(last_.rung);
    }
    const Vector3d force_D = rt::to_vector(last_.commanded_force_D_N);
    if (last_.rung == Rung::kDamping && last_.gain == 0.0) {
      // Against the motion and along nothing else, by 3 N s/m at most.
      EXPECT_LE(force_D.y() * last_.velocity_W_m_per_s[1], 0.0);
      EXPECT_LE(force_D.norm(), 3.0 * rt::to_vector(last_.velocity_W_m_per_s).norm() + 1e-9);
    }
    if (i == 500) {
      EXPECT_EQ(last_.rung, Rung::kDamping);
      EXPECT_GT(force_D.norm(), 0.08);
    }
  }
  EXPECT_EQ(rungs, (std::vector<Rung>{Rung::kFresh, Rung::kOld, Rung::kDamping, Rung::kZero}));
  EXPECT_TRUE(is_zero(device_.commands.back()));
  // And back by the ramp.
  cycles_ = 0;
  ASSERT_EQ(move(true), Fault::kNone);
  EXPECT_EQ(last_.rung, Rung::kFresh);
  EXPECT_NEAR(last_.gain, 0.02, 1e-9);  // 2 ms of a 100 ms ramp
}

TEST_F(LoopLadder, DampsNothingOutsideTheProfilesBox) {
  for (int i = 0; i < 200; ++i) {
    ASSERT_EQ(move(true), Fault::kNone);
  }
  for (int i = 0; i < 300; ++i) {
    ASSERT_EQ(move(false), Fault::kNone);
  }
  ASSERT_EQ(last_.rung, Rung::kDamping);
  double y_m = y_m_;
  while (y_m < profile_.limits.workspace_max_m[1] + 0.005) {
    ASSERT_EQ(cycle(Vector3d(0.0, y_m += 0.0002, 0.0), false), Fault::kNone);
  }
  EXPECT_TRUE(is_zero(device_.commands.back()));
}

}  // namespace
}  // namespace forcegrid::servo
