// SPDX-License-Identifier: Apache-2.0
#include "tools/recording.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <cmath>
#include <filesystem>
#include <string>
#include <utility>
#include <vector>

#include "tools/path_comparison.h"
#include "tools/recorder.h"

namespace forcegrid::tools {
namespace {

using ::testing::HasSubstr;

constexpr double kStiffness_N_per_m = -80.0;  // of the object that was felt

std::string fresh_file() {
  const std::string file = ::testing::TempDir() + "recording_" + std::to_string(getpid()) + ".h5";
  std::filesystem::remove(file);
  return file;
}

// Half a second along x with a sample every 30 ms from 0.1 s on, released for one at 0.3 s.
// @param more  attributes
void write_recording(const std::string& file, const std::string& scene,
                     const std::vector<std::pair<std::string, std::string>>& more = {}) {
  RecorderOptions options;
  options.file = file;
  options.method_names = {"hold"};
  options.attributes = {{"scene", scene}, {"rate_Hz", "500"}, {"profile_name", "vintage"}};
  options.attributes.insert(options.attributes.end(), more.begin(), more.end());
  Recorder recorder(options);
  for (int i = 0; i < 250; ++i) {
    servo::CycleRecord cycle;
    cycle.cycle = static_cast<std::uint64_t>(i);
    cycle.time_ns = recorder.start_ns() + 2'000'000L * i;
    cycle.position_W_m = {1e-4 * i, 0.0, 0.0};
    recorder.push(cycle);
  }
  for (int i = 0; i < 12; ++i) {
    servo::ArrivedSample row;
    const std::int64_t at_ns = recorder.start_ns() + 100'000'000L + 30'000'000L * i;
    row.sample.time_s = 1e-9 * static_cast<double>(at_ns);
    row.arrived = rt::TimePoint(std::chrono::nanoseconds(at_ns + 5'000'000));
    row.in_contact = i != 7;
    row.sample.contact_epoch = i < 7 ? 1 : 2;
    row.sample.contact_point_W = {0.005, 0.0, 0.0};
    row.sample.force_W = {1.0 * i, 0.0, 0.0};
    recorder.push(row);
  }
  ASSERT_EQ(recorder.finish().trouble, "");
}

TEST(Recording, BecomesATraceWithContactsAndSolvedForces) {
  const std::string file = fresh_file();
  write_recording(file, "small");
  std::string asked_scene;
  Eigen::Vector3d asked_point = Eigen::Vector3d::Zero();
  const evaluation::Trace trace =
      trace_of_recording(file, [&](const std::string& scene, const Eigen::Vector3d& point,
                                   const std::vector<Eigen::Vector3d>& positions) {
        asked_scene = scene;
        asked_point = point;
        std::vector<Eigen::Vector3d> forces;
        for (const Eigen::Vector3d& position : positions) {
          forces.push_back(kStiffness_N_per_m * position);
        }
        return forces;
      });
  EXPECT_EQ(asked_scene, "small");
  EXPECT_EQ(asked_point.x(), 0.005);
  constexpr double kClock_s = 1e-6;      // seconds since boot as a double
  ASSERT_EQ(trace.samples.size(), 11u);  // the one without contact only ends it
  EXPECT_NEAR(trace.samples[0].sample.time_s, 0.0, kClock_s);
  EXPECT_NEAR(trace.samples[0].delivered_s, 0.005, kClock_s);
  EXPECT_EQ(trace.samples[1].sample.force_W.x(), 1.0);
  ASSERT_EQ(trace.events.size(), 3u);
  EXPECT_TRUE(trace.events[0].made);
  EXPECT_FALSE(trace.events[1].made);
  EXPECT_NEAR(trace.events[1].time_s, 0.21, kClock_s);
  EXPECT_TRUE(trace.events[2].made);
  // From the contact at 0.1 s on: cycles 50 to 249.
  ASSERT_NEAR(static_cast<double>(trace.servo.size()), 200.0, 1.0);
  EXPECT_NEAR(trace.servo.back().time_s, 0.398, kClock_s);
  EXPECT_DOUBLE_EQ(trace.servo.back().force_W.x(), kStiffness_N_per_m * 0.0249);
}

TEST(Recording, WithoutSceneOrContactCantBeJudged) {
  const std::string file = fresh_file();
  write_recording(file, "");
  try {
    static_cast<void>(trace_of_recording(file, {}));
    FAIL();
  } catch (const evaluation::TraceError& error) {
    EXPECT_THAT(error.what(), HasSubstr("no reference forces"));
  }
  {
    RecorderOptions options;
    options.file = file;
    options.method_names = {"hold"};
    Recorder recorder(options);
    recorder.push(servo::CycleRecord{});
  }
  try {
    static_cast<void>(trace_of_recording(file, {}));
    FAIL();
  } catch (const evaluation::TraceError& error) {
    EXPECT_THAT(error.what(), HasSubstr("never touched"));
  }
}

TEST(Recording, OfOneOfSeveralToolsNamesItAndItsPlace) {
  const std::string file = fresh_file();
  write_recording(file, "small", {{"tool_number", "2"}, {"offset_W_mm", "0,-15,2.5"}});
  const RecordingHeader header = read_header(Hdf5Reader(file));
  EXPECT_EQ(header.tool_number, 2);
  EXPECT_EQ(header.offset_W_m, Eigen::Vector3d(0.0, -0.015, 0.0025));
  // Forces of this path alone would be another object's.
  try {
    static_cast<void>(trace_of_recording(
        file, [](const auto&, const auto&, const auto& positions) { return positions; }));
    FAIL();
  } catch (const evaluation::TraceError& error) {
    EXPECT_THAT(error.what(), HasSubstr("is of tool 2 of several and has no reference forces"));
  }
}

TEST(Recording, OfAnOnlyToolStandsWhereWDoes) {
  const std::string file = fresh_file();
  write_recording(file, "small");
  const RecordingHeader header = read_header(Hdf5Reader(file));
  EXPECT_EQ(header.tool_number, 0);
  EXPECT_EQ(header.offset_W_m, Eigen::Vector3d(0.0, 0.0, 0.0));
}

TEST(PathComparison, FindsTheLagAndWhatIsLeft) {
  TimedPath leader;
  TimedPath follower;
  const auto path = [](double t_s) {
    return Eigen::Vector3d(0.01 * std::sin(3.0 * t_s), 0.005 * std::cos(5.0 * t_s), 0.0);
  };
  constexpr double kLag_s = 0.737;
  constexpr double kAside_m = 0.0004;
  for (int i = 0; i < 1000; ++i) {
    leader.time_s.push_back(12.0 + 0.002 * i);
    leader.position_m.push_back(path(0.002 * i));
  }
  for (int i = 0; i < 1800; ++i) {
    follower.time_s.push_back(3.0 + 0.002 * i);
    follower.position_m.push_back(path(0.002 * i - kLag_s) + Eigen::Vector3d(0, 0, kAside_m));
  }
  const PathComparison found = compare_paths(leader, follower);
  EXPECT_NEAR(found.lag_s, kLag_s, 0.001);
  EXPECT_NEAR(found.rms_m, kAside_m, 2e-5);  // half a millisecond at 32 mm/s
  EXPECT_THROW(compare_paths(follower, leader), std::invalid_argument);
}

}  // namespace
}  // namespace forcegrid::tools
