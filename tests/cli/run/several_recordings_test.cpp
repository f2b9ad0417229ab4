// SPDX-License-Identifier: Apache-2.0
// Recordings, traces and reference forces of several devices on one object.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <Eigen/Core>
#include <cmath>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "evaluation/traces/trace.h"
#include "simulator/reference/reference_solution.h"
#include "tests/cli/run/two_arms.h"
#include "tests/support/program.h"
#include "tools/recording.h"

namespace forcegrid {
namespace {

using nlohmann::json;
using testing::fresh_folder;
using ::testing::HasSubstr;
using testing::Program;

constexpr auto kTimeout = std::chrono::seconds(120);

Program run_of_two(const std::string& folder, const std::string& record,
                   const std::vector<std::string>& more) {
  std::vector<std::string> arguments =
      testing::run_of_two(folder, {"--seconds", "4.5", "--record", record});
  arguments.insert(arguments.end(), more.begin(), more.end());
  return Program::forcegrid(arguments);
}

// [m] Where a recorded tool was, between two of its cycles, on the clock of the whole machine.
Eigen::Vector3d position_at(const tools::Hdf5Reader& reader, double clock_s) {
  const std::uint64_t rows = tools::read_header(reader).cycles;
  const std::vector<double> time_s = reader.numbers("/cycles/time_s", rows);
  const auto position_W = tools::read_vectors(reader, "/cycles/position_W_m", rows);
  const double at_s = clock_s - 1e-9 * std::stod(reader.attribute("start_monotonic_ns"));
  const auto after = std::lower_bound(time_s.begin(), time_s.end(), at_s);
  return position_W.at(static_cast<std::size_t>(after - time_s.begin()));
}

void others_are_where_their_own_recordings_say(const std::string& of, const std::string& other) {
  const tools::Hdf5Reader mine(of);
  const tools::Hdf5Reader theirs(other);
  const std::uint64_t rows = mine.rows("/others/tool");
  ASSERT_GT(rows, 20U);
  const double start_s = 1e-9 * std::stod(mine.attribute("start_monotonic_ns"));
  const std::vector<double> arrived_s = mine.numbers("/others/time_s", rows);
  const std::vector<double> age_ms = mine.numbers("/others/age_ms", rows);
  const auto at_W = tools::read_vectors(mine, "/others/position_W_m", rows);
  double squared_m2 = 0.0;
  for (std::size_t i = 10; i + 2 < rows; ++i) {
    const double clock_s = start_s + arrived_s[i] - 1e-3 * age_ms[i];
    squared_m2 += (position_at(theirs, clock_s) - at_W[i]).squaredNorm();
  }
  // Two ways of a few ms at some 0.1 m/s.
  EXPECT_LT(std::sqrt(squared_m2 / static_cast<double>(rows - 12)), 2e-3);
}

TEST(SeveralRecordings, EachDeviceHasAFileOfItsOwnWithReferenceForcesUnderBothTools) {
  const std::string folder = fresh_folder("two_recordings");
  Program run = run_of_two(folder, folder + "/run.h5", {"--record-surface"});
  ASSERT_EQ(run.wait(kTimeout), 0) << run.standard_error();
  const json devices = json::parse(testing::text_of(folder + "/run.json")).at("devices");
  const std::vector<std::string> files = {folder + "/run_device_1.h5", folder + "/run_device_2.h5"};
  for (std::size_t k = 0; k < 2; ++k) {
    SCOPED_TRACE(k + 1);
    const json& device = devices.at(k);
    EXPECT_EQ(device.at("reference"), "computed") << device.at("notes").dump();
    EXPECT_EQ(device.at("reference_details").at("unconverged"), 0);
    EXPECT_THAT(device.at("files").dump(), HasSubstr(files[k]));
    // The newest sample is exact where it was computed, so streaming lags by what the tool has
    // moved since; a reference force of another object would be wrong everywhere.
    const json& errors = device.at("errors");
    EXPECT_LT(errors.at("auto").at("rms_error_percent_after_1s").get<double>(), 10.0);
    EXPECT_GT(errors.at("hold").at("rms_error_percent_after_1s").get<double>(), 1.0);

    const tools::Hdf5Reader reader(files[k]);
    const tools::RecordingHeader header = tools::read_header(reader);
    EXPECT_TRUE(header.complete);
    EXPECT_TRUE(header.has_reference);
    EXPECT_EQ(header.tool_number, static_cast<int>(k) + 1);
    EXPECT_EQ(header.offset_W_m, Eigen::Vector3d(0.0, k == 0 ? -0.015 : 0.015, 0.0));
    EXPECT_THAT(run.standard_output(), HasSubstr("Wrote " + files[k]));
    // The surface of the one object is in the first device's file.
    ASSERT_EQ(reader.has("/surface/frame_time_s"), k == 0);
    if (k == 0) {
      EXPECT_GT(reader.rows("/surface/frame_time_s"), 30U);
    }
  }
  others_are_where_their_own_recordings_say(files[0], files[1]);
  others_are_where_their_own_recordings_say(files[1], files[0]);
}

// The samples are the simulator's own solutions, in single precision to its tolerance. Where the
// tool was when each was computed, the reference under both tools must agree; it is solved in
// another program, in another order, from recorded positions alone.
TEST(SeveralRecordings, ReferenceForcesAgreeWithTheSimulatorsSamples) {
  const std::string folder = fresh_folder("two_traces");
  Program run = run_of_two(folder, folder + "/run.csv.gz", {"--seed", "7"});
  ASSERT_EQ(run.wait(kTimeout), 0) << run.standard_error();
  for (const char* const name : {"/run_device_1.csv.gz", "/run_device_2.csv.gz"}) {
    SCOPED_TRACE(name);
    const evaluation::Trace trace = evaluation::read_trace(folder + name);
    std::vector<Eigen::Vector3d> path_W;
    for (const auto& servo : trace.servo) {
      path_W.push_back(servo.position_W);
    }
    simulator::ReferenceOptions one_tool;
    one_tool.scene = "small";
    one_tool.contact_point_W = trace.events.front().point_W;
    const auto alone = simulator::simulate_reference(path_W, one_tool);
    double force_N2 = 0.0;
    double difference_N2 = 0.0;
    double difference_alone_N2 = 0.0;
    std::size_t compared = 0;
    for (const evaluation::DeliveredSample& row : trace.samples) {
      const auto after =
          std::lower_bound(trace.servo.begin(), trace.servo.end(), row.sample.time_s - 1e-6,
                           [](const auto& servo, double time_s) { return servo.time_s < time_s; });
      if (after == trace.servo.end() || std::abs(after->time_s - row.sample.time_s) > 1e-5) {
        continue;
      }
      force_N2 += after->force_W.squaredNorm();
      difference_N2 += (after->force_W - row.sample.force_W).squaredNorm();
      difference_alone_N2 +=
          (alone.forces_W[static_cast<std::size_t>(after - trace.servo.begin())] -
           row.sample.force_W)
              .squaredNorm();
      ++compared;
    }
    ASSERT_GT(compared, 30U);
    // In a solution the other tool's state may be some ms older than this one's.
    EXPECT_LT(std::sqrt(difference_N2 / force_N2), 0.02);
    EXPECT_GT(difference_alone_N2, 10.0 * difference_N2) << "the other tool counts";
    std::printf(
        "%s: samples differ from the reference by %.3f %% of its RMS, from that of this "
        "tool alone by %.2f %%\n",
        name, 100.0 * std::sqrt(difference_N2 / force_N2),
        100.0 * std::sqrt(difference_alone_N2 / force_N2));
  }
}

}  // namespace
}  // namespace forcegrid
