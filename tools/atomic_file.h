#pragma once

#include <functional>
#include <stdexcept>
#include <string>

namespace forcegrid::tools {

/// A file that can't be replaced; names it, the system's words and the remedy.
class AtomicFileError : public std::runtime_error {
 public:
  using std::runtime_error::runtime_error;
};

/// Gives `file` another content, making its folder if need be. Who opens it, at any time and after
/// a power failure, finds the old one or the new one whole: it is written beside, brought to the
/// disk and renamed. The old one stays as FILE.old.
/// @param check  looks at the written file before it takes the place; what it throws leaves all as
///               it was.
/// @throws AtomicFileError; `file` is as it was then.
/// Real-time: no. Threads: any, but two for one file get in each other's way.
void replace_file(const std::string& file, const std::string& text,
                  const std::function<void(const std::string& written)>& check);

}  // namespace forcegrid::tools
