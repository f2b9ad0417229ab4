// SPDX-License-Identifier: Apache-2.0
// `forcegrid record`, `replay`, `plot` and `evaluate` on one recording.

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <signal.h>

#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <string>

#include "tests/support/program.h"

namespace forcegrid {
namespace {

using nlohmann::json;
using testing::fresh_folder;
using ::testing::HasSubstr;
using testing::Program;
using testing::text_of;

constexpr auto kTimeout = std::chrono::seconds(60);

TEST(RecordCommand, KeepsARunThatCanBeJudgedDrawnAndReplayed) {
  const std::string out = fresh_folder("record_h5");
  const std::string file = out + "/run.h5";
  Program record = Program::forcegrid({"record", file, "--scene", "small", "--seconds", "4",
                                       "--fill-budget", "100000", "--out", out, "--json"});
  ASSERT_EQ(record.wait(kTimeout), 0) << record.standard_error();
  const json summary = json::parse(record.standard_output());
  EXPECT_THAT(summary.at("files").dump(), HasSubstr("run.h5"));

  // As docs/recording.md says; the settings are those of the run.
  Program python({"/usr/bin/python3", "-c",
                  "import h5py, sys; f = h5py.File(sys.argv[1], 'r', swmr=True); "
                  "s = f.attrs['settings'].decode(); assert 'scene=\"small\"' in s, s; "
                  "assert 'rate=500' in s, s; assert f.attrs['ended'] == b'by its writer'; "
                  "c = f['cycles/cycle'][:]; assert (c[1:] - c[:-1] == 1).all(); print(len(c))",
                  file});
  ASSERT_EQ(python.wait(kTimeout), 0) << python.standard_error();
  EXPECT_EQ(std::stoull(python.standard_output()), summary.at("cycles").get<std::uint64_t>());

  // Judged on the recording, a method has the error that it had in the run.
  Program evaluate = Program::forcegrid({"evaluate", "--method", "hold", "--trace", file});
  ASSERT_EQ(evaluate.wait(kTimeout), 0) << evaluate.standard_error();
  const double of_run = summary.at("errors").at("hold").at("rms_error_percent_after_1s");
  const double of_file =
      json::parse(evaluate.standard_output()).at("rms_error_percent_after_1s").get<double>();
  EXPECT_NEAR(of_file, of_run, 0.05 * of_run + 0.05);

  Program plot = Program::forcegrid({"plot", file, "--out", out + "/plot", "--json"});
  ASSERT_EQ(plot.wait(kTimeout), 0) << plot.standard_error();
  const json drawn = json::parse(plot.standard_output());
  EXPECT_EQ(drawn.at("cycles"), summary.at("cycles"));
  EXPECT_EQ(drawn.at("cycles_lost"), 0);
  EXPECT_TRUE(drawn.at("complete").get<bool>());
  const std::string picture = text_of(out + "/plot/recording.svg");
  EXPECT_THAT(picture, HasSubstr("work on the hand"));

  Program replay =
      Program::forcegrid({"replay", file, "--method", "hold", "--out", out + "/replay", "--json"});
  ASSERT_EQ(replay.wait(kTimeout), 0) << replay.standard_error();
  const json replayed = json::parse(replay.standard_output());
  EXPECT_EQ(replayed.at("method"), "hold");
  // The chirp reaches 20 mm; another method's force lets the hand give way differently.
  EXPECT_LT(replayed.at("followed_rms_mm").get<double>(), 2.0);
  EXPECT_TRUE(std::filesystem::exists(out + "/replay/replay.h5"));
}

TEST(RecordCommand, LeavesAReadableFileWhenTheRunIsKilled) {
  const std::string out = fresh_folder("record_killed");
  const std::string file = out + "/run.h5";
  Program record =
      Program::forcegrid({"record", file, "--scene", "small", "--seconds", "60", "--out", out});
  ASSERT_TRUE(record.wait_for_text("    3 s  tool")) << record.standard_error();
  record.send_signal(SIGKILL);
  EXPECT_EQ(record.wait(kTimeout), 128 + SIGKILL);
  Program plot = Program::forcegrid({"plot", file, "--out", out, "--json"});
  ASSERT_EQ(plot.wait(kTimeout), 0) << plot.standard_error();
  const json drawn = json::parse(plot.standard_output());
  EXPECT_FALSE(drawn.at("complete").get<bool>());
  EXPECT_GT(drawn.at("duration_s").get<double>(), 0.5);
  EXPECT_EQ(drawn.at("cycles_lost"), 0);
}

// No such device: what is there stays, and what is not there does not come to be.
TEST(RecordCommand, LeavesNothingBehindWhenItDoesNotBegin) {
  const std::string out = fresh_folder("record_not_begun");
  std::ofstream(out + "/earlier.h5") << "an earlier recording";
  for (const char* name : {"/earlier.h5", "/new.h5"}) {
    Program record =
        Program::forcegrid({"record", out + name, "--device", "hid:dead:beef", "--seconds", "1",
                            "--out", out + "/results", "--json", out + "/summary.json"});
    EXPECT_EQ(record.wait(kTimeout), 1);
    EXPECT_THAT(record.standard_error(), HasSubstr("dead:beef"));
  }
  EXPECT_EQ(text_of(out + "/earlier.h5"), "an earlier recording");
  EXPECT_FALSE(std::filesystem::exists(out + "/new.h5"));
  EXPECT_FALSE(std::filesystem::exists(out + "/summary.json"));
}

TEST(RecordCommand, RefusesWhatCantBecomeARecording) {
  const std::string out = fresh_folder("record_refused");
  const std::string text = out + "/text.h5";
  std::ofstream(text) << "no HDF5";
  struct Refused {
    std::vector<std::string> arguments;
    int status;
    std::string word;
  };
  const std::vector<Refused> all = {
      {{"record", out + "/x.csv"}, 2, ".h5"},
      {{"record"}, 2, "FILE"},
      {{"record", "/no-such-folder/x.h5"}, 1, "folder that exists"},
      {{"run", "--record", out + "/x.txt"}, 1, ".csv.gz"},
      {{"replay", out + "/none.h5"}, 1, "none.h5"},
      {{"replay", text, "--out", out}, 1, "text.h5"},
      {{"plot", out + "/none.h5", "--out", out}, 1, "none.h5"},
      {{"evaluate", "--method", "hold", "--trace", out + "/none.h5"}, 1, "none.h5"},
      {{"emulate", "--device", "vintage", "--motion", "path:" + text}, 1, "time_s"},
      {{"run", "--motion", "waltz"}, 2, "path:FILE"}};
  for (const Refused& refused : all) {
    Program program = Program::forcegrid(refused.arguments);
    EXPECT_EQ(program.wait(kTimeout), refused.status) << refused.arguments.front();
    EXPECT_THAT(program.standard_error() + program.standard_output(), HasSubstr(refused.word));
  }
}

}  // namespace
}  // namespace forcegrid
