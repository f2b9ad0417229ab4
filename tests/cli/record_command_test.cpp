// SPDX-License-Identifier: Apache-2.0
// `forcegrid record`, `replay`, `plot` and `evaluate` on one recording.

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <signal.h>

#include <cmath>
#include <filesystem>
#include <fstream>
#include <nlohmann/json.hpp>
#include <sstream>
#include <string>
#include <vector>

#include "tests/support/program.h"

namespace forcegrid {
namespace {

using nlohmann::json;
using testing::fresh_folder;
using ::testing::HasSubstr;
using ::testing::Not;
using testing::Program;
using testing::text_of;

constexpr auto kTimeout = std::chrono::seconds(60);

// The first column of a picture's data.
std::vector<double> times_of(const std::string& csv) {
  std::vector<double> times_s;
  std::istringstream stream(csv);
  std::string line;
  std::getline(stream, line);
  while (std::getline(stream, line)) {
    times_s.push_back(std::stod(line));
  }
  return times_s;
}

// @param whole what `plot` said about the same file without these options.
void draws_parts_and_formats(const std::string& file, const std::string& out, const json& whole) {
  const double touch_s = whole.at("contact_from_s");
  const double end_s = whole.at("contact_to_s");
  EXPECT_GT(touch_s, whole.at("drawn_from_s").get<double>() + 0.2) << "the approach";
  Program zoom = Program::forcegrid({"plot", file, "--out", out, "--zoom", "contact", "--format",
                                     "pdf,svg", "--width", "600", "--json"});
  ASSERT_EQ(zoom.wait(kTimeout), 0) << zoom.standard_error();
  const json zoomed = json::parse(zoom.standard_output());
  EXPECT_NEAR(zoomed.at("drawn_from_s").get<double>(), touch_s - 0.1, 0.01);
  EXPECT_GE(zoomed.at("drawn_to_s").get<double>(), end_s);
  EXPECT_EQ(zoomed.at("missed_deadlines"), whole.at("missed_deadlines")) << "of the whole file";
  const std::vector<double> times_s = times_of(text_of(out + "/recording.csv"));
  ASSERT_GT(times_s.size(), 100u);
  EXPECT_NEAR(times_s.front(), touch_s - 0.1, 0.01);
  EXPECT_THAT(text_of(out + "/recording.svg"), HasSubstr("viewBox=\"0 0 600 780\""));
  EXPECT_THAT(text_of(out + "/recording.pdf"), ::testing::StartsWith("%PDF"));
  EXPECT_FALSE(std::filesystem::exists(out + "/recording.png"));

  Program part = Program::forcegrid(
      {"plot", file, "--out", out, "--from", "1", "--to", "1.5", "--format", "png", "--json"});
  ASSERT_EQ(part.wait(kTimeout), 0) << part.standard_error();
  const std::vector<double> second_s = times_of(text_of(out + "/recording.csv"));
  EXPECT_NEAR(second_s.front(), 1.0, 0.01);
  EXPECT_NEAR(second_s.back(), 1.5, 0.01);
  EXPECT_TRUE(std::filesystem::exists(out + "/recording.png"));

  struct Refused {
    std::vector<std::string> more;
    int status;
    std::string words;
  };
  for (const Refused& refused :
       {Refused{{"--from", "2", "--to", "1"}, 1, "--from 2 is not before --to 1"},
        Refused{{"--from", "1e6"}, 1, "so choose --from and --to within that"},
        Refused{{"--from", "1", "--zoom", "contact"}, 2, "--from excludes --zoom"},
        Refused{{"--format", "bmp"}, 2, "--format"}, Refused{{"--width", "10"}, 2, "--width"},
        Refused{{"--to", "nan"}, 2, "--to: 'nan' can't be used"}}) {
    std::vector<std::string> words{"plot", file, "--out", out};
    words.insert(words.end(), refused.more.begin(), refused.more.end());
    Program program = Program::forcegrid(words);
    EXPECT_EQ(program.wait(kTimeout), refused.status) << refused.words;
    EXPECT_THAT(program.standard_error(), HasSubstr(refused.words));
  }
}

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
  draws_parts_and_formats(file, out + "/parts", drawn);

