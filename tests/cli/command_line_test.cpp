// SPDX-License-Identifier: Apache-2.0
// Wrong and right words on the command line: what they end with and what they say.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cctype>
#include <map>
#include <nlohmann/json.hpp>
#include <regex>
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

struct Complaint {
  std::string name;
  std::vector<std::string> arguments;
  int status;
  std::vector<std::string> words;  // all in standard error or output
};

// NOLINTNEXTLINE(readability-identifier-naming): GoogleTest calls it so.
void PrintTo(const Complaint& complaint, std::ostream* out) { *out << complaint.name; }

class Complaints : public ::testing::TestWithParam<Complaint> {};

TEST_P(Complaints, NameTheInputAndTheRemedy) {
  Program program = Program::forcegrid(GetParam().arguments);
  EXPECT_EQ(program.wait(std::chrono::seconds(20)), GetParam().status);
  const std::string said = program.standard_error() + program.standard_output();
  for (const std::string& word : GetParam().words) {
    EXPECT_NE(said.find(word), std::string::npos) << "'" << word << "' is not in: " << said;
  }
}

// A scene's tool, and what is asked for on the command line in place of its keys.
TEST(SceneTool, IsTheSceneSOwnUnlessTheCommandLineSaysOtherwise) {
  const auto simulated = [](const std::vector<std::string>& more) {
    std::vector<std::string> words{"simulate", "--scene",     "small_slide",
                                   "--listen", "127.0.0.1:0", "--until-stdin-closes",
                                   "--json"};
    words.insert(words.end(), more.begin(), more.end());
    Program program = Program::forcegrid(words);  // whose standard input is empty
    EXPECT_EQ(program.wait(), 0) << program.standard_error();
    const std::string said = program.standard_output();
    return json::parse(said.substr(said.find('{')));
  };
  const json own = simulated({});
  EXPECT_EQ(own.at("tool"), "sphere");
  EXPECT_EQ(own.at("contact"), "slide");
  const json other = simulated({"--tool", "capsule"});
  EXPECT_EQ(other.at("tool"), "capsule");
  EXPECT_EQ(other.at("contact"), "slide") << "a key that nobody has asked to change";
}

TEST(CommandLine, SaysWhichFlagsOfAToolMeanNothingToIt) {
  const auto said = [](const std::vector<std::string>& tool) {
    std::vector<std::string> words{"simulate", "--scene",     "small",
                                   "--listen", "127.0.0.1:0", "--until-stdin-closes"};
    words.insert(words.end(), tool.begin(), tool.end());
    Program program = Program::forcegrid(words);
    EXPECT_EQ(program.wait(), 0);
    return program.standard_error();
  };
  EXPECT_THAT(said({"--friction", "0.5", "--tool-radius-mm", "5"}),
              HasSubstr("Note: --tool-radius-mm, --friction: no effect on tool point, contact "
                        "sticky"));
  EXPECT_THAT(said({"--tool", "sphere", "--tool-radius-mm", "5"}), Not(HasSubstr("no effect")));
}

