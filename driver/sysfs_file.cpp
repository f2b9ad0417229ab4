// SPDX-License-Identifier: Apache-2.0
#include "driver/sysfs_file.h"

#include <fstream>

namespace forcegrid::driver {

std::string first_line(const std::filesystem::path& file) {
  std::ifstream stream(file);
  std::string line;
  std::getline(stream, line);
  return line;
}

}  // namespace forcegrid::driver
