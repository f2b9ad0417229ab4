// SPDX-License-Identifier: Apache-2.0
// Recordings of one run come on one clock; others are refused with what tells them apart.
#include "cli/playback/one_run.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <cmath>
#include <filesystem>
#include <fstream>
#include <functional>
#include <memory>
#include <sstream>
#include <stdexcept>
#include <string>
#include <vector>

#include "profiles/device_profile.h"
#include "tools/hdf5_file.h"
#include "tools/recorder.h"

namespace forcegrid::cli {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;

constexpr std::int64_t kPeriod_ns = 2'000'000;
constexpr double kRounding_s = 1e-6;  // the file's times are doubles of seconds

struct Written {
  std::string name;
  int tool = 1;
  std::string scene = "small";
  std::string started_utc = "2026-03-05T14:07:31Z";
  std::string offset_W_mm = "0,-15,0";
  std::int64_t first_ns = 0;  // of the clock that all of a test share
  int cycles = 500;
  bool surface = false;
};

class OneRun : public testing::Test {
 protected:
  void SetUp() override { std::filesystem::create_directories(folder_); }
  void TearDown() override { std::filesystem::remove_all(folder_); }

  std::string file(const std::string& name) const { return folder_ + "/" + name + ".h5"; }

  std::string write(const Written& what) {
    const profiles::DeviceProfile profile = profiles::load_device_profile("woodenhaptics_v2015");
    std::ostringstream text;
    text << std::ifstream(profile.file).rdbuf();
    tools::RecorderOptions options;
    options.file = file(what.name);
    options.method_names = {"hold"};
    options.surface = what.surface;
    options.attributes = {{"profile_name", profile.name},
                          {"profile", text.str()},
                          {"scene", what.scene},
                          {"started_utc", what.started_utc},
                          {"offset_W_mm", what.offset_W_mm},
                          {"view_hello", R"({"methods":["hold"],"device":"an arm"})"}};
    if (what.tool > 0) {
      options.attributes.emplace_back("tool_number", std::to_string(what.tool));
    }
    tools::Recorder recorder(options);
    for (int i = 0; i < what.cycles; ++i) {
      servo::CycleRecord cycle;
      cycle.cycle = static_cast<std::uint64_t>(i);
      cycle.time_ns = clock_ns_ + what.first_ns + i * kPeriod_ns;
      cycle.position_W_m = {1e-3 * i, 0.0, 0.0};
      recorder.push(cycle);
    }
    if (what.surface) {
      recorder.push(tools::RecordedShape{.arrived_ns = clock_ns_ + what.first_ns,
                                         .object = 0,
                                         .epoch = 1,
                                         .rest_W_m = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}},
                                         .corners = {{0, 1, 2}}});
    }
    EXPECT_EQ(recorder.finish().trouble, "");
    return options.file;
  }

  std::int64_t start_ns(const std::string& name) const {
    return std::stoll(tools::Hdf5Reader(file(name)).attribute("start_monotonic_ns"));
  }

  static std::string complaint_of(const std::vector<std::string>& files) {
    try {
      recordings_of_one_run(files);
    } catch (const std::runtime_error& error) {
      return error.what();
    }
    return "";
  }

  const std::string folder_ = ::testing::TempDir() + "one_run_" + std::to_string(::getpid());
  const std::int64_t clock_ns_ = rt::Clock::now().time_since_epoch().count();
};

