// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <limits>
#include <random>
#include <string>
#include <vector>

#include "forcegrid/kriging/kriging_grid_method.h"
#include "forcegrid/kriging/posterior_grid.h"
#include "forcegrid/method_variant.h"
#include "forcegrid/methods.h"
#include "tests/forcegrid/kriging/kriging_support.h"

namespace forcegrid {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;
using Eigen::Vector3i;
using testing::AnchoredSprings;
using testing::HandMotion;

constexpr unsigned kSeed = 23;
constexpr int kAllWork = 1 << 30;
const Vector3d kPoint_W(0.08, 0.06, 0.05);

// The gradient of a cubic: forces of second degree, in newtons over metres.
struct Quadratic {
  Vector3d force_N(const Vector3d& p) const {
    return Vector3d(0.5, -0.2, 0.1) + linear * p +
           Vector3d(3e3 * p.x() * p.x() + 4e3 * p.x() * p.y() + 1e3 * p.y() * p.z(),
                    2e3 * p.x() * p.x() - 6e3 * p.y() * p.y() + 1e3 * p.x() * p.z(),
                    1e3 * p.x() * p.y() + 2e3 * p.z() * p.z());
  }
  Matrix3d stiffness_N_per_m(const Vector3d& p) const {
    Matrix3d j = linear;
    j(0, 0) += 6e3 * p.x() + 4e3 * p.y();
    j(1, 1) -= 12e3 * p.y();
    j(2, 2) += 4e3 * p.z();
    j(0, 1) += 4e3 * p.x() + 1e3 * p.z();
    j(0, 2) += 1e3 * p.y();
    j(1, 2) += 1e3 * p.x();
    return j.selfadjointView<Eigen::Upper>();
  }
  Matrix3d linear = (Matrix3d() << -300, 40, -10, 40, -500, 70, -10, 70, -900).finished();
};

PosteriorGrid grid_of_blocks(int pool_blocks = 30) {
  return PosteriorGrid(Vector3d::Constant(-0.04), Vector3i::Constant(20), 0.004,
                       static_cast<std::size_t>(pool_blocks));
}

template <typename Use>
void for_each_vertex(const PosteriorGrid& grid, Use use) {
  for (Vector3i at(0, 0, 0); grid.has(at); ++at.x()) {
    for (at.y() = 0; grid.has(at); ++at.y()) {
      for (at.z() = 0; grid.has(at); ++at.z()) {
        use(at);
      }
      at.z() = 0;
    }
    at.y() = 0;
  }
}

TEST(PosteriorGrid, ReadsQuadraticFieldsExactly) {
  const Quadratic field;
  PosteriorGrid grid = grid_of_blocks();
  int vertices = 0;
  for_each_vertex(grid, [&](const Vector3i& at) {
    const Vector3d p = grid.position_m(at);
    grid.write(at, {field.force_N(p), field.stiffness_N_per_m(p), 0.001}, 1);
    ++vertices;
  });
  ASSERT_EQ(vertices, 21 * 21 * 21);
  EXPECT_EQ(grid.blocks_in_use(), 27u);
  std::mt19937 random(kSeed);
  std::uniform_real_distribution<double> uniform(-0.04, 0.0399);
  for (int i = 0; i < 2000; ++i) {
    const Vector3d p(uniform(random), uniform(random), uniform(random));
    const PosteriorGrid::Reading reading = grid.read(p);
    ASSERT_TRUE(reading.known);
    ASSERT_LT((reading.force_N - field.force_N(p)).norm(), 2e-5)  // N, single precision of 40 N
        << p.transpose() << ", seed " << kSeed;
  }
}

TEST(PosteriorGrid, IsContinuousAcrossCellsAndBlocks) {
  PosteriorGrid grid = grid_of_blocks();
  std::mt19937 random(kSeed);
  std::uniform_real_distribution<double> uniform(-1.0, 1.0);
  for_each_vertex(grid, [&](const Vector3i& at) {  // as unsmooth as can be
    Matrix3d j;
    for (double& each : j.reshaped()) {
      each = 500.0 * uniform(random);
    }
    grid.write(at,
               {Vector3d(uniform(random), uniform(random), uniform(random)),
                0.5 * (j + j.transpose()), 0.001},
               1);
  });
  constexpr double kApart_m = 1e-8;
  for (int axis = 0; axis < 3; ++axis) {
    for (int face = 1; face < 20; ++face) {
      Vector3d p(0.0391 * uniform(random), 0.0391 * uniform(random), 0.0391 * uniform(random));
      p[axis] = -0.04 + 0.004 * face;
      const Vector3d step = kApart_m * Vector3d::Unit(axis);
      const Vector3d jump_N = grid.read(p + step).force_N - grid.read(p - step).force_N;
      EXPECT_LT(jump_N.norm(), 5e-5) << "axis " << axis << ", face " << face;
    }
  }
}

TEST(PosteriorGrid, SaysWhereItKnowsNothing) {
  PosteriorGrid grid = grid_of_blocks();
  const Vector3d inside(0.0011, 0.0013, 0.0017);
  EXPECT_FALSE(grid.read(inside).known);
  const Vector3i lowest = grid.nearest_vertex(Vector3d(0.0, 0.0, 0.0));
  for (int corner = 0; corner < 8; ++corner) {
    EXPECT_FALSE(grid.read(inside).known) << "without corner " << corner;
    EXPECT_EQ(grid.read(inside).force_N, Vector3d::Zero());
    grid.write(lowest + Vector3i(corner & 1, corner >> 1 & 1, corner >> 2 & 1),
               {Vector3d(1.0, 2.0, 3.0), Matrix3d::Zero(), 0.001}, 1);
  }
  EXPECT_TRUE(grid.read(inside).known);
  EXPECT_LT((grid.read(inside).force_N - Vector3d(1.0, 2.0, 3.0)).norm(), 1e-6);
  EXPECT_FALSE(grid.read(inside + Vector3d(0.004, 0.0, 0.0)).known);
  const double nan = std::numeric_limits<double>::quiet_NaN();
  for (const Vector3d& outside : {Vector3d(0.041, 0.0, 0.0), Vector3d(0.0, -0.041, 0.0),
                                  Vector3d(0.0, 0.0, 1e12), Vector3d(nan, 0.0, 0.0)}) {
    EXPECT_FALSE(grid.read(outside).known);
  }
}

TEST(PosteriorGrid, ForgetsTheBlockThatWasWrittenLongestAgoWhenItsPoolIsUsedUp) {
  PosteriorGrid grid = grid_of_blocks(2);
  const PosteriorGrid::Value value{Vector3d(1.0, 0.0, 0.0), Matrix3d::Zero(), 0.001};
  const Vector3i first(0, 0, 0), second(8, 0, 0), third(16, 0, 0);
  grid.write(first, value, 1);
  grid.write(second, value, 2);
  grid.write(first, value, 3);
  grid.write(third, value, 4);
  EXPECT_EQ(grid.recycled(), 1u);
  EXPECT_GT(grid.vertex(first).known, 0.0F);
  EXPECT_LT(grid.vertex(second).known, 0.0F);
  EXPECT_GT(grid.vertex(third).known, 0.0F);
}

MethodOptions workspace() {
  MethodOptions options;
  options.grid.max_W = {0.16, 0.12, 0.12};
  options.grid.cells.setConstant(49);
  return options;
}

// One servo at 500 Hz, samples at 30 Hz one period late, all work at once.
class Session {
 public:
  explicit Session(ForceMethod& method) : method_(method) { method.contact_made(1, kPoint_W); }

