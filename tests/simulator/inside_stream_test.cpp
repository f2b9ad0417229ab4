// SPDX-License-Identifier: Apache-2.0
// What is inside an object, and that it is sent while the live view wishes it.
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <set>
#include <thread>
#include <utility>

#include "simulator/drawn_mesh.h"
#include "simulator/mesh/column_cut.h"
#include "simulator/mesh/scene.h"
#include "simulator/solver/elastic_object.h"
#include "simulator/surface_stream.h"
#include "simulator/touch/solver_choice.h"
#include "simulator/touch/solver_contact.h"
#include "tests/simulator/surface_view.h"

namespace forcegrid::simulator {
namespace {

using Eigen::Vector3d;
using namespace std::chrono_literals;
using View = testing::SurfaceView;
using view_link::Edge;
using view_link::InsideLines;

constexpr auto kPatience = 20s;  // the machine may be busy; what works ends far earlier

// A lattice's springs by the closed form of simulator/mesh/lattice_block.h.
std::size_t springs_of_lattice(std::size_t nx, std::size_t ny, std::size_t nz) {
  return (nx - 1) * ny * nz + nx * (ny - 1) * nz + nx * ny * (nz - 1) +
         2 * ((nx - 1) * (ny - 1) * nz + (nx - 1) * ny * (nz - 1) + nx * (ny - 1) * (nz - 1));
}

std::unique_ptr<ToolContact> contact_of(const Scene& scene) {
  const SolverChoice choice = choose_solver(
      SolverKind::kQuasiStatic, scene.mesh.rest_position_W.size(), 30.0, SolverOptions{});
  return make_solver_contact(scene, choice, scene.tool, 30.0);
}

TEST(DrawnInside, HasEverySpringOfALattice) {
  const SpringMesh mesh = make_scene("small").mesh;
  const DrawnInside inside = drawn_inside(mesh);
  EXPECT_EQ(inside.lines.springs, springs_of_lattice(11, 11, 9));
  EXPECT_EQ(inside.lines.element_edges, 0U);
  EXPECT_EQ(inside.lines.vertices, 11U * 11U * 9U);
  std::set<Edge> different;
  for (const Edge& edge : inside.lines.edge) {
    different.insert({std::min(edge[0], edge[1]), std::max(edge[0], edge[1])});
    // Neighbours of a lattice of 10 mm, 10 mm and 12.5 mm differ by one step along one axis or two.
    const auto at = [&](std::uint32_t end) {
      return mesh.rest_position_W[static_cast<std::size_t>(inside.vertices[end])];
    };
    const Vector3d steps =
        (at(edge[0]) - at(edge[1])).cwiseAbs().cwiseQuotient(Vector3d(0.01, 0.01, 0.0125));
    EXPECT_NEAR(steps.maxCoeff(), 1.0, 1e-9);
    EXPECT_LT(steps.sum(), 2.0 + 1e-9);
  }
  EXPECT_EQ(different.size(), inside.lines.edge.size());
}

TEST(DrawnInside, HasEachEdgeOfTwoTetrahedraOnce) {
  SpringMesh mesh;
  mesh.rest_position_W.assign(7, Vector3d::Zero());  // two of them belong to no element
  mesh.tetrahedra = {{{1, 2, 3, 5}}, {{6, 3, 2, 5}}};
  const DrawnInside inside = drawn_inside(mesh);
  EXPECT_EQ(inside.vertices, (std::vector<std::int32_t>{1, 2, 3, 5, 6}));
  EXPECT_EQ(inside.lines.springs, 0U);
  EXPECT_EQ(inside.lines.element_edges, 9U) << "6 + 6, 3 of which are of both";
  EXPECT_EQ(
      inside.lines.edge,
      (std::vector<Edge>{{0, 1}, {0, 2}, {0, 3}, {1, 2}, {1, 3}, {1, 4}, {2, 3}, {2, 4}, {3, 4}}));
}

TEST(DrawnInside, HasEachEdgeOfABlockOfTetrahedraOnce) {
  // Kuhn's division: each of n x n x n cubes (n = kCubes) into six tetrahedra around its diagonal.
  // Edges along the axes 3 n (n + 1)^2, one diagonal of each square 3 n^2 (n + 1), and n^3 of the
  // cubes.
  constexpr int kCubes = 4;
  const auto vertex = [](const std::array<int, 3>& at) {
    return at[0] + (kCubes + 1) * (at[1] + (kCubes + 1) * at[2]);
  };
  SpringMesh mesh;
  mesh.rest_position_W.assign((kCubes + 1) * (kCubes + 1) * (kCubes + 1), Vector3d::Zero());
  for (int cube = 0; cube < kCubes * kCubes * kCubes; ++cube) {
    std::array<std::size_t, 3> axes = {0, 1, 2};
    do {
      std::array<int, 3> at = {cube % kCubes, cube / kCubes % kCubes, cube / kCubes / kCubes};
      Tetrahedron element{{vertex(at), 0, 0, 0}};
      for (std::size_t step = 0; step < 3; ++step) {
        ++at[axes[step]];
        element.vertex[step + 1] = vertex(at);
      }
      mesh.tetrahedra.push_back(element);
    } while (std::next_permutation(axes.begin(), axes.end()));
  }
  ASSERT_EQ(mesh.tetrahedra.size(), 6U * kCubes * kCubes * kCubes);
  EXPECT_EQ(drawn_inside(mesh).lines.element_edges, 3U * kCubes * (kCubes + 1) * (kCubes + 1) +
                                                        3U * kCubes * kCubes * (kCubes + 1) +
                                                        kCubes * kCubes * kCubes);
}

TEST(DrawnInside, OfMoreThanCanBeShownIsCountedAlone) {
  SpringMesh mesh;
  mesh.rest_position_W.assign(2, Vector3d::Zero());
  mesh.springs.assign(view_link::kMostEdges, {0, 1, 1.0});
  EXPECT_EQ(drawn_inside(mesh).lines.edge.size(), view_link::kMostEdges);
  mesh.springs.push_back({0, 1, 1.0});
  const DrawnInside inside = drawn_inside(mesh);
  EXPECT_EQ(inside.lines.springs, view_link::kMostEdges + 1);
  EXPECT_TRUE(inside.lines.edge.empty());
  EXPECT_TRUE(inside.vertices.empty());
  EXPECT_TRUE(view_link::decode_lines(view_link::encode(inside.lines).payload));
}

TEST(DrawnInside, HasNoSpringsThatACutSevered) {
  const SpringMesh whole = make_scene("small").mesh;
  const SpringMesh cut = with_cut(whole, {.half_width_m = 0.018, .depth_m = 0.04});
  std::size_t left = 0;
  for (std::size_t s = 0; s < cut.springs.size(); ++s) {
    left += cut.springs[s].stiffness_N_per_m == whole.springs[s].stiffness_N_per_m ? 1 : 0;
  }
  ASSERT_LT(left, whole.springs.size());
  EXPECT_EQ(drawn_inside(cut).lines.springs, left);
}

// A view, and an object that streams to it.
class InsideStream : public ::testing::Test {
 protected:
  InsideStream() {
    EXPECT_TRUE(view_.next_shape());
    EXPECT_TRUE(view_.next_positions());
    contact_->step({0.001, 0.002, 0.02});
    contact_->step({0.001, 0.002, -0.0001});
  }

