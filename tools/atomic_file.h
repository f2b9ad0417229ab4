// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>
#include <stdexcept>
#include <string>

namespace forcegrid::tools {

/// A file can't be replaced. what() names the file, the system's reason and the remedy.
class AtomicFileError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

/// Replaces the content of `file` atomically and creates its folder if necessary. At any time, also
/// after a power failure, a reader finds either the complete old content or the complete new one:
/// the new file is written beside the old one, synced to disk and renamed. The old content remains
/// as FILE.old.
/// @param check inspects the new file before it replaces the old one; if it throws, nothing is
///         replaced.
/// @throws AtomicFileError; `file` is then unchanged.
/// Real-time: no. Threads: any, but at most one at a time per file.
void replace_file(const std::string& file, const std::string& text,
                  const std::function<void(const std::string& written)>& check);

}  // namespace forcegrid::tools
