// SPDX-License-Identifier: Apache-2.0
#include "text/secret_file.h"

#include <fcntl.h>
#include <gtest/gtest.h>

#include <cstdlib>
#include <string>

namespace forcegrid::text {
namespace {

std::string fault_of(int descriptor) {
  return fault_of_secret_file("it's mine", descriptor, "make one", "open the door");
}

TEST(SecretFile, IsOfItsOwnerAlone) {
  std::string name = ::testing::TempDir() + "secret_file_XXXXXX";
  const int file = ::mkostemp(name.data(), O_CLOEXEC);
  ASSERT_GE(file, 0);
  ::unlink(name.c_str());
  for (const mode_t mode : {0600, 0400, 0700}) {
    ASSERT_EQ(::fchmod(file, mode), 0);
    EXPECT_EQ(fault_of(file), "") << mode;
  }
  for (const mode_t mode : {0640, 0620, 0610, 0604, 0602, 0601}) {
    ASSERT_EQ(::fchmod(file, mode), 0);
    EXPECT_NE(fault_of(file), "") << mode;
  }
  ASSERT_EQ(::fchmod(file, 0644), 0);
  EXPECT_EQ(fault_of(file),
            "its mode 0644 opens it to others, and whoever has the key can open the door; run: "
            "chmod 600 'it'\\''s mine', and make a new key if others could have read this one");
  ::close(file);
  EXPECT_EQ(fault_of(file), "look at its mode: Bad file descriptor");
}

TEST(SecretFile, IsRegular) {
  const int folder = ::open("/", O_RDONLY | O_CLOEXEC);
  ASSERT_GE(folder, 0);
  EXPECT_EQ(fault_of(folder), "is not a regular file; make one");
  ::close(folder);
}

}  // namespace
}  // namespace forcegrid::text
