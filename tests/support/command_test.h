// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <gtest/gtest.h>

#include <chrono>
#include <string>
#include <vector>

#include "tests/support/program.h"

namespace forcegrid::testing {

/// Tests that start this project's command, wait for its end, and look at what it said.
class CommandTest : public ::testing::Test {
 protected:
  explicit CommandTest(std::chrono::seconds patience) : patience_(patience) {}

  /// @returns its exit status; -1 if it went on for longer than the patience lasts.
  int run(const std::vector<std::string>& arguments) {
    Program program = Program::forcegrid(arguments);
    const auto status = program.wait(patience_);
    out_ = program.standard_output();
    error_ = program.standard_error();
    return status.value_or(-1);
  }

  const std::chrono::seconds patience_;
  std::string out_;  ///< of the last one
  std::string error_;
};

}  // namespace forcegrid::testing
