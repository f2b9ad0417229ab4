// SPDX-License-Identifier: Apache-2.0
#include "text/data_folder.h"

#include <algorithm>
#include <cstdlib>
#include <filesystem>
#include <set>
#include <string_view>

#include "text/own_prefix.h"

namespace forcegrid::text {
namespace {

namespace fs = std::filesystem;

std::string& set_share_folder() {
  static std::string folder;
  return folder;
}

std::vector<fs::path> search_folders(const DataFolder& folder) {
  std::vector<fs::path> folders;
  if (const char* path = std::getenv(folder.variable); path != nullptr) {
    std::string_view rest = path;
    while (!rest.empty()) {
      const std::size_t colon = std::min(rest.find(':'), rest.size());
      if (colon > 0) {
        folders.emplace_back(rest.substr(0, colon));
      }
      rest.remove_prefix(std::min(colon + 1, rest.size()));
    }
  }
  std::error_code error;
  const std::string prefix = own_prefix();
  fs::path share = set_share_folder();
  if (share.empty() && !prefix.empty()) {
    share = fs::path(prefix) / "share/forcegrid";
  }
  const fs::path installed = share / folder.installed;
  if (!share.empty() && fs::is_directory(installed, error)) {
    folders.push_back(installed);
  } else {
    folders.emplace_back(folder.source_folder);
  }
  return folders;
}

}  // namespace

void set_installed_data(const std::string& share_folder) { set_share_folder() = share_folder; }

std::string find_data_file(const DataFolder& folder, const std::string& name) {
  for (const fs::path& each : search_folders(folder)) {
    const fs::path candidate = each / (name + ".toml");
    std::error_code error;
    if (!name.empty() && fs::is_regular_file(candidate, error)) {
      return candidate.string();
    }
  }
  return {};
}

std::vector<std::string> data_names(const DataFolder& folder) {
  std::set<std::string> names;
  for (const fs::path& each : search_folders(folder)) {
    std::error_code error;
    for (const fs::directory_entry& entry : fs::directory_iterator(each, error)) {
      if (entry.path().extension() == ".toml") {
        names.insert(entry.path().stem().string());
      }
    }
  }
  return {names.begin(), names.end()};
}

bool is_data_path(const std::string& name_or_path) {
  return name_or_path.find('/') != std::string::npos || name_or_path.ends_with(".toml");
}

}  // namespace forcegrid::text
