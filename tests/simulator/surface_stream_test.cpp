// SPDX-License-Identifier: Apache-2.0
#include "simulator/surface_stream.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <atomic>
#include <chrono>
#include <cmath>
#include <future>
#include <nlohmann/json.hpp>
#include <set>
#include <sstream>
#include <thread>

#include "link/servo_endpoint.h"
#include "simulator/mesh/scene.h"
#include "simulator/run_simulator.h"
#include "simulator/solver/elastic_object.h"
#include "simulator/touch/solver_choice.h"
#include "simulator/touch/solver_contact.h"
#include "tests/simulator/surface_view.h"
#include "tests/support/flushed_text.h"

namespace forcegrid::simulator {
namespace {

using Eigen::Vector3d;
using ::testing::HasSubstr;
using namespace std::chrono_literals;
using View = testing::SurfaceView;

constexpr double kRate_Hz = 30.0;
constexpr auto kPatience = 20s;  // the machine may be busy; what works ends far earlier

std::unique_ptr<ToolContact> contact_of(const Scene& scene) {
  const SolverChoice choice = choose_solver(
      SolverKind::kQuasiStatic, scene.mesh.rest_position_W.size(), kRate_Hz, SolverOptions{});
  return make_solver_contact(scene, choice, scene.tool, kRate_Hz);
}

Vector3d to_vector(const view_link::Point& point) { return {point[0], point[1], point[2]}; }

// [m] Half a step of the frame's rounding on each axis, and single precision's of 0.1 m.
Vector3d half_step_m(const std::vector<Vector3d>& position_W) {
  Vector3d low_W = position_W.front();
  Vector3d high_W = low_W;
  for (const Vector3d& each_W : position_W) {
    low_W = low_W.cwiseMin(each_W);
    high_W = high_W.cwiseMax(each_W);
  }
  return 0.5 * (high_W - low_W) / 65535.0 + Vector3d::Constant(3e-8);
}

// [m] The largest distance of a frame's vertices from where they should be.
double worst_m(const view_link::SurfaceFrame& frame, const std::vector<Vector3d>& expected_W) {
  double worst = 0.0;
  for (std::size_t n = 0; n < expected_W.size(); ++n) {
    worst = std::max(worst, (to_vector(frame.position_W_m[n]) - expected_W[n]).norm());
  }
  return worst;
}

TEST(DrawnSurface, HasTheMeshsTrianglesAndOnlyTheirVertices) {
  const SpringMesh mesh = make_scene("small").mesh;
  const DrawnSurface surface = drawn_surface(mesh);
  // All of the lattice of 11 x 11 x 9 but its inside of 9 x 9 x 7.
  EXPECT_EQ(surface.vertices.size(), 11U * 11U * 9U - 9U * 9U * 7U);
  ASSERT_EQ(surface.triangles.size(), mesh.triangles.size());
  for (std::size_t t = 0; t < mesh.triangles.size(); ++t) {
    for (std::size_t k = 0; k < 3; ++k) {
      ASSERT_LT(surface.triangles[t][k], surface.vertices.size());
      EXPECT_EQ(surface.vertices[surface.triangles[t][k]], mesh.triangles[t][k]);
    }
  }
  const std::set<std::int32_t> different(surface.vertices.begin(), surface.vertices.end());
  EXPECT_EQ(different.size(), surface.vertices.size());
}

TEST(SurfaceStream, SendsTheShapeAndThenTheSurfaceAtRest) {
  View view;
  const Scene scene = make_scene("small");
  const SurfaceStream stream(scene.mesh, view.path());
  const auto shape = view.next_shape();
  ASSERT_TRUE(shape);
  const DrawnSurface expected = drawn_surface(scene.mesh);
  ASSERT_EQ(shape->rest_W_m.size(), expected.vertices.size());
  EXPECT_EQ(shape->triangle, expected.triangles);
  std::vector<Vector3d> rest_W;
  for (std::size_t n = 0; n < expected.vertices.size(); ++n) {
    rest_W.push_back(scene.mesh.rest_position_W[static_cast<std::size_t>(expected.vertices[n])]);
    EXPECT_EQ(to_vector(shape->rest_W_m[n]), rest_W[n].cast<float>().cast<double>());
  }
  const auto frame = view.next_positions();
  ASSERT_TRUE(frame);
  EXPECT_EQ(frame->epoch, shape->epoch);
  ASSERT_EQ(frame->position_W_m.size(), rest_W.size());
  EXPECT_LT(worst_m(*frame, rest_W), half_step_m(rest_W).norm());
}

TEST(SurfaceStream, FramesAreTheSolversOwnPositionsToHalfAStep) {
  View view;
  const Scene scene = make_scene("small");
  const auto contact = contact_of(scene);
  SurfaceStream stream(scene.mesh, view.path());
  ASSERT_TRUE(view.next_shape());
  ASSERT_TRUE(view.next_positions());
  const std::vector<std::int32_t> vertices = drawn_surface(scene.mesh).vertices;

  contact->step({0.001, 0.002, 0.02});
  ASSERT_TRUE(contact->step({0.001, 0.002, -0.0001}).in_contact);
  ElasticObject<float> own(scene.mesh, SolverOptions{});
  const Vector3d touch_W(0.001, 0.002, 0.0);
  ASSERT_GT(own.grab(touch_W, scene.patch_radius_m), 0);
  own.move_to(Vector3d::Zero());
  own.move_to({0.0, 0.0, -0.0001});
  for (int k = 1; k <= 5; ++k) {
    const Vector3d tool_W = touch_W + 1e-3 * Vector3d(0.3 * k, -0.2 * k, k);
    const auto answer = contact->step(tool_W);
    ASSERT_TRUE(answer.in_contact && answer.equilibrium.reached);
    own.move_to(tool_W - touch_W);
    stream.touch();
    stream.show(*contact);
    const auto frame = view.next_positions();
    ASSERT_TRUE(frame) << k;
    const std::vector<Vector3d> all_W = own.positions_W();
    std::vector<Vector3d> expected_W;
    for (const std::int32_t vertex : vertices) {
      expected_W.push_back(all_W[static_cast<std::size_t>(vertex)]);
    }
    const Vector3d tolerance_m = half_step_m(expected_W);
    int held = 0;
    for (std::size_t n = 0; n < vertices.size(); ++n) {
      const Vector3d seen_W = to_vector(frame->position_W_m[n]);
      const Vector3d error_m = (seen_W - expected_W[n]).cwiseAbs();
      ASSERT_TRUE((error_m.array() <= tolerance_m.array()).all()) << k << " " << error_m;
      const Vector3d rest_W = scene.mesh.rest_position_W[static_cast<std::size_t>(vertices[n])];
      if ((rest_W - touch_W).norm() < scene.patch_radius_m) {
        ++held;
        EXPECT_LT((seen_W - rest_W - (tool_W - touch_W)).norm(), tolerance_m.norm() + 1e-6);
      }
    }
    EXPECT_GT(held, 3);
  }
  EXPECT_EQ(stream.counts().frames, 6U);
}

TEST(SurfaceStream, WhatHasNotMovedIsSentOnceASecond) {
  View view;
  const Scene scene = make_scene("small");
  const auto contact = contact_of(scene);
  const auto start = std::chrono::steady_clock::now();
  SurfaceStream stream(scene.mesh, view.path());
  contact->step({0.001, 0.002, 0.02});
  while (stream.counts().frames == 1 && std::chrono::steady_clock::now() < start + kPatience) {
    stream.touch();  // a tool in the air
    stream.show(*contact);
    std::this_thread::sleep_for(1ms);
  }
  EXPECT_EQ(stream.counts().frames, 2U);
  EXPECT_GE(std::chrono::steady_clock::now() - start, SurfaceStream::kLongestSilence);
}

TEST(SurfaceStream, AViewThatNeverReadsCostsNeitherTimeNorMemory) {
  View view;
  const Scene scene = make_scene("small");
  const auto contact = contact_of(scene);
  SurfaceStream stream(scene.mesh, view.path());
  contact->step({0.001, 0.002, 0.02});
  contact->step({0.001, 0.002, -0.0001});
  constexpr int kFrames = 2000;
  for (int k = 1; k <= kFrames; ++k) {
    contact->step({0.001, 0.002, 1e-6 * k});
    stream.touch();
    stream.show(*contact);  // would hang here, if it waited for the view
  }
  const SurfaceStream::Counts counts = stream.counts();
  EXPECT_EQ(counts.frames, kFrames + 1U);
  // Not dropped are those in the socket's buffer of some 200 kB, at 3.2 kB each, one in the
  // sender's hand and one that waits. All of them would be 6 MB.
  EXPECT_LT(counts.frames - counts.dropped, 400U);
  EXPECT_FALSE(counts.lost);
}

TEST(SurfaceStream, GoesOnWithoutAViewThatHasGone) {
  View view;
  const Scene scene = make_scene("small");
  const auto contact = contact_of(scene);
  SurfaceStream stream(scene.mesh, view.path());
  ASSERT_TRUE(view.next_shape());
  view.hang_up();
  const auto give_up = std::chrono::steady_clock::now() + kPatience;
  while (!stream.counts().lost && std::chrono::steady_clock::now() < give_up) {
    std::this_thread::sleep_for(1ms);
  }
  ASSERT_TRUE(stream.counts().lost);
  contact->step({0.001, 0.002, 0.02});
  stream.touch();
  stream.show(*contact);
  EXPECT_EQ(stream.counts().frames, 1U);
}

TEST(SurfaceStream, WithoutAViewTheErrorNamesThePath) {
  const Scene scene = make_scene("small");
  SimulatorOptions options;
  options.scene = "small";
  options.listen = "127.0.0.1:0";
  options.surface = "/tmp/forcegrid_no_view_here/surface";
  std::ostringstream out;
  const std::atomic<bool> stop{false};
  try {
    run_simulator(options, out, stop);
    FAIL() << "runs without the view";
  } catch (const view_link::ViewLinkError& error) {
    EXPECT_THAT(error.what(), HasSubstr(options.surface));
  }
  EXPECT_EQ(out.str(), "");
}

// A simulator of the scene "small" that a view watches.
class WatchedSimulator : public ::testing::Test {
 public:
  ~WatchedSimulator() override { stop_ = true; }

