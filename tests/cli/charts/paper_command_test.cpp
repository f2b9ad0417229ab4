// SPDX-License-Identifier: Apache-2.0
// `forcegrid paper` as its user starts it; the experiments themselves are tested on small objects.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <csignal>
#include <filesystem>

#include "tests/support/program.h"

namespace forcegrid {
namespace {

using testing::fresh_folder;
using ::testing::HasSubstr;
using testing::Program;

TEST(PaperCommand, NamesAFolderThatItCantUseBeforeItBegins) {
  Program paper = Program::forcegrid({"paper", "--quick", "--out", "/dev/null/paper"});
  EXPECT_EQ(paper.wait(std::chrono::seconds(20)), 1);
  EXPECT_THAT(paper.standard_error(), HasSubstr("/dev/null/paper"));
}

TEST(PaperCommand, NeedsAFolderAndANumberOfThreadsThatThereCanBe) {
  Program without = Program::forcegrid({"paper"});
  EXPECT_EQ(without.wait(), 2);
  EXPECT_THAT(without.standard_error(), HasSubstr("--out"));
  Program jobs = Program::forcegrid({"paper", "--out", fresh_folder("paper_jobs"), "--jobs", "-1"});
  EXPECT_EQ(jobs.wait(), 2);
  EXPECT_THAT(jobs.standard_error(), HasSubstr("--jobs"));
}

TEST(PaperCommand, EndsSoonAfterCtrlC) {
  const std::string folder = fresh_folder("paper_stopped");
  Program paper =
      Program::forcegrid({"paper", "--quick", "--jobs", "1", "--out", folder, "--cache", folder});
  ASSERT_TRUE(paper.wait_for_text("reference forces of chirp on organ"));
  paper.send_signal(SIGINT);
  EXPECT_EQ(paper.wait(std::chrono::seconds(20)), 130);
  EXPECT_THAT(paper.standard_error(),
              HasSubstr("forcegrid: stopped by SIGINT; what was finished is kept"));
  EXPECT_FALSE(std::filesystem::exists(folder + "/index.html"));
}

}  // namespace
}  // namespace forcegrid
