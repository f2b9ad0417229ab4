// SPDX-License-Identifier: Apache-2.0
#include "cli/common/help_columns.h"

#include <algorithm>
#include <string_view>

namespace forcegrid::cli {
namespace {

constexpr std::size_t kOptionIndent = 2;
constexpr std::size_t kHanging = 4;

// Where the rest of a line goes: below its description, or below its own begin and a little in.
std::size_t indent_of(std::string_view line, std::size_t column) {
  const std::size_t begin = std::min(line.find_first_not_of(' '), line.size());
  if (begin >= column || begin < kOptionIndent) {
    return begin + (begin > column ? kHanging : 0);  // in a description: a list, as of devices
  }
  // The help of all commands at once has those of a subcommand farther in.
  const std::size_t description = column + begin - kOptionIndent;
  const bool is_there =
      line.size() > description && line[description] != ' ' && line[description - 1] == ' ';
  return is_there ? description : begin + kHanging;
}

// How much of a line of more than kHelpColumns characters comes first.
std::size_t first_part(std::string_view line, std::size_t indent) {
  const std::string_view fitting = line.substr(0, kHelpColumns);
  const std::size_t blank = line[kHelpColumns] == ' ' ? kHelpColumns : fitting.rfind(' ');
  if (blank != std::string_view::npos && blank > indent) {
    return blank;
  }
  const std::size_t comma = fitting.rfind(',');
  return comma != std::string_view::npos && comma > indent ? comma + 1 : kHelpColumns;
}

}  // namespace

std::string wrapped_help(const std::string& help, std::size_t column) {
  std::string text;
  for (std::size_t at = 0; at < help.size();) {
    const std::size_t end = std::min(help.find('\n', at), help.size());
    std::string line = help.substr(at, end - at);
    const std::size_t indent = indent_of(line, column);
    while (line.size() > kHelpColumns) {
      const std::size_t part = first_part(line, indent);
      text += line.substr(0, part) + "\n";
      line.erase(0, part);
      line.erase(0, std::min(line.find_first_not_of(' '), line.size()));
      line.insert(0, indent, ' ');
    }
    text += line;
    text += end < help.size() ? "\n" : "";
    at = end + 1;
  }
  return text;
}

}  // namespace forcegrid::cli
