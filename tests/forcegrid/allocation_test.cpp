// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <vector>

#include "forcegrid/method_variant.h"
#include "forcegrid/methods.h"
#include "forcegrid/pair_methods.h"
#include "tests/support/allocation_count.h"

namespace forcegrid {
namespace {

using testing::AllocationCount;

TEST(AllocationCount, SeesAnAllocation) {
  AllocationCount count;
  std::vector<double> allocating(100);
  allocating[0] = 1.0;
  EXPECT_GE(count.value(), 1u);
  EXPECT_EQ(allocating[0], 1.0);
}

TEST(ForceMethods, NeverAllocateAfterConstruction) {
  MethodOptions options;
  options.grid.min_W = Eigen::Vector3d::Constant(-0.05);
  options.grid.max_W = Eigen::Vector3d::Constant(0.05);
  options.grid.cells = Eigen::Vector3i::Constant(20);
  options.influence_radius_m = 0.02;
  options.samples_per_cell = 3;
  std::vector<std::string> variants = method_names();
  for (const char* variant :
       {"forcegrid storage=blocks", "forcegrid-tangent storage=adaptive read=tricubic",
        "forcegrid+request storage=blocks read=tricubic", "forcegrid-mls storage=blocks"}) {
    variants.emplace_back(variant);
  }
  for (const std::string& name : variants) {
    const MethodVariant variant = parse_method_variant(name, options);
    const auto method = make_force_method(variant.name, variant.options);
    double sum = 0.0;
    AllocationCount count;
    for (int i = 0; i < 200; ++i) {
      const Eigen::Vector3d at(0.0002 * i - 0.02, 0.01, 0.0001 * i);
      if (i % 50 == 0) {
        method->contact_made(static_cast<std::uint32_t>(i), at);
      }
      Sample sample;
      sample.position_W = at;
      sample.force_W = 3.0 * at;
      sample.has_stiffness = true;
      sample.stiffness_W = 3.0 * Eigen::Matrix3d::Identity();
      sample.time_s = i;
      method->take_sample(sample);
      method->observe(i, at);
      method->work(100);
      Eigen::Vector3d wanted_W;
      sum += method->plan_request(i, at, wanted_W) ? 1.0 : 0.0;
      sum += method->force(i, at).force_W.x();
    }
    method->contact_lost();
    EXPECT_EQ(count.value(), 0u) << name;
    EXPECT_NE(sum, 0.0) << name;
  }
}

TEST(PairForceMethods, NeverAllocateAfterConstruction) {
  for (const std::string& name : pair_method_names()) {
    const auto method = make_pair_force_method(name, {});
    double sum = 0.0;
    AllocationCount count;
    for (int i = 0; i < 200; ++i) {
      const PairVector at =
          PairVector(0.0002 * i * PairVector::Unit(i % 6) + 0.01 * PairVector::Unit((i / 7) % 6));
      if (i % 100 == 0) {
        method->contacts_made(static_cast<std::uint32_t>(i), PairVector::Zero());
      }
      PairSample sample;
      sample.time_s = i;
      sample.positions_W = at;
      sample.forces_W = (i % 50 < 25 ? -300.0 : -100.0) * at;  // a surprise now and then
      sample.has_stiffness = i >= 100;
      sample.stiffness_W = -300.0 * PairMatrix::Identity();
      method->take_sample(sample);
      method->observe(i, at);
      method->work(20000);
      sum += method->forces(i, at).forces_W.norm();
    }
    method->contacts_lost();
    EXPECT_EQ(count.value(), 0u) << name;
    EXPECT_NE(sum, 0.0) << name;
  }
}

}  // namespace
}  // namespace forcegrid
