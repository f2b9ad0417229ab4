#pragma once

#include <string>

namespace forcegrid::cli {

/// A flag's spelling of an earlier version, which is read for one version more. CLI11 knows both
/// spellings as names of one option; the current one comes first.
struct DeprecatedFlag {
  const char* old_name;  ///< "--shadow"
  const char* name;      ///< "--evaluate"
};

/// The flag that `argument` of the command line spells in the old way ("--shadow" or
/// "--shadow=hold"), or null.
const DeprecatedFlag* deprecated_flag(const std::string& argument);

/// Says on standard error, once for each, which of the command line's flags are spelt in the old
/// way and what to write.
void note_deprecated_flags(int argc, const char* const* argv);

}  // namespace forcegrid::cli
