// SPDX-License-Identifier: Apache-2.0
#include "simulator/mesh/column_cut.h"

#include <gtest/gtest.h>

#include <cmath>
#include <set>

#include "simulator/mesh/error.h"
#include "simulator/mesh/scene.h"
#include "simulator/solver/elastic_object.h"

namespace forcegrid::simulator {
namespace {

using Eigen::Vector3d;

// The cube of the scene small: 11 x 11 x 9 vertices, 10 mm and 12.5 mm apart, its top at z = 0.
// A column of 25 mm half width holds 5 x 5 vertices of each layer; with a depth of 30 mm the layers
// at 0, -12.5 and -25 mm are cut, and springs between layers down to a middle of -18.75 mm.
const ColumnCut kCut{.centre_W = Vector3d::Zero(), .half_width_m = 0.025, .depth_m = 0.030};

TEST(ColumnCut, SeversTheSpringsAcrossItsSidesAndNoOthers) {
  const SpringMesh whole = make_scene("small").mesh;
  const SpringMesh cut = with_cut(whole, kCut);
  ASSERT_EQ(cut.springs.size(), whole.springs.size());
  int in_layers = 0;
  for (std::size_t i = 0; i < whole.springs.size(); ++i) {
    const Vector3d& a = whole.rest_position_W[static_cast<std::size_t>(whole.springs[i].a)];
    const Vector3d& b = whole.rest_position_W[static_cast<std::size_t>(whole.springs[i].b)];
    const double left = cut.springs[i].stiffness_N_per_m / whole.springs[i].stiffness_N_per_m;
    const bool along_an_edge = (a - b).cwiseAbs().minCoeff() < 1e-9 && a.z() == b.z() &&
                               ((a - b).cwiseAbs().array() > 1e-9).count() == 1;
    if (left < 0.5) {
      EXPECT_DOUBLE_EQ(left, kSevered);
      in_layers += along_an_edge ? 1 : 0;
    } else {
      EXPECT_EQ(left, 1.0);
    }
  }
  // In each of three layers, five edges cross each of the four sides.
  EXPECT_EQ(in_layers, 3 * 4 * 5);
}

TEST(ColumnCut, OpensTheSurface) {
  const SpringMesh whole = make_scene("small").mesh;
  const SpringMesh cut = with_cut(whole, kCut);
  // On the top, the ring of lattice squares around 4 x 4 inner ones: 6 x 6 - 4 x 4, two triangles
  // each. A corner's square has one triangle that no side crosses only if its diagonal runs so.
  const std::size_t gone = whole.triangles.size() - cut.triangles.size();
  EXPECT_GE(gone, 2U * (36U - 16U) - 4U);
  EXPECT_LE(gone, 2U * (36U - 16U));
  EXPECT_NO_THROW(check(cut)) << "every vertex is still held, and at rest";
}

TEST(ColumnCut, MakesTheObjectSofterUnderTheTool) {
  const Scene scene = make_scene("small");
  double force_N[2] = {};
  const SpringMesh meshes[2] = {scene.mesh, with_cut(scene.mesh, kCut)};
  for (int i = 0; i < 2; ++i) {
    ElasticObject<double> object(meshes[i]);
    ASSERT_TRUE(object.grab(scene.mesh.top_W, scene.patch_radius_m));
    force_N[i] = object.move_to(Vector3d(0.0, 0.0, 0.005)).force_W.norm();
  }
  EXPECT_GT(force_N[0], 0.1);
  EXPECT_LT(force_N[1], 0.9 * force_N[0]);
  EXPECT_GT(force_N[1], 0.1 * force_N[0]) << "its foot still holds it";
}

TEST(ColumnCut, RefusesAnObjectThatLoadsKeepInShape) {
  EXPECT_THROW(with_cut(make_scene("stomach").mesh, kCut), Error);
}

}  // namespace
}  // namespace forcegrid::simulator
