// SPDX-License-Identifier: Apache-2.0
#include "text/output_file.h"

#include <gtest/gtest.h>
#include <sys/wait.h>
#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <iterator>
#include <stdexcept>
#include <string>

namespace forcegrid::text {
namespace {

namespace fs = std::filesystem;

class OutputFileTest : public ::testing::Test {
 public:
  OutputFileTest() {
    fs::remove_all(folder_);
    fs::create_directories(folder_);
    std::ofstream(file_) << "old";
  }
  ~OutputFileTest() override { fs::remove_all(folder_); }

 protected:
  static std::string content(const fs::path& file) {
    std::ifstream stream(file);
    return {std::istreambuf_iterator<char>(stream), {}};
  }
  std::ptrdiff_t files() const { return std::distance(fs::directory_iterator(folder_), {}); }

  fs::path folder_ = fs::path(::testing::TempDir()) / ("output_file_" + std::to_string(::getpid()));
  fs::path file_ = folder_ / "result.csv";
};

TEST_F(OutputFileTest, ReplacesTheOldContentOnlyWhenItIsFinished) {
  {
    OutputFile output(file_);
    output.stream() << "new" << std::flush;
    EXPECT_EQ(content(file_), "old");
  }
  EXPECT_EQ(content(file_), "old");
  EXPECT_EQ(files(), 1) << "the partial file is removed";
  OutputFile output(file_);
  output.stream() << "new";
  output.finish();
  EXPECT_EQ(content(file_), "new");
  EXPECT_EQ(files(), 1);
}

TEST_F(OutputFileTest, FollowsASymbolicLink) {
  fs::create_symlink(file_, folder_ / "link.csv");
  OutputFile output(folder_ / "link.csv");
  output.stream() << "new";
  output.finish();
  EXPECT_TRUE(fs::is_symlink(folder_ / "link.csv"));
  EXPECT_EQ(content(file_), "new");
}

TEST_F(OutputFileTest, WritesDirectlyToWhatIsNoRegularFile) {
  OutputFile output("/dev/null");
  output.stream() << "new";
  output.finish();
  EXPECT_FALSE(fs::is_regular_file("/dev/null"));
}

TEST_F(OutputFileTest, NamesAFileThatCannotBeWritten) {
  try {
    const OutputFile output(folder_ / "nowhere" / "result.csv");
    ADD_FAILURE() << "it was opened";
  } catch (const std::runtime_error& error) {
    EXPECT_NE(std::string(error.what()).find("nowhere/result.csv can't be written (No such file"),
              std::string::npos)
        << error.what();
  }
  OutputFile full("/dev/full");
  full.stream() << "new";
  EXPECT_THROW(full.finish(), std::runtime_error);
}

TEST_F(OutputFileTest, IsRemovedFromAProcessThatEndsAtOnce) {
  const pid_t pid = ::fork();
  if (pid == 0) {
    OutputFile output(file_);
    output.stream() << "half" << std::flush;
    const bool there = files() == 2;
    remove_unfinished_files();
    ::_exit(there ? 0 : 1);
  }
  int status = -1;
  ASSERT_EQ(::waitpid(pid, &status, 0), pid);
  EXPECT_EQ(status, 0) << "there was no partial file to remove";
  EXPECT_EQ(files(), 1);
  EXPECT_EQ(content(file_), "old");
}

}  // namespace
}  // namespace forcegrid::text
