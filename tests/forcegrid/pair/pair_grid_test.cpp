// SPDX-License-Identifier: Apache-2.0
#include "forcegrid/pair/pair_grid.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <memory>
#include <random>
#include <string>
#include <vector>

#include "forcegrid/method_variant.h"
#include "forcegrid/pair/pair_grid_method.h"
#include "forcegrid/pair_methods.h"
#include "tests/forcegrid/pair/series_springs.h"

namespace forcegrid::pair {
namespace {

constexpr double kSpacing_m = 0.003;
constexpr unsigned kSeed = 21;
constexpr double kSingle_N = 1e-5;  // rounding of single precision, forces of some newtons

RadialWeight reaching(double radius_m) {
  RadialWeight weight;
  weight.influence_radius_m = radius_m;
  return weight;
}

void spread(PairGrid& grid, const PairVector& p_m, const PairVector& f_N) {
  grid.begin(p_m, f_N);
  while (grid.spread() > 0) {
  }
}

// A function with a coefficient for each product of coordinates: what the read is exact for.
class Multilinear {
 public:
  explicit Multilinear(unsigned seed) {
    std::mt19937 numbers(seed);
    std::uniform_real_distribution<double> coefficient(-1.0, 1.0);
    for (PairVector& each : coefficients_N_) {
      for (double& component : each) {
        component = coefficient(numbers);
      }
    }
  }
  PairVector at(const PairVector& cells) const {
    PairVector sum = PairVector::Zero();
    for (unsigned product = 0; product < coefficients_N_.size(); ++product) {
      double factor = 1.0;
      for (int a = 0; a < 6; ++a) {
        factor *= ((product >> a) & 1U) != 0 ? cells[a] : 1.0;
      }
      sum += factor * coefficients_N_[product];
    }
    return sum;
  }

