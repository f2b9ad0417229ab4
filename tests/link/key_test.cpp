// SPDX-License-Identifier: Apache-2.0
#include "link/key.h"

#include <fcntl.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <sstream>

#include "tests/link/counting_key.h"

namespace forcegrid::link {
namespace {

using testing::AllOf;
using testing::HasSubstr;

/// The key of counting_key(), its id worked out with Python's hashlib.blake2b.
constexpr const char* kLine =
    "forcegrid-link-key-1 0af94caac92e9cd0 "
    "000102030405060708090a0b0c0d0e0f101112131415161718191a1b1c1d1e1f\n";

class LinkKeyFile : public testing::Test {
 public:
  ~LinkKeyFile() override {
    std::error_code ignored;
    std::filesystem::remove_all(folder_, ignored);
  }

 protected:
  LinkKeyFile() {
    std::string name = testing::TempDir() + "forcegrid_key_XXXXXX";
    folder_ = ::mkdtemp(name.data());
  }

  std::string write(const std::string& text, mode_t mode = 0600) const {
    const std::string file = path();
    std::ofstream(file) << text;
    ::chmod(file.c_str(), mode);
    return file;
  }
  std::string path() const { return folder_ + "/link.key"; }

  static std::string refusal(const std::string& file) {
    try {
      return "loaded " + to_string(LinkKey::load(file).id());
    } catch (const LinkError& error) {
      return error.what();
    }
  }

  std::string folder_;
};

std::string text_of(const std::string& file) {
  std::ostringstream text;
  text << std::ifstream(file).rdbuf();
  return text.str();
}

TEST_F(LinkKeyFile, IsReadWithItsIdAndSecret) {
  const LinkKey key = LinkKey::load(write(kLine));
  EXPECT_EQ(to_string(key.id()), "0af94caac92e9cd0");
  for (std::size_t i = 0; i < kKeyBytes; ++i) {
    EXPECT_EQ(key.secret()[i], i);
  }
}

TEST_F(LinkKeyFile, OfANewKeyIsTheOwnersAloneAndCanBeLoaded) {
  const KeyId id = LinkKey::generate(path());
  struct stat status {};
  ASSERT_EQ(::stat(path().c_str(), &status), 0);
  EXPECT_EQ(status.st_mode & 07777U, 0600U);
  EXPECT_EQ(LinkKey::load(path()).id(), id);
}

TEST_F(LinkKeyFile, HoldsAnotherKeyEachTime) {
  const KeyId first = LinkKey::generate(path());
  const KeyId second = LinkKey::generate(path() + "2");
  EXPECT_NE(first, second);
  EXPECT_NE(text_of(path()).substr(38), text_of(path() + "2").substr(38));
}

TEST_F(LinkKeyFile, IsNeverOverwritten) {
  const std::string file = write("mine");
  try {
    LinkKey::generate(file);
    FAIL() << "it was overwritten";
  } catch (const LinkError& error) {
    EXPECT_THAT(error.what(), AllOf(HasSubstr(file), HasSubstr("is not overwritten")));
  }
  EXPECT_EQ(text_of(file), "mine");
  const std::string dangling = path() + ".link";
  ASSERT_EQ(::symlink((path() + ".elsewhere").c_str(), dangling.c_str()), 0);
  EXPECT_THROW(LinkKey::generate(dangling), LinkError);
  EXPECT_FALSE(std::filesystem::exists(path() + ".elsewhere"));
}

TEST_F(LinkKeyFile, OpenToOthersIsRefusedWithTheCommandThatClosesIt) {
  for (const mode_t mode : {0640, 0604, 0660, 0644, 0620, 0601}) {
    EXPECT_THAT(refusal(write(kLine, mode)),
                AllOf(HasSubstr("run: chmod 600 '" + path() + "'"), HasSubstr("mode 06")))
        << mode;
  }
  EXPECT_EQ(refusal(write(kLine, 0400)), "loaded 0af94caac92e9cd0");
}

TEST_F(LinkKeyFile, ThatIsNoneIsRefused) {
  EXPECT_THAT(refusal(path()), AllOf(HasSubstr("No such file"), HasSubstr("forcegrid keygen")));
  EXPECT_THAT(refusal(folder_), HasSubstr("not a regular file"));
  ASSERT_EQ(::mkfifo((path() + ".pipe").c_str(), 0600), 0);
  EXPECT_THAT(refusal(path() + ".pipe"), HasSubstr("not a regular file"));
}

TEST_F(LinkKeyFile, WithAnythingButOneKeyIsRefusedAndNotShown) {
  const std::string line = kLine;
  const std::string no_hex = std::string(line).replace(40, 1, "g");
  const std::string spaced = std::string(line).replace(40, 1, " ");
  for (const std::string& text :
       {std::string(), line.substr(0, line.size() - 1), line + "\n", line + line,
        "x" + line.substr(1), no_hex, spaced, std::string(line).replace(37, 1, "-")}) {
    const std::string message = refusal(write(text));
    EXPECT_THAT(message, HasSubstr("holds no key")) << text;
    EXPECT_THAT(message, testing::Not(HasSubstr("0102"))) << text;
  }
}

TEST_F(LinkKeyFile, ThatWasDamagedIsRefusedByItsId) {
  std::string line = kLine;
  line[40] = 'a';
  EXPECT_THAT(refusal(write(line)), AllOf(HasSubstr("is damaged"), HasSubstr("0af94caac92e9cd0")));
}

}  // namespace
}  // namespace forcegrid::link
