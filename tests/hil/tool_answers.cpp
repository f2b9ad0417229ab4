// SPDX-License-Identifier: Apache-2.0
#include "tests/hil/tool_answers.h"

#include <gtest/gtest.h>

#include <algorithm>

#include "tests/hil/hil_bench.h"

namespace forcegrid::hil {

using nlohmann::json;

Answer ask(const std::string& user, const std::string& command, const std::string& set_up) {
  const ShellResult said =
      shell(set_up + "su " + user + " -c 'forcegrid " + command + " --json 2>/dev/null'");
  const json result = json::parse(said.text, nullptr, false);
  EXPECT_TRUE(result.is_object()) << "forcegrid " << command << " said: " << said.text;
  return {said.status, result.is_object() ? result : json::object()};
}

json obstacle(const Answer& answer) {
  const json devices = answer.result.value("devices", json::array());
  if (devices.size() != 1 || devices[0].at("obstacles").size() != 1) {
    ADD_FAILURE() << devices.dump(2);
    return {{"kind", ""}, {"what", ""}, {"remedy", ""}};
  }
  return devices[0].at("obstacles")[0];
}

json finding(const Answer& answer, const std::string& check) {
  for (const json& one : answer.result.value("findings", json::array())) {
    if (one.at("check") == check) {
      return one;
    }
  }
  ADD_FAILURE() << "nothing is said of " << check << ": " << answer.result.dump(2);
  return {{"verdict", ""}, {"what", ""}, {"remedy", ""}, {"measured", json::object()}};
}

std::string command_in(const std::string& remedy) {
  return remedy.substr(0, std::min(remedy.find(", then"), remedy.find(" (")));
}

}  // namespace forcegrid::hil
