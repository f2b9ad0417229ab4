#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <vector>

#include "cli/run/run_command.h"
#include "tools/config_file.h"

namespace CLI {
class App;
class Option;
}  // namespace CLI

namespace forcegrid::cli {

/// One key that a configuration file may have: an option of a subcommand, by its long name.
struct ConfigKey {
  std::string name;                    ///< "run.rate": subcommands and option, joined by dots
  std::vector<std::string> old_names;  ///< deprecated spellings that files may still have
  CLI::Option* option = nullptr;
  tools::ConfigType type = tools::ConfigType::kText;
  bool takes_several = false;
  std::string unit;   ///< "Hz"; empty: a pure number, or no number
  std::string range;  ///< "100..4000", "{a,b}"; empty: what its type holds
  std::string description;
  /// What applies now; empty: unset. After built-in and every layer.
  std::vector<std::string> texts;
  std::string origin = "built-in";  ///< or "system", "user", "file"
  std::string file;                 ///< of the layer; empty for built-in
  std::uint32_t line = 0;
};

/// The keys of `app`, which are the configurable options of all of its subcommands but those of
/// `without`. The unit stands behind the type's name in CLI11's type_name(): "FLOAT Hz".
std::vector<ConfigKey> config_keys(CLI::App& app, const std::vector<std::string>& without);

/// Shows the defaults of `from` for the options of the same names of `to`, which write to the same
/// variables.
void share_defaults(const CLI::App& from, CLI::App& to);

/// Gives the values of `layers`, later ones over earlier ones, to the options' variables and makes
/// them the defaults that --help shows. What the command line says later overrides them.
/// @throws tools::ConfigError for an unknown key (with the nearest known one), a value of another
///         type or out of range, a file that is asked for and not there.
void apply_config(std::vector<ConfigKey>& keys, const std::vector<tools::ConfigLayer>& layers);

/// `--config FILE` and `--no-config`, wherever they stand on the command line.
struct ConfigChoice {
  std::string file;
  bool none = false;  ///< built-in defaults only
};
ConfigChoice find_config_choice(int argc, const char* const* argv);

/// Declares both for help and for the parser, for `app` and the subcommands added after.
void add_config_choice(CLI::App& app, ConfigChoice& choice);

struct ConfigOptions {
  std::vector<std::string> names;  ///< keys, or the beginnings of some; empty: all
  bool markdown = false;
  JsonTarget json;
};

/// Adds the subcommand, which sets `action`. `keys` and `layers` are read when that runs.
void add_config(CLI::App& app, ConfigOptions& options, const std::vector<ConfigKey>& keys,
                const std::vector<tools::ConfigLayer>& layers, std::function<int()>& action);

/// Prints the keys, as a TOML file, as a table for docs/config.md or as JSON.
/// @returns 0, or 2 for a name that no key begins with.
int config_command(const ConfigOptions& options, const std::vector<ConfigKey>& keys,
                   const std::vector<tools::ConfigLayer>& layers);

}  // namespace forcegrid::cli