INSTANTIATE_TEST_SUITE_P(
    Words, Complaints,
    ::testing::Values(
        Complaint{"NoCommand", {}, 2, {"subcommand"}},
        Complaint{"UnknownCommand", {"rum"}, 2, {"rum"}},
        Complaint{"UnknownFlag", {"run", "--sceen", "block"}, 2, {"--sceen"}},
        Complaint{"UnknownScene", {"run", "--scene", "blok"}, 2, {"blok", "block"}},
        Complaint{"UnknownMethod", {"run", "--method", "magic"}, 2, {"magic", "forcegrid", "hold"}},
        Complaint{"UnknownMethodOfARun", {"run", "--method", "magic"}, 2, {"contact, direct"}},
        Complaint{"SceneIsAFolder", {"scene", "/tmp"}, 1, {"'/tmp': a folder, not a file"}},
        Complaint{"RunWhoseSceneIsAFolder",
                  {"run", "--scene", "/tmp"},
                  1,
                  {"'/tmp': a folder, not a file"}},
        Complaint{"SceneIsADevice", {"scene", "/dev/null"}, 1, {"a device, not a file"}},
        Complaint{"ProfileIsADevice",
                  {"emulate", "--device", "/dev/null"},
                  1,
                  {"'/dev/null': a device, not a file"}},
        Complaint{"NegativeTime", {"run", "--seconds", "-1"}, 2, {"--seconds"}},
        Complaint{"TimeIsNoNumber", {"run", "--seconds", "soon"}, 2, {"--seconds", "soon"}},
        Complaint{"SilenceBeyondTheWatchdog",
                  {"run", "--device-timeout-ms", "500"},
                  2,
                  {"--device-timeout-ms", "500", "10 to 450"}},
        Complaint{"TimeIsNan", {"run", "--seconds", "nan"}, 2, {"--seconds", "nan"}},
        Complaint{"RadiusIsNan", {"run", "--r-mm", "nan"}, 2, {"--r-mm", "nan"}},
        Complaint{"SeedBelowZero",
                  {"run", "--seed", "-1"},
                  2,
                  {"--seed: '-1' can't be used; give a whole number from 0 to "
                   "18446744073709551615"}},
        Complaint{"SeedOfAChartBelowZero",
                  {"chart", "accuracy", "--out", ".", "--seed", "-1"},
                  2,
                  {"--seed: '-1' can't be used"}},
        Complaint{"SeedTooLarge",
                  {"emulate", "--seed", "18446744073709551616"},
                  2,
                  {"--seed: '18446744073709551616' can't be used"}},
        Complaint{"OneRateOfTuningIsNan",
                  {"tune", "--rates", "500,nan"},
                  2,
                  {"--rates: 'nan' can't be used; give a number from 100 to 4000"}},
        Complaint{"TimeOfTuningIsNan",
                  {"tune", "--time", "nan"},
                  2,
                  {"--time: 'nan' can't be used; give a number from 1 to 86400"}},
        Complaint{"JsonNotWritable",
                  {"run", "--json", "/no-such-folder/x.json"},
                  1,
                  {"--json /no-such-folder/x.json", "folder that exists"}},
        Complaint{"RadiusReachesTooFar",
                  {"run", "--cells", "400,400,400", "--r-mm", "1000"},
                  1,
                  {"vertices", "smaller r"}},
        Complaint{"RateTooLow", {"run", "--rate", "99"}, 2, {"--rate"}},
        Complaint{"UnknownProfile",
                  {"run", "--device", "emulated:woodenhaptics_v1999"},
                  1,
                  {"woodenhaptics_v1999", "woodenhaptics_v2015", "phantom_desktop"}},
        Complaint{"UnknownDeviceForm", {"run", "--device", "usb:1"}, 1, {"usb:1", "usbip://HOST"}},
        Complaint{"NothingListens",
                  {"run", "--device", "usbip://127.0.0.1:1/1-1", "--simulator", "127.0.0.1:9"},
                  1,
                  {"usbip://127.0.0.1:1/1-1"}},
        Complaint{"NoSuchHidDevice",
                  {"run", "--device", "hid:1234:0006", "--simulator", "127.0.0.1:9"},
                  1,
                  {"1234:0006", "emulated:"}},
        Complaint{"SimulatorNotOnLoopback",
                  {"run", "--simulator", "192.0.2.1:24870", "--seconds", "1"},
                  1,
                  {"192.0.2.1", "loopback"}},
        Complaint{"FolderNotWritable",
                  {"run", "--out", "/proc/no-such-folder"},
                  1,
                  {"/proc/no-such-folder", "--out"}},
        Complaint{"EmulateWithoutDevice", {"emulate"}, 2, {"--device"}},
        Complaint{"EmulateBeyondLoopback",
                  {"emulate", "--device", "phantom_desktop", "--listen", "0.0.0.0:3240"},
                  1,
                  {"0.0.0.0", "loopback"}},
        Complaint{"SimulateBeyondLoopback",
                  {"simulate", "--listen", "0.0.0.0:0"},
                  1,
                  {"0.0.0.0", "loopback"}},
        Complaint{"TheToolOfASimulatorThatRunsAlready",
                  {"run", "--simulator", "127.0.0.1:1", "--friction", "0.2"},
                  1,
                  {"--friction", "give this option to 'forcegrid simulate'"}},
        Complaint{"ATurningToolOfASimulatorThatRunsAlready",
                  {"run", "--simulator", "127.0.0.1:1", "--tool-turns"},
                  1,
                  {"--tool-turns", "give this option to 'forcegrid simulate'"}},
        Complaint{"ATurningToolAndWorkers",
                  {"run", "--scene", "small", "--tool-turns", "--workers", "1"},
                  1,
                  {"--tool-turns: --workers know a tool that stays upright; leave them out"}},
        Complaint{"ATurningToolAndRequests",
                  {"run", "--scene", "small", "--tool-turns", "--requests-per-s", "30"},
                  1,
                  {"--tool-turns: the force depends on the tool's orientation"}},
        Complaint{"ATurningToolAndTheMethodDirect",
                  {"run", "--scene", "small", "--tool-turns", "--method", "direct"},
                  1,
                  {"--tool-turns: method direct", "choose another method"}},
        Complaint{"ATurningToolAndAnotherSolver",
                  {"simulate", "--scene", "small", "--tool-turns", "--solver", "local", "--listen",
                   "127.0.0.1:0"},
                  1,
                  {"solver local", "leave --solver or --tool-turns out"}},
        Complaint{"TheSceneOfASimulatorThatRunsAlready",
                  {"run", "--simulator", "127.0.0.1:1", "--scene", "small"},
                  1,
                  {"--scene: --simulator", "give this option to 'forcegrid simulate'"}},
        Complaint{"AFolderForAChartThatCanNotBeWritten",
                  {"chart", "solvers", "--out", "/proc/no-such-folder"},
                  1,
                  {"/proc/no-such-folder", "--out"}},
        Complaint{"AScenesToolSlidesUnderWorkers",
                  {"run", "--scene", "small_slide", "--workers", "2"},
                  1,
                  {"tool sphere, contact slide", "--workers"}},
        Complaint{"AScenesToolSlidesInAChart",
                  {"chart", "accuracy", "--scenes", "small_slide", "--out", "."},
                  2,
                  {"small_slide", "a chart needs"}},
        Complaint{"ListenIsNoAddress", {"simulate", "--listen", "nonsense"}, 1, {"nonsense"}},
        Complaint{
            "KinematicsWithoutInput", {"kinematics", "--profile", "vintage"}, 2, {"--counts"}},
        Complaint{"TwoCounts",
                  {"kinematics", "--profile", "vintage", "--counts", "1,2"},
                  2,
                  {"--counts"}},
        Complaint{
            "OutOfReach", {"kinematics", "--profile", "vintage", "--position", "9,9,9"}, 1, {"9"}},
        Complaint{"NoSuchProfileFile",
                  {"kinematics", "--profile", "no.toml", "--counts", "1,2,3"},
                  1,
                  {"no.toml"}}),
    [](const auto& test) { return test.param.name; });

