// SPDX-License-Identifier: Apache-2.0
#pragma once

namespace forcegrid::cli {

/// The project's version, e.g. "0.2.0". Static text.
const char* program_version() noexcept;

/// The commit that the program was built from: twelve hexadecimal digits, followed by "-changed" if
/// files differed from that commit; "unknown" if the sources were not a git checkout. Static text.
const char* program_commit() noexcept;

}  // namespace forcegrid::cli
