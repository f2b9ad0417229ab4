// SPDX-License-Identifier: Apache-2.0
// Fits that are closer than the noise that they expect (kriging_field.h, "Closeness").
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <vector>

#include "forcegrid/kriging/kriging_field.h"
#include "tests/forcegrid/kriging/kriging_support.h"

namespace forcegrid::kriging {
namespace {

using Eigen::Vector3d;
using testing::HandMotion;
using Plain = DictionaryField<double, 32, 0>;
using ForceLaw = std::function<Vector3d(const Vector3d&)>;

constexpr unsigned kSeed = 7;
constexpr double kShare = 0.3;
const History kNoHistory = History::Zero();

FieldSettings with(double nugget_N2, double share) {
  FieldSettings settings;
  settings.nugget_N2 = nugget_N2;
  settings.fitted_share = share;
  return settings;
}

// A spring in a broad hollow, as smooth as the prior expects.
Vector3d smooth_N(const Vector3d& p_m) {
  const Vector3d from_centre_m = p_m - Vector3d(0.02, -0.01, 0.03);
  constexpr double kLength_m = 0.04;
  const double depth_N_per_m =
      15.0 * std::exp(-from_centre_m.squaredNorm() / (2.0 * kLength_m * kLength_m));
  return Vector3d(-150.0 * p_m.x(), -200.0 * p_m.y(), -300.0 * p_m.z()) -
         depth_N_per_m * from_centre_m;
}

// The same with a ripple that the prior hardly expects.
Vector3d rippled_N(const Vector3d& p_m) {
  return smooth_N(p_m) + Vector3d(0.0, 0.0, 0.005 * std::sin(p_m.x() / 0.0005));
}

// Takes the samples of `seconds` of a hand's motion at 30 Hz. Returns the forces [N] that the field
// predicts 50 ms after each.
std::vector<Vector3d> play(Field& field, const ForceLaw& law, double seconds) {
  const HandMotion motion(kSeed);
  std::vector<Vector3d> predicted_N;
  for (int i = 0; i < static_cast<int>(30.0 * seconds); ++i) {
    Observation sample;
    sample.position_m = motion.position_m(i / 30.0);
    sample.force_N = law(sample.position_m);
    field.take(sample);
    predicted_N.push_back(field.read(motion.position_m((i + 1.5) / 30.0), kNoHistory).force_N);
  }
  return predicted_N;
}

double most_apart_N(const std::vector<Vector3d>& a, const std::vector<Vector3d>& b) {
  double most_N = 0.0;
  for (std::size_t i = 0; i < a.size(); ++i) {
    most_N = std::max(most_N, (a[i] - b[i]).norm());
  }
  return most_N;
}

TEST(CloseFit, ComesWithEnoughSamplesAndIsCloser) {
  const ForceLaw law = smooth_N;
  Plain close(with(1e-6, kShare));
  Plain all_noise(with(1e-6, 1.0));
  EXPECT_EQ(most_apart_N(play(close, law, 2.0), play(all_noise, law, 2.0)), 0.0) << "60 samples";
  const std::vector<Vector3d> closely_N = play(close, law, 20.0);
  const std::vector<Vector3d> noisily_N = play(all_noise, law, 20.0);
  const HandMotion motion(kSeed);
  double closely_N2 = 0.0;
  double noisily_N2 = 0.0;
  for (std::size_t i = 100; i < closely_N.size(); ++i) {
    const Vector3d exact_N = law(motion.position_m((static_cast<double>(i) + 1.5) / 30.0));
    closely_N2 += (closely_N[i] - exact_N).squaredNorm();
    noisily_N2 += (noisily_N[i] - exact_N).squaredNorm();
  }
  EXPECT_LT(closely_N2, 0.7 * noisily_N2);
}

TEST(CloseFit, IsNotTriedOnSamplesThatThePriorHardlyExpects) {
  const ForceLaw law = rippled_N;
  Plain close(with(1e-6, kShare));
  Plain all_noise(with(1e-6, 1.0));
  EXPECT_EQ(most_apart_N(play(close, law, 20.0), play(all_noise, law, 20.0)), 0.0);
}

TEST(CloseFit, EndsWhenSamplesAreNoLongerLikely) {
  Plain close(with(1e-6, kShare));
  Plain all_noise(with(1e-6, 1.0));
  play(close, smooth_N, 20.0);
  play(all_noise, smooth_N, 20.0);
  const auto a = play(close, rippled_N, 20.0);
  const auto b = play(all_noise, rippled_N, 20.0);
  const std::vector<Vector3d> a_end(a.end() - 300, a.end());
  const std::vector<Vector3d> b_end(b.end() - 300, b.end());
  EXPECT_GT(most_apart_N(a, b), 1e-4);
  EXPECT_LT(most_apart_N(a_end, b_end), 1e-6);
}

}  // namespace
}  // namespace forcegrid::kriging
