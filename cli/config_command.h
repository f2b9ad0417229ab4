// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "cli/common/options.h"
#include "cli/run/run_command.h"
#include "tools/config_file.h"

namespace forcegrid::cli {

/// One key of a configuration file: an option of a subcommand, by its long name.
struct ConfigKey {
  std::string name;                    ///< "run.rate": subcommands and option joined by dots
  std::vector<std::string> old_names;  ///< deprecated spellings that files may still have
  Option* option = nullptr;
  tools::ConfigType type = tools::ConfigType::kText;
  bool takes_several = false;
  std::string unit;   ///< "Hz"; empty: a pure number, or no number
  std::string range;  ///< "100..4000", "{a,b}"; empty: what its type holds
  std::string description;
  /// The value in effect after the built-in default and all layers; empty: unset.
  std::vector<std::string> texts;
  /// Or "system", "user", "file", "environment NAME".
  std::string origin = "built-in";
  std::string file;  ///< of the layer; empty for built-in
  std::uint32_t line = 0;
};

/// Returns the keys of the program: the options of all its subcommands except `without` that a
/// configuration file may set, and those of all commands as `log.level` (log_key()). A type_name()
/// holds the unit after the type's name: "FLOAT Hz".
std::vector<ConfigKey> config_keys(const Command& program, const std::vector<std::string>& without);

/// Where the value in effect comes from: "user, config.toml:3".
std::string where_from(const ConfigKey& key);

/// Makes the options of `to` show the defaults of the options with the same names in `from`. Both
/// write to the same variables.
void share_defaults(const Command& from, const Command& to);

/// Assigns the values of `layers` to the options' variables, later layers over earlier ones, and
/// makes them the defaults that --help shows. The command line overrides them afterwards.
/// @throws tools::ConfigError for an unknown key (naming the nearest known one), a value of the
///         wrong type or out of range, or a required file that does not exist.
void apply_config(std::vector<ConfigKey>& keys, const std::vector<tools::ConfigLayer>& layers);

/// Assigns the values of environment variables (log_variable()) in the same way, over those of all
/// files. An empty variable counts as none.
/// @throws tools::ConfigError for a value that can't be used, naming the variable.
void apply_environment(std::vector<ConfigKey>& keys);

/// `--config FILE` and `--no-config`, at any place of the command line.
struct ConfigChoice {
  std::string file;
  bool none = false;  ///< built-in defaults only
};
ConfigChoice find_config_choice(int argc, const char* const* argv);

/// Declares both options for help and parser.
void add_config_choice(Command& program, ConfigChoice& choice);

struct ConfigOptions {
  std::vector<std::string> names;  ///< keys or prefixes of keys; empty: all
  bool markdown = false;
  JsonTarget json;
};

/// Adds the subcommand, which sets `action`. `action` reads `keys` and `layers` when it runs.
void add_config(Command& app, ConfigOptions& options, const std::vector<ConfigKey>& keys,
                const std::vector<tools::ConfigLayer>& layers, std::function<int()>& action);

/// Prints the keys, as a TOML file, as a table for docs/config.md or as JSON.
/// @returns 0, or 2 if no key begins with one of the names.
int config_command(const ConfigOptions& options, const std::vector<ConfigKey>& keys,
                   const std::vector<tools::ConfigLayer>& layers);

}  // namespace forcegrid::cli
