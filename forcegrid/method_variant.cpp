// SPDX-License-Identifier: Apache-2.0
#include "forcegrid/method_variant.h"

#include <charconv>
#include <cmath>
#include <initializer_list>
#include <sstream>
#include <stdexcept>
#include <utility>

#include "forcegrid/methods.h"
#include "forcegrid/pair_methods.h"

namespace forcegrid {
namespace {

[[noreturn]] void refuse(const std::string& word, const std::string& remedy) {
  throw std::invalid_argument("method option '" + word + "': " + remedy);
}

// The number at the front of `text`; what follows it goes to `rest`.
double number(const std::string& word, std::string_view text, std::string_view& rest) {
  double value = 0.0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error != std::errc() || !std::isfinite(value)) {
    refuse(word, "'" + std::string(text) + "' is not a number");
  }
  rest = text.substr(static_cast<std::size_t>(end - text.data()));
  return value;
}

double plain_number(const std::string& word, std::string_view text) {
  std::string_view rest;
  const double value = number(word, text, rest);
  if (!rest.empty()) {
    refuse(word, "'" + std::string(rest) + "' after the number is not understood");
  }
  return value;
}

double positive(const std::string& word, double value) {
  if (!(value > 0.0)) {
    refuse(word, "has to be above zero");
  }
  return value;
}

double length_m(const std::string& word, std::string_view text) {
  std::string_view unit;
  const double value = number(word, text, unit);
  if (unit == "mm") {
    return positive(word, 1e-3 * value);
  }
  if (unit == "m") {
    return positive(word, value);
  }
  refuse(word, "give a length with its unit, m or mm, e.g. 2mm");
}

int whole_number(const std::string& word, std::string_view text, int low, int high) {
  int value = 0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error != std::errc() || end != text.data() + text.size() || value < low || value > high) {
    refuse(word, "use a whole number from " + std::to_string(low) + " to " + std::to_string(high));
  }
  return value;
}

template <typename Value>
Value choice(const std::string& word, std::string_view text,
             std::initializer_list<std::pair<std::string_view, Value>> known) {
  std::string names;
  for (const auto& [name, value] : known) {
    if (name == text) {
      return value;
    }
    names += (names.empty() ? "" : ", ") + std::string(name);
  }
  refuse(word, "use one of: " + names);
}

void set_option(MethodOptions& options, const std::string& method, const std::string& word) {
  const std::size_t equals = word.find('=');
  const std::string key = word.substr(0, equals);
  if (equals == std::string::npos) {
    refuse(word, "has no value; write " + key + "=VALUE");
  }
  const std::string_view value = std::string_view(word).substr(equals + 1);
  if (key == "unit") {
    if (value == "m") {
      options.unit_m = 1.0;
    } else if (value == "mm") {
      options.unit_m = 1e-3;
    } else if (value == "cells") {
      options.grid.check();
      options.unit_m = std::cbrt(options.grid.spacing_m().prod());
    } else {
      options.unit_m = length_m(word, value);
    }
  } else if (key == "r") {
    options.influence_radius_m = length_m(word, value);
  } else if (key == "s") {
    options.samples_per_cell = whole_number(word, value, 0, 65535);
  } else if (key == "weight") {
    options.weight = choice<WeightKind>(word, value,
                                        {{"paper", WeightKind::kPaper},
                                         {"idw4", WeightKind::kInverse4},
                                         {"idw6", WeightKind::kInverse6}});
  } else if (key == "read") {
    options.interpolation = choice<Interpolation>(
        word, value,
        {{"trilinear", Interpolation::kTrilinear}, {"tricubic", Interpolation::kTricubic}});
  } else if (key == "storage") {
    options.storage = choice<GridStorage>(word, value,
                                          {{"dense", GridStorage::kDense},
                                           {"blocks", GridStorage::kBlocks},
                                           {"adaptive", GridStorage::kAdaptive}});
  } else if (key == "pool") {
    options.pool_blocks = whole_number(word, value, 1, 1 << 22);
  } else if (key == "cells") {
    std::string_view rest = value;
    for (int axis = 0; axis < 3; ++axis) {
      const std::size_t comma = rest.find(',');
      options.grid.cells[axis] = whole_number(word, rest.substr(0, comma), 1, 4096);
      if (comma != std::string_view::npos) {
        rest = rest.substr(comma + 1);
      } else if (axis == 0) {
        options.grid.cells.setConstant(options.grid.cells[0]);
        break;
      } else if (axis == 1) {
        refuse(word, "give one number, or three: X,Y,Z");
      }
    }
  } else if (key == "ridge") {
    options.ridge = positive(word, plain_number(word, value));
  } else if (key == "nug") {
    options.nugget = positive(word, plain_number(word, value));
  } else if (key == "samples") {
    const bool many = method == "kriging-store" || method == "forcegrid-kriging" ||
                      method == "kriging-6d" || method == "auto-6d";
    options.samples = whole_number(word, value, 2, many ? 48 : 32);
  } else if (key == "spacing") {
    options.spacing_m = length_m(word, value);
  } else if (key == "spacing_N") {
    options.spacing_N = positive(word, plain_number(word, value));
  } else if (key == "h") {
    options.vertex_spacing_m = length_m(word, value);
  } else if (key == "budget") {
    options.budget_reads = positive(word, plain_number(word, value));
  } else {
    refuse(word,
           "known keys are unit, r, s, weight, read, storage, pool, cells, ridge, nug, samples, "
           "spacing, spacing_N, h, budget");
  }
}

// @param check throws for a name that is not known.
MethodVariant parse(std::string_view text, const MethodOptions& base, const std::string& known,
                    void (*check)(const std::string& name)) {
  std::istringstream words{std::string{text}};
  MethodVariant variant;
  variant.options = base;
  if (!(words >> variant.name)) {
    throw std::invalid_argument("a method has no name; " + known);
  }
  check(variant.name);
  variant.text = variant.name;
  for (std::string word; words >> word;) {
    set_option(variant.options, variant.name, word);
    variant.text += " " + word;
  }
  return variant;
}

}  // namespace

MethodVariant parse_method_variant(std::string_view text, const MethodOptions& base) {
  return parse(text, base, known_methods(), check_method_name);
}

MethodVariant parse_pair_variant(std::string_view text, const MethodOptions& base) {
  return parse(text, base, known_pair_methods(), check_pair_method_name);
}

}  // namespace forcegrid
