// SPDX-License-Identifier: Apache-2.0
#include "cli/common/number_check.h"

#include <cerrno>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <limits>
#include <optional>
#include <string>

#include "cli/common/options.h"

namespace forcegrid::cli {
namespace {

// The sentence after the option's name.
std::string refusal(const std::string& input, const std::string& wanted) {
  return "'" + input + "' can't be used; give " + wanted;
}

// The whole text as a number; nothing: it is none, or too large.
std::optional<double> number_in(const std::string& text, double /*type*/) {
  char* end = nullptr;
  const double value = std::strtod(text.c_str(), &end);
  return !text.empty() && *end == '\0' ? std::optional(value) : std::nullopt;
}

std::optional<std::int64_t> number_in(const std::string& text, std::int64_t /*type*/) {
  constexpr int kAnyBase = 0;  // as CLI11 reads the value afterwards
  char* end = nullptr;
  errno = 0;
  const std::int64_t value = std::strtoll(text.c_str(), &end, kAnyBase);
  return !text.empty() && *end == '\0' && errno == 0 ? std::optional(value) : std::nullopt;
}

template <typename Number>
Check in_range(Number low, Number high, const std::string& low_text, const std::string& high_text,
               const std::string& kind) {
  const std::string wanted = kind + " from " + low_text + " to " + high_text;
  return {[low, high, wanted](const std::string& input) {
            const std::optional<Number> value = number_in(input, Number{});
            // A comparison with NaN is false.
            return value && *value >= low && *value <= high ? std::string()
                                                            : refusal(input, wanted);
          },
          low_text + ".." + high_text};
}

std::string short_text(double value) {
  char text[32];
  std::snprintf(text, sizeof text, "%g", value);
  return text;
}

}  // namespace

Check between(double low, double high) {
  return in_range(low, high, short_text(low), short_text(high), "a number");
}

Check whole_between(std::int64_t low, std::int64_t high) {
  return in_range(low, high, std::to_string(low), std::to_string(high), "a whole number");
}

Check finite_number() {
  return {[](const std::string& input) {
    const std::optional<double> value = number_in(input, 0.0);
    return value && std::isfinite(*value) ? std::string() : refusal(input, "a finite number");
  }};
}

Check seed_number() {
  return {[](const std::string& input) {
    const std::string wanted =
        "a whole number from 0 to " + std::to_string(std::numeric_limits<std::uint64_t>::max());
    // strtoull, which CLI11 uses, wraps a negative number round and caps one that is too large.
    const bool plain = !input.empty() && input.find_first_not_of("0123456789") == std::string::npos;
    return plain && std::to_string(std::strtoull(input.c_str(), nullptr, 10)) == input
               ? std::string()
               : refusal(input, wanted);
  }};
}

}  // namespace forcegrid::cli