  template <typename Force, typename Use>
  void play(const std::function<Vector3d(double)>& displacement_m, double duration_s,
            const Force& force_N, Use use) {
    const int cycles = static_cast<int>(duration_s * 500.0);
    for (int i = 0; i < cycles; ++i, ++cycle_) {
      const double time_s = cycle_ * 0.002;
      const Vector3d d = displacement_m(i * 0.002);
      if (cycle_ % 17 == 0) {
        if (pending_) {
          method_.take_sample(sample_);
        }
        sample_.time_s = time_s;
        sample_.position_W = kPoint_W + d;
        sample_.force_W = force_N(d);
        pending_ = true;
      }
      method_.observe(time_s, kPoint_W + d);
      while (method_.work(kAllWork) > 0) {
      }
      use(time_s, d);
    }
  }

 private:
  ForceMethod& method_;
  int cycle_ = 0;
  bool pending_ = false;
  Sample sample_;
};

TEST(ForcegridKriging, IsAsAccurateAsItsKrigingToAFiftiethOfAPercent) {
  const AnchoredSprings object(kSeed);
  const auto force_N = [&object](const Vector3d& d) { return object.force_N(d); };
  const HandMotion motion(kSeed);
  KrigingGridMethod method(workspace());
  Session session(method);
  double grid_N2 = 0.0, kriging_N2 = 0.0, reference_N2 = 0.0;
  int on_grid = 0, cycles = 0;
  session.play(
      [&motion](double t_s) { return motion.position_m(t_s); }, 10.0, force_N,
      [&](double time_s, const Vector3d& d) {
        if (time_s < 1.0) {
          return;
        }
        ++cycles;
        const ForceEstimate estimate = method.force(time_s, kPoint_W + d);
        on_grid += estimate.status == EstimateStatus::kOk;
        grid_N2 += (estimate.force_W - force_N(d)).squaredNorm();
        kriging_N2 +=
            (method.kriging().force(time_s, kPoint_W + d).force_W - force_N(d)).squaredNorm();
        reference_N2 += force_N(d).squaredNorm();
      });
  EXPECT_LT(std::sqrt(grid_N2 / reference_N2), std::sqrt(kriging_N2 / reference_N2) + 2e-4)
      << "seed " << kSeed;
  EXPECT_LT(std::sqrt(kriging_N2 / reference_N2), 0.01);
  EXPECT_GT(on_grid, 99 * cycles / 100) << "of " << cycles;
  EXPECT_LT(method.memory_bytes(), 4u << 20);
}

TEST(ForcegridKriging, KnowsAPlaceWithoutItsSamplesAndNothingWhereItHasNotBeen) {
  const AnchoredSprings object(kSeed);
  const auto force_N = [&object](const Vector3d& d) { return object.force_N(d); };
  const HandMotion motion(kSeed);
  KrigingGridMethod method(workspace());
  Session session(method);
  const auto around = [&motion](const Vector3d& centre_m) {
    return [&motion, centre_m](double t_s) {
      return Vector3d(centre_m + 0.5 * motion.position_m(t_s + 1.0));
    };
  };
  const auto nothing = [](double, const Vector3d&) {};
  const Vector3d near_m = Vector3d::Zero();
  const Vector3d far_m(0.045, 0.0, 0.0);
  session.play(around(near_m), 8.0, force_N, nothing);
  session.play(around(far_m), 8.0, force_N, nothing);
  double error_N2 = 0.0, reference_N2 = 0.0;
  for (double t_s = 0.0; t_s < 7.0; t_s += 0.01) {
    const Vector3d d = around(near_m)(t_s);
    const ForceEstimate estimate = method.force(16.0, kPoint_W + d);
    ASSERT_TRUE(method.grid().read(d).known) << d.transpose();
    error_N2 += (estimate.force_W - force_N(d)).squaredNorm();
    reference_N2 += force_N(d).squaredNorm();
  }
  EXPECT_LT(std::sqrt(error_N2 / reference_N2), 0.01) << "seed " << kSeed;
  const Vector3d never_m(0.045, 0.04, 0.0);
  EXPECT_FALSE(method.grid().read(never_m).known);
  EXPECT_EQ(method.force(16.0, kPoint_W + never_m).status, EstimateStatus::kPartlyKnown);
  const Vector3d unknown_m(-0.07, -0.05, 0.05);
  EXPECT_EQ(method.force(16.0, kPoint_W + unknown_m).status, EstimateStatus::kUnknown);
  EXPECT_EQ(method.force(16.0, kPoint_W + unknown_m).force_W, Vector3d::Zero());
}

TEST(ForcegridKriging, RewritesWhatASurpriseContradicts) {
  const AnchoredSprings object(kSeed);
  const AnchoredSprings cut(kSeed, 0.4);
  const HandMotion motion(kSeed);
  KrigingGridMethod method(workspace());
  Session session(method);
  const auto path = [&motion](double t_s) { return motion.position_m(t_s + 1.0); };
  const auto nothing = [](double, const Vector3d&) {};
  session.play(
      path, 5.0, [&object](const Vector3d& d) { return object.force_N(d); }, nothing);
  double error_N2 = 0.0, reference_N2 = 0.0;
  session.play(
      path, 5.0, [&cut](const Vector3d& d) { return cut.force_N(d); },
      [&](double time_s, const Vector3d& d) {
        if (time_s > 8.0) {
          error_N2 += (method.force(time_s, kPoint_W + d).force_W - cut.force_N(d)).squaredNorm();
          reference_N2 += cut.force_N(d).squaredNorm();
        }
      });
  EXPECT_LT(std::sqrt(error_N2 / reference_N2), 0.05) << "seed " << kSeed;
}

TEST(ForcegridKriging, AsksAtVerticesWhereItKnowsLittle) {
  const AnchoredSprings object(kSeed);
  KrigingGridMethod method(workspace());
  Session session(method);
  int asked = 0;
  session.play([](double t_s) { return Vector3d(0.05 * t_s, 0.01 * t_s, 0.0); }, 0.5,
               [&object](const Vector3d& d) { return object.force_N(d); },
               [&](double time_s, const Vector3d& d) {
                 Vector3d wanted_W;
                 if (!method.plan_request(time_s, kPoint_W + d, wanted_W)) {
                   return;
                 }
                 ++asked;
                 const Vector3d wanted_m = wanted_W - kPoint_W;
                 const Vector3i vertex = method.grid().nearest_vertex(wanted_m);
                 EXPECT_LT((method.grid().position_m(vertex) - wanted_m).norm(), 1e-9);
                 EXPECT_GT(method.kriging().field().deviation_N(wanted_m, kriging::History::Zero()),
                           kriging::FieldRequests::kAsk_N);
               });
  EXPECT_GT(asked, 3);
}

TEST(ForcegridKriging, WritesNoMoreThanItsBudget) {
  const AnchoredSprings object(kSeed);
  KrigingGridMethod method(workspace());
  method.contact_made(1, kPoint_W);
  method.observe(0.0, kPoint_W);
  Sample sample;
  sample.position_W = kPoint_W;
  sample.force_W = object.force_N(Vector3d::Zero());
  method.take_sample(sample);
  int calls = 0;
  for (int done = 1; done > 0; ++calls) {
    done = method.work(200);
    EXPECT_LT(done, 200 + 96 * 96 / 2 + KrigingGridMethod::kVertexUnits);
  }
  EXPECT_GT(calls, 10);
  EXPECT_TRUE(method.grid().read(Vector3d(0.001, 0.002, 0.003)).known);
}

TEST(ForcegridKriging, RefusesOptionsThatCannotBeUsedAndTakesThoseThatCan) {
  const auto refusal = [](const std::string& variant, const MethodOptions& base) {
    try {
      const MethodVariant parsed = parse_method_variant(variant, base);
      make_force_method(parsed.name, parsed.options);
    } catch (const std::invalid_argument& error) {
      return std::string(error.what());
    }
    return std::string();
  };
  EXPECT_NE(refusal("forcegrid-kriging h=1mm", workspace()).find("2mm to 20mm"), std::string::npos);
  EXPECT_NE(refusal("forcegrid-kriging", {}).find("needs a workspace"), std::string::npos);
  EXPECT_NE(refusal("forcegrid-kriging pool=5", workspace()).find("pool=96"), std::string::npos);
  EXPECT_NE(refusal("forcegrid-kriging samples=49", workspace()).find("2 to 48"),
            std::string::npos);
  MethodOptions huge = workspace();
  huge.grid.max_W.x() = 20.0;
  EXPECT_NE(refusal("forcegrid-kriging", huge).find("too many vertices"), std::string::npos);
  for (const char* variant :
       {"forcegrid-kriging", "forcegrid-kriging h=2mm", "forcegrid-kriging h=6mm samples=48"}) {
    EXPECT_EQ(refusal(variant, workspace()), "") << variant;
  }
}

}  // namespace
}  // namespace forcegrid
