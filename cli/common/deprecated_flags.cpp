// SPDX-License-Identifier: Apache-2.0
#include "cli/common/deprecated_flags.h"

#include <cstring>
#include <set>

#include "log/log.h"

namespace forcegrid::cli {
namespace {

constexpr DeprecatedFlag kFlags[] = {{"--shadow", "--evaluate"}, {"--no-truth", "--no-reference"}};

}  // namespace

const DeprecatedFlag* deprecated_flag(const std::string& argument) {
  const std::string name = argument.substr(0, argument.find('='));
  for (const DeprecatedFlag& flag : kFlags) {
    if (name == flag.old_name) {
      return &flag;
    }
  }
  return nullptr;
}

void note_deprecated_flags(int argc, const char* const* argv) {
  std::set<const DeprecatedFlag*> noted;
  for (int i = 1; i < argc && std::strcmp(argv[i], "--") != 0; ++i) {
    const DeprecatedFlag* const flag = deprecated_flag(argv[i]);
    if (flag != nullptr && noted.insert(flag).second) {
      log::warn("command", std::string(flag->old_name) +
                               " is deprecated and will be removed in version 0.3; write " +
                               flag->name);
    }
  }
}

}  // namespace forcegrid::cli