struct NumberOption {
  std::vector<std::string> command;
  std::string name;  ///< "--rate"
};

// Every option of every command whose help gives a number as its type.
std::vector<NumberOption> number_options() {
  const std::vector<std::vector<std::string>> commands{{"run"},
                                                       {"record"},
                                                       {"doctor"},
                                                       {"calibrate"},
                                                       {"tune"},
                                                       {"scene"},
                                                       {"replay"},
                                                       {"plot"},
                                                       {"emulate"},
                                                       {"simulate"},
                                                       {"worker"},
                                                       {"devices"},
                                                       {"keygen"},
                                                       {"chart", "accuracy"},
                                                       {"chart", "stability"},
                                                       {"kinematics"},
                                                       {"evaluate"},
                                                       {"paper"},
                                                       {"config"},
                                                       {"chart", "solvers"},
                                                       {"chart", "wrist"}};
  const std::regex numbers(R"(\n +(--[a-zA-Z-]+)[^ ]* +\[?(?:FLOAT|INT|UINT))");
  std::vector<NumberOption> options;
  for (const std::vector<std::string>& command : commands) {
    std::vector<std::string> words = command;
    words.emplace_back("--help");
    Program help = Program::forcegrid(words);
    EXPECT_EQ(help.wait(), 0);
    const std::string text = help.standard_output();
    for (std::sregex_iterator match(text.begin(), text.end(), numbers), end; match != end;
         ++match) {
      options.push_back({command, (*match)[1].str()});
    }
  }
  return options;
}