  // Shows until a frame of this type comes, and returns it; nothing if none comes.
  std::optional<view_link::Frame> shown(view_link::InsideType wanted) {
    const auto give_up = std::chrono::steady_clock::now() + kPatience;
    while (std::chrono::steady_clock::now() < give_up) {
      stream_.touch();
      stream_.show(*contact_);
      while (auto frame = view_.next(1ms)) {
        if (frame->type == static_cast<std::uint16_t>(wanted)) {
          return frame;
        }
      }
    }
    return std::nullopt;
  }

  std::optional<InsideLines> shown_lines() {
    const auto frame = shown(view_link::InsideType::kLines);
    return frame ? view_link::decode_lines(frame->payload) : std::nullopt;
  }

  View view_;
  Scene scene_ = make_scene("small");
  std::unique_ptr<ToolContact> contact_ = contact_of(scene_);
  SurfaceStream stream_{scene_.mesh, view_.path()};
};

TEST_F(InsideStream, BeginsWithTheWishAndEndsWithIt) {
  for (int i = 0; i < 20; ++i) {
    contact_->step({0.001, 0.002, -1e-4 * i});
    stream_.touch();
    stream_.show(*contact_);
  }
  EXPECT_EQ(stream_.counts().inside_frames, 0U) << "nobody wishes it";
  view_.wish(true);
  const auto lines = shown_lines();
  ASSERT_TRUE(lines);
  EXPECT_EQ(lines->edge, drawn_inside(scene_.mesh).lines.edge);
  const auto first = shown(view_link::InsideType::kFrame);
  ASSERT_TRUE(first);
  EXPECT_EQ(view_link::decode_frame(first->payload)->epoch, lines->epoch);
  view_.wish(false);
  // Its end is known when moves bring surfaces alone.
  const auto give_up = std::chrono::steady_clock::now() + kPatience;
  int surfaces_alone = 0;
  for (int i = 0; surfaces_alone < 50 && std::chrono::steady_clock::now() < give_up; ++i) {
    contact_->step({0.001, 0.002, -1e-4 * (i % 50)});
    const SurfaceStream::Counts before = stream_.counts();
    std::this_thread::sleep_for(5ms);  // more than the limit of bytes a second asks for
    stream_.touch();
    stream_.show(*contact_);
    const SurfaceStream::Counts after = stream_.counts();
    surfaces_alone = after.inside_frames != before.inside_frames ? 0
                     : after.frames != before.frames             ? surfaces_alone + 1
                                                                 : surfaces_alone;
  }
  EXPECT_EQ(surfaces_alone, 50);
  view_.wish(true);
  const auto again = shown_lines();
  ASSERT_TRUE(again);
  EXPECT_GT(again->epoch, lines->epoch);
}

TEST_F(InsideStream, FramesAreTheSolversOwnPositionsToHalfAStep) {
  view_.wish(true);
  ASSERT_TRUE(shown_lines());
  ElasticObject<float> own(scene_.mesh, SolverOptions{});
  const Vector3d touch_W(0.001, 0.002, 0.0);
  ASSERT_GT(own.grab(touch_W, scene_.patch_radius_m), 0);
  own.move_to(Vector3d::Zero());
  own.move_to({0.0, 0.0, -0.0001});
  ASSERT_TRUE(contact_->step(touch_W + Vector3d(0.0, 0.0, -0.004)).in_contact);
  own.move_to({0.0, 0.0, -0.004});
  const std::vector<Vector3d> expected_W = own.positions_W();
  // The lattice's middle column below the tool: (5, 5, l), see lattice_block.h.
  const auto middle = [](std::size_t l) { return 5 + 11 * (5 + 11 * l); };
  const auto give_up = std::chrono::steady_clock::now() + kPatience;
  double worst_m = 1.0;
  while (worst_m > 3e-6 && std::chrono::steady_clock::now() < give_up) {
    const auto frame = shown(view_link::InsideType::kFrame);
    ASSERT_TRUE(frame);
    const auto decoded = view_link::decode_frame(frame->payload);
    ASSERT_TRUE(decoded);
    ASSERT_EQ(decoded->position_W_m.size(), expected_W.size());
    worst_m = 0.0;
    for (std::size_t vertex = 0; vertex < expected_W.size(); ++vertex) {
      const auto& [x, y, z] = decoded->position_W_m[vertex];
      worst_m = std::max(worst_m, (Vector3d(x, y, z) - expected_W[vertex]).norm());
    }
    for (std::size_t l = 1; worst_m < 3e-6 && l < 8; ++l) {
      EXPECT_LT(decoded->position_W_m[middle(l)][2],
                scene_.mesh.rest_position_W[middle(l)].z() - 1e-4)
          << "pressed down, layer " << l;
    }
  }
  EXPECT_LE(worst_m, 3e-6) << "half of 0.1 m / 65535 along each axis, and single precision";
}

TEST_F(InsideStream, OfACutObjectIsAnotherOne) {
  view_.wish(true);
  const auto whole = shown_lines();
  ASSERT_TRUE(whole);
  const SpringMesh cut = with_cut(scene_.mesh, {});
  stream_.change(cut);
  const auto after = shown_lines();
  ASSERT_TRUE(after);
  EXPECT_LT(after->edge.size(), whole->edge.size());
  EXPECT_GT(after->epoch, whole->epoch);
  stream_.change(scene_.mesh);
  const auto again = shown_lines();
  ASSERT_TRUE(again);
  EXPECT_EQ(again->edge, whole->edge);
}

TEST_F(InsideStream, OfALargeObjectWaitsUntilItsBytesMayGo) {
  // 1089 vertices are 6,534 bytes: at 3 MB/s one frame each 2.2 ms, however often it moves.
  view_.wish(true);
  ASSERT_TRUE(shown_lines());
  const auto begin = std::chrono::steady_clock::now();
  const std::uint64_t before = stream_.counts().inside_frames;
  int shows = 0;
  while (std::chrono::steady_clock::now() < begin + 300ms) {
    contact_->step({0.001, 0.002, -1e-5 * (++shows % 100)});
    stream_.touch();
    stream_.show(*contact_);
  }
  const double passed_s = rt::seconds(std::chrono::steady_clock::now() - begin);
  const auto sent = static_cast<double>(stream_.counts().inside_frames - before);
  EXPECT_LE(sent, 1.0 + passed_s * SurfaceStream::kMostInside_per_s / 6534.0);
  EXPECT_GE(sent, 1.0);
}

TEST_F(InsideStream, WithstandsWhatIsNoWish) {
  view_.wish(true);
  ASSERT_TRUE(shown_lines());
  const view_link::Bytes odd =
      view_link::bytes_of({static_cast<std::uint16_t>(view_link::InsideType::kWish), 0, {1, 2}});
  const view_link::Bytes other = view_link::bytes_of({99, 3, {1, 0, 0, 0}});
  view_.send(other);
  EXPECT_TRUE(shown(view_link::InsideType::kFrame)) << "a type that it does not know is ignored";
  view_.send(odd);
  view_.wish(true);
  EXPECT_TRUE(shown(view_link::InsideType::kFrame));
  EXPECT_FALSE(stream_.counts().lost);
}

}  // namespace
}  // namespace forcegrid::simulator
