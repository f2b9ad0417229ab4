// SPDX-License-Identifier: Apache-2.0
// The errors that no method can be below, against sums over the instants at which nothing can be
// known.

#include "evaluation/scenarios/blind_limit.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "evaluation/scenarios/network.h"
#include "evaluation/scenarios/scenarios.h"

namespace forcegrid::evaluation {
namespace {

using Eigen::Vector3d;

constexpr double kServo_Hz = 500.0;
constexpr double kStiffness_N_per_m = 120.0;

const ForceTable& springs() {
  static const ForceTable table = [] {
    const TableLattice lattice;
    std::vector<Vector3d> forces_W;
    for (std::size_t i = 0; i < lattice.node_count(); ++i) {
      forces_W.push_back(-kStiffness_N_per_m * lattice.node_W_m(i));
    }
    return ForceTable(lattice, forces_W);
  }();
  return table;
}

SceneExtras extras_of(const std::string& name) { return chart_scene("small+" + name).extras; }

struct Case {
  Trajectory trajectory;
  Trace trace;
  BlindLimit limit;
};

Case limit_of(const std::string& motion, const SceneExtras& extras,
              const std::string& condition = "ideal") {
  Case found{Trajectory(motion), {}, {}};
  found.trace =
      make_trace(found.trajectory, springs(), network_condition(condition), kServo_Hz, 1, extras);
  found.limit =
      blind_limit(TouchedObject(found.trajectory, springs(), extras, kServo_Hz), found.trace);
  return found;
}

// In % of the RMS force, over the instants after the first second.
template <typename Error>
double rms_percent_after_1s(const Trace& trace, const Error& error_N) {
  double reference = 0.0;
  double sum = 0.0;
  double count = 0.0;
  for (const ServoInstant& instant : trace.servo) {
    reference += instant.force_W.squaredNorm();
    if (instant.time_s >= 1.0) {
      sum += std::pow(error_N(instant), 2);
      count += 1.0;
    }
  }
  return 100.0 * std::sqrt(sum / count / (reference / static_cast<double>(trace.servo.size())));
}

TEST(BlindLimit, IsNoErrorWhereNothingChanges) {
  for (const char* extras : {"viscous", "relaxing", "unconverged"}) {
    EXPECT_NEAR(limit_of("random", extras_of(extras)).limit.after_1s_percent, 0.0, 1e-9) << extras;
  }
  EXPECT_NEAR(limit_of("regrab", {}).limit.after_1s_percent, 0.0, 1e-9);
}

// The first sample is of time 0, where the tremor's force is not zero, and arrives at 1/30 s.
TEST(BlindLimit, IsTheForceItselfUntilASampleShowsIt) {
  const Case hold = limit_of("hold", {});
  double unknown = 0.0;
  double reference = 0.0;
  double first = 0.0;
  for (const ServoInstant& instant : hold.trace.servo) {
    reference += instant.force_W.squaredNorm();
    first += instant.time_s < 1.0 ? 1.0 : 0.0;
    unknown += instant.time_s < 1.0 / 30.0 - 1e-9 ? instant.force_W.squaredNorm() : 0.0;
  }
  EXPECT_GT(unknown, 0.0);
  EXPECT_NEAR(hold.limit.first_1s_percent,
              100.0 * std::sqrt(unknown / first /
                                (reference / static_cast<double>(hold.trace.servo.size()))),
              1e-9);
}

// A cut at 7 s to 60 % and at 13 s to a half of that. Samples of 30 Hz fall on both instants and
// arrive one period later, or 100 ms after that.
TEST(BlindLimit, IsWhatACutTakesUntilASampleArrives) {
  for (const auto& [condition, blind_s] :
       {std::pair{"ideal", 1.0 / 30.0}, std::pair{"delay100", 0.1 + 1.0 / 30.0}}) {
    const Case cut = limit_of("hold", extras_of("cut"), condition);
    const double expected_percent =
        rms_percent_after_1s(cut.trace, [blind_s = blind_s](const ServoInstant& instant) {
          const double force_N = instant.force_W.norm();
          for (const auto& [cut_s, factor] : {std::pair{7.0, 0.6}, std::pair{13.0, 0.5}}) {
            if (instant.time_s >= cut_s - 1e-9 && instant.time_s < cut_s + blind_s - 1e-9) {
              return force_N / factor - force_N;
            }
          }
          return 0.0;
        });
    EXPECT_GT(expected_percent, 1.0);
    EXPECT_NEAR(cut.limit.after_1s_percent, expected_percent, 1e-6) << condition;
  }
}

// A converged simulator's own error is of a millinewton's size: a sample of less does not show a
// cut, though it differs by more than 1 %; one of 12 mN does.
TEST(BlindLimit, LearnsOfACutOnlyFromAForce) {
  const SceneExtras extras = extras_of("cut");
  Case cut = limit_of("hold", extras);
  const auto limit_with_force_of = [&](double force_N) {
    Trace trace = cut.trace;
    DeliveredSample early;
    early.sample.time_s = 7.001;
    early.sample.position_W =
        first_contact_point_W() + Vector3d(force_N / kStiffness_N_per_m, 0.0, 0.0);
    early.delivered_s = 7.002;
    const auto later =
        std::find_if(trace.samples.begin(), trace.samples.end(),
                     [&](const auto& sample) { return sample.delivered_s > early.delivered_s; });
    trace.samples.insert(later, early);
    return blind_limit(TouchedObject(cut.trajectory, springs(), extras, kServo_Hz), trace)
        .after_1s_percent;
  };
  EXPECT_EQ(limit_with_force_of(0.5e-3), cut.limit.after_1s_percent);
  EXPECT_LT(limit_with_force_of(12e-3), 0.8 * cut.limit.after_1s_percent);
}

// A slide at a constant velocity: a sample tells where the object was one period before it arrives.
// So the object is believed to be where it was one to two periods ago.
TEST(BlindLimit, IsHowFarAnObjectSlidesBetweenSamples) {
  const SceneExtras sliding = extras_of("sliding");
  const Case slide = limit_of("hold", sliding);
  const Vector3d v_m_per_s = sliding.effect.slide_W_m / 3.0;
  const double largest_N = kStiffness_N_per_m * v_m_per_s.norm() * 2.0 / 30.0;
  const double at_most = rms_percent_after_1s(slide.trace, [&](const ServoInstant& instant) {
    return instant.time_s >= 6.0 && instant.time_s < 9.0 + 2.0 / 30.0 ? largest_N : 0.0;
  });
  const double at_least = rms_percent_after_1s(slide.trace, [&](const ServoInstant& instant) {
    return instant.time_s >= 6.1 && instant.time_s < 9.0 ? 0.5 * largest_N : 0.0;
  });
  EXPECT_GT(slide.limit.after_1s_percent, at_least);
  EXPECT_LT(slide.limit.after_1s_percent, at_most);
}

// A wall is unknown from its first touch until the first sample within it arrives, and known ever
// after.
TEST(BlindLimit, IsTheWallsForceUntilASampleWithinIt) {
  const SceneExtras wall = extras_of("wall_flat");
  const Case chirp = limit_of("chirp", wall);
  double touched_s = 0.0;
  double known_s = 0.0;
  const auto wall_N = [&](const Vector3d& position_W) {
    return wall.walls[0].at(position_W - first_contact_point_W()).force_W.norm();
  };
  for (const DeliveredSample& each : chirp.trace.samples) {
    if (wall_N(each.sample.position_W) > 0.0) {
      known_s = each.delivered_s;
      break;
    }
  }
  const double expected_percent =
      rms_percent_after_1s(chirp.trace, [&](const ServoInstant& instant) {
        const double push_N = wall_N(instant.position_W);
        touched_s = touched_s == 0.0 && push_N > 0.0 ? instant.time_s : touched_s;
        return instant.time_s < known_s - 1e-9 ? push_N : 0.0;
      });
  EXPECT_GT(known_s, touched_s);
  EXPECT_NEAR(chirp.limit.after_1s_percent, expected_percent, 1e-6);
}

}  // namespace
}  // namespace forcegrid::evaluation
