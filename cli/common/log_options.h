// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

#include "cli/common/options.h"

namespace forcegrid::cli {

/// What a person wants to see, of every command.
struct LogChoice {
  std::string level = "info";
  std::string file;
  std::string format = "text";
  bool quiet = false;
};

/// Adds --log-level, --log-file, --log-format and --quiet.
void add_log_options(Command& program, LogChoice& choice);

/// Options of all commands that take a value, for whoever looks for the command's name by itself.
bool is_log_option_with_value(const std::string& word);

/// The configuration key of one of these options, by its long name: "log-level" is "log.level".
std::string log_key(const std::string& option);

/// The environment variable of such a key: "log.level" is FORCEGRID_LOG_LEVEL, "log.quiet" is
/// FORCEGRID_QUIET. Empty: the key has none.
std::string log_variable(const std::string& key);

/// The environment of a child process: this one's, but the child says everything as JSON lines on
/// its standard error and leaves it to this process what appears. "NAME=VALUE" each.
std::vector<std::string> environment_of_child();

/// Begins the log as chosen. @param first_line  of the file.
/// @throws std::runtime_error if the file can't be written.
void start_log(const LogChoice& choice, const std::string& first_line);

}  // namespace forcegrid::cli
