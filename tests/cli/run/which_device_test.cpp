// SPDX-License-Identifier: Apache-2.0
// `forcegrid run` drives the device that was named, or none: an emulated one is never taken for a
// real one, nor a real one for an emulated one.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <string>

#include "tests/support/program.h"

namespace forcegrid {
namespace {

using testing::fresh_folder;
using ::testing::HasSubstr;
using ::testing::Not;
using testing::Program;

constexpr auto kTimeout = std::chrono::seconds(30);

TEST(WhichDevice, IsAnEmulatedOneWhereNoneWasNamedAndTheFirstLineSaysSo) {
  Program run = Program::forcegrid({"run", "--scene", "small", "--seconds", "1", "--no-reference",
                                    "--out", fresh_folder("which")});
  ASSERT_EQ(run.wait(kTimeout), 0) << run.standard_error();
  EXPECT_THAT(run.standard_output(), HasSubstr(" (emulated), profile woodenhaptics_v2015"));
  EXPECT_THAT(run.standard_output(), HasSubstr("Emulated motors: final current 0 0 0 mA"));
}

TEST(WhichDevice, IsNoEmulatedOneWhereTheRealOneIsMissing) {
  for (const char* device : {"hid:path=9-9", "hid:1234:0006:no-such-serial", "falcon:path=9-9"}) {
    Program run = Program::forcegrid({"run", "--device", device, "--scene", "small", "--seconds",
                                      "1", "--firmware", "/no-such-file", "--no-reference", "--out",
                                      fresh_folder("which_missing")});
    const auto status = run.wait(kTimeout);
    ASSERT_TRUE(status.has_value()) << device;
    EXPECT_NE(*status, 0) << device;
    EXPECT_THAT(run.standard_output(), Not(HasSubstr("Device: "))) << device;
    EXPECT_THAT(run.standard_output(), Not(HasSubstr("Emulated motors"))) << device;
  }
}

// The dead-man's switch that nobody holds: positions are shown, and no motor gets any current.
TEST(WhichDevice, ShowsPositionsWithoutAnyCurrentWhileNobodyHoldsTheSwitch) {
  const std::string folder = fresh_folder("positions");
  Program run =
      Program::forcegrid({"run", "--scene", "small", "--dead-man", "signal", "--seconds", "2.5",
                          "--no-reference", "--out", folder, "--json", folder + "/run.json"});
  ASSERT_EQ(run.wait(kTimeout), 0) << run.standard_error();
  EXPECT_THAT(run.standard_output(), HasSubstr("tool ("));
  const std::string json = testing::text_of(folder + "/run.json");
  const std::size_t at = json.find("\"max_abs_current_mA\": [");
  ASSERT_NE(at, std::string::npos);
  const std::string most = json.substr(at, json.find(']', at) - at);
  EXPECT_EQ(most.find_first_of("123456789", most.find('[')), std::string::npos) << most;
}

}  // namespace
}  // namespace forcegrid
