// SPDX-License-Identifier: Apache-2.0
#include "cli/config_command.h"

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <nlohmann/json.hpp>

#include "cli/common/log_options.h"
#include "cli/common/option_values.h"
#include "cli/common/options.h"
#include "cli/common/tools_names.h"
#include "cli/tools_program.h"
#include "log/log.h"
#include "text/nearest_name.h"

namespace forcegrid::cli {
namespace {

using nlohmann::ordered_json;
using tools::ConfigError;
using tools::ConfigType;
using tools::ConfigValue;

const char* word_of(ConfigType type) {
  switch (type) {
    case ConfigType::kText:
      return "text";
    case ConfigType::kInteger:
      return "integer";
    case ConfigType::kNumber:
      return "number";
    case ConfigType::kBoolean:
      return "true or false";
  }
  return "";
}

// "FLOAT Hz:100..4000" -> type, unit, range.
void read_type_name(ConfigKey& key) {
  const std::string full = key.option->type_text();
  const std::size_t colon = full.find(':');
  const std::string type = full.substr(0, colon);
  if (colon != std::string::npos) {
    key.range = full.substr(colon + 1);
  }
  const std::size_t blank = type.find(' ');
  if (blank != std::string::npos) {
    key.unit = type.substr(blank + 1);
  }
  if (key.option->is_flag()) {
    key.type = ConfigType::kBoolean;
  } else if (type.find("INT") != std::string::npos) {
    key.type = ConfigType::kInteger;
  } else if (type.find("FLOAT") != std::string::npos) {
    key.type = ConfigType::kNumber;
  }
  key.takes_several = key.option->takes_several();
}

std::vector<std::string> default_of(const ConfigKey& key) {
  const std::vector<std::string> texts = key.option->default_texts();
  return texts.empty() && key.type == ConfigType::kBoolean ? std::vector<std::string>{"false"}
                                                           : texts;
}

// @param name_of  the key's name, from a spelling of the option.
template <typename NameOf>
void collect_own(const Command& command, const NameOf& name_of, std::vector<ConfigKey>& keys) {
  for (const std::unique_ptr<Option>& option : command.options()) {
    if (!option->is_in_config()) {
      continue;
    }
    ConfigKey key;
    const std::vector<std::string>& spellings = option->spellings();
    key.name = name_of(spellings.front());
    for (std::size_t i = 1; i < spellings.size(); ++i) {
      key.old_names.push_back(name_of(spellings[i]));
    }
    key.option = option.get();
    key.description = option->description();
    read_type_name(key);
    key.texts = default_of(key);
    keys.push_back(std::move(key));
  }
}

void collect(const Command& command, const std::string& path, std::vector<ConfigKey>& keys) {
  for (const std::unique_ptr<Command>& sub : command.subcommands()) {
    const std::string name = path + (path.empty() ? "" : ".") + sub->name();
    collect_own(
        *sub, [&name](const std::string& option) { return name + "." + option; }, keys);
    collect(*sub, name, keys);
  }
}

bool fits(const ConfigValue& value, const ConfigKey& key) {
  if (value.is_array && !key.takes_several) {
    return false;
  }
  return value.type == key.type ||
         (key.type == ConfigType::kNumber && value.type == ConfigType::kInteger);
}

std::string wanted_words(const ConfigKey& key) {
  std::string words = key.takes_several ? std::string("an array, each element: ") : "";
  words += word_of(key.type);
  words += key.unit.empty() ? "" : " in " + key.unit;
  return words + (key.range.empty() ? "" : ", " + key.range);
}

// Whether `name` is this key's name or a deprecated one.
bool spells(const ConfigKey& key, const std::string& name) {
  return key.name == name ||
         std::find(key.old_names.begin(), key.old_names.end(), name) != key.old_names.end();
}

void apply(const ConfigValue& value, const std::string& origin, std::vector<ConfigKey>& keys) {
  const std::string where =
      value.file + ":" + std::to_string(value.line) + ": key '" + value.key + "': ";
  const auto key = std::find_if(keys.begin(), keys.end(),
                                [&](const ConfigKey& known) { return spells(known, value.key); });
  if (key == keys.end() && !has_tools_commands() &&
      is_tools_command(value.key.substr(0, value.key.find('.')))) {
    return;  // that program checks it
  }
  if (key == keys.end()) {
    std::vector<std::string> names;
    for (const ConfigKey& known : keys) {
      names.push_back(known.name);
    }
    throw ConfigError(where + "unknown; the nearest known key is '" +
                      text::nearest_name(value.key, names) +
                      "' ('forcegrid config' lists all keys)");
  }
  if (key->name != value.key) {
    log::warn("config",
              where + "deprecated, will be removed in version 0.3; write '" + key->name + "'");
  }
  if (value.texts.empty()) {
    throw ConfigError(where + "an empty array; write " + wanted_words(*key) +
                      ", or leave the key out");
  }
  if (!fits(value, *key)) {
    throw ConfigError(where + "wrong type; write " + wanted_words(*key));
  }
  try {
    key->option->preset(value.texts);
  } catch (const OptionError& error) {
    throw ConfigError(where + error.what() + "; write " + wanted_words(*key));
  }
  key->texts = value.texts;
  key->origin = origin;
  key->file = value.file;
  key->line = value.line;
}

// The description in one line.
std::string one_line(std::string text) {
  std::replace(text.begin(), text.end(), '\n', ' ');
  for (std::size_t at = 0; (at = text.find("  ")) != std::string::npos;) {
    text.erase(at, 1);
  }
  return text;
}

// A cell of a Markdown table.
std::string cell(const std::string& text) {
  std::string escaped;
  for (const char c : text) {
    if (c == '|' || c == '<' || c == '*' || c == '_') {
      escaped += '\\';
    }
    escaped += c;
  }
  return escaped;
}

void print_toml(const std::vector<const ConfigKey*>& keys) {
  std::string table;
  for (const ConfigKey* key : keys) {
    const std::size_t dot = key->name.rfind('.');
    if (key->name.substr(0, dot) != table) {
      table = key->name.substr(0, dot);
      std::printf("\n[%s]\n", table.c_str());
    }
    const std::string name = key->name.substr(dot + 1);
    std::printf("# %s; %s\n", one_line(key->description).c_str(), wanted_words(*key).c_str());
    if (key->texts.empty()) {
      std::printf("# %s is unset  # %s\n", name.c_str(), where_from(*key).c_str());
    } else {
      std::printf("%s = %s  # %s\n", name.c_str(),
                  tools::toml_text(key->texts, key->type, key->takes_several).c_str(),
                  where_from(*key).c_str());
    }
  }
}

void print_markdown(const std::vector<const ConfigKey*>& keys) {
  std::string table;
  for (const ConfigKey* key : keys) {
    const std::size_t dot = key->name.rfind('.');
    if (key->name.substr(0, dot) != table) {
      table = key->name.substr(0, dot);
      std::printf("\n### `[%s]`\n\n| key | built-in | value | meaning |\n|---|---|---|---|\n",
                  table.c_str());
    }
    const std::string value =
        key->texts.empty()
            ? "unset"
            : std::string("`")
                  .append(tools::toml_text(key->texts, key->type, key->takes_several))
                  .append("`");
    std::printf("| `%s` | %s | %s | %s |\n", key->name.substr(dot + 1).c_str(), value.c_str(),
                cell(wanted_words(*key)).c_str(), cell(one_line(key->description)).c_str());
  }
}

ordered_json json_of(const ConfigKey& key) {
  ordered_json value = nullptr;
  if (key.takes_several) {
    value = ordered_json::array();
  }
  for (const std::string& text : key.texts) {
    const ordered_json one =
        key.type == ConfigType::kText ? ordered_json(text) : ordered_json::parse(text);
    if (key.takes_several) {
      value.push_back(one);
    } else {
      value = one;
    }
  }
  return {{"key", key.name},           {"value", value},
          {"type", word_of(key.type)}, {"array", key.takes_several},
          {"unit", key.unit},          {"range", key.range},
          {"from", key.origin},        {"file", key.file},
          {"line", key.line},          {"description", one_line(key.description)}};
}

// Somebody may ask for a table ("run"), a key ("run.rate") or the last part of one ("rate").
std::string unknown_name(const std::string& name, const std::vector<ConfigKey>& keys) {
  std::vector<std::string> tables;
  std::vector<std::string> names;
  for (const ConfigKey& key : keys) {
    const std::string table = key.name.substr(0, key.name.rfind('.'));
    if (tables.empty() || tables.back() != table) {
      tables.push_back(table);
    }
    names.push_back(key.name);
    names.push_back(key.name.substr(key.name.rfind('.') + 1));
  }
  names.insert(names.begin(), tables.begin(), tables.end());
  const std::string nearest = text::nearest_name(name, names);
  std::string meant;
  for (const ConfigKey& key : keys) {
    if (key.name.ends_with("." + nearest)) {
      meant += (meant.empty() ? "'" : ", '") + key.name + "'";
    }
  }
  return "config: '" + name + "' is neither a key nor a table; the nearest is " +
         (meant.empty() ? "'" + nearest + "'" : meant) + ". The tables: " + joined(tables) +
         "; 'forcegrid config' lists all keys";
}

}  // namespace

std::string where_from(const ConfigKey& key) {
  return key.file.empty() ? key.origin
                          : key.origin + ", " + key.file + ":" + std::to_string(key.line);
}

std::vector<ConfigKey> config_keys(const Command& program,
                                   const std::vector<std::string>& without) {
  std::vector<ConfigKey> keys;
  collect(program, "", keys);
  collect_own(program, log_key, keys);
  std::erase_if(keys, [&](const ConfigKey& key) {
    const std::string command = key.name.substr(0, key.name.find('.'));
    return std::find(without.begin(), without.end(), command) != without.end();
  });
  return keys;
}

void share_defaults(const Command& from, const Command& to) {
  for (const std::unique_ptr<Option>& option : to.options()) {
    const auto& names = option->spellings();
    const Option* const same = names.empty() ? nullptr : from.find_option(names.front());
    if (same != nullptr && !same->default_text().empty()) {
      option->show_default(same->default_text());
    }
  }
}

void apply_config(std::vector<ConfigKey>& keys, const std::vector<tools::ConfigLayer>& layers) {
  for (const tools::ConfigLayer& layer : layers) {
    std::error_code error;
    const bool there = std::filesystem::exists(layer.file, error);
    if (error || (!there && layer.required)) {
      throw ConfigError("configuration file '" + layer.file +
                        "': " + (error ? error.message() : std::string("no such file")) +
                        "; name an existing one with --config, or leave it out");
    }
    if (!there) {
      continue;
    }
    for (const ConfigValue& value : tools::read_config_file(layer.file)) {
      apply(value, layer.name, keys);
    }
  }
}

void apply_environment(std::vector<ConfigKey>& keys) {
  for (ConfigKey& key : keys) {
    const std::string variable = log_variable(key.name);
    const char* const value = variable.empty() ? nullptr : std::getenv(variable.c_str());
    if (value == nullptr || *value == '\0') {
      continue;
    }
    std::string text = value;
    if (key.type == ConfigType::kBoolean && (text == "0" || text == "1")) {
      text = text == "1" ? "true" : "false";
    }
    const std::string where = "environment variable " + variable + "=" + value + ": ";
    if (key.type == ConfigType::kBoolean && text != "true" && text != "false") {
      throw ConfigError(where + "write 1, 0, true or false");
    }
    try {
      key.option->preset({text});
    } catch (const OptionError& error) {
      throw ConfigError(where + error.what() + "; write " + wanted_words(key));
    }
    key.texts = {text};
    key.origin = "environment " + variable;
    key.file.clear();
    key.line = 0;
  }
}

ConfigChoice find_config_choice(int argc, const char* const* argv) {
  ConfigChoice choice;
  constexpr char kFlag[] = "--config";
  constexpr char kWithValue[] = "--config=";
  for (int i = 1; i < argc && std::strcmp(argv[i], "--") != 0; ++i) {
    if (std::strcmp(argv[i], "--no-config") == 0) {
      choice.none = true;
    } else if (std::strcmp(argv[i], kFlag) == 0 && i + 1 < argc) {
      choice.file = argv[i + 1];
    } else if (std::strncmp(argv[i], kWithValue, sizeof kWithValue - 1) == 0) {
      choice.file = argv[i] + sizeof kWithValue - 1;
    }
  }
  return choice;
}

void add_config_choice(Command& program, ConfigChoice& choice) {
  Option* const file = program.add_option(
      "--config", choice.file,
      "Configuration file that overrides the system's and the user's (forcegrid config)");
  file->type_name("FILE")->not_in_config();
  program
      .add_flag("--no-config", choice.none, "Built-in defaults only: read no configuration file")
      ->not_in_config()
      ->excludes(file);
}

void add_config(Command& app, ConfigOptions& options, const std::vector<ConfigKey>& keys,
                const std::vector<tools::ConfigLayer>& layers, std::function<int()>& action) {
  Command& config = app.add_subcommand(
      "config", "Show every key of the configuration file: value, unit, range and origin");
  config.add_option("KEY", options.names, "Only keys that begin with it, e.g. run or run.rate");
  config.add_flag("--markdown", options.markdown, "Print the table of docs/config.md")
      ->not_in_config();
  config.callback([&options, &keys, &layers, &action] {
    action = [&options, &keys, &layers] { return config_command(options, keys, layers); };
  });
}

int config_command(const ConfigOptions& options, const std::vector<ConfigKey>& keys,
                   const std::vector<tools::ConfigLayer>& layers) {
  std::vector<const ConfigKey*> shown;
  for (const ConfigKey& key : keys) {
    const bool wanted =
        options.names.empty() ||
        std::any_of(options.names.begin(), options.names.end(), [&](const std::string& name) {
          return key.name == name || key.name.starts_with(name + ".");
        });
    if (wanted) {
      shown.push_back(&key);
    }
  }
  if (!has_tools_commands()) {
    std::string commands;
    for (const ToolsCommand& command : tools_commands()) {
      commands += (commands.empty() ? "" : ", ") + std::string(command.name);
    }
    log::warn("config", "the keys of " + commands +
                            " are left out: forcegrid-tools, which has these commands, is not "
                            "beside this program");
  }
  for (const std::string& name : options.names) {
    const bool known = std::any_of(keys.begin(), keys.end(), [&](const ConfigKey& key) {
      return key.name == name || key.name.starts_with(name + ".");
    });
    if (!known) {
      log::error("config", unknown_name(name, keys));
      return 2;
    }
  }
  if (options.json.wanted) {
    ordered_json files = ordered_json::array();
    for (const tools::ConfigLayer& layer : layers) {
      files.push_back({{"layer", layer.name},
                       {"file", layer.file},
                       {"read", std::filesystem::exists(layer.file)}});
    }
    ordered_json list = ordered_json::array();
    for (const ConfigKey* key : shown) {
      list.push_back(json_of(*key));
    }
    write_json(options.json, ordered_json{{"files", files}, {"keys", list}}.dump(2));
    return 0;
  }
  if (options.markdown) {
    print_markdown(shown);
    return 0;
  }
  std::printf("# Later overrides earlier: built-in");
  for (const tools::ConfigLayer& layer : layers) {
    std::printf(", %s %s%s", layer.name.c_str(), layer.file.c_str(),
                std::filesystem::exists(layer.file) ? "" : " (not there)");
  }
  std::printf(", environment, flags.\n");
  print_toml(shown);
  return 0;
}

}  // namespace forcegrid::cli
