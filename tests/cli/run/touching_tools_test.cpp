// SPDX-License-Identifier: Apache-2.0
// The tools of two devices that stand so near that they push each other away.
#include <gtest/gtest.h>

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "tests/support/program.h"
#include "tools/recording.h"

namespace forcegrid {
namespace {

using nlohmann::json;
using testing::fresh_folder;
using testing::Program;

constexpr auto kTimeout = std::chrono::seconds(120);
constexpr char kArm[] = "emulated:woodenhaptics_v2015";
constexpr double kApart_mm = 12.0;  // spheres of 8 mm overlap by 4 mm
constexpr double kRadius_m = 0.008;

json run_of_two(const std::string& folder, const std::string& stiffness_N_per_m,
                const std::string& seconds) {
  const std::string half_mm = std::to_string(0.5 * kApart_mm);
  Program run = Program::forcegrid({"run",
                                    "--device",
                                    kArm,
                                    "--device",
                                    kArm,
                                    "--device-offset-mm",
                                    "0,-" + half_mm + ",0",
                                    "--device-offset-mm",
                                    "0," + half_mm + ",0",
                                    "--tool",
                                    "sphere",
                                    "--tool-radius-mm",
                                    "8",
                                    "--scene",
                                    "small",
                                    "--motion",
                                    "still",
                                    "--out",
                                    folder,
                                    "--json",
                                    folder + "/run.json",
                                    "--record",
                                    folder + "/run.h5",
                                    "--device-timeout-ms",
                                    "400",
                                    "--seconds",
                                    seconds,
                                    "--no-reference",
                                    "--tool-stiffness-N-per-m",
                                    stiffness_N_per_m});
  EXPECT_EQ(run.wait(kTimeout), 0) << run.standard_error();
  return json::parse(testing::text_of(folder + "/run.json")).at("devices");
}

struct Recorded {
  explicit Recorded(const std::string& file) {
    const tools::Hdf5Reader reader(file);
    const std::uint64_t rows = tools::read_header(reader).cycles;
    const double start_s = 1e-9 * std::stod(reader.attribute("start_monotonic_ns"));
    for (const double cycle_s : reader.numbers("/cycles/time_s", rows)) {
      time_s.push_back(start_s + cycle_s);
    }
    position_W = tools::read_vectors(reader, "/cycles/position_W_m", rows);
    tool_force_W = tools::read_vectors(reader, "/cycles/tool_force_W_N", rows);
  }
  [[nodiscard]] std::size_t at(double clock_s) const {
    const auto after = std::ranges::lower_bound(time_s, clock_s);
    return static_cast<std::size_t>(
        std::min(after - time_s.begin(), static_cast<std::ptrdiff_t>(time_s.size()) - 1));
  }
  std::vector<double> time_s;
  std::vector<Eigen::Vector3d> position_W, tool_force_W;
};

TEST(TouchingTools, PushEachOtherAwayWithTheSpringBetweenTwoSpheres) {
  const std::string folder = fresh_folder("touching");
  constexpr double kStiffness_N_per_m = 150.0;
  const json devices = run_of_two(folder, "150", "5");
  for (const json& device : devices) {
    const json& touch = device.at("several_tools").at("tool_touch");
    EXPECT_EQ(touch.at("stiffness_N_per_m"), kStiffness_N_per_m);
    EXPECT_GT(touch.at("cycles"), 1000);
    EXPECT_EQ(device.at("ended_by"), "time");
  }
  const Recorded left(folder + "/run_device_1.h5");
  const Recorded right(folder + "/run_device_2.h5");
  const double end_s = std::min(left.time_s.back(), right.time_s.back()) - 0.05;
  double force_N2 = 0.0;
  double sum_N2 = 0.0;     // of both forces
  double spring_N2 = 0.0;  // of the left one less the spring's of both positions
  for (std::size_t i = left.at(end_s - 2.0); i < left.at(end_s); ++i) {
    const std::size_t k = right.at(left.time_s[i]);
    const Eigen::Vector3d apart_W = left.position_W[i] - right.position_W[k];
    const double overlap_m = std::max(0.0, 2.0 * kRadius_m - apart_W.norm());
    force_N2 += left.tool_force_W[i].squaredNorm();
    sum_N2 += (left.tool_force_W[i] + right.tool_force_W[k]).squaredNorm();
    spring_N2 += (left.tool_force_W[i] - kStiffness_N_per_m * overlap_m * apart_W.normalized())
                     .squaredNorm();
    EXPECT_LE(left.tool_force_W[i].y(), 0.0);
  }
  EXPECT_GT(force_N2, 0.0);
  EXPECT_LT(std::sqrt(sum_N2 / force_N2), 0.05) << "action and reaction";
  EXPECT_LT(std::sqrt(spring_N2 / force_N2), 0.05);
  std::printf("RMS: sum of both %.2f %%, off the spring %.2f %% of the force\n",
              100.0 * std::sqrt(sum_N2 / force_N2), 100.0 * std::sqrt(spring_N2 / force_N2));
}

TEST(TouchingTools, PassThroughEachOtherIfAsked) {
  const json devices = run_of_two(fresh_folder("passing"), "0", "2");
  for (const json& device : devices) {
    const json& touch = device.at("several_tools").at("tool_touch");
    EXPECT_EQ(touch, (json{{"stiffness_N_per_m", 0.0}, {"cycles", 0}, {"largest_force_N", 0.0}}));
  }
}

}  // namespace
}  // namespace forcegrid
