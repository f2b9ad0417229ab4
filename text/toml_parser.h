// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <stdexcept>
#include <string>

// toml++ 3.3 asserts on some malformed files, "[<" for one, and in a release build takes it for
// granted that they don't occur. Here its assertions are on in every build and refuse the file.
// Sources include toml++ through this header only, so that its inline functions have one meaning.
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

/// Reads and parses a whole file in ASCII (toml++ 3.3 gets lost in some characters beyond it).
/// A private header: it brings toml++ with it.
/// @throws TomlError when it can't be read, is not ASCII, or is no TOML.
/// Real-time: no. Threads: any.
toml::table read_toml_file(const std::string& file);

}  // namespace forcegrid::text
