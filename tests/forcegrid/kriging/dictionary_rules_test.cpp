// SPDX-License-Identifier: Apache-2.0
#include "forcegrid/kriging/dictionary_rules.h"

#include <gtest/gtest.h>

namespace forcegrid::kriging {
namespace {

using Eigen::Vector3d;

constexpr double kNugget_N2 = 1e-5;

struct Slot {
  Vector3d position_m = Vector3d::Zero();
  Vector3d force_N = Vector3d::Zero();
  Vector3d first_position_m = Vector3d::Zero();
  Vector3d first_force_N = Vector3d::Zero();
  double doubt_N2 = 0.0;
  bool used = false;
};
using Slots = std::array<Slot, 4>;

Slot slot_at(double x_m) {
  Slot slot;
  slot.position_m.x() = slot.first_position_m.x() = x_m;
  slot.used = true;
  return slot;
}

Settled settle(Slots& slots, int newest) {
  const SampleSpacing spacing;  // 1 mm
  const Slot& t = slots[static_cast<std::size_t>(newest)];
  return settle_newest(slots, newest, spacing, kNugget_N2,
                       [&](const Slot& s) { return (s.position_m - t.position_m).squaredNorm(); });
}

TEST(DictionaryRules, KeepTheNewestWhereItIsApartFromAllOthers) {
  Slots slots{slot_at(0.0), slot_at(0.0011), slot_at(0.003), Slot{}};
  EXPECT_EQ(settle(slots, 1).fate, Settled::Fate::kStays);
  Slots alone{slot_at(0.0), Slot{}, Slot{}, Slot{}};
  EXPECT_EQ(settle(alone, 0).fate, Settled::Fate::kStays);
}

TEST(DictionaryRules, LetTheNewestGoWhereAnotherIsNear) {
  Slots slots{slot_at(0.0), slot_at(0.0008), slot_at(0.003), Slot{}};
  EXPECT_EQ(settle(slots, 1).fate, Settled::Fate::kGoes);
}

TEST(DictionaryRules, ReplaceASampleThatIsDoubtedMore) {
  Slots slots{slot_at(0.0), slot_at(0.0008), slot_at(0.003), Slot{}};
  slots[0].doubt_N2 = 11.0 * kNugget_N2;
  const Settled settled = settle(slots, 1);
  EXPECT_EQ(settled.fate, Settled::Fate::kReplaces);
  EXPECT_EQ(settled.replaced, 0);
}

TEST(DictionaryRules, ReplaceASampleThatIsRepeatedButOnlyNearWhereItBegan) {
  Slots slots{slot_at(0.0), slot_at(0.0002), slot_at(0.003), Slot{}};
  EXPECT_EQ(settle(slots, 1).fate, Settled::Fate::kReplaces);
  EXPECT_EQ(slots[1].first_position_m.x(), 0.0) << "the place where the first one was";
  Slots dragged{slot_at(0.0), slot_at(0.0002), slot_at(0.003), Slot{}};
  dragged[0].first_position_m.x() = -0.0005;
  EXPECT_EQ(settle(dragged, 1).fate, Settled::Fate::kGoes);
}

TEST(DictionaryRules, GiveUpTheSampleOfLeastValueButNeverTheNewest) {
  const Slots slots{slot_at(0.0), slot_at(0.001), slot_at(0.004), slot_at(0.009)};
  const auto separation_m2 = [](const Slot& a, const Slot& b) {
    return (a.position_m - b.position_m).squaredNorm();
  };
  const auto value = [](int /*slot*/, double nearest_m2) { return nearest_m2; };
  EXPECT_EQ(least_valuable(slots, -1, separation_m2, value), 0);
  EXPECT_EQ(least_valuable(slots, 0, separation_m2, value), 1);
}

TEST(DictionaryRules, MeasureAnInnovationByItsPrediction) {
  const Vector3d error_N(0.3, 0.0, 0.0);
  const Eigen::Matrix3d covariance_N2 = 0.02 * Eigen::Matrix3d::Identity();
  EXPECT_NEAR(normalised_innovation(error_N, covariance_N2, 1.0, 0.01), 0.09 / 0.03 / 3.0, 1e-12);
  EXPECT_NEAR(normalised_innovation(error_N, covariance_N2, 2.0, 0.01), 0.09 / 0.05 / 3.0, 1e-12);
}

}  // namespace
}  // namespace forcegrid::kriging