TEST(CommandLine, RefusesWhatIsNotFiniteForEveryNumberOfEveryCommand) {
  const std::map<std::string, std::string> lists{
      {"--counts", "1,#,1"},  {"--position", "0,#,0"},        {"--force", "0,#,0"},
      {"--contact", "0,#,0"}, {"--workspace", "0,0,0,1,#,1"}, {"--cells", "9,#,9"},
      {"--coupling", "100,#"}};
  const std::vector<NumberOption> options = number_options();
  EXPECT_GT(options.size(), 60u) << "is the help's format another one?";
  for (const NumberOption& option : options) {
    for (const std::string word : {"nan", "inf", "-inf"}) {
      std::string value = word;
      if (const auto list = lists.find(option.name); list != lists.end()) {
        value = list->second;
        value.replace(value.find('#'), 1, word);
      }
      std::vector<std::string> words = option.command;
      words.push_back(option.name + "=" + value);
      Program program = Program::forcegrid(words);
      EXPECT_EQ(program.wait(), 2) << option.command.back() << ' ' << words.back();
      EXPECT_THAT(program.standard_error(),
                  HasSubstr(option.name + ": '" + word + "' can't be used; give a"))
          << option.command.back();
    }
  }
}

// The commands of a help text, by the names in its list "Subcommands".
std::vector<std::string> commands_in(const std::string& help) {
  std::vector<std::string> names;
  std::istringstream lines(help.substr(std::min(help.find("Subcommands:"), help.size())));
  for (std::string line; std::getline(lines, line);) {
    if (line.starts_with("  ") && line.size() > 2 && line[2] != ' ') {
      names.push_back(line.substr(2, line.find(' ', 2) - 2));
    }
  }
  return names;
}

std::string help_of(std::vector<std::string> command, const char* flag = "--help") {
  command.emplace_back(flag);
  Program program = Program::forcegrid(command);
  EXPECT_EQ(program.wait(std::chrono::seconds(20)), 0);
  return program.standard_output();
}

void expect_narrow(const std::string& help, const std::string& whose) {
  std::istringstream lines(help);
  for (std::string line; std::getline(lines, line);) {
    EXPECT_LE(line.size(), 100u) << whose << ": " << line;
  }
}

TEST(Help, IsAtMost100ColumnsWideForEveryCommand) {
  expect_narrow(help_of({}, "--help-all"), "--help-all");
  const std::string help = help_of({});
  expect_narrow(help, "forcegrid");
  const std::vector<std::string> commands = commands_in(help);
  EXPECT_GE(commands.size(), 17u);
  std::size_t nested = 0;
  for (const std::string& command : commands) {
    const std::string of_command = help_of({command});
    expect_narrow(of_command, command);
    for (const std::string& below : commands_in(of_command)) {
      expect_narrow(help_of({command, below}), command + " " + below);
      ++nested;
    }
  }
  EXPECT_GE(nested, 3u) << "of chart";
}

TEST(Help, LosesNothingWhereItIsWrapped) {
  const std::string help = help_of({"run"});
  // A list of names behind commas, a description, and one that its author has laid out.
  EXPECT_THAT(help, HasSubstr("discrimination_stiff,\n      discrimination_varied"));
  std::string words = help;
  words.erase(std::unique(words.begin(), words.end(),
                          [](char a, char b) { return std::isspace(a) && std::isspace(b); }),
              words.end());
  std::replace(words.begin(), words.end(), '\n', ' ');
  EXPECT_THAT(words, HasSubstr("hid:/dev/forcegrid/LINK the same by the lasting name that the udev "
                               "rule gives it"));
}

int status_in_shell(const std::string& line) {
  return Program({"/bin/bash", "-c", "set -o pipefail; " + line})
      .wait(std::chrono::seconds(20))
      .value_or(-1);
}

