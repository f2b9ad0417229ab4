// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

namespace forcegrid::tools {

/// A configuration can't be used. what() names file, line, key and remedy.
class ConfigError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

/// TOML type of a value or, for an array, of each element.
enum class ConfigType { kText, kInteger, kNumber, kBoolean };

/// One assignment of a configuration file: `rate = 500` in the table [run] has the key "run.rate".
struct ConfigValue {
  std::string key;                 ///< tables and name, joined by dots
  std::vector<std::string> texts;  ///< one text per element, as on a command line
  ConfigType type = ConfigType::kText;
  bool is_array = false;
  std::string file;
  std::uint32_t line = 0;
};

/// Reads all assignments of a TOML file, in order of their lines. The elements of an array must
/// have one type: texts, booleans or numbers. Integers among numbers count as numbers.
/// @throws ConfigError for a file that can't be read or parsed, for dates, and for arrays of
///         tables, of arrays or of mixed types.
/// Real-time: no. Threads: any.
std::vector<ConfigValue> read_config_file(const std::string& file);

/// A configuration file and its role.
struct ConfigLayer {
  std::string name;  ///< "system", "user", "file"
  std::string file;
  bool required = false;  ///< a missing file is an error
};

/// Returns the configuration files, where later ones override earlier ones:
/// /etc/forcegrid/config.toml, $XDG_CONFIG_HOME/forcegrid/config.toml ($HOME/.config if that
/// variable is unset, empty or relative), and `asked` unless empty. Source: XDG Base Directory
/// Specification.
std::vector<ConfigLayer> config_layers(const std::string& asked);

/// Formats a name or value in TOML; `texts` as an array if `is_array`.
std::string toml_text(const std::vector<std::string>& texts, ConfigType type, bool is_array);

/// Sets `key` ("motors.max_current_A") in the lines of a TOML file: replaces its line below its
/// table's header, or inserts a line directly below the header and adds the table if necessary.
/// `value` is in TOML syntax.
void set_toml_key(std::vector<std::string>& lines, const std::string& key,
                  const std::string& value);

/// Sets keys ("run.rate", with the value in TOML syntax) in a configuration file and keeps the rest
/// of it. The file is replaced as by replace_file().
/// @throws ConfigError if the file can't be written, or if the result would not have these values
///         (a file whose keys are not under the headers of their tables).
void set_in_config(const std::string& file,
                   const std::vector<std::pair<std::string, std::string>>& keys);

}  // namespace forcegrid::tools