 protected:
  WatchedSimulator() {
    SimulatorOptions options;
    options.scene = "small";
    options.listen = "127.0.0.1:0";
    options.nice = 0;
    options.surface = view_.path();
    result_ = std::async(std::launch::async, [this, options] {
      std::ostream out(&out_);
      return run_simulator(options, out, stop_);
    });
    const auto give_up = std::chrono::steady_clock::now() + kPatience;
    while (out_.flushed().empty() && std::chrono::steady_clock::now() < give_up) {
      std::this_thread::sleep_for(1ms);
    }
    std::istringstream words(out_.flushed());
    words >> address_ >> address_;
  }

  // Keeps the tool at `position_W_m` until the simulator has answered there, and a frame has come
  // with its highest vertex at `top_m`.
  bool held_until_top_is(link::ServoEndpoint& servo, const link::Vector3& position_W_m,
                         double top_m) {
    const auto give_up = std::chrono::steady_clock::now() + kPatience;
    bool answered = false;
    bool shown = false;
    while (!(answered && shown) && std::chrono::steady_clock::now() < give_up) {
      link::ToolState state;
      state.sequence = ++sequence_;
      state.servo_time_ns = 1000 + sequence_;
      state.position_W_m = position_W_m;
      servo.send(state);
      servo.wait(2ms);
      while (const auto sample = servo.receive()) {
        answered = answered || sample->position_W_m == position_W_m;
      }
      while (const auto frame = view_.next_positions(1ms)) {
        double highest_m = -1.0;
        for (const view_link::Point& point : frame->position_W_m) {
          highest_m = std::max(highest_m, static_cast<double>(point[2]));
        }
        shown = std::abs(highest_m - top_m) < 1e-5;
      }
    }
    return answered && shown;
  }

