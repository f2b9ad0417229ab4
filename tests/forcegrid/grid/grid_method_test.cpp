// SPDX-License-Identifier: Apache-2.0
#include "forcegrid/grid/grid_method.h"

#include <gtest/gtest.h>

#include <cmath>
#include <random>
#include <stdexcept>
#include <string>

#include "forcegrid/grid/adaptive_grid.h"
#include "forcegrid/grid/grid_factory.h"

namespace forcegrid {
namespace {

using Eigen::Vector3d;
using Eigen::Vector3i;

constexpr unsigned kSeed = 5;
constexpr GridStorage kStorages[] = {GridStorage::kDense, GridStorage::kBlocks,
                                     GridStorage::kAdaptive};
constexpr GridMethodKind kKinds[] = {GridMethodKind::kSilent, GridMethodKind::kRequest,
                                     GridMethodKind::kTangent, GridMethodKind::kMls};

MethodOptions small_grid(GridStorage storage = GridStorage::kDense) {
  MethodOptions options;
  options.grid.min_W = Vector3d(-0.05, -0.05, -0.05);
  options.grid.max_W = Vector3d(0.05, 0.05, 0.05);
  options.grid.cells = Vector3i(10, 10, 10);
  options.influence_radius_m = 0.03;
  options.storage = storage;
  return options;
}

Sample sample_at(const Vector3d& position_W, const Vector3d& force_W, double time_s = 0.0) {
  Sample sample;
  sample.position_W = position_W;
  sample.force_W = force_W;
  sample.time_s = time_s;
  return sample;
}

void finish(ForceMethod& method) {
  while (method.work(1000) > 0) {
  }
}

std::uint64_t count(const ForceMethod& method, const std::string& name) {
  for (const NamedCounter& counter : method.counters()) {
    if (counter.name == name) {
      return counter.value;
    }
  }
  ADD_FAILURE() << "no counter " << name;
  return 0;
}

std::string refusal(GridMethodKind kind, const MethodOptions& options) {
  try {
    plan_grid(kind, options);
  } catch (const std::invalid_argument& error) {
    return error.what();
  }
  return "accepted";
}

TEST(GridMethod, StopsCountingACellAtItsThreshold) {
  for (const GridStorage storage : kStorages) {
    MethodOptions options = small_grid(storage);
    options.samples_per_cell = 2;
    const auto method = make_grid_method(GridMethodKind::kSilent, options);
    const Vector3d at(0.001, 0.001, 0.001);
    method->contact_made(1, at);
    finish(*method);
    for (int i = 0; i < 5; ++i) {
      method->take_sample(sample_at(at, Vector3d(i, 0, 0), 0.1 * i));
      finish(*method);
    }
    EXPECT_EQ(count(*method, "samples_over_threshold"), 3u);
    // Samples 0 and 1 at one place: their mean.
    EXPECT_NEAR(method->force(1.0, at).force_W.x(), 0.5, 1e-6);
    // Another cell still takes samples, and a new contact counts afresh.
    method->take_sample(sample_at(Vector3d(-0.041, -0.041, -0.041), Vector3d::Zero(), 1.0));
    finish(*method);
    EXPECT_EQ(count(*method, "samples_over_threshold"), 3u);
    method->contact_made(2, at);
    method->take_sample(sample_at(at, Vector3d::Zero(), 1.1));
    finish(*method);
    EXPECT_EQ(count(*method, "samples_over_threshold"), 3u);
  }
}

TEST(GridMethod, StartsOnACleanGridHoweverQuicklyContactsFollow) {
  for (const GridStorage storage : kStorages) {
    const auto method = make_grid_method(GridMethodKind::kSilent, small_grid(storage));
    for (int contact = 1; contact < 30; ++contact) {
      method->contact_made(static_cast<std::uint32_t>(contact), Vector3d::Zero());
      method->take_sample(sample_at(Vector3d::Zero(), Vector3d(contact, 0, 0), contact));
      for (int cycle = 0; cycle < contact % 7; ++cycle) {
        method->observe(contact, Vector3d::Zero());
        method->work(200 * (contact % 5));
        const ForceEstimate estimate = method->force(contact, Vector3d::Zero());
        if (estimate.status == EstimateStatus::kOk) {
          ASSERT_NEAR(estimate.force_W.x(), contact, 1e-5);
        }
      }
    }
    finish(*method);
    ASSERT_EQ(method->force(99.0, Vector3d::Zero()).status, EstimateStatus::kOk);
    EXPECT_NEAR(method->force(99.0, Vector3d::Zero()).force_W.x(), 29.0, 1e-5);
  }
}

TEST(GridMethod, CutsTheOldestFillShortWhenSamplesOverrunTheBudgetAndCountsIt) {
  const auto method = make_grid_method(GridMethodKind::kSilent, small_grid());
  method->contact_made(1, Vector3d::Zero());
  for (int i = 0; i < 10; ++i) {
    method->take_sample(sample_at(Vector3d::Zero(), Vector3d(i, 0, 0), 0.1 * i));
  }
  EXPECT_EQ(count(*method, "fills_cut_short"), 2u);
  finish(*method);
  EXPECT_NEAR(method->force(2.0, Vector3d::Zero()).force_W.x(), (2 + 9) / 2.0, 1e-5);
}

TEST(GridMethod, CountsSamplesThatItCanNotUse) {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  const auto tangent = make_grid_method(GridMethodKind::kTangent, small_grid());
  EXPECT_TRUE(tangent->needs().stiffness);
  tangent->contact_made(1, Vector3d::Zero());
  tangent->take_sample(sample_at(Vector3d::Zero(), Vector3d(1, 0, 0)));
  Sample sample = sample_at(Vector3d::Zero(), Vector3d(1, 0, 0));
  sample.has_stiffness = true;
  sample.stiffness_W(1, 2) = nan;
  tangent->take_sample(sample);
  sample.stiffness_W.setZero();
  sample.force_W.x() = 1e300;
  tangent->take_sample(sample);
  sample.force_W.x() = 1.0;
  sample.position_W.x() = 0.06;
  tangent->take_sample(sample);
  finish(*tangent);
  EXPECT_EQ(count(*tangent, "samples_unusable"), 3u);
  EXPECT_EQ(count(*tangent, "samples_outside"), 1u);
  EXPECT_EQ(tangent->force(0.0, Vector3d::Zero()).status, EstimateStatus::kUnknown);
}

TEST(GridMethod, RefusesWhatMakesNoSenseWithAReasonAndARemedy) {
  MethodOptions options = small_grid();
  options.samples_per_cell = -1;
  EXPECT_NE(refusal(GridMethodKind::kSilent, options).find("use 0 (all samples) to 65535"),
            std::string::npos);
  options = small_grid();
  options.grid.cells.y() = 0;
  EXPECT_NE(refusal(GridMethodKind::kSilent, options).find("cells must be 1 to 4096"),
            std::string::npos);
  options = small_grid();
  options.grid.max_W.z() = options.grid.min_W.z();
  EXPECT_NE(refusal(GridMethodKind::kSilent, options).find("must exceed"), std::string::npos);
  options = small_grid();
  options.grid.min_W.x() = std::numeric_limits<double>::quiet_NaN();
  EXPECT_NE(refusal(GridMethodKind::kSilent, options).find("finite"), std::string::npos);
  options = small_grid();
  options.unit_m = -1.0;
  EXPECT_NE(refusal(GridMethodKind::kSilent, options).find("unit of length"), std::string::npos);
  options = small_grid(GridStorage::kAdaptive);
  EXPECT_NE(refusal(GridMethodKind::kMls, options).find("use storage=dense or storage=blocks"),
            std::string::npos);
  options = small_grid();
  options.interpolation = Interpolation::kTricubic;
  EXPECT_NE(refusal(GridMethodKind::kMls, options).find("64 fits"), std::string::npos);
  EXPECT_EQ(refusal(GridMethodKind::kTangent, options), "accepted");
  options = small_grid(GridStorage::kBlocks);
  options.grid.cells.setConstant(100);
  options.pool_blocks = 3;
  EXPECT_NE(refusal(GridMethodKind::kSilent, options).find("use a larger pool"), std::string::npos);
  options = small_grid();
  options.grid.cells.setConstant(1000);
  EXPECT_NE(refusal(GridMethodKind::kSilent, options).find("smaller r"), std::string::npos);
  options.influence_radius_m = 0.002;
  EXPECT_NE(refusal(GridMethodKind::kSilent, options).find("use storage=blocks or fewer cells"),
            std::string::npos);
  options.grid.cells.setConstant(300);
  options.influence_radius_m = 0.03;
  EXPECT_NE(refusal(GridMethodKind::kRequest, options).find("too many for a servo cycle"),
            std::string::npos);
}

TEST(GridMethod, GivesTheSameForcesFromBlocksAsFromADenseGridToTheLastBit) {
  SCOPED_TRACE(kSeed);
  for (const GridMethodKind kind : kKinds) {
    for (const Interpolation interpolation :
         {Interpolation::kTrilinear, Interpolation::kTricubic}) {
      if (kind == GridMethodKind::kMls && interpolation == Interpolation::kTricubic) {
        continue;
      }
      MethodOptions options = small_grid();
      options.grid.cells = Vector3i(30, 17, 23);
      options.influence_radius_m = 0.016;
      options.interpolation = interpolation;
      const auto dense = make_grid_method(kind, options);
      options.storage = GridStorage::kBlocks;
      const auto blocks = make_grid_method(kind, options);
      std::mt19937 random(kSeed);
      std::uniform_real_distribution<double> place(-0.05, 0.05);
      std::uniform_real_distribution<double> newtons(-5.0, 5.0);
      const auto anywhere = [&] { return Vector3d(place(random), place(random), place(random)); };
      for (int contact = 0; contact < 2; ++contact) {
        dense->contact_made(1, Vector3d::Zero());
        blocks->contact_made(1, Vector3d::Zero());
        for (int n = 0; n < 40; ++n) {
          Sample sample = sample_at(
              anywhere(), Vector3d(newtons(random), newtons(random), newtons(random)), 0.1 * n);
          sample.has_stiffness = true;
          sample.stiffness_W = 20.0 * Eigen::Matrix3d::Identity();
          sample.stiffness_W(0, 1) = newtons(random);
          dense->take_sample(sample);
          blocks->take_sample(sample);
          finish(*dense);
          finish(*blocks);
        }
        int known = 0;
        for (int n = 0; n < 1000; ++n) {
          const Vector3d at = anywhere();
          const ForceEstimate one = dense->force(9.0, at);
          const ForceEstimate other = blocks->force(9.0, at);
          ASSERT_EQ(one.status, other.status);
          ASSERT_EQ(one.force_W, other.force_W) << at.transpose();
          known += one.status == EstimateStatus::kOk ? 1 : 0;
        }
        EXPECT_GT(known, 100);
      }
      EXPECT_EQ(count(*blocks, "blocks_recycled"), 0u);
    }
  }
}

TEST(GridMethod, EmptiesTheBlockThatWasReachedLongestAgoWhenThePoolIsUsedUpAndCountsIt) {
  MethodOptions options = small_grid(GridStorage::kBlocks);
  options.grid.cells = Vector3i(79, 7, 7);  // ten blocks in a row along x
  options.influence_radius_m = 0.001;
  options.pool_blocks = 5;
  const auto method = make_grid_method(GridMethodKind::kSilent, options);
  method->contact_made(1, Vector3d::Zero());
  const double spacing_m = 0.1 / 79;
  const auto middle_of = [&](int block) {
    // On a vertex, so that a sample with an r below the spacing reaches it alone.
    return Vector3d(-0.05 + (8 * block + 4) * spacing_m, -0.05 + 3 * 0.1 / 7, -0.05 + 3 * 0.1 / 7);
  };
  for (const int block : {0, 1, 2, 3, 4, 0, 5, 6}) {
    method->take_sample(sample_at(middle_of(block), Vector3d(block + 1, 0, 0)));
    finish(*method);
  }
  EXPECT_EQ(count(*method, "blocks_recycled"), 2u);
  for (int block = 0; block < 10; ++block) {
    // Block 0 was reached again after 1 and 2, so those two had to go.
    const bool there = block == 0 || (block >= 3 && block <= 6);
    const ForceEstimate estimate = method->force(1.0, middle_of(block));
    EXPECT_EQ(estimate.status != EstimateStatus::kUnknown, there) << block;
    EXPECT_NEAR(estimate.force_W.x(), there ? block + 1 : 0, 1e-5) << block;
  }
}

TEST(GridMethod, Has400CellsAnAxisInBlocksAtAFractionOfTheVolumesMemory) {
  MethodOptions options = small_grid(GridStorage::kBlocks);
  options.grid.cells.setConstant(400);
  options.influence_radius_m = 0.003;
  const auto method = make_grid_method(GridMethodKind::kSilent, options);
  const double whole_bytes = 16.0 * 401 * 401 * 401;
  EXPECT_LT(static_cast<double>(method->memory_bytes()), 0.1 * whole_bytes);
  method->contact_made(1, Vector3d::Zero());
  for (const double x : {-0.045, 0.0, 0.045}) {
    method->take_sample(sample_at(Vector3d(x, 0.5 * x, -x), Vector3d(1 + x, 0, 0)));
  }
  finish(*method);
  EXPECT_EQ(count(*method, "blocks_recycled"), 0u);
  for (const double x : {-0.045, 0.0, 0.045}) {
    EXPECT_NEAR(method->force(1.0, Vector3d(x, 0.5 * x, -x)).force_W.x(), 1 + x, 1e-5);
  }
}

TEST(ForcegridMls, IsExactForAnAffineFieldWhenTheRidgeIsSmall) {
  SCOPED_TRACE(kSeed);
  for (const GridStorage storage : {GridStorage::kDense, GridStorage::kBlocks}) {
    for (const WeightKind weight :
         {WeightKind::kPaper, WeightKind::kInverse4, WeightKind::kInverse6}) {
      MethodOptions options = small_grid(storage);
      options.influence_radius_m = 0.05;
      options.ridge = 1e-9;
      options.weight = weight;
      const auto method = make_grid_method(GridMethodKind::kMls, options);
      method->contact_made(1, Vector3d::Zero());
      Eigen::Matrix3d slope;
      slope << -100, 20, 5, 10, -300, 40, 0, 7, -50;
      const Vector3d at_rest(1, -2, 3);
      std::mt19937 random(kSeed);
      std::uniform_real_distribution<double> around(-0.015, 0.015);
      const auto anywhere = [&] {
        return Vector3d(around(random), around(random), around(random));
      };
      for (int n = 0; n < 60; ++n) {
        const Vector3d at = anywhere();
        method->take_sample(sample_at(at, at_rest + slope * at));
        finish(*method);
      }
      for (int n = 0; n < 200; ++n) {
        const Vector3d at = anywhere();
        const ForceEstimate estimate = method->force(9.0, at);
        ASSERT_EQ(estimate.status, EstimateStatus::kOk);
        // Moments in single precision: their relative 1e-6 or so comes back through the slope.
        EXPECT_LT((estimate.force_W - at_rest - slope * at).norm(), 2e-3);
      }
    }
  }
}

TEST(ForcegridMls, GivesTheNearestSamplesForceWhereASingleSampleIsKnown) {
  const auto method = make_grid_method(GridMethodKind::kMls, small_grid());
  method->contact_made(1, Vector3d::Zero());
  method->take_sample(sample_at(Vector3d(0.001, 0.002, 0.003), Vector3d(1, 2, 3)));
  finish(*method);
  // One sample has no slope: the ridge leaves its force everywhere, but for the rounding of single
  // precision (6e-8) that the ridge of 1e-5 multiplies.
  EXPECT_LT((method->force(0.0, Vector3d(0.004, 0, 0)).force_W - Vector3d(1, 2, 3)).norm(), 0.02);
}

// The paper's rule over every cell of the grid.
Vector3d brute_force_choice(const GridGeometry& g, double rho_m, const Vector3d& tool_W,
                            const std::vector<int>& samples) {
  Vector3d best = Vector3d::Constant(1e9);
  int fewest = 1 << 30;
  double nearest_m = 0.0;
  std::size_t n = 0;
  for (int i = 0; i < g.cells.x(); ++i) {
    for (int j = 0; j < g.cells.y(); ++j) {
      for (int k = 0; k < g.cells.z(); ++k, ++n) {
        const Vector3d centre =
            g.min_W + Vector3d(i + 0.5, j + 0.5, k + 0.5).cwiseProduct(g.spacing_m());
        const double d = (centre - tool_W).norm();
        if (d <= rho_m && (samples[n] < fewest || (samples[n] == fewest && d < nearest_m))) {
          best = centre;
          fewest = samples[n];
          nearest_m = d;
        }
      }
    }
  }
  return best;
}

TEST(ForcegridRequest, AsksForTheLeastSampledCellNearestToTheTool) {
  SCOPED_TRACE(kSeed);
  for (const GridStorage storage : {GridStorage::kDense, GridStorage::kBlocks}) {
    MethodOptions options = small_grid(storage);
    options.grid.max_W.x() = 0.07;
    options.grid.cells = Vector3i(9, 11, 10);
    options.influence_radius_m = 0.022;
    const auto method = make_grid_method(GridMethodKind::kRequest, options);
    EXPECT_TRUE(method->needs().requests);
    const GridGeometry& g = options.grid;
    std::vector<int> samples(g.cell_count(), 0);
    const auto count_in = [&](const Vector3d& at) {
      const Vector3i cell = (at - g.min_W).cwiseQuotient(g.spacing_m()).cast<int>();
      ++samples[static_cast<std::size_t>((cell.x() * g.cells.y() + cell.y()) * g.cells.z() +
                                         cell.z())];
    };
    std::mt19937 random(kSeed);
    std::uniform_real_distribution<double> unit(0.0, 1.0);
    method->contact_made(1, Vector3d::Zero());
    for (int n = 0; n < 1500; ++n) {
      // In a corner of the box, so that the cells around fill up and the border matters.
      const Vector3d tool = g.min_W + 0.03 * Vector3d(unit(random), unit(random), unit(random));
      if (n % 4 == 0) {
        method->take_sample(sample_at(tool, Vector3d(1, 0, 0), n));
        count_in(tool);
        finish(*method);
      }
      Vector3d wanted;
      ASSERT_TRUE(method->plan_request(n, tool, wanted));
      const Vector3d expected = brute_force_choice(g, options.influence_radius_m, tool, samples);
      ASSERT_LT((wanted - expected).norm(), 1e-12) << "request " << n;
      Sample answer = sample_at(wanted, Vector3d(1, 0, 0), n);
      answer.from_query = true;
      method->take_sample(answer);
      count_in(wanted);
      finish(*method);
    }
  }
}

TEST(ForcegridRequest, AsksElsewhereWhileAnAnswerIsOnItsWayAndNotBeyondTheThreshold) {
  MethodOptions options = small_grid();
  options.influence_radius_m = 0.012;
  options.samples_per_cell = 1;
  const auto method = make_grid_method(GridMethodKind::kRequest, options);
  Vector3d wanted = Vector3d::Constant(7.0);
  EXPECT_FALSE(method->plan_request(0.0, Vector3d::Zero(), wanted));  // no contact
  method->contact_made(1, Vector3d::Zero());
  const Vector3d tool(0.006, 0.005, 0.005);  // in the cell whose centre is (5, 5, 5) mm
  EXPECT_FALSE(method->plan_request(0.0, Vector3d(1, 0, 0), wanted));
  EXPECT_EQ(wanted, Vector3d::Constant(7.0));
  ASSERT_TRUE(method->plan_request(0.0, tool, wanted));
  EXPECT_LT((wanted - Vector3d(0.005, 0.005, 0.005)).norm(), 1e-12);
  ASSERT_TRUE(method->plan_request(0.0, tool, wanted));
  EXPECT_LT((wanted - Vector3d(0.015, 0.005, 0.005)).norm(), 1e-12);
  // Centres within 12 mm of the tool: its own cell's and the six beside it.
  for (int n = 2; n < 7; ++n) {
    EXPECT_TRUE(method->plan_request(0.0, tool, wanted)) << n;
  }
  EXPECT_FALSE(method->plan_request(0.0, tool, wanted));  // all are asked for, s = 1
}

Sample affine_sample(const Vector3d& at) {
  Sample sample = sample_at(at, Vector3d(1, 2, 3) - 100.0 * at);
  sample.has_stiffness = true;
  sample.stiffness_W = -100.0 * Eigen::Matrix3d::Identity();
  return sample;
}

TEST(AdaptiveGrid, IsDenseAroundTheToolWhereverItGoesAndSparseElsewhere) {
  MethodOptions options = small_grid(GridStorage::kAdaptive);
  options.grid.cells.setConstant(160);
  options.influence_radius_m = 0.02;
  options.weight = WeightKind::kPaper;
  const GridPlan plan = plan_grid(GridMethodKind::kSilent, options);
  AdaptiveGrid grid(plan.geometry, plan.weighting, false);
  ASSERT_TRUE(grid.allocated());
  EXPECT_EQ(grid.geometry().cells, Vector3i::Constant(40));
  grid.restart();
  for (const Vector3d& tool : {Vector3d(-0.04, 0.0, 0.03), Vector3d(-0.02, 0.01, 0.03),
                               Vector3d(0.045, 0.049, -0.049), Vector3d(-0.04, 0.0, 0.03)}) {
    grid.follow(tool);
    while (grid.prepare(64) > 0) {
    }
    AdaptiveGrid::Fill fill = grid.begin_fill(sample_at(tool, tool), false);
    while (!grid.finished(fill)) {
      grid.continue_fill(fill, 500);
    }
    // Twelve dense cells from the tool, kept inside, all is known to the dense grid.
    for (int corner = 0; corner < 8; ++corner) {
      const double reach_m = 11.5 * 0.1 / 160;
      const Vector3d at =
          (tool + reach_m * Vector3d((corner & 1) != 0 ? 1 : -1, (corner & 2) != 0 ? 1 : -1,
                                     (corner & 4) != 0 ? 1 : -1))
              .cwiseMax(-0.05)
              .cwiseMin(0.05);
      EXPECT_EQ(grid.dense().read(at).status, EstimateStatus::kOk) << at.transpose();
      EXPECT_EQ(grid.read(at).force_W, grid.dense().read(at).force_W);
    }
  }
  // Where the tool was long ago the sparse grid still knows.
  const Vector3d before(0.045, 0.049, -0.049);
  EXPECT_NE(grid.dense().read(before).status, EstimateStatus::kOk);
  EXPECT_EQ(grid.read(before).status, EstimateStatus::kOk);
  EXPECT_LT((grid.read(before).force_W - before).norm(), 1e-6);
}

TEST(AdaptiveGrid, InheritsWhatTheSparseGridKnowsAndThenResolvesMore) {
  for (const WeightKind weight :
       {WeightKind::kPaper, WeightKind::kInverse4, WeightKind::kInverse6}) {
    MethodOptions options = small_grid(GridStorage::kAdaptive);
    options.grid.cells.setConstant(120);
    options.influence_radius_m = 0.02;
    options.weight = weight;
    const auto method = make_grid_method(GridMethodKind::kTangent, options);
    method->contact_made(1, Vector3d::Zero());
    // An affine field is exact in both grids, so it must stay exact through inheritance.
    for (double x = -0.03; x < 0.03; x += 0.002) {
      const Vector3d tool(x, 0.3 * x, -0.5 * x);
      method->observe(x, tool);
      method->take_sample(affine_sample(tool));
      finish(*method);
      const Vector3d beside = tool + Vector3d(0.004, -0.003, 0.002);
      const ForceEstimate estimate = method->force(x, beside);
      ASSERT_EQ(estimate.status, EstimateStatus::kOk);
      ASSERT_LT((estimate.force_W - affine_sample(beside).force_W).norm(), 2e-5);
    }
  }
}

TEST(AdaptiveGrid, TakesAFractionOfTheUniformGridsMemory) {
  MethodOptions options = small_grid(GridStorage::kAdaptive);
  options.grid.cells.setConstant(200);
  const auto adaptive = make_grid_method(GridMethodKind::kSilent, options);
  EXPECT_LT(static_cast<double>(adaptive->memory_bytes()), 0.1 * 16.0 * 201 * 201 * 201);
}

}  // namespace
}  // namespace forcegrid
