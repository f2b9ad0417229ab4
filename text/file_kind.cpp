// SPDX-License-Identifier: Apache-2.0
#include "text/file_kind.h"

#include <filesystem>
#include <system_error>

namespace forcegrid::text {

std::string why_no_file(const std::string& path) {
  using std::filesystem::file_type;
  std::error_code error;
  const file_type type = std::filesystem::status(path, error).type();
  switch (type) {
    case file_type::regular:
      return "";
    case file_type::not_found:
      return "no such file";
    case file_type::directory:
      return "a folder, not a file";
    case file_type::block:
    case file_type::character:
      return "a device, not a file";
    case file_type::fifo:
      return "a pipe, not a file";
    case file_type::socket:
      return "a socket, not a file";
    default:
      return error ? error.message() : "not a file";
  }
}

}  // namespace forcegrid::text
