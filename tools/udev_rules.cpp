// SPDX-License-Identifier: Apache-2.0
#include "tools/udev_rules.h"

#include <fnmatch.h>

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <map>

namespace forcegrid::tools {
namespace {

namespace fs = std::filesystem;

constexpr char kOurFile[] = "10-forcegrid.rules";
constexpr unsigned long kOthersMayWrite = 0002;

/// `key op "value"` of a rule, as in ATTRS{idVendor}=="1234".
struct Token {
  std::string key;
  std::string operation;
  std::string value;

  bool matches() const { return operation == "==" || operation == "!="; }
};

bool is_blank(char c) { return c == ' ' || c == '\t' || c == ','; }

std::vector<Token> tokens_of(const std::string& line) {
  std::vector<Token> tokens;
  std::size_t at = 0;
  for (;;) {
    while (at < line.size() && is_blank(line[at])) {
      ++at;
    }
    const std::size_t operation = line.find_first_of("=!+-:", at);
    const std::size_t open = line.find('"', at);
    const std::size_t close = open == std::string::npos ? open : line.find('"', open + 1);
    if (close == std::string::npos || operation > open) {
      return tokens;  // the end, or nothing that udev could read
    }
    Token token{line.substr(at, operation - at), line.substr(operation, open - operation),
                line.substr(open + 1, close - open - 1)};
    for (std::string* text : {&token.key, &token.operation}) {
      while (!text->empty() && is_blank(text->back())) {
        text->pop_back();
      }
    }
    tokens.push_back(std::move(token));
    at = close + 1;
  }
}

std::string hex4(std::uint16_t value) {
  char text[8];
  std::snprintf(text, sizeof text, "%04x", value);
  return text;
}

/// udev's patterns: shell globs, several joined by '|'.
bool fits(const std::string& patterns, const std::string& text) {
  for (std::size_t begin = 0; begin <= patterns.size();) {
    const std::size_t end = std::min(patterns.find('|', begin), patterns.size());
    if (::fnmatch(patterns.substr(begin, end - begin).c_str(), text.c_str(), FNM_CASEFOLD) == 0) {
      return true;
    }
    begin = end + 1;
  }
  return false;
}

/// Whether a condition excludes the node.
bool contradicts(const Token& token, const RuledNode& node) {
  const std::map<std::string, std::string> facts = {
      {"ACTION", "add"},
      {"SUBSYSTEM", node.subsystem},
      {"KERNEL", node.kernel},
      {"ATTR{idVendor}", hex4(node.vendor_id)},
      {"ATTRS{idVendor}", hex4(node.vendor_id)},
      {"ATTR{idProduct}", hex4(node.product_id)},
      {"ATTRS{idProduct}", hex4(node.product_id)},
      {"ENV{ID_VENDOR_ID}", hex4(node.vendor_id)},
      {"ENV{ID_MODEL_ID}", hex4(node.product_id)},
  };
  // A hidraw node has no numbers of its own, they are of its USB device.
  const bool own_attribute = token.key.starts_with("ATTR{id") && node.subsystem != "usb";
  // A node's parents are matched as well: those of a hidraw node are of hid and usb.
  if (token.key == "SUBSYSTEMS") {
    const bool fit = fits(token.value, node.subsystem) || fits(token.value, "usb") ||
                     (node.subsystem == "hidraw" && fits(token.value, "hid"));
    return token.operation == "==" && !fit;
  }
  const auto fact = facts.find(token.key);
  if (fact == facts.end()) {
    return false;
  }
  const bool fit = !own_attribute && fits(token.value, fact->second);
  return fit != (token.operation == "==");
}

bool opens_by_mode(const Token& token) {
  return token.key == "MODE" && !token.matches() &&
         (std::strtoul(token.value.c_str(), nullptr, 8) & kOthersMayWrite) != 0;
}

/// "chmod 666 ...", "chmod a+rw ...", "chmod o=rw ..."
bool opens_by_chmod(const Token& token) {
  const std::size_t at = token.value.find("chmod ");
  if (!token.key.starts_with("RUN") || at == std::string::npos) {
    return false;
  }
  const std::string rest = token.value.substr(at + 6);
  const std::string mode = rest.substr(0, rest.find(' '));
  if (mode.find_first_not_of("01234567") == std::string::npos) {
    return (std::strtoul(mode.c_str(), nullptr, 8) & kOthersMayWrite) != 0;
  }
  const std::size_t sign = mode.find_first_of("+=");
  return sign != std::string::npos && mode.find('w', sign) != std::string::npos &&
         (sign == 0 || mode.substr(0, sign).find_first_of("ao") != std::string::npos);
}

struct Found {
  std::optional<OpenRule> by_mode;
  std::optional<OpenRule> by_chmod;
};

void take_line(const std::string& line, OpenRule place, const RuledNode& node, Found& found) {
  const std::vector<Token> tokens = tokens_of(line);
  for (const Token& token : tokens) {
    if (token.matches() && contradicts(token, node)) {
      return;
    }
  }
  for (const Token& token : tokens) {
    place.assignment = token.key + token.operation + "\"" + token.value + "\"";
    place.final = token.operation == ":=";
    if (opens_by_mode(token) && !(found.by_mode && found.by_mode->final)) {
      found.by_mode = place;
    } else if (opens_by_chmod(token)) {
      found.by_chmod = place;
    }
  }
}

void take_file(const fs::path& file, const RuledNode& node, Found& found) {
  std::ifstream stream(file);
  std::string rule;
  int begins = 0;
  int number = 0;
  for (std::string line; std::getline(stream, line);) {
    ++number;
    const std::size_t text = line.find_first_not_of(" \t");
    if (text == std::string::npos || line[text] == '#') {
      continue;
    }
    begins = rule.empty() ? number : begins;
    if (line.back() == '\\') {
      rule += line.substr(0, line.size() - 1);
      continue;
    }
    take_line(rule + line,
              {.file = file.string(),
               .line = begins,
               .assignment = "",
               .before_ours = file.filename() < fs::path(kOurFile)},
              node, found);
    rule.clear();
  }
}

}  // namespace

std::optional<OpenRule> rule_that_opens(const RuledNode& node,
                                        const std::vector<std::string>& folders) {
  std::map<std::string, fs::path> files;  // by their names, as udev reads them
  for (const std::string& folder : folders) {
    std::error_code error;
    for (const auto& entry : fs::directory_iterator(folder, error)) {
      if (entry.path().extension() == ".rules") {
        files.emplace(entry.path().filename().string(), entry.path());
      }
    }
  }
  Found found;
  for (const auto& [name, file] : files) {
    take_file(file, node, found);
  }
  return found.by_mode ? found.by_mode : found.by_chmod;
}

}  // namespace forcegrid::tools
