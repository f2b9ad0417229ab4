// SPDX-License-Identifier: Apache-2.0
#include "tools/recorder.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <signal.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cmath>
#include <cstdio>
#include <filesystem>
#include <fstream>
#include <stdexcept>
#include <string>
#include <vector>

#include "tools/hdf5_file.h"

namespace forcegrid::tools {
namespace {

using servo::CycleRecord;
using ::testing::HasSubstr;

std::string fresh_file(const std::string& name) {
  const std::string file =
      ::testing::TempDir() + "recorder_" + std::to_string(getpid()) + "_" + name + ".h5";
  std::filesystem::remove(file);
  return file;
}

// Cycle `i` of a tool that moves along x at 0.1 m/s against a force of -2 N.
CycleRecord cycle(std::uint64_t i) {
  CycleRecord record;
  record.cycle = i;
  record.time_ns = rt::Clock::now().time_since_epoch().count();
  record.counts = {static_cast<std::int32_t>(i), -70'000, 3};
  record.has_orientation = true;
  record.orientation_WT_wxyz = {0.5, -0.5, 0.1 * static_cast<double>(i % 5), 0.7};
  record.angular_velocity_W_rad_per_s = {0.25, -0.5, 1.0};
  record.gimbal_angle_rad = {0.1, 0.2, 0.3};
  record.gimbal_counts = {-4, 5, static_cast<std::int32_t>(i)};
  record.buttons = 3;
  record.tool_torque_W_Nm = {0.0, -0.125, 0.5};
  record.position_W_m = {2e-4 * static_cast<double>(i), 0.01, -0.02};
  record.method_force_W_N[0] = {-2.5, 0.0, 0.0};
  record.method_force_W_N[1] = {-3.0, 0.5, 0.25};
  record.method_status[1] = EstimateStatus::kOutside;
  record.commanded_force_D_N = {-2.0, 0.0, 0.0};
  record.sample_age_ms = 33.5;
  record.requests_per_s = 120.0;
  record.budget_reads = i == 0 ? NAN : i == 1 ? 1234.1 : INFINITY;
  record.fault = servo::Fault::kNone;
  return record;
}

RecorderOptions options_for(const std::string& file) {
  RecorderOptions options;
  options.file = file;
  options.method_names = {"forcegrid", "hold"};
  options.attributes = {{"forcegrid_version", "1.2.3"}, {"settings", "[run]\nrate = 500\n"}};
  return options;
}

TEST(Recorder, KeepsEveryCycleAndSampleWithUnitsInTheNames) {
  const std::string file = fresh_file("every");
  constexpr std::uint64_t kCycles = 1234;
  {
    Recorder recorder(options_for(file));
    for (std::uint64_t i = 0; i < kCycles; ++i) {
      recorder.push(cycle(i));
    }
    servo::ArrivedSample sample;
    sample.in_contact = true;
    sample.arrived = rt::Clock::now();
    sample.sample.force_W = {1.0, 2.0, 3.0};
    sample.sample.stiffness_W << 1, 2, 3, 4, 5, 6, 7, 8, 9;
    sample.has_torque = true;
    sample.torque_W_Nm = {0.25, -0.5, 1.0};
    sample.orientation_WT_wxyz = {0.0, 0.6, 0.0, 0.8};
    recorder.push(sample);
    const RecorderEnd& end = recorder.finish();
    EXPECT_EQ(end.cycles, kCycles);
    EXPECT_EQ(end.samples, 1u);
    EXPECT_EQ(end.cycles_lost, 0u);
    EXPECT_EQ(end.trouble, "");
  }
  const Hdf5Reader reader(file);
  EXPECT_EQ(reader.attribute("settings"), "[run]\nrate = 500\n");
  EXPECT_EQ(reader.attribute("forcegrid_version"), "1.2.3");
  EXPECT_EQ(reader.attribute("method_names"), "forcegrid;hold");
  ASSERT_EQ(reader.rows("/cycles/position_W_m"), kCycles);
  const auto positions = reader.numbers("/cycles/position_W_m", kCycles);
  const auto counts = reader.numbers("/cycles/counts", kCycles);
  const auto asked = reader.numbers("/cycles/asked_force_W_N", kCycles);
  const auto status = reader.numbers("/cycles/method_status", kCycles);
  for (std::uint64_t i = 0; i < kCycles; ++i) {
    ASSERT_EQ(positions[3 * i], 2e-4 * static_cast<double>(i));
    ASSERT_EQ(counts[3 * i], static_cast<double>(i));
    ASSERT_EQ(counts[3 * i + 1], -70'000.0);
    ASSERT_EQ(asked[6 * i], -2.5);
    ASSERT_EQ(asked[6 * i + 5], 0.25);
    ASSERT_EQ(status[2 * i + 1], static_cast<double>(EstimateStatus::kOutside));
  }
  EXPECT_EQ(reader.column("/cycles/orientation_WT_wxyz").row_shape,
            (std::vector<std::uint64_t>{4}));
  const auto orientation = reader.numbers("/cycles/orientation_WT_wxyz", kCycles);
  EXPECT_EQ(orientation[4 * 13 + 1], -0.5);
  EXPECT_EQ(orientation[4 * 13 + 2], 0.1 * 3.0);
  EXPECT_EQ(reader.numbers("/cycles/angular_velocity_W_rad_per_s", 1)[1], -0.5);
  EXPECT_EQ(reader.numbers("/cycles/gimbal_angle_rad", 1)[2], 0.3);
  EXPECT_EQ(reader.numbers("/cycles/gimbal_counts", 8)[3 * 7 + 2], 7.0);
  EXPECT_EQ(reader.numbers("/cycles/buttons", 1)[0], 3.0);
  EXPECT_EQ(reader.numbers("/cycles/has_orientation", 1)[0], 1.0);
  EXPECT_EQ(reader.numbers("/cycles/requests_per_s", 1)[0], 120.0);
  const auto budget_reads = reader.numbers("/cycles/budget_reads", 3);
  EXPECT_TRUE(std::isnan(budget_reads[0]));
  EXPECT_EQ(budget_reads[1], 1234.1) << "a double: the replay sets the same";
  EXPECT_EQ(budget_reads[2], INFINITY);
  // -2 N along the whole way.
  const auto work_J = reader.numbers("/cycles/work_on_hand_J", kCycles);
  constexpr double kRounding_J = 1e-12;
  EXPECT_EQ(work_J.front(), 0.0);
  EXPECT_NEAR(work_J.back(), -2.0 * 2e-4 * (kCycles - 1), kRounding_J);
  EXPECT_EQ(reader.numbers("/samples/stiffness_W_N_per_m", 1)[5], 6.0);
  EXPECT_EQ(reader.numbers("/samples/force_W_N", 1)[2], 3.0);
  EXPECT_EQ(reader.numbers("/samples/torque_W_Nm", 1)[1], -0.5);
  EXPECT_EQ(reader.numbers("/samples/orientation_WT_wxyz", 1)[3], 0.8);
  EXPECT_EQ(reader.numbers("/cycles/tool_torque_W_Nm", 1)[1], -0.125);
}

TEST(Recorder, KeepsWhereTheOtherToolsAre) {
  const std::string file = fresh_file("others");
  {
    RecorderOptions options = options_for(file);
    options.other_tools = true;
    Recorder recorder(options);
    recorder.push(
        {recorder.start_ns() + 250'000'000,
         {.tool = 3, .in_contact = true, .age_ns = 1'500'000, .position_W_m = {1, 2, 3}}});
    EXPECT_EQ(recorder.finish().trouble, "");
  }
  const Hdf5Reader reader(file);
  ASSERT_EQ(reader.rows("/others/tool"), 1U);
  EXPECT_NEAR(reader.numbers("/others/time_s", 1)[0], 0.25, 1e-12);
  EXPECT_EQ(reader.numbers("/others/tool", 1)[0], 3.0);
  EXPECT_EQ(reader.numbers("/others/in_contact", 1)[0], 1.0);
  EXPECT_EQ(reader.numbers("/others/age_ms", 1)[0], 1.5);
  EXPECT_EQ(reader.numbers("/others/position_W_m", 1), (std::vector<double>{1, 2, 3}));
}

TEST(Recorder, OfAnOnlyToolHasNoOthers) {
  const std::string file = fresh_file("no_others");
  {
    Recorder recorder(options_for(file));
    recorder.push(RecordedTool{});
    EXPECT_EQ(recorder.finish().trouble, "");
  }
  EXPECT_FALSE(Hdf5Reader(file).has("/others/tool"));
}

// Records in a process of its own until it is killed.
pid_t start_endless(const std::string& file) {
  const pid_t child = fork();
  if (child == 0) {
    prctl(PR_SET_PDEATHSIG, SIGKILL);
    Recorder recorder(options_for(file));
    for (std::uint64_t i = 0;; ++i) {
      recorder.push(cycle(i));
      usleep(500);
    }
  }
  return child;
}

std::uint64_t rows_so_far(const std::string& file) {
  try {
    return Hdf5Reader(file).rows("/cycles/cycle");
  } catch (const Hdf5Error&) {
    return 0;  // not begun yet
  }
}

TEST(Recorder, LeavesAReadableFileWhenKilled) {
  const std::string file = fresh_file("killed");
  const pid_t child = start_endless(file);
  ASSERT_GT(child, 0);
  std::uint64_t seen = 0;
  for (int i = 0; i < 1500 && seen == 0; ++i) {
    usleep(10'000);
    seen = rows_so_far(file);  // while it is being written
  }
  kill(child, SIGKILL);
  int status = 0;
  waitpid(child, &status, 0);
  ASSERT_TRUE(WIFSIGNALED(status));
  ASSERT_GT(seen, 0u);
  const Hdf5Reader reader(file);
  const std::uint64_t rows = reader.rows("/cycles/cycle");
  EXPECT_GE(rows, seen);
  const auto numbers = reader.numbers("/cycles/cycle", rows);
  for (std::uint64_t i = 0; i < rows; ++i) {
    ASSERT_EQ(numbers[i], static_cast<double>(i));
  }
  EXPECT_EQ(reader.attribute("forcegrid_version"), "1.2.3");

  // And by Python, as docs/recording.md says.
  const std::string script =
      "/usr/bin/python3 -c \"import h5py; f = h5py.File('" + file +
      "', 'r', swmr=True); c = f['cycles/cycle'][:]; "
      "assert (c[:" +
      std::to_string(rows) + "] == range(" + std::to_string(rows) +
      ")).all(); assert f['cycles/position_W_m'].shape[1] == 3; print(f.attrs['method_names'])\"";
  std::FILE* const python = popen(script.c_str(), "r");
  ASSERT_NE(python, nullptr);
  char line[200] = {};
  EXPECT_NE(std::fgets(line, sizeof line, python), nullptr);
  EXPECT_EQ(pclose(python), 0);
  EXPECT_THAT(std::string(line), HasSubstr("forcegrid;hold"));
}

TEST(Recorder, EndsInTimeWhereTheDiskFillsUp) {
  const std::string file = fresh_file("space");
  RecorderOptions options = options_for(file);
  int asked = 0;
  options.free_bytes = [&asked](const std::string&) -> std::uintmax_t {
    return ++asked == 1 ? 100 << 20 : 10 << 20;
  };
  std::string message;
  options.trouble = [&message](const std::string& sentence) { message = sentence; };
  Recorder recorder(options);
  for (std::uint64_t i = 0; i < 100; ++i) {
    recorder.push(cycle(i));
  }
  for (int i = 0; i < 1000 && rows_so_far(file) == 0; ++i) {
    usleep(10'000);
  }
  recorder.push(cycle(100));
  const RecorderEnd& end = recorder.finish();
  EXPECT_EQ(end.cycles, 100u);
  EXPECT_EQ(end.cycles_lost, 1u);
  EXPECT_THAT(end.trouble, HasSubstr("64 MB"));
  EXPECT_THAT(end.trouble, HasSubstr(file));
  EXPECT_EQ(message, end.trouble);
  EXPECT_EQ(Hdf5Reader(file).rows("/cycles/cycle"), 100u);
}

TEST(Recorder, EndsAloneWhenSomethingElseThrows) {
  RecorderOptions options = options_for(fresh_file("throws"));
  options.free_bytes = [](const std::string&) -> std::uintmax_t {
    throw std::runtime_error("the folder is gone");
  };
  Recorder recorder(options);
  recorder.push(cycle(0));
  const RecorderEnd& end = recorder.finish();
  EXPECT_EQ(end.cycles_lost, 1u);
  EXPECT_THAT(end.trouble, HasSubstr("the folder is gone"));
}

TEST(Recorder, KeepsWhatIsThereWhenWritingFails) {
  const std::string file = fresh_file("limit");
  constexpr rlim_t kLargestFile_bytes = 400'000;
  const pid_t child = fork();
  if (child == 0) {
    const rlimit limit{kLargestFile_bytes, kLargestFile_bytes};
    setrlimit(RLIMIT_FSIZE, &limit);
    signal(SIGXFSZ, SIG_IGN);
    Recorder recorder(options_for(file));
    for (std::uint64_t i = 0; recorder.trouble_so_far().empty() && i < 100'000; ++i) {
      recorder.push(cycle(i * 7919));  // hardly compressible
      usleep(100);
    }
    const RecorderEnd& end = recorder.finish();
    const bool said = end.trouble.find(file) != std::string::npos && end.cycles > 0;
    exit(said ? 0 : 1);  // with the library's own end
  }
  int status = 0;
  waitpid(child, &status, 0);
  ASSERT_TRUE(WIFEXITED(status)) << status;
  EXPECT_EQ(WEXITSTATUS(status), 0);
  const Hdf5Reader reader(file);
  const std::uint64_t rows = reader.rows("/cycles/fault");
  EXPECT_GT(rows, 0u);
  EXPECT_EQ(reader.numbers("/cycles/cycle", rows)[rows - 1],
            7919.0 * static_cast<double>(rows - 1));
}

TEST(Recorder, RefusesAFileThatCantBeMade) {
  try {
    Recorder recorder(options_for("/no-such-folder/x.h5"));
    FAIL();
  } catch (const Hdf5Error& error) {
    EXPECT_THAT(error.what(), HasSubstr("/no-such-folder/x.h5"));
    EXPECT_THAT(error.what(), HasSubstr("folder that exists"));
  }
}

TEST(Hdf5Reader, NamesTheFileThatIsNone) {
  const std::string file = fresh_file("none");
  EXPECT_THROW(Hdf5Reader{file}, Hdf5Error);
  std::ofstream(file) << "no HDF5";
  try {
    Hdf5Reader reader(file);
    FAIL();
  } catch (const Hdf5Error& error) {
    EXPECT_THAT(error.what(), HasSubstr(file));
  }
}

// A surface of `vertices` vertices, of which the first has the value `first`.
RecordedFrame picture(std::int64_t arrived_ns, std::uint16_t first, std::size_t vertices) {
  RecordedFrame frame;
  frame.arrived_ns = arrived_ns;
  frame.simulator_s = 7.5;
  frame.epoch = 3;
  frame.low_W_m = {-0.1F, -0.2F, -0.3F};
  frame.step_m = {1e-6F, 2e-6F, 3e-6F};
  frame.value.assign(vertices, {0, 1, 65'535});
  frame.value.front()[0] = first;
  return frame;
}

TEST(Recorder, KeepsTheSurfaceOnlyIfItIsAskedTo) {
  const std::string file = fresh_file("surface");
  RecorderOptions options = options_for(file);
  options.surface = true;
  {
    Recorder recorder(options);
    const std::int64_t start_ns = recorder.start_ns();
    RecordedShape shape{start_ns + 10'000'000, 1, 3, {}, {{0, 1, 2}}};
    shape.rest_W_m = {{0.0F, 0.0F, 0.0F}, {0.5F, 0.0F, 0.0F}, {0.0F, 0.25F, 0.0F}};
    recorder.push(shape);
    recorder.push(picture(start_ns + 20'000'000, 11, 3));
    recorder.push(picture(start_ns + 50'000'000, 12, 3));
    EXPECT_EQ(recorder.finish().surface_frames, 2U);
    EXPECT_EQ(recorder.finish().trouble, "");
  }
  const Hdf5Reader reader(file);
  EXPECT_EQ(reader.numbers("/surface/shape_vertices", 1), std::vector<double>{3.0});
  EXPECT_EQ(reader.numbers("/surface/corners", 1), (std::vector<double>{0.0, 1.0, 2.0}));
  EXPECT_EQ(reader.numbers("/surface/rest_W_m", 1, 1), (std::vector<double>{0.5, 0.0, 0.0}));
  EXPECT_NEAR(reader.numbers("/surface/frame_time_s", 1, 1)[0], 0.05, 1e-9);
  EXPECT_EQ(reader.numbers("/surface/frame_simulator_s", 1)[0], 7.5);
  EXPECT_EQ(reader.column("/surface/vertex_value").type, Hdf5Type::kUint16);
  ASSERT_EQ(reader.rows("/surface/vertex_value"), 6U);
  EXPECT_EQ(reader.numbers("/surface/vertex_value", 1, 3),
            (std::vector<double>{12.0, 1.0, 65535.0}));

  const std::string without = fresh_file("no_surface");
  {
    Recorder recorder(options_for(without));
    recorder.push(picture(recorder.start_ns(), 1, 3));
    EXPECT_EQ(recorder.finish().surface_frames, 0U);
  }
  EXPECT_FALSE(Hdf5Reader(without).has("/surface/vertex_value"));
}

TEST(Recorder, LeavesOutPicturesThatASecondHasNoRoomFor) {
  SurfaceBound bound;
  // 8 MB/s of pictures of 400 kB: every second one.
  int kept = 0;
  for (int i = 0; i < 200; ++i) {
    kept += bound.take(0.05 * i, 400'000) ? 1 : 0;
  }
  EXPECT_NEAR(kept, 100 + 10, 2) << "and what the first second may have at once";
  // One that is larger than a second's share is kept, and those after it wait for its debt.
  SurfaceBound large;
  EXPECT_TRUE(large.take(0.0, 6'000'000));
  EXPECT_FALSE(large.take(0.4, 6'000'000));
  EXPECT_TRUE(large.take(0.6, 6'000'000));
  // 4 GB in all.
  SurfaceBound all;
  std::size_t bytes = 0;
  for (int i = 0; i < 2000; ++i) {
    bytes += all.take(1.0 * i, 4'000'000) ? 4'000'000 : 0;
  }
  EXPECT_EQ(bytes, 4'000'000'000U);
}

}  // namespace
}  // namespace forcegrid::tools
