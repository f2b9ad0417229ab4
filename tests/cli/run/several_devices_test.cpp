// SPDX-License-Identifier: Apache-2.0
// Several devices in one simulation: in one program, and in programs of their own at one simulator.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <signal.h>

#include <atomic>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <thread>
#include <vector>

#include "link/simulator_endpoint.h"
#include "tests/cli/run/two_arms.h"
#include "tests/link/raw_peer.h"
#include "tests/support/program.h"

namespace forcegrid {
namespace {

using nlohmann::json;
using testing::address_in;
using testing::fresh_folder;
using ::testing::HasSubstr;
using testing::kArm;
using ::testing::Not;
using testing::Program;
using testing::run_of_two;
using testing::servo_at;

constexpr auto kTimeout = std::chrono::seconds(60);

json summary_in(const std::string& folder) {
  return json::parse(testing::text_of(folder + "/run.json"));
}

void expect_motors_off(const json& device) {
  for (const json& current_mA : device.at("emulator").at("final_current_mA")) {
    EXPECT_EQ(current_mA, 0.0);
  }
}

TEST(SeveralDevices, HoldOneObjectInOneProgram) {
  const std::string folder = fresh_folder("two");
  Program run = Program::forcegrid(run_of_two(folder, {"--seconds", "5"}));
  ASSERT_EQ(run.wait(kTimeout), 0) << run.standard_error();
  const json summary = summary_in(folder);
  ASSERT_EQ(summary.at("devices").size(), 2U);
  EXPECT_EQ(summary.at("exit_status"), 0);
  for (int k = 0; k < 2; ++k) {
    SCOPED_TRACE(k + 1);
    const json& device = summary.at("devices").at(k);
    EXPECT_EQ(device.at("device"), kArm);
    EXPECT_EQ(device.at("ended_by"), "time");
    EXPECT_EQ(device.at("scene"), "small");
    EXPECT_TRUE(device.at("zero_current_delivered"));
    EXPECT_GT(device.at("samples_received"), 10);
    expect_motors_off(device);
    const json& several = device.at("several_tools");
    EXPECT_EQ(several.at("tool_number"), k + 1);
    EXPECT_EQ(several.at("offset_W_mm"), json({0.0, k == 0 ? -15.0 : 15.0, 0.0}));
    EXPECT_THAT(several.at("unit").at("url").get<std::string>(), HasSubstr("usbip://127.0.0.1:"));
    const json& others = several.at("other_tools");
    EXPECT_GT(others.at("messages"), 10);
    ASSERT_EQ(others.at("newest").size(), 1U);
    EXPECT_EQ(others.at("newest").at(0).at("tool"), 2 - k);
    // The other one stands where it was placed, seen in the same frame.
    const double y_m = others.at("newest").at(0).at("position_W_m").at(1);
    EXPECT_NEAR(y_m, k == 0 ? 0.015 : -0.015, 0.01);
  }
  EXPECT_NE(summary["devices"][0]["several_tools"]["unit"]["url"],
            summary["devices"][1]["several_tools"]["unit"]["url"]);
  EXPECT_EQ(summary["devices"][0]["several_tools"]["tool_touch"]["stiffness_N_per_m"], 200.0);
  const json& tools = summary.at("devices").at(0).at("simulator").at("tools");
  ASSERT_EQ(tools.size(), 2U);
  EXPECT_EQ(tools.at(0).at("contacts"), 1);
  EXPECT_EQ(tools.at(1).at("contacts"), 1);
  EXPECT_THAT(run.standard_output(), HasSubstr("device 2: Device: "));
  EXPECT_THAT(run.standard_output(), HasSubstr("Device 1, emulated:woodenhaptics_v2015:"));
  EXPECT_THAT(run.standard_output() + run.standard_error(),
              HasSubstr("The workspaces of devices 1 and 2 have 120 x 130 x 120 mm"));
}

// Each loop renders its tool's force over both, and each knows the other tool in every cycle.
TEST(SeveralDevices, RenderAForceOverBothTools) {
  const std::string folder = fresh_folder("two_over_both");
  Program run =
      Program::forcegrid(run_of_two(folder, {"--seconds", "9", "--method", "auto-6d", "--evaluate",
                                             "auto;hold", "--motion", "hold,lissajous"}));
  ASSERT_EQ(run.wait(kTimeout), 0) << run.standard_error();
  for (const json& device : summary_in(folder).at("devices")) {
    EXPECT_EQ(device.at("method"), "auto-6d");
    EXPECT_EQ(device.at("ended_by"), "time");
    const json& counters = device.at("counters");
    EXPECT_GT(counters.at("samples_paired"), 100);
    EXPECT_GT(counters.at("samples_paired"), 5 * counters.at("samples_unpaired").get<int>());
    EXPECT_EQ(counters.at("samples_untold"), 0);
    EXPECT_EQ(counters.at("samples_with_stiffness"), counters.at("samples_paired"));
    const json& cycles = device.at("candidate_cycles");
    EXPECT_GT(cycles.at("auto-6d"), 3 * cycles.at("auto").get<int>());
    const json& errors = device.at("errors");
    EXPECT_LT(errors.at("auto-6d").at("rms_error_percent_after_1s"),
              0.5 * errors.at("auto").at("rms_error_percent_after_1s").get<double>());
    EXPECT_TRUE(device.at("zero_current_delivered"));
    expect_motors_off(device);
  }
  EXPECT_THAT(run.standard_output(), HasSubstr("Over both tools in "));
}

// Where one tool lets go for a fault, the other hand is rendered alone.
TEST(SeveralDevices, RenderOneToolAloneAfterAFaultOfTheOther) {
  const std::string folder = fresh_folder("two_over_both_fault");
  Program run = Program::forcegrid(
      run_of_two(folder, {"--seconds", "6", "--method", "auto-6d", "--fault-stops", "one",
                          "--fault", "2:connection-closed:when=motors", "--no-reference"}));
  ASSERT_EQ(run.wait(kTimeout), 1) << run.standard_error();
  const json devices = summary_in(folder).at("devices");
  EXPECT_EQ(devices[1]["ended_by"], "fault");
  EXPECT_EQ(devices[0]["ended_by"], "time");
  EXPECT_GT(devices[0]["candidate_cycles"]["auto"], 500);
  EXPECT_TRUE(devices[0]["zero_current_delivered"]);
  expect_motors_off(devices[0]);
}

// The simulator answers each, with the other tool where it is.
TEST(SeveralDevices, MakeRequests) {
  const std::string folder = fresh_folder("two_with_requests");
  Program run =
      Program::forcegrid(run_of_two(folder, {"--seconds", "10", "--method", "forcegrid+request",
                                             "--requests-per-s", "60", "--no-reference"}));
  ASSERT_EQ(run.wait(kTimeout), 0) << run.standard_error();
  const json devices = summary_in(folder).at("devices");
  for (const json& device : devices) {
    EXPECT_EQ(device.at("ended_by"), "time");
    EXPECT_GT(device.at("requests_made"), 30);
    EXPECT_GT(device.at("answers_taken"), 10);
    expect_motors_off(device);
  }
  const json& simulator = devices.at(0).at("simulator");
  EXPECT_GE(simulator.at("replies").get<int>(),
            devices[0]["answers_taken"].get<int>() + devices[1]["answers_taken"].get<int>());
}

TEST(SeveralDevices, AFaultOfOneInMidForceBringsAllToZeroForce) {
  const std::string folder = fresh_folder("two_fault");
  Program run = Program::forcegrid(
      run_of_two(folder, {"--seconds", "50", "--fault", "2:connection-closed:when=motors"}));
  ASSERT_EQ(run.wait(kTimeout), 1) << run.standard_error();
  const json devices = summary_in(folder).at("devices");
  EXPECT_EQ(devices[1]["ended_by"], "fault");
  EXPECT_EQ(devices[1]["faults"][0]["name"], "unplugged");
  EXPECT_EQ(devices[0]["ended_by"], "other_device");
  EXPECT_TRUE(devices[0]["faults"].empty());
  EXPECT_TRUE(devices[0]["zero_current_delivered"]);
  EXPECT_THAT(devices[0]["notes"].dump(), HasSubstr("device 2 had a fault"));
  for (const json& device : devices) {
    expect_motors_off(device);
  }
}

TEST(SeveralDevices, OrOnlyThatOneAsAsked) {
  const std::string folder = fresh_folder("two_fault_one");
  Program run =
      Program::forcegrid(run_of_two(folder, {"--seconds", "5", "--fault-stops", "one", "--fault",
                                             "1:connection-closed:when=motors"}));
  ASSERT_EQ(run.wait(kTimeout), 1) << run.standard_error();
  const json summary = summary_in(folder);
  const json& devices = summary.at("devices");
  EXPECT_EQ(summary.at("exit_status"), 1);
  EXPECT_EQ(devices[0]["ended_by"], "fault");
  EXPECT_EQ(devices[1]["ended_by"], "time");
  EXPECT_GT(devices[1]["cycles"], devices[0]["cycles"]);
  EXPECT_TRUE(devices[1]["zero_current_delivered"]);
  for (const json& device : devices) {
    expect_motors_off(device);
  }
}

TEST(SeveralDevices, OneSignalEndsAll) {
  const std::string folder = fresh_folder("two_signal");
  Program run = Program::forcegrid(run_of_two(folder, {"--seconds", "0"}));
  ASSERT_TRUE(run.wait_for_text("device 1:     0")) << run.standard_error();
  ASSERT_TRUE(run.wait_for_text("device 2:     0"));
  run.send_signal(SIGINT);
  ASSERT_EQ(run.wait(kTimeout), 130) << run.standard_error();
  for (const json& device : summary_in(folder).at("devices")) {
    EXPECT_EQ(device.at("ended_by"), "SIGINT");
    EXPECT_TRUE(device.at("zero_current_delivered"));
    expect_motors_off(device);
  }
}

TEST(SeveralDevices, TheEmergencyStopEndsAll) {
  const std::string folder = fresh_folder("two_emergency");
  Program run = Program::forcegrid(run_of_two(folder, {"--seconds", "0"}));
  ASSERT_TRUE(run.wait_for_text("device 1:     0")) << run.standard_error();
  ASSERT_TRUE(run.wait_for_text("device 2:     0"));
  run.send_signal(SIGUSR1);
  ASSERT_EQ(run.wait(kTimeout), 3) << run.standard_error();
  for (const json& device : summary_in(folder).at("devices")) {
    EXPECT_EQ(device.at("ended_by"), "emergency_stop");
    EXPECT_TRUE(device.at("zero_current_delivered"));
    expect_motors_off(device);
  }
}

struct Complaint {
  const char* name;
  std::vector<std::string> arguments;
  const char* sentence;
};

class BadInput : public ::testing::TestWithParam<Complaint> {};

TEST_P(BadInput, GetsAClearSentence) {
  std::vector<std::string> arguments = {"run", "--out", fresh_folder("bad_input"), "--seconds",
                                        "1"};
  arguments.insert(arguments.end(), GetParam().arguments.begin(), GetParam().arguments.end());
  Program run = Program::forcegrid(arguments);
  const auto status = run.wait(kTimeout);
  ASSERT_TRUE(status == 1 || status == 2) << run.standard_output();
  EXPECT_THAT(run.standard_error(), HasSubstr(GetParam().sentence));
  EXPECT_THAT(run.standard_output(), Not(HasSubstr("Device: "))) << "before a device is opened";
}

const std::vector<std::string> kTwo = {"--device", kArm, "--device", kArm};
std::vector<std::string> two_with(std::vector<std::string> more) {
  more.insert(more.begin(), kTwo.begin(), kTwo.end());
  return more;
}

INSTANTIATE_TEST_SUITE_P(
    SeveralDevices, BadInput,
    ::testing::Values(
        Complaint{"TheSameDeviceTwice",
                  {"--device", "hid:1234:0006", "--device", "hid:1234:0006"},
                  "--device hid:1234:0006 is given twice"},
        Complaint{"AtTheSamePlace",
                  two_with({"--device-offset-mm", "0,5,0", "--device-offset-mm", "0,0,0"}),
                  "devices 1 and 2 stand 5 mm apart in the scene"},
        Complaint{"MoreOffsetsThanDevices",
                  two_with({"--device-offset-mm", "0,5,0", "--device-offset-mm", "0,30,0",
                            "--device-offset-mm", "0,90,0"}),
                  "more often than --device"},
        Complaint{"AnOffsetThatIsNone", two_with({"--device-offset-mm", "0,5"}),
                  "'0,5' is no offset; write X,Y,Z in mm"},
        Complaint{"Five",
                  {"--device", kArm, "--device", kArm, "--device", kArm, "--device", kArm,
                   "--device", kArm},
                  "5 devices (--device): a simulator serves at most 4 tools"},
        Complaint{"Live", two_with({"--live"}), "leave --live out"},
        Complaint{"Tour", two_with({"--view", "--tour"}), "leave --tour out"},
        Complaint{"RecordWithoutAKnownEnding", two_with({"--record", "x.txt"}),
                  "the name must end in .h5"},
        Complaint{"StiffTools", two_with({"--tool-stiffness-N-per-m", "4000"}),
                  "N/m would shake; give at most that, or a higher --rate"},
        Complaint{"Workers", two_with({"--workers", "1"}), "leave --workers out"},
        Complaint{"Reconnect", two_with({"--reconnect"}), "leave --reconnect out"},
        Complaint{"SecondProcessor", two_with({"--core", "/tmp/line"}), "leave --core out"},
        Complaint{"ThreeMotions", two_with({"--motion", "hold,chirp,poke"}),
                  "has 3 motions for 2 devices; give one for all, or one for each"},
        Complaint{"UnknownMotion", two_with({"--motion", "hold,jump"}), "'jump' is not a motion"},
        Complaint{"BothToolsOfThree",
                  {"--device", kArm, "--device", kArm, "--device", kArm, "--method", "auto-6d"},
                  "method auto-6d is over the positions of two tools of one program, and there are "
                  "3 devices; give two, or choose a method of one tool, such as auto"},
        Complaint{"BothToolsOfOne",
                  {"--method", "kriging-6d"},
                  "there is one device; give a second --device"},
        Complaint{"BothToolsEvaluatedOfOne",
                  {"--evaluate", "forcegrid-6d"},
                  "method forcegrid-6d is over the positions of two tools"},
        Complaint{"UnknownMethod", two_with({"--method", "kriging-7d"}),
                  "known methods: auto-6d, kriging-6d, forcegrid-6d, auto, "},
        Complaint{"Direct", two_with({"--scene", "small", "--method", "direct"}),
                  "choose another method"},
        Complaint{"Sliding", two_with({"--scene", "small_slide"}), "use --contact sticky"},
        Complaint{"Solver", two_with({"--solver", "local"}), "leave --solver out"},
        Complaint{"FaultOfAMissingDevice", two_with({"--fault", "3:babble"}),
                  "there is no device 3"},
        Complaint{"UnknownFault", two_with({"--fault", "2:sneeze"}), "'sneeze' is unknown"},
        Complaint{"ToolNumberAlone", {"--tool-number", "2"}, "--tool-number: the simulator"}),
    [](const auto& complaint) { return std::string(complaint.param.name); });

// As two surgeons do on two machines; here both are on this one.
TEST(SeveralRuns, ShareOneSimulatorAndOneObject) {
  Program simulator = Program::forcegrid(
      {"simulate", "--tools", "2", "--scene", "small", "--listen", "127.0.0.1:0", "--json"});
  const std::string address = address_in(simulator.wait_for_line("listening "));
  const std::string left_folder = fresh_folder("left");
  const std::string right_folder = fresh_folder("right");
  Program left = Program::forcegrid(servo_at(address, "1", "-15", left_folder, "6"));
  Program right = Program::forcegrid(servo_at(address, "2", "15", right_folder, "6"));
  ASSERT_TRUE(left.wait_for_text("Samples come"));
  ASSERT_TRUE(right.wait_for_text("Samples come"));

  // A number that is taken, and a third tool: each is told why and ends at once.
  Program taken = Program::forcegrid(servo_at(address, "2", "0", fresh_folder("taken"), "30"));
  EXPECT_EQ(taken.wait(kTimeout), 4) << taken.standard_output();
  EXPECT_THAT(
      taken.standard_output() + taken.standard_error(),
      HasSubstr("has another servo that moves tool 2; give this run another --tool-number"));
  EXPECT_EQ(left.wait(kTimeout), 0) << left.standard_error();
  EXPECT_EQ(right.wait(kTimeout), 0) << right.standard_error();
  for (const std::string& folder : {left_folder, right_folder}) {
    const json summary = summary_in(folder);
    EXPECT_GT(summary.at("samples_received"), 10);
    EXPECT_GT(summary.at("several_tools").at("other_tools").at("messages"), 10);
    EXPECT_FALSE(summary.contains("devices")) << "one device: its keys are at the top";
    expect_motors_off(summary);
  }
  simulator.send_signal(SIGINT);
  ASSERT_TRUE(simulator.wait(kTimeout));
  const std::string out = simulator.standard_output();
  const json report = json::parse(out.substr(out.find("\n{") + 1));
  EXPECT_EQ(report.at("tools").at(0).at("contacts").get<int>() +
                report.at("tools").at(1).at("contacts").get<int>(),
            2);
}

TEST(SeveralRuns, AFaultOfOneBringsTheOtherToZeroForceToo) {
  Program simulator = Program::forcegrid(
      {"simulate", "--tools", "2", "--scene", "small", "--listen", "127.0.0.1:0"});
  const std::string address = address_in(simulator.wait_for_line("listening "));
  const std::string folder = fresh_folder("goes_on");
  Program other = Program::forcegrid(servo_at(address, "1", "-15", folder, "50"));
  ASSERT_TRUE(other.wait_for_text("Samples come"));
  std::vector<std::string> failing = servo_at(address, "2", "15", fresh_folder("fails"), "50");
  failing.insert(failing.end(), {"--fault", "connection-closed:when=motors"});
  Program fails = Program::forcegrid(failing);
  EXPECT_EQ(fails.wait(kTimeout), 1);
  ASSERT_EQ(other.wait(kTimeout), 1) << other.standard_error();
  const json summary = summary_in(folder);
  EXPECT_EQ(summary.at("ended_by"), "other_device");
  EXPECT_TRUE(summary.at("zero_current_delivered"));
  EXPECT_THAT(summary.at("notes").dump(), HasSubstr("has stopped every tool"));
  expect_motors_off(summary);
}

TEST(SeveralRuns, AreToldThatASimulatorOfOneToolHasNoPlace) {
  Program simulator =
      Program::forcegrid({"simulate", "--scene", "small", "--listen", "127.0.0.1:0"});
  const std::string address = address_in(simulator.wait_for_line("listening "));
  Program first = Program::forcegrid(servo_at(address, "1", "-15", fresh_folder("first"), "0"));
  ASSERT_TRUE(first.wait_for_text("Samples come"));
  Program second = Program::forcegrid(servo_at(address, "2", "15", fresh_folder("second"), "30"));
  EXPECT_EQ(second.wait(kTimeout), 4);
  EXPECT_THAT(second.standard_output() + second.standard_error(),
              HasSubstr("serves 1 tool and has no place for tool 2; end another run, or start it "
                        "with a larger --tools"));
  first.send_signal(SIGINT);
  EXPECT_EQ(first.wait(kTimeout), 130);
}

// A simulator of somebody's that speaks version 1 of the link only.
TEST(SeveralRuns, AreToldThatASimulatorKnowsOneTool) {
  const link::RawPeer simulator;
  std::atomic<bool> over{false};
  std::thread answers([&] {
    std::uint32_t samples = 0;
    while (!over) {
      std::optional<link::Decoded> asked = simulator.receive(20);
      if (!asked || asked->tool != 0 || !std::holds_alternative<link::ToolState>(asked->message)) {
        continue;  // another version: dropped
      }
      link::ForceSample sample = link::answer_to(std::get<link::ToolState>(asked->message));
      sample.sequence = ++samples;
      simulator.answer(sample, asked->session_id);
    }
  });
  Program run =
      Program::forcegrid(servo_at(simulator.address(), "2", "0", fresh_folder("version_1"), "30"));
  const auto status = run.wait(kTimeout);
  over = true;
  answers.join();
  EXPECT_EQ(status, 4);
  EXPECT_THAT(
      run.standard_output() + run.standard_error(),
      HasSubstr("knows one tool (version 1 of the link), so tool 2 cannot be one of several "
                "there"));
}

}  // namespace
}  // namespace forcegrid
