// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

namespace forcegrid::testing {

inline constexpr char kArm[] = "emulated:woodenhaptics_v2015";

/// `forcegrid run` with two emulated arms on the scene `small`; its summary is in folder/run.json.
inline std::vector<std::string> run_of_two(const std::string& folder,
                                           const std::vector<std::string>& more) {
  std::vector<std::string> arguments = {"run",
                                        "--device",
                                        kArm,
                                        "--device",
                                        kArm,
                                        "--scene",
                                        "small",
                                        "--out",
                                        folder,
                                        "--json",
                                        folder + "/run.json",
                                        "--device-timeout-ms",
                                        "400"};
  arguments.insert(arguments.end(), more.begin(), more.end());
  return arguments;
}

}  // namespace forcegrid::testing
