#pragma once

#include <cstdint>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

namespace forcegrid::tools {

/// A configuration that can't be used; the text names file, line, key and remedy.
class ConfigError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

/// What TOML says of a value or, in an array, of each element.
enum class ConfigType { kText, kInteger, kNumber, kBoolean };

/// One assignment of a configuration file: `rate = 500` in the table [run] has the key "run.rate".
struct ConfigValue {
  std::string key;                 ///< tables and name, joined by dots
  std::vector<std::string> texts;  ///< one, or those of an array, as on a command line
  ConfigType type = ConfigType::kText;
  bool is_array = false;
  std::string file;
  std::uint32_t line = 0;
};

/// All assignments of a TOML file, in order of their lines. An array may hold texts, booleans or
/// numbers (integers among numbers count as numbers), not several of these.
/// @throws ConfigError for a file that can't be read or parsed, for dates, and for arrays of
/// tables,
///         of arrays or of several types.
/// Real-time: no. Threads: any.
std::vector<ConfigValue> read_config_file(const std::string& file);

/// A file that configures, and what it is called.
struct ConfigLayer {
  std::string name;  ///< "system", "user", "file"
  std::string file;
  bool required = false;  ///< its absence is an error
};

/// The files in the order in which later ones override earlier ones: /etc/forcegrid/config.toml,
/// $XDG_CONFIG_HOME/forcegrid/config.toml ($HOME/.config where that is unset, empty or relative, as
/// the XDG Base Directory Specification has it), `asked` unless empty.
std::vector<ConfigLayer> config_layers(const std::string& asked);

/// A name or value as TOML writes it; `texts` as an array if `is_array`.
std::string toml_text(const std::vector<std::string>& texts, ConfigType type, bool is_array);

/// Replaces the line of `key` ("motors.max_current_A") below its table's header in the lines of a
/// TOML file, or puts one right below that, making the table if need be. `value` is as TOML writes
/// it.
void set_toml_key(std::vector<std::string>& lines, const std::string& key,
                  const std::string& value);

/// Sets keys ("run.rate", with the value as TOML writes it) in a configuration file, and leaves all
/// else in it as it is. The file appears whole or not at all; the one before is kept as FILE.old.
/// @throws ConfigError when it can't be written, or where the result would not say so (a file whose
///         keys are not under the headers of their tables).
void set_in_config(const std::string& file,
                   const std::vector<std::pair<std::string, std::string>>& keys);

}  // namespace forcegrid::tools