  View view_;
  FlushedText out_;
  std::atomic<bool> stop_{false};
  std::future<SimulatorSummary> result_;
  std::string address_;
  std::uint32_t sequence_ = 0;
};

TEST_F(WatchedSimulator, ShowsThePullAndTheRestOfTheNextSession) {
  const auto shape = view_.next_shape();
  ASSERT_TRUE(shape);
  EXPECT_EQ(shape->rest_W_m.size(), 11U * 11U * 9U - 9U * 9U * 7U);
  {
    link::ServoEndpoint servo(address_);
    EXPECT_TRUE(held_until_top_is(servo, {0.001, 0.002, 0.02}, 0.0));
    EXPECT_TRUE(held_until_top_is(servo, {0.001, 0.002, -0.0001}, 0.0));
    EXPECT_TRUE(held_until_top_is(servo, {0.001, 0.002, 0.006}, 0.006)) << "the held patch follows";
  }
  link::ServoEndpoint next(address_);
  EXPECT_TRUE(held_until_top_is(next, {0.001, 0.002, 0.02}, 0.0)) << "another run begins at rest";
  stop_ = true;
  const SimulatorSummary summary = result_.get();
  ASSERT_TRUE(summary.surface);
  EXPECT_GE(summary.surface->frames, 3U);
  EXPECT_FALSE(summary.surface->view_lost);
  const nlohmann::json json = to_json(summary).at("surface");
  EXPECT_EQ(json.at("frames"), summary.surface->frames);
  EXPECT_GE(json.at("frame_ms").at("max").get<double>(),
            json.at("frame_ms").at("mean").get<double>());
}

}  // namespace
}  // namespace forcegrid::simulator
