// SPDX-License-Identifier: Apache-2.0
#include "cli/common/child_message.h"

#include <nlohmann/json.hpp>

namespace forcegrid::cli {

std::optional<log::Message> read_child_message(const std::string& line) {
  if (!line.starts_with("{\"time\":")) {
    return std::nullopt;
  }
  try {
    const nlohmann::json json = nlohmann::json::parse(line);
    const auto level = log::parse_level(json.at("level").get<std::string>());
    if (!level) {
      return std::nullopt;
    }
    log::Message message{*level, json.at("component"), json.at("message"), json.at("process")};
    message.servo_time_ns = json.at("servo_time_ns");
    message.repeats = json.value("repeats", std::uint64_t{0});
    return message;
  } catch (const nlohmann::json::exception&) {
    return std::nullopt;
  }
}

}  // namespace forcegrid::cli
