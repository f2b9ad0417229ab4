// SPDX-License-Identifier: Apache-2.0
#include "bench/openvdb_peer.h"

#include <openvdb/openvdb.h>
#include <openvdb/tools/Interpolation.h>

#include <cmath>

namespace forcegrid::bench {

struct OpenVdbGrid::Implementation {
  openvdb::Vec3SGrid::Ptr grid;
};

OpenVdbGrid::OpenVdbGrid(int vertices) : implementation_(std::make_unique<Implementation>()) {
  openvdb::initialize();
  implementation_->grid = openvdb::Vec3SGrid::create(openvdb::Vec3s(0.0F));
  auto accessor = implementation_->grid->getAccessor();
  for (int i = 0; i < vertices; ++i) {
    for (int j = 0; j < vertices; ++j) {
      for (int k = 0; k < vertices; ++k) {
        const float value = std::sin(static_cast<float>(i + 3 * j + 7 * k));
        accessor.setValue({i, j, k}, openvdb::Vec3s(value, 2.0F * value, 3.0F * value));
      }
    }
  }
}

OpenVdbGrid::~OpenVdbGrid() = default;

std::array<float, 3> OpenVdbGrid::sample_all(const std::array<double, 3>* index_positions,
                                             int count) const {
  auto accessor = implementation_->grid->getConstAccessor();
  openvdb::Vec3s sum(0.0F);
  for (int i = 0; i < count; ++i) {
    const auto& p = index_positions[i];
    sum += openvdb::tools::BoxSampler::sample(accessor, openvdb::Vec3R(p[0], p[1], p[2]));
  }
  return {sum.x(), sum.y(), sum.z()};
}

}  // namespace forcegrid::bench
