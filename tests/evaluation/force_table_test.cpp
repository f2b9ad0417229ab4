// SPDX-License-Identifier: Apache-2.0
#include "evaluation/objects/force_table.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <fstream>

#include "evaluation/motions/trajectories.h"
#include "simulator/mesh/lattice_block.h"

namespace forcegrid::evaluation {
namespace {

using Eigen::Matrix3d;
using Eigen::Vector3d;
using ::testing::HasSubstr;

constexpr double kRounding = 1e-11;

TableLattice small_lattice() {
  TableLattice lattice;
  lattice.min_W_m = {-0.01, -0.005, 0.002};
  lattice.spacing_m = 0.004;
  lattice.nodes = {6, 5, 4};
  return lattice;
}

template <typename Field>
ForceTable table_of(const TableLattice& lattice, const Field& field) {
  std::vector<Vector3d> forces_W;
  for (std::size_t i = 0; i < lattice.node_count(); ++i) {
    forces_W.push_back(field(lattice.node_W_m(i)));
  }
  return ForceTable(lattice, forces_W);
}

Vector3d random_inside(const TableLattice& lattice, SeededNumbers& numbers) {
  Vector3d d;
  for (int axis = 0; axis < 3; ++axis) {
    d[axis] = numbers.uniform(lattice.min_W_m[axis], lattice.max_W_m()[axis]);
  }
  return d;
}

std::string fresh_folder(const std::string& name) {
  const std::filesystem::path folder = std::filesystem::path(::testing::TempDir()) / name;
  std::filesystem::remove_all(folder);
  std::filesystem::create_directories(folder);
  return folder.string();
}

template <typename Call>
std::string message(const Call& call) {
  try {
    call();
  } catch (const std::exception& error) {
    return error.what();
  }
  return "no error";
}

simulator::SpringMesh tiny_block(double stiffness_N_per_m) {
  simulator::LatticeBlockOptions options;
  options.vertex_count = {4, 4, 4};
  options.size_m = {0.03, 0.03, 0.03};
  options.stiffness_N_per_m = stiffness_N_per_m;
  return simulator::make_lattice_block(options);
}

TableOptions tiny_options(const std::string& cache) {
  TableOptions options;
  options.lattice.min_W_m = {-0.003, -0.003, -0.001};
  options.lattice.spacing_m = 0.001;
  options.lattice.nodes = {7, 7, 5};
  options.threads = 2;
  options.cache = cache;
  return options;
}

TEST(ForceTable, IsExactAtItsNodes) {
  const TableLattice lattice = small_lattice();
  SeededNumbers numbers(3);
  std::vector<Vector3d> forces_W;
  for (std::size_t i = 0; i < lattice.node_count(); ++i) {
    forces_W.emplace_back(numbers.normal(), numbers.normal(), numbers.normal());
  }
  const ForceTable table(lattice, forces_W);
  for (std::size_t i = 0; i < lattice.node_count(); ++i) {
    EXPECT_LT((table.force_W(lattice.node_W_m(i)) - forces_W[i]).norm(), kRounding) << i;
  }
}

TEST(ForceTable, ReproducesCubicPolynomialsAndTheirDerivatives) {
  // In units of centimetres, so that all powers count.
  const auto field = [](const Vector3d& d) {
    const Vector3d p = 100.0 * d;
    return Vector3d(p.x() * p.x() * p.x() - 2.0 * p.y() * p.z(),
                    1.0 + p.y() * p.y() * p.y() * p.x(), p.z() * p.z() * p.z() * p.x() * p.x());
  };
  const auto derivative = [](const Vector3d& d) {
    const Vector3d p = 100.0 * d;
    Matrix3d j;
    j << 3.0 * p.x() * p.x(), -2.0 * p.z(), -2.0 * p.y(),  //
        p.y() * p.y() * p.y(), 3.0 * p.y() * p.y() * p.x(), 0.0,
        2.0 * p.x() * p.z() * p.z() * p.z(), 0.0, 3.0 * p.z() * p.z() * p.x() * p.x();
    return Matrix3d(100.0 * j);
  };
  const TableLattice lattice = small_lattice();
  const ForceTable table = table_of(lattice, field);
  SeededNumbers numbers(5);
  for (int i = 0; i < 200; ++i) {
    const Vector3d d = random_inside(lattice, numbers);
    EXPECT_LT((table.at(d).force_W - field(d)).norm(), kRounding);
    EXPECT_LT((table.at(d).stiffness_W - derivative(d)).norm(), 1e-8);
  }
}

TEST(ForceTable, IsTwiceContinuouslyDifferentiableAcrossItsCells) {
  TableLattice lattice;
  lattice.min_W_m.setZero();
  lattice.spacing_m = 1.0;
  lattice.nodes = {6, 6, 6};
  SeededNumbers numbers(7);
  const ForceTable table = table_of(lattice, [&numbers](const Vector3d&) {
    return Vector3d(numbers.normal(), numbers.normal(), numbers.normal());
  });
  constexpr double kStep = 1e-5;
  for (int i = 0; i < 50; ++i) {
    Vector3d knot = random_inside(lattice, numbers);
    const int axis = i % 3;
    knot[axis] = 1.0 + i % 4;
    const auto slope_at = [&](double offset) {
      return Vector3d(table.at(knot + offset * Vector3d::Unit(axis)).stiffness_W.col(axis));
    };
    const Vector3d second_before = (slope_at(-kStep) - slope_at(-2.0 * kStep)) / kStep;
    const Vector3d second_after = (slope_at(2.0 * kStep) - slope_at(kStep)) / kStep;
    EXPECT_LT((slope_at(kStep) - slope_at(-kStep)).norm(), 1e-2);
    // The third derivative jumps, by some tens: over 3e-5 that is below 1e-2.
    EXPECT_LT((second_after - second_before).norm(), 1e-2) << "axis " << axis;
  }
}

TEST(ForceTable, RefusesToAnswerOutsideItsRange) {
  const ForceTable table =
      table_of(small_lattice(), [](const Vector3d& d) { return Vector3d(-100.0 * d); });
  EXPECT_THAT(message([&] { table.force_W({0.0, 0.0, 0.0}); }), HasSubstr("outside its range"));
  EXPECT_THAT(message([&] {
                table.force_W({std::nan(""), 0.0, 0.005});
              }),
              HasSubstr("outside its range"));
  EXPECT_FALSE(table.contains({0.0, 0.0, 0.0}));
  EXPECT_TRUE(table.contains(table.clamped({1.0, -1.0, 0.0})));
  EXPECT_TRUE(table.clamped({1.0, -1.0, 0.0}).isApprox(Vector3d(0.01, -0.005, 0.002)));
}

TEST(ForceTable, RefusesForcesThatDontFitTheLattice) {
  const TableLattice lattice = small_lattice();
  std::vector<Vector3d> forces_W(lattice.node_count() - 1, Vector3d::Zero());
  EXPECT_THAT(message([&] { ForceTable(lattice, forces_W); }), HasSubstr("119 forces for 120"));
  forces_W.emplace_back(std::nan(""), 0.0, 0.0);
  EXPECT_THAT(message([&] { ForceTable(lattice, forces_W); }), HasSubstr("not finite"));
  TableLattice thin = lattice;
  thin.nodes[1] = 3;
  EXPECT_THAT(message([&] { ForceTable(thin, {}); }), HasSubstr("use 4 to 1000"));
}

TEST(BuildTable, IsTheObjectItself) {
  const simulator::SpringMesh mesh = tiny_block(50.0);
  const TableOptions options = tiny_options(fresh_folder("table_object"));
  const BuiltTable built = build_table(mesh, options);
  EXPECT_EQ(built.unconverged, 0U);
  EXPECT_LT(built.table.force_W(Vector3d::Zero()).norm(), 1e-9);
  // Pulled along its normal, the object pulls back.
  EXPECT_LT(built.table.at(Vector3d::Zero()).stiffness_W(2, 2), -1.0);
  SeededNumbers numbers(11);
  std::vector<Vector3d> displacements_W;
  for (int i = 0; i < 30; ++i) {
    displacements_W.push_back(random_inside(options.lattice, numbers));
  }
  const TableDifference difference = compare_with_live(built.table, mesh, displacements_W, options);
  EXPECT_EQ(difference.positions, 30U);
  EXPECT_LT(difference.rms_percent, 0.1);
  EXPECT_GT(difference.live_rms_N, 0.01);
}

TEST(BuildTable, ComparisonSeesATableThatIsOnePercentOff) {
  const simulator::SpringMesh mesh = tiny_block(50.0);
  const TableOptions options = tiny_options("");
  const BuiltTable built = build_table(mesh, options);
  const ForceTable off = table_of(options.lattice, [&built](const Vector3d& d) {
    return Vector3d(1.01 * built.table.force_W(d));
  });
  const TableDifference difference = compare_with_live(
      off, mesh, {{0.002, 0.0, 0.001}, {-0.002, 0.001, 0.002}, {0.0, 0.0, 0.0025}}, options);
  EXPECT_NEAR(difference.rms_percent, 1.0, 0.1);
}

TEST(BuildTable, CacheGoesByContent) {
  const std::string cache = fresh_folder("table_cache");
  const TableOptions options = tiny_options(cache);
  const simulator::SpringMesh mesh = tiny_block(50.0);
  const BuiltTable first = build_table(mesh, options);
  EXPECT_FALSE(first.from_cache);
  const BuiltTable again = build_table(mesh, options);
  EXPECT_TRUE(again.from_cache);
  EXPECT_EQ(again.key, first.key);
  const Vector3d d(0.0013, -0.0021, 0.0017);
  EXPECT_EQ(again.table.force_W(d), first.table.force_W(d));

  simulator::SpringMesh other = mesh;
  other.springs.back().stiffness_N_per_m *= 1.001;
  EXPECT_NE(table_key(other, options), first.key);
  EXPECT_FALSE(build_table(other, options).from_cache);
  TableOptions finer = options;
  finer.lattice.spacing_m *= 0.9;
  EXPECT_NE(table_key(mesh, finer), first.key);
  TableOptions stricter = options;
  stricter.relative_tolerance *= 0.5;
  EXPECT_NE(table_key(mesh, stricter), first.key);
  EXPECT_TRUE(build_table(mesh, options).from_cache);
}

TEST(BuildTable, ADamagedCacheIsMadeAnew) {
  const std::string cache = fresh_folder("table_damaged");
  const TableOptions options = tiny_options(cache);
  const simulator::SpringMesh mesh = tiny_block(50.0);
  const BuiltTable first = build_table(mesh, options);
  const std::string file = cache + "/table-" + first.key + ".bin";
  {
    std::fstream stream(file, std::ios::in | std::ios::out | std::ios::binary);
    stream.seekp(500);
    stream.put('x');
    ASSERT_TRUE(stream);
  }
  const BuiltTable second = build_table(mesh, options);
  EXPECT_FALSE(second.from_cache);
  EXPECT_EQ(second.table.force_W({0.001, 0.0, 0.001}), first.table.force_W({0.001, 0.0, 0.001}));
  std::filesystem::resize_file(file, 100);
  EXPECT_FALSE(build_table(mesh, options).from_cache);
  EXPECT_TRUE(build_table(mesh, options).from_cache);
}

TEST(BuildTable, StopsWhenAskedTo) {
  TableOptions options = tiny_options(fresh_folder("table_stopped"));
  const std::atomic<bool> cancel{true};
  options.cancel = &cancel;
  EXPECT_THROW(build_table(tiny_block(50.0), options), Stopped);
}

TEST(BuildTable, NamesAFolderThatCantBeMade) {
  EXPECT_THAT(message([] { build_table(tiny_block(50.0), tiny_options("/dev/null/cache")); }),
              HasSubstr("/dev/null/cache"));
}

TEST(ContentHash, IsFnv1a) {
  // Test vectors of the function's authors.
  EXPECT_EQ(ContentHash().text(), "cbf29ce484222325");
  ContentHash hash;
  hash.add("foobar", 6);
  EXPECT_EQ(hash.text(), "85944171f73967e8");
}

}  // namespace
}  // namespace forcegrid::evaluation
