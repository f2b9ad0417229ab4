// SPDX-License-Identifier: Apache-2.0
#include "view/private_folder.h"

#include <sys/un.h>

#include <cerrno>
#include <cstdlib>
#include <cstring>
#include <filesystem>

#include "view/options.h"

namespace forcegrid::view {
namespace {

constexpr char kTemplate[] = "/forcegrid-view-XXXXXX";
constexpr std::size_t kLongestName = sizeof("/simulator");  // of a socket in it, with its end
static_assert(sizeof(sockaddr_un::sun_path) > sizeof("/tmp") + sizeof(kTemplate) + kLongestName);

// A socket's path has at most 107 bytes: a longer runtime folder is of no use.
std::string parent_folder() {
  std::error_code error;
  const char* runtime = std::getenv("XDG_RUNTIME_DIR");
  const bool usable =
      runtime != nullptr && runtime[0] == '/' &&
      std::strlen(runtime) + sizeof(kTemplate) + kLongestName < sizeof(sockaddr_un::sun_path) &&
      std::filesystem::is_directory(runtime, error);
  return usable ? runtime : "/tmp";
}

}  // namespace

PrivateFolder::PrivateFolder() : path_(parent_folder() + kTemplate) {
  if (::mkdtemp(path_.data()) == nullptr) {
    throw ViewError("cannot make the folder " + path_ + ": " + std::strerror(errno));
  }
}

PrivateFolder::~PrivateFolder() {
  std::error_code error;
  std::filesystem::remove_all(path_, error);
}

}  // namespace forcegrid::view
