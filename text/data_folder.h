// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

namespace forcegrid::text {

/// Where to look for one kind of TOML file that comes with the program: profiles or scenes.
struct DataFolder {
  const char* variable;   ///< environment variable: folders separated by ':', searched first
  const char* installed;  ///< folder below share/forcegrid of own_prefix()
  /// In the source tree: searched by a program that is not installed. An installed one must not
  /// read from where it was built, which may by now be anybody's folder.
  std::string source_folder;
};

/// For a library that carries its own data, such as Python's wheel: `share_folder` takes the place
/// of share/forcegrid of own_prefix(). Real-time: no. Threads: before all other calls.
void set_installed_data(const std::string& share_folder);

/// The file `name`.toml in the first folder that has it; empty if no folder has it. Real-time: no.
/// Threads: any.
std::string find_data_file(const DataFolder& folder, const std::string& name);

/// Names of all TOML files in the folders, sorted, each once.
std::vector<std::string> data_names(const DataFolder& folder);

/// Whether `name_or_path` is a path: it has a slash or ends in ".toml".
bool is_data_path(const std::string& name_or_path);

}  // namespace forcegrid::text
