#pragma once

namespace forcegrid::cli {

/// What was built: the project's version, as "0.2.0". Static text.
const char* program_version() noexcept;

/// The commit that it was built from, twelve hexadecimal digits, followed by "-changed" where files
/// differed from it; "unknown" where the sources were no git checkout. Static text.
const char* program_commit() noexcept;

}  // namespace forcegrid::cli
