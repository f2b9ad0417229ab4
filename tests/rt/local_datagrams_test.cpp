// SPDX-License-Identifier: Apache-2.0
#include "rt/local_datagrams.h"

#include <gtest/gtest.h>
#include <sys/stat.h>
#include <unistd.h>

#include <array>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <stdexcept>
#include <string>

namespace forcegrid::rt {
namespace {

using Bytes = std::array<std::uint8_t, 4>;

class LocalDatagramsTest : public testing::Test {
 public:
  ~LocalDatagramsTest() override { std::filesystem::remove_all(folder_); }

 protected:
  LocalDatagramsTest() {
    char folder[] = "/tmp/forcegrid_datagrams_XXXXXX";
    EXPECT_NE(::mkdtemp(folder), nullptr);
    folder_ = folder;
  }
  std::string folder_;
};

TEST_F(LocalDatagramsTest, AnswerTheSenderOfTheNewest) {
  LocalDatagrams server(folder_ + "/server");
  LocalDatagrams client(folder_ + "/client");
  Bytes bytes{};
  EXPECT_EQ(server.receive(bytes), -1);
  EXPECT_FALSE(server.reply(Bytes{9})) << "nobody has asked";
  ASSERT_TRUE(client.send(folder_ + "/server", Bytes{1, 2, 3, 4}));
  ASSERT_EQ(server.receive(bytes), 4);
  EXPECT_EQ(bytes, (Bytes{1, 2, 3, 4}));
  ASSERT_TRUE(server.reply(Bytes{5, 6, 7, 8}));
  ASSERT_EQ(client.receive(bytes), 4);
  EXPECT_EQ(bytes, (Bytes{5, 6, 7, 8}));
}

TEST_F(LocalDatagramsTest, TellTheWholeLengthOfWhatIsTooLong) {
  LocalDatagrams server(folder_ + "/server");
  LocalDatagrams client(folder_ + "/client");
  ASSERT_TRUE(client.send(folder_ + "/server", std::array<std::uint8_t, 9>{}));
  Bytes bytes{};
  EXPECT_EQ(server.receive(bytes), 9);
}

TEST_F(LocalDatagramsTest, NameAPathThatCanNotBeBound) {
  const LocalDatagrams first(folder_ + "/one");
  struct stat status {};
  ASSERT_EQ(::stat((folder_ + "/one").c_str(), &status), 0);
  EXPECT_EQ(status.st_mode & 0777U, 0600U);
  for (const std::string& wrong :
       {folder_ + "/one", folder_ + "/none/one", std::string(200, 'x')}) {
    try {
      const LocalDatagrams second(wrong);
      ADD_FAILURE() << wrong;
    } catch (const std::runtime_error& error) {
      EXPECT_NE(std::string(error.what()).find(wrong), std::string::npos) << error.what();
    }
  }
  LocalDatagrams client(folder_ + "/client");
  EXPECT_FALSE(client.send(folder_ + "/nobody", Bytes{}));
}

TEST_F(LocalDatagramsTest, ReplaceASocketWhoseProcessWasKilledAndNoOtherFile) {
  const std::string path = folder_ + "/server";
  sockaddr_un address{};
  address.sun_family = AF_UNIX;
  path.copy(address.sun_path, path.size());
  const int socket = ::socket(AF_UNIX, SOCK_DGRAM | SOCK_CLOEXEC, 0);
  ASSERT_EQ(::bind(socket, reinterpret_cast<const sockaddr*>(&address), sizeof(address)), 0);
  EXPECT_THROW(const LocalDatagrams second(path), std::runtime_error) << "it is in use";
  ::close(socket);
  {
    LocalDatagrams server(path);
    LocalDatagrams client(folder_ + "/client");
    ASSERT_TRUE(client.send(path, Bytes{1}));
    Bytes bytes{};
    EXPECT_EQ(server.receive(bytes), 4);
  }
  std::ofstream(path) << "a person's file";
  EXPECT_THROW(const LocalDatagrams third(path), std::runtime_error);
  EXPECT_EQ(std::filesystem::file_size(path), 15U);
}

}  // namespace
}  // namespace forcegrid::rt
