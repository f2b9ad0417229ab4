// SPDX-License-Identifier: Apache-2.0
// Programs of others as processes of their own; the witness is the summary that the emulated device
// writes at its end, also when the program has crashed.
#include <dlfcn.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cerrno>
#include <csignal>
#include <cstdlib>
#include <nlohmann/json.hpp>
#include <string>
#include <thread>
#include <vector>

#include "tests/compat/hd_rig.h"
#include "tests/support/program.h"

namespace forcegrid::testing {
namespace {

using namespace std::chrono_literals;
using nlohmann::json;
using ::testing::HasSubstr;

constexpr char kNoCurrent[] = "[0.0,0.0,0.0]";

class Programs : public ::testing::Test {
 protected:
  Programs() : folder_(fresh_folder("programs")) {
    setenv("XDG_CONFIG_HOME", folder_.c_str(), 1);
    setenv("FORCEGRID_DEVICE", "emulated:woodenhaptics_v2015", 1);
    setenv("LD_LIBRARY_PATH", FORCEGRID_COMPAT_DIR, 1);
  }
  std::unique_ptr<Program> start(const std::string& name, const std::vector<std::string>& command) {
    setenv("FORCEGRID_EMULATOR_SUMMARY", summary(name).c_str(), 1);
    return std::make_unique<Program>(command);
  }
  std::string summary(const std::string& name) const { return folder_ + "/" + name + ".json"; }
  // Once it is whole.
  json arm(const std::string& name) const {
    json parsed;
    EXPECT_TRUE(wait_until([&] {
      parsed = json::parse(text_of(summary(name)), nullptr, false);
      return !parsed.is_discarded();
    })) << name;
    return parsed.is_array()            ? parsed.at(0)
           : parsed.contains("devices") ? parsed.at("devices").at(0)
                                        : parsed;
  }
  static double most_mA(const json& arm) {
    const auto most = arm.at("max_abs_current_mA").get<std::vector<double>>();
    return *std::max_element(most.begin(), most.end());
  }

  std::string folder_;
};

TEST_F(Programs, OfEveryShapeRunAndFeelTheirSpring) {
  std::vector<std::pair<std::string, std::unique_ptr<Program>>> running;
  const auto finish = [&] {
    for (auto& [name, program] : running) {
      EXPECT_EQ(program->wait(), 0) << name << ": " << program->standard_error();
      EXPECT_THAT(program->standard_output(), HasSubstr("ticks"));
      const json witness = arm(name);
      EXPECT_EQ(witness.at("final_current_mA").dump(), kNoCurrent) << name;
      EXPECT_GT(most_mA(witness), 100.0) << name;
    }
    running.clear();
  };
  for (const char* name : {"RV", "RG", "UN", "HP", "GP", "SAW", "SG"}) {
    running.emplace_back(name, start(name, {FORCEGRID_CLIENT_SHAPES, name, "3"}));
    if (running.size() == 4) {
      finish();
    }
  }
#ifndef FORCEGRID_SANITIZED  // Python has no sanitizer's runtime
  running.emplace_back("PY", start("PY", {"/usr/bin/python3", FORCEGRID_CTYPES_CLIENT, "3"}));
#endif
  finish();
}

TEST_F(Programs, N08_EndCleanlyWhateverTheirEnd) {
  std::vector<std::pair<std::string, std::unique_ptr<Program>>> running;
  for (const char* end : {"device-first", "twice", "not-at-all", "abort"}) {
    running.emplace_back(end, start(end, {FORCEGRID_CLIENT_SHAPES, "RV", "3", end}));
  }
  for (auto& [end, program] : running) {
    const auto status = program->wait();
    ASSERT_TRUE(status) << end;
    if (end == "abort") {
      EXPECT_EQ(*status, 128 + SIGABRT);
    } else if (end == "not-at-all") {
      EXPECT_EQ(*status, 0) << program->standard_error();
    }  // the others' callbacks see a device that has gone
    const json witness = arm(end);
    EXPECT_EQ(witness.at("final_current_mA").dump(), kNoCurrent) << end;
    EXPECT_GT(most_mA(witness), 100.0) << end;
  }
}

TEST_F(Programs, N08_AKilledOneLeavesZeroCurrent) {
  const auto program = start("killed", {FORCEGRID_CLIENT_SHAPES, "RV", "30"});
  std::this_thread::sleep_for(2500ms);
  program->send_signal(SIGKILL);
  EXPECT_EQ(program->wait(), 128 + SIGKILL);
  const json witness = arm("killed");
  EXPECT_EQ(witness.at("final_current_mA").dump(), kNoCurrent);
  EXPECT_GT(most_mA(witness), 100.0);
}

TEST_F(Programs, N10_ASecondProcessIsRefusedAndTheFirstDoesNotNotice) {
  Rig rig;
  const auto first = start("first", {FORCEGRID_CLIENT_SHAPES, "RV", "3"});
  ASSERT_TRUE(wait_until([&] { return rig.report().configured; }));
  std::this_thread::sleep_for(500ms);
  const rt::TimePoint began = rt::Clock::now();
  EXPECT_EQ(hdInitDevice(HD_DEFAULT_DEVICE), HD_INVALID_HANDLE);
  EXPECT_LT(rt::Clock::now() - began, 1s);
  const HDErrorInfo error = hdGetError();
  EXPECT_EQ(error.errorCode, static_cast<HDerror>(HD_DEVICE_FAULT));
  EXPECT_EQ(error.internalErrorCode, EBUSY);
  EXPECT_EQ(first->wait(), 0) << first->standard_error();
  EXPECT_EQ(hdInitDevice(HD_DEFAULT_DEVICE), 0U);
}

TEST_F(Programs, APlugInThatNamesNoLibraryFindsOurs) {
  ASSERT_NE(dlopen(FORCEGRID_COMPAT_DIR "/libHD.so", RTLD_LAZY | RTLD_GLOBAL), nullptr)
      << dlerror();
  void* const plug_in = dlopen(FORCEGRID_PLUG_IN, RTLD_LAZY);
  ASSERT_NE(plug_in, nullptr) << dlerror();
  const auto run = reinterpret_cast<int (*)()>(dlsym(plug_in, "plug_in_run"));
  ASSERT_NE(run, nullptr);
  EXPECT_EQ(run(), 0);
}

}  // namespace
}  // namespace forcegrid::testing
