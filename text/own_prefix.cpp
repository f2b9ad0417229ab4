// SPDX-License-Identifier: Apache-2.0
#include "text/own_prefix.h"

#include <dlfcn.h>
#include <link.h>

#include <filesystem>

namespace forcegrid::text {

namespace fs = std::filesystem;

std::string own_file() {
  Dl_info info{};
  void* extra = nullptr;
  std::error_code error;
  if (::dladdr1(reinterpret_cast<const void*>(&own_file), &info, &extra, RTLD_DL_LINKMAP) != 0 &&
      extra != nullptr) {
    // The program's own name is empty there, and its file is what it was called by.
    const char* name = static_cast<const link_map*>(extra)->l_name;
    if (name != nullptr && *name != '\0') {
      const fs::path file = fs::canonical(name, error);
      if (!error) {
        return file.string();
      }
    }
  }
  return fs::read_symlink("/proc/self/exe", error).string();
}

std::string own_prefix() {
  for (fs::path folder = fs::path(own_file()).parent_path(); folder.has_relative_path();
       folder = folder.parent_path()) {
    const fs::path name = folder.filename();
    if (name == "bin" || name == "lib" || name == "lib64") {
      return folder.parent_path().string();
    }
  }
  return {};
}

}  // namespace forcegrid::text
