// SPDX-License-Identifier: Apache-2.0
#include "link/library_versions.h"

#include <sodium.h>
#include <zlib.h>

namespace forcegrid::link {

std::vector<std::pair<std::string, std::string>> library_versions() {
  return {{"libsodium", sodium_version_string()}, {"zlib", zlibVersion()}};
}

}  // namespace forcegrid::link
