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

/// `forcegrid run` of tool `number` at the simulator that listens there, for so many seconds, from
/// so far beside the object's middle; its summary is in folder/run.json.
inline std::vector<std::string> servo_at(const std::string& simulator, const std::string& number,
                                         const std::string& y_mm, const std::string& folder,
                                         const std::string& seconds) {
  return {"run",
          "--simulator",
          simulator,
          "--tool-number",
          number,
          "--out",
          folder,
          "--json",
          folder + "/run.json",
          "--seconds",
          seconds,
          "--device-offset-mm",
          "0," + y_mm + ",0",
          "--device-timeout-ms",
          "400"};
}

/// The address in a line "listening ADDRESS ...".
inline std::string address_in(const std::string& line) {
  const std::size_t begin = line.find(' ') + 1;
  return line.substr(begin, line.find(' ', begin) - begin);
}

}  // namespace forcegrid::testing
