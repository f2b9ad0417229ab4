// SPDX-License-Identifier: Apache-2.0
// `forcegrid exec` around programs that show what they got.
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cstdlib>
#include <string>
#include <vector>

#include "tests/support/program.h"

namespace forcegrid {
namespace {

using ::testing::HasSubstr;
using testing::Program;

constexpr char kFolder[] = "/lib/forcegrid/openhaptics";

TEST(Exec, SetsThePathAndTheDeviceForTheProgram) {
  setenv("LD_LIBRARY_PATH", "/somewhere", 1);
  Program program({FORCEGRID_PROGRAM, "exec", "--device", "falcon", "--", "env"});
  EXPECT_EQ(program.wait(), 0);
  EXPECT_THAT(program.standard_output(), HasSubstr(std::string(kFolder) + ":/somewhere\n"));
  EXPECT_THAT(program.standard_output(), HasSubstr("FORCEGRID_DEVICE=falcon\n"));
}

TEST(Exec, LeavesTheProgramsOwnWordsAndStatusToIt) {
  Program program({FORCEGRID_PROGRAM, "exec", "--", "sh", "-c",
                   "echo \"$@\"; trap | grep -c PIPE; exit 7", "sh", "--config", "nonesuch", "--",
                   "--help", "chart"});
  EXPECT_EQ(program.wait(), 7);
  EXPECT_EQ(program.standard_output(), "--config nonesuch -- --help chart\n0\n");
}

TEST(Exec, SaysWhatIsMissing) {
  Program nothing({FORCEGRID_PROGRAM, "exec"});
  EXPECT_EQ(nothing.wait(), 2);
  EXPECT_THAT(nothing.standard_error(), HasSubstr("exec -- PROGRAM"));
  Program nonesuch({FORCEGRID_PROGRAM, "exec", "--", "forcegrid_nonesuch"});
  EXPECT_EQ(nonesuch.wait(), 127);
  EXPECT_THAT(nonesuch.standard_error(), HasSubstr("forcegrid_nonesuch: No such file"));
}

TEST(Exec, NamesThePackageOfTheLibraries) {
  const std::string bin = testing::fresh_folder("exec") + "/bin";
  Program copies({"sh", "-c", "mkdir " + bin + " && cp '" FORCEGRID_PROGRAM "' " + bin});
  ASSERT_EQ(copies.wait(), 0);
  Program alone({bin + "/forcegrid", "exec", "--", "true"});
  EXPECT_EQ(alone.wait(), 1);
  EXPECT_THAT(alone.standard_error(), HasSubstr("libHD.so"));
  EXPECT_THAT(alone.standard_error(), HasSubstr("install libforcegrid-hd"));
}

}  // namespace
}  // namespace forcegrid