TEST(CommandLine, ReadsADeprecatedFlagAndNamesTheNewOne) {
  // Both flags are read: only then is it known that `direct` has no answer for a tool that slides.
  Program run =
      Program::forcegrid({"run", "--scene", "small", "--tool", "sphere", "--contact", "slide",
                          "--no-truth", "--shadow=direct", "--out", fresh_folder("deprecated")});
  EXPECT_EQ(run.wait(), 1);
  EXPECT_THAT(run.standard_error(), HasSubstr("method direct"));
  EXPECT_THAT(run.standard_error(), HasSubstr("--no-truth is deprecated"));
  EXPECT_THAT(run.standard_error(), HasSubstr("write --no-reference"));
  EXPECT_THAT(run.standard_error(), HasSubstr("write --evaluate"));
}

TEST(CommandLine, FailsWhereItsOutputIsLost) {
  const std::string config = FORCEGRID_PROGRAM " --no-config config";
  EXPECT_EQ(status_in_shell(config + " >/dev/full"), 1);
  EXPECT_EQ(status_in_shell(FORCEGRID_PROGRAM " --no-config scene small_linear >/dev/full"), 1);
  EXPECT_EQ(status_in_shell(config + " >/dev/null"), 0);
  EXPECT_EQ(status_in_shell(config + " | true"), 0) << "a reader that has seen enough";
}

TEST(CommandLine, RefusesAPortInUseAndNamesIt) {
  Program first =
      Program::forcegrid({"emulate", "--device", "phantom_desktop", "--listen", "127.0.0.1:0"});
  const std::string line = first.wait_for_line("listening ");
  const std::string address = line.substr(10, line.find(' ', 10) - 10);
  Program second =
      Program::forcegrid({"emulate", "--device", "phantom_desktop", "--listen", address});
  EXPECT_EQ(second.wait(std::chrono::seconds(20)), 1);
  EXPECT_NE(second.standard_error().find(address), std::string::npos) << second.standard_error();
}

TEST(CommandLine, PrintsTheKinematicsOfTheDeviceSheet) {
  // Sheet 11.1 and 11.2, woodenhaptics_v2015, counts -1500, 1200, 5200, force -0.75, 0.25, 1.5 N.
  Program program =
      Program::forcegrid({"kinematics", "--profile", "woodenhaptics_v2015", "--counts",
                          "-1500,1200,5200", "--force", "-0.75,0.25,1.5"});
  ASSERT_EQ(program.wait(std::chrono::seconds(20)), 0) << program.standard_error();
  const json result = json::parse(program.standard_output());
  const double position_m[] = {0.069947798294, -0.087954703032, 0.144028221590};
  const double torque_Nm[] = {0.006520922300, -0.249100221465, 0.319213855073};
  const double current_A[] = {0.015735816360, -0.801480764044, 1.027071605768};
  const int report_mA[] = {15, -801, 1027};
  for (std::size_t i = 0; i < 3; ++i) {
    EXPECT_NEAR(result.at("position_m")[i].get<double>(), position_m[i], 1e-11);
    EXPECT_NEAR(result.at("joint_torque_Nm")[i].get<double>(), torque_Nm[i], 1e-11);
    EXPECT_NEAR(result.at("current_A")[i].get<double>(), current_A[i], 1e-11);
    EXPECT_EQ(result.at("report_mA")[i], report_mA[i]);
  }
}

TEST(CommandLine, InvertsAPosition) {
  // Sheet D.3, PHANTOM class.
  Program program = Program::forcegrid(
      {"kinematics", "--profile", "phantom_desktop", "--position", "-0.06,0.08,-0.06"});
  ASSERT_EQ(program.wait(std::chrono::seconds(20)), 0) << program.standard_error();
  const json result = json::parse(program.standard_output());
  const double angle_rad[] = {0.982649506346, -0.331518421211, -0.226388609935};
  const double counts[] = {5765.290952, -1945.047692, -1328.241856};
  for (std::size_t i = 0; i < 3; ++i) {
    EXPECT_NEAR(result.at("joint_angles_rad")[i].get<double>(), angle_rad[i], 1e-11);
    EXPECT_NEAR(result.at("counts")[i].get<double>(), counts[i], 1e-5);
  }
}

}  // namespace
}  // namespace forcegrid
