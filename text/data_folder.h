// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

namespace forcegrid::text {

/// Where one kind of TOML file that comes with the program is found: profiles, scenes.
struct DataFolder {
  const char* variable;       ///< environment: folders separated by ':', looked at first
  const char* installed;      ///< folder below share/forcegrid of the installed program
  std::string source_folder;  ///< in the source tree, looked at last
};

/// The file `name`.toml in the first folder that has it; empty: none has. Real-time: no.
/// Threads: any.
std::string find_data_file(const DataFolder& folder, const std::string& name);

/// Names of all TOML files in the folders, sorted, each once.
std::vector<std::string> data_names(const DataFolder& folder);

/// Whether `name_or_path` is meant as a path: it has a slash or ends in ".toml".
bool is_data_path(const std::string& name_or_path);

}  // namespace forcegrid::text
