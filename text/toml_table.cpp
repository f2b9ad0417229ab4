// SPDX-License-Identifier: Apache-2.0
#include "text/toml_table.h"

#include <algorithm>
#include <cmath>

#include "text/nearest_name.h"
#include "text/text.h"

namespace forcegrid::text {
namespace {

[[noreturn]] void fail(const std::string& file, std::uint32_t line, const std::string& key,
                       const std::string& problem, const std::string& remedy) {
  throw TomlError(file + ":" + std::to_string(line) + ": key '" + key + "': " + problem + "; " +
                  remedy);
}

std::string integer_words(std::int64_t min, std::int64_t max) {
  return "a whole number from " + std::to_string(min) + " to " + std::to_string(max);
}

std::string place_of(std::size_t i) { return " in place " + std::to_string(i + 1); }

}  // namespace

TomlTable::TomlTable(const toml::table& table, std::string file, std::string path)
    : table_(table), file_(std::move(file)), path_(std::move(path)) {}

TomlTable::TomlTable(const toml::table& table, std::string file, std::string path,
                     const std::vector<std::string>& keys)
    : TomlTable(table, std::move(file), std::move(path)) {
  refuse_others(keys);
}

void TomlTable::refuse_others(const std::vector<std::string>& keys) const {
  for (const auto& [key, node] : table_) {
    const std::string name(key.str());
    if (std::find(keys.begin(), keys.end(), name) == keys.end()) {
      fail(file_, key.source().begin.line, full(name),
           node.is_table() ? "unknown table" : "unknown key",
           "write one of: " + joined(keys) + " (the nearest is " + nearest_name(name, keys) + ")");
    }
  }
}

std::uint32_t TomlTable::line_of(std::string_view key) const {
  const toml::node* node = table_.get(key);
  return node != nullptr ? node->source().begin.line : table_line();
}

TomlTable TomlTable::table(const char* key, const std::vector<std::string>& keys) const {
  const toml::table* inner = required(key, "a table [" + full(key) + "]").as_table();
  if (inner == nullptr) {
    refuse(key, "it is not a table", "write a table [" + full(key) + "]");
  }
  return TomlTable(*inner, file_, full(key), keys);
}

std::vector<TomlTable> TomlTable::tables(
    const char* key,
    const std::function<std::vector<std::string>(const TomlTable&)>& keys_of) const {
  const std::string remedy = "write one or more tables [[" + full(key) + "]]";
  const auto* array = required(key, "one or more tables [[" + full(key) + "]]").as_array();
  if (array == nullptr || array->empty()) {
    refuse(key, "it is not a list of tables", remedy);
  }
  std::vector<TomlTable> all;
  for (const toml::node& node : *array) {
    const toml::table* inner = node.as_table();
    if (inner == nullptr) {
      refuse(key, "it is not a list of tables", remedy);
    }
    const std::string path = full(key) + "[" + std::to_string(all.size() + 1) + "]";
    all.push_back(TomlTable(*inner, file_, path));
    all.back().refuse_others(keys_of(all.back()));
  }
  return all;
}

std::string TomlTable::text(const char* key, std::size_t max_length) const {
  const auto* value = required(key, "a string").as_string();
  if (value == nullptr) {
    refuse(key, "wrong type", "write a string in quotes");
  }
  if (value->get().empty() || value->get().size() > max_length) {
    refuse(key, "it has " + std::to_string(value->get().size()) + " characters",
           "write a string of 1 to " + std::to_string(max_length) + " characters");
  }
  return value->get();
}

bool TomlTable::flag(const char* key) const {
  const auto* value = required(key, "true or false").as_boolean();
  if (value == nullptr) {
    refuse(key, "wrong type", "write true or false");
  }
  return value->get();
}

double TomlTable::number(const char* key, const NumberRange& range) const {
  return number_of(required(key, range.words), key, range, "");
}

std::int64_t TomlTable::integer(const char* key, std::int64_t min, std::int64_t max) const {
  return integer_of(required(key, integer_words(min, max)), key, min, max, "");
}

std::array<double, 3> TomlTable::axes(const char* key, const NumberRange& range) const {
  const toml::array& array = array_of(key, 3, std::string("three times ") + range.words);
  std::array<double, 3> result{};
  for (std::size_t i = 0; i < 3; ++i) {
    result[i] = number_of(array[i], key, range, place_of(i));
  }
  return result;
}

std::array<double, 3> TomlTable::axes_or_number(const char* key, const NumberRange& range) const {
  if (const toml::node* node = table_.get(key); node != nullptr && node->is_array()) {
    return axes(key, range);
  }
  const double all = number(key, range);
  return {all, all, all};
}

std::vector<std::int64_t> TomlTable::integers(const char* key, std::size_t count, std::int64_t min,
                                              std::int64_t max) const {
  const std::string words = (count == 3   ? std::string("three")
                             : count == 6 ? std::string("six")
                                          : std::to_string(count)) +
                            " times " + integer_words(min, max);
  const toml::array& array = array_of(key, count, words);
  std::vector<std::int64_t> result;
  for (std::size_t i = 0; i < count; ++i) {
    result.push_back(integer_of(array[i], key, min, max, place_of(i)));
  }
  return result;
}

std::string TomlTable::text_or(const char* key, const std::string& otherwise) const {
  return has(key) ? text(key) : otherwise;
}

bool TomlTable::flag_or(const char* key, bool otherwise) const {
  return has(key) ? flag(key) : otherwise;
}

double TomlTable::number_or(const char* key, const NumberRange& range, double otherwise) const {
  return has(key) ? number(key, range) : otherwise;
}

std::int64_t TomlTable::integer_or(const char* key, std::int64_t min, std::int64_t max,
                                   std::int64_t otherwise) const {
  return has(key) ? integer(key, min, max) : otherwise;
}

std::array<double, 3> TomlTable::axes_or(const char* key, const NumberRange& range,
                                         const std::array<double, 3>& otherwise) const {
  return has(key) ? axes(key, range) : otherwise;
}

void TomlTable::refuse(std::string_view key, const std::string& problem,
                       const std::string& remedy) const {
  fail(file_, line_of(key), full(key), problem, remedy);
}

std::string TomlTable::full(std::string_view key) const {
  return path_.empty() ? std::string(key) : path_ + "." + std::string(key);
}

std::uint32_t TomlTable::table_line() const { return std::max(table_.source().begin.line, 1U); }

const toml::node& TomlTable::required(const char* key, const std::string& what) const {
  const toml::node* node = table_.get(key);
  if (node == nullptr) {
    fail(file_, table_line(), full(key), "missing", "write " + what);
  }
  return *node;
}

const toml::array& TomlTable::array_of(const char* key, std::size_t size,
                                       const std::string& words) const {
  const auto* array = required(key, words + " in brackets").as_array();
  if (array == nullptr) {
    refuse(key, "wrong type", "write " + words + ", in brackets");
  }
  if (array->size() != size) {
    refuse(key, "it has " + std::to_string(array->size()) + " elements",
           "write " + words + ", in brackets");
  }
  return *array;
}

double TomlTable::number_of(const toml::node& node, const char* key, const NumberRange& range,
                            const std::string& place) const {
  double value = 0.0;
  if (const auto* real = node.as_floating_point()) {
    value = real->get();
  } else if (const auto* whole = node.as_integer()) {
    value = static_cast<double>(whole->get());
  } else {
    refuse(key, "wrong type" + place, std::string("write ") + range.words);
  }
  if (!std::isfinite(value)) {
    refuse(key, "not finite" + place, std::string("write ") + range.words);
  }
  if (value < range.min || value > range.max) {
    refuse(key, number_text(value) + place + " is impossible", std::string("write ") + range.words);
  }
  return value;
}

std::int64_t TomlTable::integer_of(const toml::node& node, const char* key, std::int64_t min,
                                   std::int64_t max, const std::string& place) const {
  const auto* whole = node.as_integer();
  if (whole == nullptr) {
    refuse(key, "wrong type" + place, "write " + integer_words(min, max));
  }
  if (whole->get() < min || whole->get() > max) {
    refuse(key, std::to_string(whole->get()) + place + " is impossible",
           "write " + integer_words(min, max));
  }
  return whole->get();
}

}  // namespace forcegrid::text