TEST_F(OneRun, RecordingsAreOnOneClockInTheOrderOfTheirTools) {
  const std::string right = write({.name = "right",
                                   .tool = 2,
                                   .offset_W_mm = "0,15,0",
                                   .first_ns = 300'000'000,
                                   .cycles = 600});
  const std::string left = write({.name = "left", .surface = true});
  const RecordedRuns runs = recordings_of_one_run({right, left});
  ASSERT_EQ(runs.size(), 2U);
  EXPECT_EQ(runs[0]->file(), left);
  EXPECT_EQ(runs[1]->file(), right);
  const double duration_s = 0.3 + 1e-9 * 599 * kPeriod_ns;
  for (std::size_t k = 0; k < 2; ++k) {
    SCOPED_TRACE(k);
    EXPECT_EQ(runs[k]->place(), k);
    EXPECT_NEAR(runs[k]->duration_s(), duration_s, kRounding_s);
    const nlohmann::json& recording = runs[k]->hello().at("recording");
    EXPECT_EQ(recording.at("tools"), 2);
    EXPECT_EQ(recording.at("first_ns"), runs[0]->first_ns());
    EXPECT_EQ(recording.at("surface_frames"), 1) << "that of the left one, which both show";
  }
  EXPECT_NEAR(runs[0]->seconds_of(0), 0.0, kRounding_s);
  EXPECT_NEAR(runs[1]->seconds_of(0), 0.3, kRounding_s);
  // At one time of the clock each shows the cycle that it had then.
  EXPECT_EQ(runs[0]->cycle_at(0.5 - kRounding_s), 250U);
  EXPECT_EQ(runs[1]->cycle_at(0.5 - kRounding_s), 100U);
  EXPECT_EQ(runs[1]->cycle_at(0.0), 0U) << "it has not begun";
  EXPECT_EQ(runs[0]->cycle_at(1.2), 500U) << "it is over";
  EXPECT_NEAR(runs[0]->surface().entries().at(0).time_s, 0.0, kRounding_s);
}

TEST_F(OneRun, ARecordingAloneMayBeOfAnyRun) {
  EXPECT_EQ(recordings_of_one_run({write({.name = "alone", .tool = 0})}).size(), 1U);
  const RecordedRuns one = recordings_of_one_run({write({.name = "second", .tool = 2})});
  EXPECT_EQ(one.front()->place(), 0U);
  EXPECT_NEAR(one.front()->duration_s(), 0.998, kRounding_s);
}

TEST_F(OneRun, OthersAreRefusedWithWhatTellsThemApart) {
  const std::string left = write({.name = "left"});
  const auto with = [&](Written other) {
    other.name = "other";
    return complaint_of({left, write(other)});
  };
  const Written right{.name = "right", .tool = 2, .offset_W_mm = "0,15,0"};
  ASSERT_EQ(with(right), "");

  Written other = right;
  other.tool = 1;
  EXPECT_THAT(with(other),
              AllOf(HasSubstr("left.h5"), HasSubstr("other.h5"), HasSubstr("not of one run"),
                    HasSubstr("both are of tool 1"), HasSubstr("give the recordings of one run")));
  other = right;
  other.tool = 0;
  EXPECT_THAT(with(other), HasSubstr("other.h5 is of a run with one device; give it alone"));
  other = right;
  other.scene = "block";
  EXPECT_THAT(with(other), HasSubstr("the scenes are 'small' and 'block'"));
  other.scene = "";
  EXPECT_THAT(with(other), HasSubstr("the scenes are 'small' and another program's"));
  other = right;
  other.started_utc = "2026-03-05T15:07:31Z";
  const std::string apart = with(other);  // made some time after the other one: noted in both
  const double apart_s = 3600.0 - 1e-9 * static_cast<double>(start_ns("other") - start_ns("left"));
  EXPECT_THAT(apart, HasSubstr("their clocks began " + std::to_string(std::llround(apart_s)) +
                               " s apart, as on two machines"));
  other = right;
  other.first_ns = 3'000'000'000;
  EXPECT_THAT(with(other), AllOf(HasSubstr("by their clock"), HasSubstr("ended 2.0 s before")));
  other = right;
  other.offset_W_mm = "0,-15,0";
  EXPECT_THAT(with(other), HasSubstr("both devices stood at the same place of the scene"));
}

TEST_F(OneRun, NoMoreThanAViewShows) {
  EXPECT_THAT(complaint_of({"a.h5", "b.h5", "c.h5", "d.h5", "e.h5"}),
              HasSubstr("5 recordings: a view shows at most 4 devices"));
}

}  // namespace
}  // namespace forcegrid::cli
