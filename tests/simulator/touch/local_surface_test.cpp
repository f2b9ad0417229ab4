// SPDX-License-Identifier: Apache-2.0
#include "simulator/touch/local_surface.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <limits>
#include <set>

#include "contact/distance.h"
#include "link/wire.h"
#include "simulator/mesh/scene.h"
#include "simulator/touch/tool_contact.h"
#include "simulator/touch/tool_geometry.h"

namespace forcegrid::simulator {
namespace {

using Eigen::Vector3d;

constexpr double kFloat_m = 1e-8;  // rounding of an offset of some centimetres

link::SurfacePatch at(const Vector3d& position_W) {
  link::SurfacePatch patch;
  patch.position_W_m = {position_W.x(), position_W.y(), position_W.z()};
  return patch;
}

contact::Corners corners_W(const link::SurfacePatch& patch, std::size_t triangle) {
  contact::Corners corners;
  for (std::size_t k = 0; k < 3; ++k) {
    const link::SurfacePatch::Vertex& offset = patch.vertices_W_m[patch.triangles[triangle][k]];
    for (std::size_t axis = 0; axis < 3; ++axis) {
      corners[k][static_cast<Eigen::Index>(axis)] =
          patch.position_W_m[axis] + static_cast<double>(offset[axis]);
    }
  }
  return corners;
}

double distance_m(const contact::Corners& corners, const Vector3d& point_W) {
  return contact::nearest(point_W, point_W, corners).distance_m;
}

class LocalSurfaceTest : public ::testing::TestWithParam<const char*> {
 protected:
  Scene scene_ = make_scene(GetParam());
};

TEST_P(LocalSurfaceTest, HasTheNearestTrianglesOfTheMeshAsTheyAreAndAsManyAsFit) {
  auto surface = LocalSurface::make(scene_.mesh, {});
  ASSERT_TRUE(surface);
  const Vector3d tool_W = scene_.mesh.top_W + Vector3d(0.003, -0.004, 0.008);
  link::SurfacePatch patch = at(tool_W);
  surface->cut(std::nullopt, patch);
  ASSERT_GT(patch.triangle_count, 9U);
  EXPECT_LE(patch.vertex_count, link::SurfacePatch::kMaxVertices);
  std::array<std::byte, link::kMaxDatagramBytes> buffer;
  EXPECT_EQ(link::encode(patch, 1, buffer).status, link::WireStatus::kOk);

  // Every triangle is one of the mesh, with the same way round; the nearest of all is among them.
  double nearest_m = std::numeric_limits<double>::infinity();
  std::set<std::size_t> found;
  for (std::size_t t = 0; t < patch.triangle_count; ++t) {
    const contact::Corners corners = corners_W(patch, t);
    nearest_m = std::min(nearest_m, distance_m(corners, tool_W));
    for (std::size_t m = 0; m < scene_.mesh.triangles.size(); ++m) {
      bool same = true;
      for (std::size_t k = 0; k < 3; ++k) {
        const auto vertex = static_cast<std::size_t>(scene_.mesh.triangles[m][k]);
        same = same && (scene_.mesh.rest_position_W[vertex] - corners[k]).norm() < kFloat_m;
      }
      if (same) {
        found.insert(m);
      }
    }
  }
  EXPECT_EQ(found.size(), patch.triangle_count);
  double nearest_of_all_m = std::numeric_limits<double>::infinity();
  for (const auto& triangle : scene_.mesh.triangles) {
    contact::Corners corners;
    for (std::size_t k = 0; k < 3; ++k) {
      corners[k] = scene_.mesh.rest_position_W[static_cast<std::size_t>(triangle[k])];
    }
    nearest_of_all_m = std::min(nearest_of_all_m, distance_m(corners, tool_W));
  }
  EXPECT_NEAR(nearest_m, nearest_of_all_m, kFloat_m);
}

INSTANTIATE_TEST_SUITE_P(Scenes, LocalSurfaceTest, ::testing::Values("small", "stomach"));

TEST(LocalSurface, LiesWhereTheToolWillTouch) {
  const Scene scene = make_scene("small");
  auto surface = LocalSurface::make(scene.mesh, {.shape = "sphere", .radius_m = 0.006});
  ASSERT_TRUE(surface);
  link::SurfacePatch patch = at(scene.mesh.top_W + Vector3d(0.0, 0.0, 0.05));
  surface->cut(std::nullopt, patch);
  EXPECT_EQ(patch.triangle_count, 0U) << "5 cm away nothing is near";
  EXPECT_EQ(patch.tool_radius_m, 0.006F);
  EXPECT_EQ(patch.tool_length_m, 0.0F);
  const Vector3d touch_W = scene.mesh.top_W + Vector3d(0.02, 0.01, 0.0);
  surface->cut(touch_W, patch);
  ASSERT_GT(patch.triangle_count, 0U);
  EXPECT_LT(distance_m(corners_W(patch, 0), touch_W), kFloat_m);
}

TEST(LocalSurface, StatesAGraspersJawsAndIsNoneOfAnObjectWithoutSurface) {
  const Scene scene = make_scene("small");
  auto surface = LocalSurface::make(scene.mesh, {.shape = "grasper",
                                                 .contact = "slide",
                                                 .radius_m = 0.004,
                                                 .length_m = 0.03,
                                                 .opening_rad = 0.7});
  ASSERT_TRUE(surface);
  link::SurfacePatch patch = at(scene.mesh.top_W);
  surface->cut(std::nullopt, patch);
  EXPECT_GT(patch.triangle_count, 9U);
  EXPECT_EQ(patch.tool_radius_m, 0.004F);
  EXPECT_EQ(patch.tool_length_m, 0.03F);
  EXPECT_EQ(patch.tool_opening_crad, 70);
  std::array<std::byte, link::kMaxDatagramBytes> buffer;
  EXPECT_EQ(link::encode(patch, 1, buffer).status, link::WireStatus::kOk);
  EXPECT_FALSE(LocalSurface::make(SpringMesh{}, {}));
}

TEST(WayIn, IsWhereThePathOfAPointOrASphereMeetsThePlane) {
  const Scene scene = make_scene("small");
  const Vector3d above_W = scene.mesh.top_W + Vector3d(0.002, 0.001, 0.003);
  const Vector3d below_W = scene.mesh.top_W + Vector3d(0.004, 0.001, -0.001);
  const Vector3d expected_W = scene.mesh.top_W + Vector3d(0.0035, 0.001, 0.0);
  for (const char* shape : {"point", "sphere", "capsule"}) {
    SCOPED_TRACE(shape);
    const WayIn way_in(scene.mesh, tool_shape({.shape = shape}));
    const auto touch_W = way_in.between(above_W, below_W);
    ASSERT_TRUE(touch_W);
    EXPECT_LT((*touch_W - expected_W).norm(), 2.0 * WayIn::kTouching_m);
    EXPECT_FALSE(way_in.between(above_W, above_W + Vector3d(0.001, 0.0, -0.002)));
  }
}

TEST(ToolContact, ATouchIsWhereTheToolCameInHoweverFarItHasGoneSince) {
  const Scene scene = make_scene("small");
  for (const char* shape : {"point", "sphere"}) {
    SCOPED_TRACE(shape);
    const auto tool = make_tool_contact(scene, {}, {.shape = shape});
    tool->step(scene.mesh.top_W + Vector3d(0.0, 0.0, 0.001));
    const auto answer = tool->step(scene.mesh.top_W + Vector3d(0.0, 0.0, -0.002));
    ASSERT_TRUE(answer.in_contact);
    EXPECT_EQ(answer.epoch, 1U);
    EXPECT_LT((answer.point_W - scene.mesh.top_W).norm(), 2.0 * WayIn::kTouching_m);
    EXPECT_GT(answer.equilibrium.force_W.z(), 0.1) << "2 mm deep it pushes already";
    // As one that was held from that point on.
    const auto gone_W = answer.equilibrium.displacement_W;
    EXPECT_NEAR(gone_W.z(), -0.002, 2.0 * WayIn::kTouching_m);
  }
}

}  // namespace
}  // namespace forcegrid::simulator
