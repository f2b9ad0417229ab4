// SPDX-License-Identifier: Apache-2.0
#include "device_emulator/run_emulator.h"

#include <gtest/gtest.h>
#include <unistd.h>

#include <cmath>
#include <filesystem>
#include <nlohmann/json.hpp>
#include <sstream>
#include <string>
#include <thread>

#include "hand_pointer.h"

namespace forcegrid::emulator {
namespace {

template <typename Call>
std::string error_of(Call&& call) {
  try {
    call();
  } catch (const std::exception& error) {
    return error.what();
  }
  ADD_FAILURE() << "nothing was thrown";
  return {};
}

EmulatorOptions any_port() {
  EmulatorOptions options;
  options.profiles = {"woodenhaptics_v2015"};
  options.listen = "127.0.0.1:0";
  return options;
}

TEST(RunEmulator, SaysWhereItListensAndEndsWithTheReportWhenStopped) {
  std::atomic<bool> stop{false};
  std::ostringstream out;
  auto options = any_port();
  options.profiles.push_back("phantom_desktop");
  std::thread stopper([&stop] {
    std::this_thread::sleep_for(std::chrono::milliseconds(100));
    stop = true;
  });
  const auto reports = run_emulator(options, out, stop);
  stopper.join();
  ASSERT_EQ(reports.size(), 2U);
  EXPECT_EQ(reports[0].device, "woodenhaptics_v2015");
  EXPECT_EQ(reports[1].busid, "1-2");
  EXPECT_GT(reports[0].frames, 0U);
  const std::size_t port_begin = std::string("listening 127.0.0.1:").size();
  const std::string port =
      out.str().substr(port_begin, out.str().find(' ', port_begin) - port_begin);
  EXPECT_GT(std::stoi(port), 0);
  EXPECT_EQ(out.str(), "listening 127.0.0.1:" + port + " busid 1-1 device woodenhaptics_v2015\n" +
                           "listening 127.0.0.1:" + port + " busid 1-2 device phantom_desktop\n");
}

TEST(RunEmulator, EndsWhenItsStopDescriptorCloses) {
  int ends[2];
  ASSERT_EQ(::pipe(ends), 0);
  std::thread stopper([&ends] {
    std::this_thread::sleep_for(std::chrono::milliseconds(50));
    ::close(ends[1]);
  });
  std::ostringstream out;
  const std::atomic<bool> never{false};
  EXPECT_EQ(run_emulator(any_port(), out, never, ends[0]).size(), 1U);
  stopper.join();
  ::close(ends[0]);
}

TEST(RunEmulator, TakesTargetsOfTheHandsAndReportsThem) {
  char folder[] = "/tmp/forcegrid_hand_XXXXXX";
  ASSERT_NE(::mkdtemp(folder), nullptr);
  auto options = any_port();
  options.profiles.push_back("falcon");
  options.hand_target = std::string(folder) + "/hand";
  EmulatorServer server(server_options(options));
  server.start();
  HandPointer pointer(options.hand_target);
  pointer.send({0.01, 0.02, 0.03});
  pointer.send_bytes(23);
  pointer.send_bytes(25);
  pointer.send({0.01, std::nan(""), 0.03});
  pointer.send({std::nan(""), std::nan(""), std::nan("")});
  const auto give_up = std::chrono::steady_clock::now() + std::chrono::seconds(20);
  const auto counted = [&server](std::size_t device) { return *server.report(device).hand_target; };
  while (counted(0).taken + counted(0).malformed < 5 &&
         std::chrono::steady_clock::now() < give_up) {
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }
  for (const std::size_t device : {0U, 1U}) {
    EXPECT_EQ(counted(device).taken, 2U);
    EXPECT_EQ(counted(device).malformed, 3U);
  }
  const nlohmann::json json = server.report(0);
  EXPECT_EQ(json.at("hand_target").at("malformed"), 3);
  server.stop();
  std::filesystem::remove_all(folder);
}

TEST(RunEmulator, WrongOptionsAreErrorsThatNameTheRemedy) {
  auto options = any_port();
  options.profiles = {"woodenhaptics_v1899"};
  EXPECT_NE(error_of([&] { server_options(options); }).find("woodenhaptics_v2015"),
            std::string::npos);
  options = any_port();
  options.hand = "iron";
  EXPECT_NE(error_of([&] { server_options(options); }).find("light, firm, arm or none"),
            std::string::npos);
  options = any_port();
  options.hand_target = "/tmp/hand";
  options.hand_lets_go = true;
  EXPECT_NE(error_of([&] { server_options(options); }).find("must hold the device"),
            std::string::npos);
  options = any_port();
  options.hand_target = "/no_such_folder/hand";
  EXPECT_NE(error_of([&] { EmulatorServer server(server_options(options)); }).find("/no_such_fold"),
            std::string::npos);
  options = any_port();
  options.contact_m = {0.0, std::nan(""), 0.0};
  EXPECT_NE(error_of([&] { server_options(options); }).find("contact point"), std::string::npos);
  options = any_port();
  options.profiles.clear();
  EXPECT_NE(error_of([&] { EmulatorServer server(server_options(options)); }).find("no device"),
            std::string::npos);
}

TEST(ListenAddress, TakesLoopbackOnly) {
  EXPECT_EQ(parse_listen_address("127.0.0.1:3240").port, 3240);
  EXPECT_EQ(parse_listen_address("127.1.2.3:0").address, "127.1.2.3");
  EXPECT_EQ(parse_listen_address("localhost:1").text(), "127.0.0.1:1");
  EXPECT_TRUE(parse_listen_address("[::1]:3240").ipv6);
  EXPECT_EQ(parse_listen_address("[::1]:3240").text(), "[::1]:3240");
  for (const char* text : {"0.0.0.0:3240", "192.168.1.4:3240", "[::]:3240", "[fe80::1]:3240"}) {
    const std::string message = error_of([text] { parse_listen_address(text); });
    EXPECT_NE(message.find("not loopback"), std::string::npos) << message;
    EXPECT_NE(message.find("SSH tunnel"), std::string::npos) << message;
  }
}

TEST(ListenAddress, RefusesWhatIsNoAddress) {
  for (const char* text : {"", ":", "3240", "127.0.0.1", "127.0.0.1:", ":3240", "127.0.0.1:65536",
                           "127.0.0.1:-1", "127.0.0.1:32x", "127.0.0.1: 3240", "example.org:3240",
                           "::1:3240", "127.0.0.256:1", "127.0.0.1:99999999999999999999"}) {
    EXPECT_THROW(parse_listen_address(text), EmulatorError) << text;
  }
}

TEST(ListenAddress, PortInUseIsAnErrorWithTheRemedy) {
  EmulatorServer first(server_options(any_port()));
  auto options = any_port();
  options.listen = first.address();
  const std::string message = error_of([&] { EmulatorServer second(server_options(options)); });
  EXPECT_NE(message.find(first.address()), std::string::npos) << message;
  EXPECT_NE(message.find("choose another port"), std::string::npos) << message;
}

}  // namespace
}  // namespace forcegrid::emulator
