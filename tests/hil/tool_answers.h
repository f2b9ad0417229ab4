// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <nlohmann/json.hpp>
#include <string>

namespace forcegrid::hil {

/// Status of `forcegrid devices` where there is none that could be opened.
inline constexpr int kNoneUsable = 3;

/// What a tool said as JSON; its text for people is thrown away.
struct Answer {
  int status = -1;
  nlohmann::json result;  ///< an empty object, and a failure of the test, where it said none
};

/// `forcegrid COMMAND --json` as `user` of the guest.
/// @param set_up shell commands that root gives before, e.g. limits of the session.
Answer ask(const std::string& user, const std::string& command, const std::string& set_up = "");

/// The only obstacle of the only device that `forcegrid devices` told of.
nlohmann::json obstacle(const Answer& answer);

/// What `forcegrid doctor` says of `check`.
nlohmann::json finding(const Answer& answer, const std::string& check);

/// The command in an advice, e.g. of "sudo usermod -aG plugdev ada, then log in again" what is
/// before ", then".
std::string command_in(const std::string& remedy);

}  // namespace forcegrid::hil