  Program replay =
      Program::forcegrid({"replay", file, "--method", "hold", "--out", out + "/replay", "--json"});
  ASSERT_EQ(replay.wait(kTimeout), 0) << replay.standard_error();
  const json replayed = json::parse(replay.standard_output());
  EXPECT_EQ(replayed.at("method"), "hold");
  // The chirp reaches 20 mm; another method's force lets the hand give way differently.
  EXPECT_LT(replayed.at("followed_rms_mm").get<double>(), 2.0);
  EXPECT_TRUE(std::filesystem::exists(out + "/replay/replay.h5"));
}

TEST(RecordCommand, ReplaysTheTurnsOfAWrist) {
  const std::string out = fresh_folder("record_wrist");
  const std::string file = out + "/run.h5";
  Program record = Program::forcegrid(
      {"record", file, "--device", "emulated:woodenhaptics_v2015_wrist", "--scene", "small",
       "--wrist", "twist", "--seconds", "5", "--no-reference", "--out", out});
  ASSERT_EQ(record.wait(kTimeout), 0) << record.standard_error();
  Program replay =
      Program::forcegrid({"replay", file, "--method", "hold", "--out", out + "/replay", "--json"});
  ASSERT_EQ(replay.wait(kTimeout), 0) << replay.standard_error();
  const std::string path = text_of(out + "/replay/replayed_path.csv");
  EXPECT_THAT(path,
              ::testing::StartsWith("time_s,x_m,y_m,z_m,gimbal_1_rad,gimbal_2_rad,gimbal_3_rad"));
  // Twist: joint 3 alone, by a radian. The emulated wrist ends where the path does.
  const std::string last = path.substr(path.rfind('\n', path.size() - 2) + 1);
  const double last_rad = std::stod(last.substr(last.rfind(',') + 1));
  const json run = json::parse(text_of(out + "/replay/replay_run.json"));
  const auto angle_rad = run.at("emulator").at("wrist").at("angle_rad").get<std::vector<double>>();
  EXPECT_GT(std::abs(last_rad), 0.1);
  EXPECT_NEAR(angle_rad.at(2), last_rad, 0.01);
  EXPECT_NEAR(angle_rad.at(0), 0.0, 0.01);
}

// The recorded orientation is the product of the rotations of the recorded counts, worked out here
// in numpy from the PHANTOM sheet and the gimbal's axes.
TEST(RecordCommand, RecordsHowTheStylusOfAPhantomIsTurned) {
  const std::string out = fresh_folder("record_phantom_wrist");
  const std::string file = out + "/run.h5";
  Program record = Program::forcegrid({"record", file, "--device", "emulated:phantom_desktop_wrist",
                                       "--scene", "small", "--seconds", "5", "--no-reference",
                                       "--out", out, "--json", out + "/summary.json"});
  ASSERT_EQ(record.wait(kTimeout), 0) << record.standard_error();
  const json orientation = json::parse(text_of(out + "/summary.json")).at("orientation");
  EXPECT_TRUE(orientation.at("has_orientation").get<bool>()) << orientation;
  EXPECT_GT(orientation.at("largest_speed_rad_per_s").get<double>(), 0.2);
  Program python(
      {"/usr/bin/python3", "-c",
       "import sys, h5py, numpy as np\n"
       "f = h5py.File(sys.argv[1]); c = f['cycles']\n"
       "assert c['has_orientation'][:].all()\n"
       "arm = 2 * np.pi / 4096 / 9 * c['counts'][:]\n"
       "g = 2 * np.pi * c['gimbal_counts'][:] / np.array([1270, 2612, 1231])\n"
       "assert np.abs(g - c['gimbal_angle_rad'][:]).max() < 1e-12\n"
       "def about(axis, angle):\n"
       "    q = np.zeros((len(angle), 4)); q[:, 0] = np.cos(angle / 2)\n"
       "    q[:, 1 + axis] = np.sin(angle / 2); return q\n"
       "def times(a, b):\n"
       "    v, w = np.cross(a[:, 1:], b[:, 1:]), a[:, :1] * b[:, :1]\n"
       "    w = w - (a[:, 1:] * b[:, 1:]).sum(1, keepdims=True)\n"
       "    return np.hstack([w, v + a[:, :1] * b[:, 1:] + b[:, :1] * a[:, 1:]])\n"
       "q = about(2, arm[:, 0])\n"
       "for turn in (about(1, np.pi / 2 - arm[:, 2]), about(0, g[:, 0]), about(1, g[:, 1]),\n"
       "             about(0, g[:, 2])):\n"
       "    q = times(q, turn)\n"
       "same = np.abs((q * c['orientation_WT_wxyz'][:]).sum(1))\n"
       "assert np.abs(same - 1).max() < 1e-12, same\n"
       "print(np.ptp(g, axis=0).min())\n",
       file});
  ASSERT_EQ(python.wait(kTimeout), 0) << python.standard_error();
  EXPECT_GT(std::stod(python.standard_output()), 0.1) << "the hand turned every joint";
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

// A file that may not grow stands for a disk that fails: the run goes on, ends with a message in
// plain words and a status, and does not claim a file that it has not written.
TEST(RecordCommand, DoesNotClaimAFileThatCouldNotBeWritten) {
  const std::string out = fresh_folder("record_too_large");
  const std::string file = out + "/run.h5";
  std::string command = "trap '' XFSZ; ulimit -f 64; exec";
  for (const std::string& word : testing::forcegrid_command(
           {"record", file, "--scene", "small", "--seconds", "1.5", "--no-reference", "--out",
            out + "/results", "--json", out + "/summary.json"})) {
    command += " '" + word + "'";
  }
  Program record({"/bin/bash", "-c", command});
  EXPECT_EQ(record.wait(kTimeout), 1) << record.standard_error();
  EXPECT_THAT(record.standard_error(), HasSubstr("can't be written (File too large); the recording "
                                                 "ends here"));
  EXPECT_THAT(record.standard_error(), Not(HasSubstr("errno")));
  EXPECT_THAT(record.standard_output(), HasSubstr("Wrote " + out + "/results/forces.csv"));
  EXPECT_THAT(record.standard_output(), Not(HasSubstr("Wrote " + file)));
  const json files = json::parse(text_of(out + "/summary.json")).at("files");
  EXPECT_THAT(files.dump(), Not(HasSubstr("run.h5")));
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
      {{"plot", out + "/none.h5", "--out", out}, 1, "none.h5: no such file"},
      {{"plot", "/dev/null", "--out", out}, 1, "/dev/null: a device, not a file"},
      {{"plot", out, "--out", out}, 1, "a folder, not a file"},
      {{"evaluate", "--method", "hold", "--trace", out}, 1, "is a folder, not a file"},
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
