// SPDX-License-Identifier: Apache-2.0
#include "cli/common/log_options.h"

#include <unistd.h>

#include <algorithm>
#include <cstring>
#include <string_view>

#include "log/log.h"

namespace forcegrid::cli {
namespace {

struct LogKey {
  const char* key;
  const char* option;  // without dashes
  const char* variable;
};
constexpr LogKey kLogKeys[] = {{"log.level", "log-level", "FORCEGRID_LOG_LEVEL"},
                               {"log.file", "log-file", "FORCEGRID_LOG_FILE"},
                               {"log.format", "log-format", "FORCEGRID_LOG_FORMAT"},
                               {"log.quiet", "quiet", "FORCEGRID_QUIET"}};

}  // namespace

void add_log_options(Command& program, LogChoice& choice) {
  program
      .add_option("--log-level", choice.level,
                  "Least important messages to show, on the console and in the file")
      ->check(one_of(log::level_names()))
      ->show_default();
  program
      .add_option("--log-file", choice.file,
                  "Also write messages to this file, with times; it is rotated at 10 MB, and three "
                  "older ones are kept")
      ->type_name("FILE");
  program
      .add_option("--log-format", choice.format,
                  "Form of messages on standard error and in the file: text, or one JSON object "
                  "per line")
      ->check(one_of({"text", "json"}))
      ->show_default();
  program.add_flag("--quiet", choice.quiet,
                   "Show only errors and results; the log file is not affected");
}

bool is_log_option_with_value(const std::string& word) {
  return word == "--log-level" || word == "--log-file" || word == "--log-format";
}

std::string log_key(const std::string& option) {
  for (const LogKey& known : kLogKeys) {
    if (option == known.option) {
      return known.key;
    }
  }
  return "log." + option;
}

std::string log_variable(const std::string& key) {
  for (const LogKey& known : kLogKeys) {
    if (key == known.key) {
      return known.variable;
    }
  }
  return "";
}

std::vector<std::string> environment_of_child() {
  std::vector<std::string> variables;
  for (char** variable = environ; variable != nullptr && *variable != nullptr; ++variable) {
    const std::string_view text = *variable;
    const std::string_view name = text.substr(0, text.find('='));
    const bool ours = std::any_of(std::begin(kLogKeys), std::end(kLogKeys),
                                  [name](const LogKey& known) { return name == known.variable; });
    if (!ours) {
      variables.emplace_back(text);
    }
  }
  // Errors at least: this process quotes a child's reason for not starting.
  const log::Level level = std::min(log::least_level(), log::Level::kError);
  variables.push_back(std::string("FORCEGRID_LOG_LEVEL=") + log::name_of(level));
  variables.emplace_back("FORCEGRID_LOG_FORMAT=json");
  return variables;
}

void start_log(const LogChoice& choice, const std::string& first_line) {
  log::Options options;
  options.level = log::parse_level(choice.level).value_or(log::Level::kInfo);
  options.quiet = choice.quiet;
  options.json = choice.format == "json";
  options.file = choice.file;
  options.first_line = first_line;
  log::start(options);
}

}  // namespace forcegrid::cli
