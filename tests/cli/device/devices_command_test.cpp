// SPDX-License-Identifier: Apache-2.0
// `forcegrid devices`, with a USB/IP server and with a computer that has nothing.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>
#include <string>

#include "tests/support/program.h"

namespace forcegrid {
namespace {

using nlohmann::json;
using testing::fresh_folder;
using ::testing::HasSubstr;
using testing::Program;

constexpr auto kTimeout = std::chrono::seconds(20);

TEST(DevicesCommand, ListsWhatAUsbipServerOffersWithTheWordsToUseIt) {
  Program emulator = Program::forcegrid({"emulate", "--device", "woodenhaptics_v2015", "--device",
                                         "falcon", "--listen", "127.0.0.1:0"});
  const std::string line = emulator.wait_for_line("listening ");
  const std::string address = line.substr(10, line.find(' ', 10) - 10);
  Program devices = Program::forcegrid(
      {"devices", "--root", fresh_folder("nothing"), "--usbip", address, "--json"});
  ASSERT_EQ(devices.wait(kTimeout), 0) << devices.standard_error();
  const json list = json::parse(devices.standard_output()).at("devices");
  ASSERT_EQ(list.size(), 2u);
  EXPECT_EQ(list[0].at("ids"), "1234:0006");
  EXPECT_EQ(list[0].at("url"), "usbip://" + address + "/1-1");
  EXPECT_EQ(list[1].at("ids"), "0403:cb48");
  EXPECT_EQ(list[1].at("profiles"), json({"falcon"}));
  EXPECT_THAT(devices.standard_error(), HasSubstr("--profile falcon"));
}

TEST(DevicesCommand, HasAnExitStatusForEachEnd) {
  const std::string nothing = fresh_folder("nothing");
  Program none = Program::forcegrid({"devices", "--root", nothing});
  EXPECT_EQ(none.wait(kTimeout), 4);
  EXPECT_THAT(none.standard_output(), HasSubstr("emulated:"));
  Program refused = Program::forcegrid({"devices", "--root", nothing, "--usbip", "127.0.0.1:1"});
  EXPECT_EQ(refused.wait(kTimeout), 1);
  EXPECT_THAT(refused.standard_error(), HasSubstr("127.0.0.1:1: Connection refused"));
  EXPECT_THAT(refused.standard_output(), HasSubstr("No haptic device found where it could be"));
  Program emulator =
      Program::forcegrid({"emulate", "--device", "vintage", "--listen", "127.0.0.1:0"});
  const std::string line = emulator.wait_for_line("listening ");
  Program some = Program::forcegrid({"devices", "--root", nothing, "--usbip", "127.0.0.1:1",
                                     "--usbip", line.substr(10, line.find(' ', 10) - 10)});
  EXPECT_EQ(some.wait(kTimeout), 1) << "though there is one that can be used";
  EXPECT_THAT(some.standard_output(), HasSubstr("ready"));
  EXPECT_THAT(some.standard_error(), HasSubstr("127.0.0.1:1: Connection refused"));
  Program port = Program::forcegrid({"devices", "--root", nothing, "--usbip", "127.0.0.1:x"});
  EXPECT_EQ(port.wait(kTimeout), 1);
  EXPECT_THAT(port.standard_error(), HasSubstr("HOST:PORT"));
  Program unsaid = Program::forcegrid({"devices", "--usbip"});
  EXPECT_EQ(unsaid.wait(kTimeout), 2);
}

}  // namespace
}  // namespace forcegrid