 private:
  std::array<PairVector, 64> coefficients_N_;
};

// Samples at the 64 corners of a cell, too near to reach another vertex. Cells whose corners lie in
// one block, in 64, and on both sides of the origin.
TEST(PairGrid, IsExactForMultilinearFunctionsWithinACell) {
  RecordProperty("seed", static_cast<int>(kSeed));
  std::mt19937 numbers(kSeed);
  std::uniform_real_distribution<double> within(0.0, 1.0);
  const std::vector<PairVector> lowest = {PairVector::Zero(), PairVector::Ones(),
                                          -PairVector::Ones(),
                                          (PairVector() << 4, -3, 7, 0, 1, -6).finished()};
  for (const PairVector& low : lowest) {
    const Multilinear function(kSeed);
    PairGrid grid(kSpacing_m, reaching(0.9 * kSpacing_m), 200);
    for (unsigned corner = 0; corner < 64; ++corner) {
      PairVector cells;
      for (int a = 0; a < 6; ++a) {
        cells[a] = (corner >> a) & 1U;
      }
      spread(grid, kSpacing_m * (low + cells), function.at(cells));
    }
    for (int i = 0; i < 20; ++i) {
      PairVector cells;
      for (double& x : cells) {
        x = within(numbers);
      }
      const PairGrid::Reading reading = grid.read(kSpacing_m * (low + cells));
      EXPECT_NEAR(reading.known, 1.0, 1e-5);
      EXPECT_LT((reading.force_N - function.at(cells)).norm(), 10 * kSingle_N);
    }
  }
}

// w(d) = 1/(1+(d/L)^2) - (d/L)/((r/L)(1+(r/L)^2)), and the mean of two samples by hand.
TEST(PairGrid, AveragesTheSamplesNearAVertexByThePapersWeight) {
  const double r = 6.0;
  const auto w = [r](double d_mm) {
    return 1.0 / (1.0 + d_mm * d_mm) - d_mm / (r * (1.0 + r * r));
  };
  PairGrid grid(kSpacing_m, reaching(1e-3 * r), 3000);
  PairVector near_m = PairVector::Zero();
  near_m[2] = 0.0015;
  PairVector far_m = PairVector::Zero();
  far_m[4] = -0.004;
  const PairVector near_N = PairVector::LinSpaced(6, 1.0, 6.0);
  const PairVector far_N = PairVector::Constant(-2.0);
  spread(grid, near_m, near_N);
  spread(grid, far_m, far_N);
  const PairVector expected_N = (w(1.5) * near_N + w(4.0) * far_N) / (w(1.5) + w(4.0));
  EXPECT_LT((grid.read(PairVector::Zero()).force_N - expected_N).norm(), kSingle_N);
}

// Vertices within r, counted one by one.
TEST(PairGrid, ReachesEveryVertexWithinItsRadiusAndNoOther) {
  const double radius_m = 2.0 * kSpacing_m;
  PairGrid grid(kSpacing_m, reaching(radius_m), 3000);
  const PairVector at_m =
      kSpacing_m * (PairVector() << 0.3, -0.2, 0.45, 0.1, -0.4, 0.25).finished();
  spread(grid, at_m, PairVector::Ones());
  int reached = 0;
  int expected = 0;
  for (int n = 0; n < 7 * 7 * 7 * 7 * 7 * 7; ++n) {
    PairVector vertex_m;
    for (int a = 0, rest = n; a < 6; ++a, rest /= 7) {
      vertex_m[a] = kSpacing_m * (rest % 7 - 3);
    }
    // Just inside of the vertex's cell, so that rounding cannot choose the one before.
    const PairVector read_m = vertex_m.array() + 1e-9;
    reached += grid.read(read_m).known > 0.5 ? 1 : 0;
    expected += (vertex_m - at_m).norm() < radius_m ? 1 : 0;
  }
  EXPECT_GT(expected, 200);
  EXPECT_EQ(reached, expected);
}

// A pool that is much too small still answers near the newest sample as a large one does.
TEST(PairGrid, KeepsWhatIsNearWhenItsPoolIsUsedUp) {
  RecordProperty("seed", static_cast<int>(kSeed));
  const double radius_m = 1.5 * kSpacing_m;
  PairGrid small(kSpacing_m, reaching(radius_m), 400);
  PairGrid large(kSpacing_m, reaching(radius_m), 40000);
  const testing::SeriesSprings object;
  testing::RandomPositions positions(kSeed, 0.02);
  int known = 0;
  for (int i = 0; i < 150; ++i) {
    const PairVector p_m = positions.next();
    spread(small, p_m, object.forces_N(p_m));
    spread(large, p_m, object.forces_N(p_m));
    ASSERT_LE(small.blocks_used(), 400);
    const PairGrid::Reading found = small.read(p_m);
    const PairGrid::Reading expected = large.read(p_m);
    EXPECT_LE(found.known, expected.known + 1e-5);
    known += found.known > 0.95 * expected.known ? 1 : 0;
  }
  EXPECT_GT(small.blocks_given_up(), 1000U);
  EXPECT_EQ(large.blocks_given_up(), 0U);
  EXPECT_GT(known, 135);
}

TEST(PairGrid, IsEmptyWhenCleared) {
  PairGrid grid(kSpacing_m, reaching(2 * kSpacing_m), 3000);
  const PairVector p_m = PairVector::Constant(0.001);
  spread(grid, p_m, PairVector::Ones());
  EXPECT_GT(grid.read(p_m).known, 0.99);
  grid.clear();
  EXPECT_EQ(grid.read(p_m).known, 0.0);
  EXPECT_EQ(grid.blocks_used(), 0);
  spread(grid, p_m, 2.0 * PairVector::Ones());  // nothing of before is averaged in
  EXPECT_NEAR(grid.read(p_m).force_N[0], 2.0, kSingle_N);
}

std::unique_ptr<PairForceMethod> method(const std::string& text) {
  const MethodVariant variant = parse_pair_variant(text, {});
  return make_pair_force_method(variant.name, variant.options);
}

PairSample sample(double time_s, const PairVector& p_W, double force_N) {
  PairSample made;
  made.time_s = time_s;
  made.positions_W = p_W;
  made.forces_W.setConstant(force_N);
  return made;
}

TEST(PairGridMethod, ReadsTheDenseGridNearSamplesAndTheSparseOneFartherAway) {
  const auto grid = method("forcegrid-6d h=2mm r=4mm");
  const PairVector touched_W = PairVector::Constant(0.1);
  EXPECT_EQ(grid->forces(0.0, touched_W).status, EstimateStatus::kUnknown);
  grid->contacts_made(1, touched_W);
  EXPECT_EQ(grid->forces(0.0, touched_W).status, EstimateStatus::kUnknown);
  const PairVector at_W = touched_W.array() + 0.0005;
  grid->take_sample(sample(0.0, at_W, 3.0));
  while (grid->work(1000) > 0) {
  }
  const PairEstimate near = grid->forces(0.1, at_W);
  EXPECT_EQ(near.status, EstimateStatus::kOk);
  EXPECT_NEAR(near.forces_W[5], 3.0, kSingle_N);
  // 6 mm away: beyond the dense grid's 4 mm, within the sparse one's 12.
  const PairEstimate aside = grid->forces(0.1, at_W + 0.006 * PairVector::Unit(0));
  EXPECT_GT(aside.forces_W[5], 0.5);
  EXPECT_LE(aside.forces_W[5], 3.0 + kSingle_N);
  const PairEstimate far = grid->forces(0.1, at_W + 0.03 * PairVector::Unit(0));
  EXPECT_EQ(far.status, EstimateStatus::kUnknown);
  EXPECT_EQ(far.forces_W, PairVector::Zero());
  grid->contacts_lost();
  EXPECT_EQ(grid->forces(0.1, at_W).status, EstimateStatus::kOk);
  EXPECT_EQ(grid->forces(0.1, at_W).forces_W, PairVector::Zero());
  grid->contacts_made(2, touched_W);
  EXPECT_EQ(grid->forces(0.1, at_W).status, EstimateStatus::kUnknown);
}

TEST(PairGridMethod, CountsSamplesOutsideAndPiecesWithinItsBudget) {
  const auto grid = method("forcegrid-6d");
  grid->contacts_made(1, PairVector::Zero());
  grid->take_sample(sample(0.0, 100.0 * PairVector::Ones(), 1.0));
  EXPECT_STREQ(grid->counters()[1].name, "samples_outside");
  EXPECT_EQ(grid->counters()[1].value, 1U);
  EXPECT_EQ(grid->forces(0.0, 100.0 * PairVector::Ones()).status, EstimateStatus::kOutside);
  grid->take_sample(sample(0.1, PairVector::Zero(), 1.0));
  for (int done = 1; done > 0;) {
    done = grid->work(10);
    EXPECT_LE(done, 10 + PairGrid::kVerticesOfABlock);
  }
  EXPECT_NEAR(grid->forces(0.0, PairVector::Zero()).forces_W[0], 1.0, kSingle_N);
}

TEST(PairGridMethod, RefusesARadiusThatWouldReachTooManyVertices) {
  for (const char* text : {"forcegrid-6d r=13mm", "forcegrid-6d h=0.5mm", "forcegrid-6d h=60mm"}) {
    EXPECT_THROW(method(text), std::invalid_argument) << text;
  }
  EXPECT_LT(method("forcegrid-6d")->memory_bytes(), 20'000'000U);
}

}  // namespace
}  // namespace forcegrid::pair
