// SPDX-License-Identifier: Apache-2.0
#include "device_session/program_path.h"

#include <unistd.h>

#include <cstdlib>
#include <filesystem>
#include <sstream>

#include "device_session/device_session.h"
#include "text/own_prefix.h"

namespace forcegrid::session {
namespace {

namespace fs = std::filesystem;

bool runs(const fs::path& file) { return ::access(file.c_str(), X_OK) == 0; }

}  // namespace

std::string forcegrid_program() {
  if (const char* set = std::getenv("FORCEGRID_PROGRAM"); set != nullptr && *set != '\0') {
    if (!runs(set)) {
      throw SessionError(SessionError::Reason::kUnusable,
                         std::string("FORCEGRID_PROGRAM is '") + set +
                             "', which is no program; name the program forcegrid, or unset it");
    }
    return set;
  }
  const std::string prefix = text::own_prefix();
  if (const fs::path program = fs::path(prefix) / "bin/forcegrid";
      !prefix.empty() && runs(program)) {
    return program.string();
  }
  const char* path = std::getenv("PATH");
  std::istringstream folders(path != nullptr ? path : "/usr/local/bin:/usr/bin");
  for (std::string entry; std::getline(folders, entry, ':');) {
    if (!entry.empty() && runs(fs::path(entry) / "forcegrid")) {
      return (fs::path(entry) / "forcegrid").string();
    }
  }
  throw SessionError(SessionError::Reason::kUnusable,
                     "the program forcegrid, which emulates devices, is neither installed beside " +
                         text::own_file() + " nor in PATH; install it, or set FORCEGRID_PROGRAM");
}

}  // namespace forcegrid::session
