// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

namespace forcegrid::cli {

/// A deprecated spelling of a flag, accepted for one more version. In CLI11 both spellings name the
/// same option; the current one comes first.
struct DeprecatedFlag {
  const char* old_name;  ///< "--shadow"
  const char* name;      ///< "--evaluate"
};

/// Returns the flag that `argument` of the command line gives in its deprecated spelling
/// ("--shadow" or "--shadow=hold"), or null.
const DeprecatedFlag* deprecated_flag(const std::string& argument);

/// Prints to standard error, once per flag, each deprecated spelling on the command line and its
/// replacement.
void note_deprecated_flags(int argc, const char* const* argv);

}  // namespace forcegrid::cli
