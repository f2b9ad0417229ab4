// SPDX-License-Identifier: Apache-2.0
#include "text/file_kind.h"

#include <gtest/gtest.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/un.h>
#include <unistd.h>

#include <cstring>
#include <filesystem>
#include <fstream>
#include <string>

namespace forcegrid::text {
namespace {

TEST(FileKind, SaysWhatStandsInAFilesPlace) {
  const std::string folder = ::testing::TempDir() + "file_kind_" + std::to_string(getpid());
  std::filesystem::create_directory(folder);
  EXPECT_EQ(why_no_file(folder), "a folder, not a file");
  EXPECT_EQ(why_no_file(folder + "/nothing"), "no such file");
  EXPECT_EQ(why_no_file(""), "no such file");
  EXPECT_EQ(why_no_file("/dev/null"), "a device, not a file");

  const std::string file = folder + "/file";
  std::ofstream(file) << "text";
  EXPECT_EQ(why_no_file(file), "");
  EXPECT_EQ(why_no_file(file + "/below"), "no such file");
  std::filesystem::create_symlink(file, folder + "/link");
  EXPECT_EQ(why_no_file(folder + "/link"), "");
  std::filesystem::create_symlink(folder + "/link_to_itself", folder + "/link_to_itself");
  EXPECT_EQ(why_no_file(folder + "/link_to_itself"), "Too many levels of symbolic links");

  ASSERT_EQ(mkfifo((folder + "/pipe").c_str(), 0600), 0);
  EXPECT_EQ(why_no_file(folder + "/pipe"), "a pipe, not a file");

  sockaddr_un address{};
  address.sun_family = AF_UNIX;
  const std::string socket_name = folder + "/socket";
  ASSERT_LT(socket_name.size(), sizeof address.sun_path);
  std::strcpy(address.sun_path, socket_name.c_str());
  const int socket = ::socket(AF_UNIX, SOCK_STREAM, 0);
  ASSERT_EQ(bind(socket, reinterpret_cast<const sockaddr*>(&address), sizeof address), 0);
  EXPECT_EQ(why_no_file(socket_name), "a socket, not a file");
  ::close(socket);
  std::filesystem::remove_all(folder);
}

}  // namespace
}  // namespace forcegrid::text
