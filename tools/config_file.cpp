// SPDX-License-Identifier: Apache-2.0
#include "tools/config_file.h"

#include <algorithm>
#include <charconv>
#include <cstdlib>
#include <fstream>

#include "text/toml_parser.h"
#include "tools/atomic_file.h"

namespace forcegrid::tools {
namespace {

constexpr char kSystemFile[] = "/etc/forcegrid/config.toml";

[[noreturn]] void fail(const std::string& file, const toml::node& node, const std::string& key,
                       const std::string& problem) {
  throw ConfigError(file + ":" + std::to_string(node.source().begin.line) + ": key '" + key +
                    "': " + problem);
}

std::string shortest_text(double number) {
  char text[32];
  const auto end = std::to_chars(text, text + sizeof text, number).ptr;
  return {text, end};
}

struct Scalar {
  std::string text;
  ConfigType type = ConfigType::kText;
};

Scalar scalar_of(const std::string& file, const toml::node& node, const std::string& key) {
  if (const auto* text = node.as_string()) {
    return {text->get(), ConfigType::kText};
  }
  if (const auto* integer = node.as_integer()) {
    return {std::to_string(integer->get()), ConfigType::kInteger};
  }
  if (const auto* number = node.as_floating_point()) {
    return {shortest_text(number->get()), ConfigType::kNumber};
  }
  if (const auto* boolean = node.as_boolean()) {
    return {boolean->get() ? "true" : "false", ConfigType::kBoolean};
  }
  fail(file, node, key,
       "expected a single value, found a date, table or array; write a text, a number, true or "
       "false");
}

bool is_numeric(ConfigType type) {
  return type == ConfigType::kInteger || type == ConfigType::kNumber;
}

ConfigValue array_value(const std::string& file, const toml::array& array, const std::string& key) {
  ConfigValue value;
  value.is_array = true;
  for (const toml::node& element : array) {
    const Scalar scalar = scalar_of(file, element, key);
    if (value.texts.empty()) {
      value.type = scalar.type;
    } else if (is_numeric(value.type) && is_numeric(scalar.type)) {
      value.type = std::max(value.type, scalar.type);
    } else if (value.type != scalar.type) {
      fail(file, element, key, "an array with elements of different types; use one type");
    }
    value.texts.push_back(scalar.text);
  }
  return value;
}

void flatten(const std::string& file, const toml::table& table, const std::string& path,
             std::vector<ConfigValue>& values) {
  for (const auto& [name, node] : table) {
    const std::string key = path + (path.empty() ? "" : ".") + std::string(name);
    if (const toml::table* inner = node.as_table()) {
      flatten(file, *inner, key, values);
      continue;
    }
    ConfigValue value;
    if (const toml::array* array = node.as_array()) {
      value = array_value(file, *array, key);
    } else {
      const Scalar scalar = scalar_of(file, node, key);
      value.texts = {scalar.text};
      value.type = scalar.type;
    }
    value.key = key;
    value.file = file;
    value.line = node.source().begin.line;
    values.push_back(std::move(value));
  }
}

std::string quoted(const std::string& text) {
  std::string result = "\"";
  for (const char c : text) {
    if (c == '"' || c == '\\') {
      result += '\\';
    }
    result += c == '\n' ? std::string("\\n") : std::string(1, c);
  }
  return result + "\"";
}

std::string before(const std::string& line, char end) {
  const std::size_t first = line.find_first_not_of(" \t");
  const std::size_t at = line.find(end);
  if (first == std::string::npos || at == std::string::npos || at < first) {
    return "";
  }
  const std::size_t last = line.find_last_not_of(" \t", at - 1);
  return line.substr(first, last + 1 - first);
}

}  // namespace

std::vector<ConfigValue> read_config_file(const std::string& file) {
  std::vector<ConfigValue> values;
  try {
    flatten(file, text::read_toml_file(file), "", values);
  } catch (const text::TomlError& error) {
    throw ConfigError(error.what());
  }
  std::stable_sort(values.begin(), values.end(),
                   [](const ConfigValue& a, const ConfigValue& b) { return a.line < b.line; });
  return values;
}

std::vector<ConfigLayer> config_layers(const std::string& asked) {
  std::vector<ConfigLayer> layers{{"system", kSystemFile, false}};
  const char* const xdg = std::getenv("XDG_CONFIG_HOME");
  const char* const home = std::getenv("HOME");
  if (xdg != nullptr && xdg[0] == '/') {
    layers.push_back({"user", std::string(xdg) + "/forcegrid/config.toml", false});
  } else if (home != nullptr && home[0] == '/') {
    layers.push_back({"user", std::string(home) + "/.config/forcegrid/config.toml", false});
  }
  if (!asked.empty()) {
    layers.push_back({"file", asked, true});
  }
  return layers;
}

std::string toml_text(const std::vector<std::string>& texts, ConfigType type, bool is_array) {
  std::string result;
  for (const std::string& text : texts) {
    result += (result.empty() ? "" : ", ") + (type == ConfigType::kText ? quoted(text) : text);
  }
  return is_array ? "[" + result + "]" : result;
}

void set_toml_key(std::vector<std::string>& lines, const std::string& key,
                  const std::string& value) {
  const std::size_t dot = key.rfind('.');
  std::string header = "[";
  header.append(key, 0, dot).append("]");
  const std::string name = key.substr(dot + 1);
  const std::string line = name + " = " + value;
  const auto table = std::find_if(lines.begin(), lines.end(), [&](const std::string& one) {
    return before(one, ']').append("]") == header;
  });
  if (table == lines.end()) {
    lines.insert(lines.end(), {header, line});
    return;
  }
  for (auto at = table + 1; at != lines.end() && before(*at, ']').rfind('[', 0) != 0; ++at) {
    if (before(*at, '=') == name) {
      *at = line;
      return;
    }
  }
  lines.insert(table + 1, line);
}

void set_in_config(const std::string& file,
                   const std::vector<std::pair<std::string, std::string>>& keys) {
  std::vector<std::string> lines;
  std::ifstream old(file);
  for (std::string line; std::getline(old, line);) {
    lines.push_back(line);
  }
  for (const auto& [key, value] : keys) {
    set_toml_key(lines, key, value);
  }
  std::string text;
  for (const std::string& line : lines) {
    text += line + "\n";
  }
  const auto check = [&](const std::string& written) {
    const std::vector<ConfigValue> values = read_config_file(written);
    for (const auto& [key, value] : keys) {
      const auto says_it = [&key = key, &value = value](const ConfigValue& one) {
        return one.key == key && toml_text(one.texts, one.type, one.is_array) == value;
      };
      const bool said = std::any_of(values.begin(), values.end(), says_it);
      if (!said) {
        throw ConfigError(
            file + ": key '" + key +
            "' can't be set there; put it under the header of its table by hand: " + value);
      }
    }
  };
  try {
    replace_file(file, text, check);
  } catch (const AtomicFileError& error) {
    throw ConfigError(error.what());
  }
}

}  // namespace forcegrid::tools
