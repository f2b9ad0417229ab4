// SPDX-License-Identifier: Apache-2.0
#include "cli/config_command.h"

#include <CLI/CLI.hpp>
#include <algorithm>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <nlohmann/json.hpp>

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

// Rewrites CLI11's "INT in [1 - 10]" in the form of the other ranges: "1..10".
std::string plain_range(const std::string& range) {
  const std::size_t begin = range.find(" in [");
  const std::size_t middle = range.find(" - ", begin);
  if (begin == std::string::npos || middle == std::string::npos || range.back() != ']') {
    return range;
  }
  const std::size_t low = begin + std::strlen(" in [");
  const std::size_t high = middle + std::strlen(" - ");
  return range.substr(low, middle - low) + ".." + range.substr(high, range.size() - 1 - high);
}

// "FLOAT Hz:100..4000" -> type, unit, range.
void read_type_name(ConfigKey& key) {
  const std::string full = key.option->get_type_name();
  const std::size_t colon = full.find(':');
  const std::string type = full.substr(0, colon);
  if (colon != std::string::npos) {
    key.range = plain_range(full.substr(colon + 1));
  }
  const std::size_t blank = type.find(' ');
  if (blank != std::string::npos) {
    key.unit = type.substr(blank + 1);
  }
  if (key.option->get_items_expected_max() == 0) {
    key.type = ConfigType::kBoolean;
  } else if (type.find("INT") != std::string::npos) {
    key.type = ConfigType::kInteger;
  } else if (type.find("FLOAT") != std::string::npos) {
    key.type = ConfigType::kNumber;
  }
  key.takes_several = key.option->get_items_expected_max() > 1;
}

// CLI11 writes the default of a list as "[a,b]".
std::vector<std::string> default_of(const ConfigKey& key) {
  std::string text = key.option->get_default_str();
  if (key.type == ConfigType::kBoolean) {
    return {text.empty() ? "false" : text};
  }
  if (!key.takes_several) {
    return text.empty() ? std::vector<std::string>{} : std::vector<std::string>{text};
  }
  if (text.size() >= 2 && text.front() == '[') {
    text = text.substr(1, text.size() - 2);
  }
  return text.empty() ? std::vector<std::string>{} : CLI::detail::split(text, ',');
}

void collect(CLI::App& app, const std::string& path, std::vector<ConfigKey>& keys) {
  for (CLI::App* sub : app.get_subcommands([](CLI::App*) { return true; })) {
    const std::string name = path + (path.empty() ? "" : ".") + sub->get_name();
    for (CLI::Option* option : sub->get_options()) {
      if (!option->get_configurable() || option->get_lnames().empty()) {
        continue;
      }
      ConfigKey key;
      const std::vector<std::string>& spellings = option->get_lnames();
      key.name = name + "." + spellings.front();
      for (std::size_t i = 1; i < spellings.size(); ++i) {
        key.old_names.push_back(name + "." + spellings[i]);
      }
      key.option = option;
      key.description = option->get_description();
      read_type_name(key);
      key.texts = default_of(key);
      keys.push_back(std::move(key));
    }
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
    std::fprintf(stderr, "forcegrid: %sdeprecated, will be removed in version 0.3; write '%s'\n",
                 where.c_str(), key->name.c_str());
  }
  if (value.texts.empty()) {
    throw ConfigError(where + "an empty array; write " + wanted_words(*key) +
                      ", or leave the key out");
  }
  if (!fits(value, *key)) {
    throw ConfigError(where + "wrong type; write " + wanted_words(*key));
  }
  try {
    for (const std::string& text : value.texts) {
      key->option->add_result(text);
    }
    key->option->run_callback();
    key->option->clear();
  } catch (const CLI::Error& error) {
    throw ConfigError(where + error.what() + "; write " + wanted_words(*key));
  }
  key->option->required(false);
  key->option->default_str(value.is_array ? "[" + CLI::detail::join(value.texts, ",") + "]"
                                          : value.texts.front());
  key->texts = value.texts;
  key->origin = origin;
  key->file = value.file;
  key->line = value.line;
}

// The description in one line.
std::string one_line(std::string text) {
  std::replace(text.begin(), text.end(), '\n', ' ');
  for (std::size_t at; (at = text.find("  ")) != std::string::npos;) {
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

std::string origin_text(const ConfigKey& key) {
  return key.file.empty() ? key.origin
                          : key.origin + ", " + key.file + ":" + std::to_string(key.line);
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
      std::printf("# %s is unset  # %s\n", name.c_str(), origin_text(*key).c_str());
    } else {
      std::printf("%s = %s  # %s\n", name.c_str(),
                  tools::toml_text(key->texts, key->type, key->takes_several).c_str(),
                  origin_text(*key).c_str());
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
            : "`" + tools::toml_text(key->texts, key->type, key->takes_several) + "`";
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

}  // namespace

std::vector<ConfigKey> config_keys(CLI::App& app, const std::vector<std::string>& without) {
  std::vector<ConfigKey> keys;
  collect(app, "", keys);
  std::erase_if(keys, [&](const ConfigKey& key) {
    const std::string command = key.name.substr(0, key.name.find('.'));
    return std::find(without.begin(), without.end(), command) != without.end();
  });
  return keys;
}

void share_defaults(const CLI::App& from, CLI::App& to) {
  for (CLI::Option* option : to.get_options()) {
    const auto& names = option->get_lnames();
    const CLI::Option* const same =
        names.empty() ? nullptr : from.get_option_no_throw("--" + names.front());
    if (same != nullptr && !same->get_default_str().empty()) {
      option->default_str(same->get_default_str());
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

void add_config_choice(CLI::App& app, ConfigChoice& choice) {
  app.fallthrough();  // inherited, so that they may also follow the subcommand
  CLI::Option* const file = app.add_option(
      "--config", choice.file,
      "Configuration file that overrides the system's and the user's (forcegrid config)");
  file->type_name("FILE")->configurable(false);
  app.add_flag("--no-config", choice.none, "Built-in defaults only: read no configuration file")
      ->configurable(false)
      ->excludes(file);
}

void add_config(CLI::App& app, ConfigOptions& options, const std::vector<ConfigKey>& keys,
                const std::vector<tools::ConfigLayer>& layers, std::function<int()>& action) {
  CLI::App& config = *app.add_subcommand(
      "config", "Show every key of the configuration file: value, unit, range and origin");
  config.add_option("KEY", options.names, "Only keys that begin with it, e.g. run or run.rate");
  config.add_flag("--markdown", options.markdown, "Print the table of docs/config.md")
      ->configurable(false);
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
  for (const std::string& name : options.names) {
    const bool known = std::any_of(keys.begin(), keys.end(), [&](const ConfigKey& key) {
      return key.name == name || key.name.starts_with(name + ".");
    });
    if (!known) {
      std::vector<std::string> names;
      for (const ConfigKey& key : keys) {
        names.push_back(key.name);
      }
      std::fprintf(stderr, "forcegrid: config: no key '%s'; the nearest is '%s'\n", name.c_str(),
                   text::nearest_name(name, names).c_str());
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
  std::printf(", flags.\n");
  print_toml(shown);
  return 0;
}

}  // namespace forcegrid::cli
