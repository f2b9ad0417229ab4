// SPDX-License-Identifier: Apache-2.0
#include "text/toml_parser.h"

#include <algorithm>
#include <fstream>
#include <iterator>

#include "text/file_kind.h"

namespace forcegrid::text {
namespace {

std::string read_ascii(const std::string& file) {
  const std::string why_not = why_no_file(file);
  if (!why_not.empty()) {
    throw TomlError(file + ": " + why_not + "; write the path of a TOML file");
  }
  std::ifstream stream(file, std::ios::binary);
  const std::string text{std::istreambuf_iterator<char>(stream), {}};
  if (!stream) {
    throw TomlError(file + ": can't be read; make the file readable");
  }
  const auto odd = std::find_if(text.begin(), text.end(), [](char c) {
    return static_cast<unsigned char>(c) > 0x7E || c == '\0';
  });
  if (odd != text.end()) {
    throw TomlError(file + ":" + std::to_string(1 + std::count(text.begin(), odd, '\n')) +
                    ": a character that is not ASCII; write it in ASCII");
  }
  return text;
}

}  // namespace

toml::table read_toml_file(const std::string& file) {
  const std::string text = read_ascii(file);
  try {
    return toml::parse(text, file);
  } catch (const toml::parse_error& problem) {
    throw TomlError(file + ":" + std::to_string(problem.source().begin.line) + ": " +
                    std::string(problem.description()) + "; correct the TOML syntax");
  } catch (const TomlAssertion&) {
    throw TomlError(file +
                    ": a key or table name has a character that TOML does not allow there; "
                    "use letters, digits, - and _");
  }
}

}  // namespace forcegrid::text
