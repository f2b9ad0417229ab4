// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <stdexcept>
#include <string>

// toml++ 3.3 asserts on some malformed files, "[<" for one; a release build assumes that they do
// not occur. Here its assertions are on in every build and refuse the file. Sources include toml++
// through this header only, so that its inline functions have one definition.
namespace forcegrid::text {
struct TomlAssertion {};
}  // namespace forcegrid::text
#undef NDEBUG
#define TOML_ASSERT(expression) \
  static_cast<void>((expression) || (throw forcegrid::text::TomlAssertion{}, false))
#define TOML_HEADER_ONLY 1
#define TOML_EXCEPTIONS 1
#pragma GCC diagnostic push
#pragma GCC diagnostic ignored \
    "-Wterminate"  // an assertion in a noexcept function ends the program
#include <toml++/toml.h>
#pragma GCC diagnostic pop

namespace forcegrid::text {

/// A TOML file that can't be read or parsed; the text names file, line and remedy.
class TomlError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

/// Reads and parses a whole file in ASCII (toml++ 3.3 cannot cope with some characters beyond it).
/// This header is private: it includes toml++.
/// @throws TomlError when it can't be read, is not ASCII, or is no TOML.
/// Real-time: no. Threads: any.
toml::table read_toml_file(const std::string& file);

}  // namespace forcegrid::text
