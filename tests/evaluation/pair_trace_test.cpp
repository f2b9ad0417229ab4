// SPDX-License-Identifier: Apache-2.0
#include "evaluation/traces/pair_trace.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <limits>
#include <string>

#include "evaluation/traces/trace.h"
#include "tests/evaluation/pair_ramp.h"

namespace forcegrid::evaluation {
namespace {

using ::testing::HasSubstr;

constexpr char kHeader[] =
    "kind,t_s,delivered_s,p1x_m,p1y_m,p1z_m,p2x_m,p2y_m,p2z_m,f1x_N,f1y_N,f1z_N,f2x_N,f2y_N,f2z_N";

class PairTraceFile : public ::testing::Test {
 public:
  ~PairTraceFile() override { std::filesystem::remove_all(folder_); }

 protected:
  PairTraceFile() {
    std::filesystem::remove_all(folder_);
    std::filesystem::create_directories(folder_);
  }

  std::string file(const std::string& name) const { return (folder_ / name).string(); }

  std::string written(const std::string& text) const {
    std::ofstream(file("trace.csv")) << text;
    return file("trace.csv");
  }

  // What reading a file with this text says.
  std::string refusal(const std::string& text) const {
    try {
      read_pair_trace(written(text));
    } catch (const TraceError& error) {
      return error.what();
    }
    return "it was read";
  }

  const std::filesystem::path folder_ =
      std::filesystem::path(::testing::TempDir()) /
      (std::string("pair_trace_") +
       ::testing::UnitTest::GetInstance()->current_test_info()->name());
};

TEST_F(PairTraceFile, MeansWhatItsColumnsSay) {
  const PairTrace trace = read_pair_trace(
      written(std::string(kHeader) + ",residual\n"
                                     "contact,0,0.01,1,2,3,4,5,6,,,,,,,\n"
                                     "sample,0.5,0.6,.1,.2,.3,.4,.5,.6,1,2,3,4,5,6,1e-3\n"
                                     "servo,0.7,,1,2,3,4,5,6,-1,-2,-3,-4,-5,-6,\n"));
  ASSERT_EQ(trace.samples.size(), 1U);
  ASSERT_EQ(trace.servo.size(), 1U);
  ASSERT_EQ(trace.contacts.size(), 1U);
  const PairVector count = PairVector::LinSpaced(6, 1.0, 6.0);
  EXPECT_EQ(trace.contacts[0].points_W, count);
  EXPECT_EQ(trace.contacts[0].delivered_s, 0.01);
  EXPECT_EQ(trace.samples[0].sample.time_s, 0.5);
  EXPECT_EQ(trace.samples[0].delivered_s, 0.6);
  EXPECT_LT((trace.samples[0].sample.positions_W - 0.1 * count).norm(), 1e-15);
  EXPECT_EQ(trace.samples[0].sample.forces_W, count);
  EXPECT_EQ(trace.samples[0].sample.relative_residual, 1e-3);
  EXPECT_EQ(trace.servo[0].time_s, 0.7);
  EXPECT_EQ(trace.servo[0].positions_W, count);
  EXPECT_EQ(trace.servo[0].forces_W, -count);
}

std::string stiffness_columns() {
  std::string columns;
  for (const char row : std::string("012345")) {
    for (const char column : std::string("012345")) {
      columns += std::string(",j") + row + column + "_N_per_m";
    }
  }
  return columns;
}

TEST_F(PairTraceFile, HasTheStiffnessOfEachSampleOrNone) {
  std::string entries;
  for (int i = 0; i < 36; ++i) {
    entries += "," + std::to_string(i);
  }
  const std::string none(36, ',');
  const std::string header = std::string(kHeader) + stiffness_columns() + "\n";
  const std::string numbers = ".1,.2,.3,.4,.5,.6,1,2,3,4,5,6";
  const PairTrace trace =
      read_pair_trace(written(header + "sample,0.5,0.6," + numbers + entries + "\nsample,0.6,0.7," +
                              numbers + none + "\nservo,0.7,," + numbers + none + "\n"));
  ASSERT_EQ(trace.samples.size(), 2U);
  EXPECT_TRUE(trace.samples[0].sample.has_stiffness);
  EXPECT_FALSE(trace.samples[1].sample.has_stiffness);
  for (int i = 0; i < 36; ++i) {
    EXPECT_EQ(trace.samples[0].sample.stiffness_W(i / 6, i % 6), i);
  }
  write_pair_trace(file("again.csv"), trace);
  const PairTrace again = read_pair_trace(file("again.csv"));
  EXPECT_EQ(again.samples[0].sample.stiffness_W, trace.samples[0].sample.stiffness_W);
  EXPECT_FALSE(again.samples[1].sample.has_stiffness);

  EXPECT_THAT(refusal(header + "sample,0.5,0.6," + numbers + ",1" + none.substr(1) + "\n"),
              HasSubstr("column 'j01_N_per_m': is empty; give all 36 entries of a stiffness"));
  EXPECT_THAT(refusal(std::string(kHeader) + ",j00_N_per_m\n"),
              HasSubstr("'j01_N_per_m': is missing from the header; give all 36 columns"));
}

TEST_F(PairTraceFile, ReadsBackExactlyWhatWasWritten) {
  PairTrace trace = testing::PairRamp().trace();
  trace.contacts = {{0.0, trace.servo.front().positions_W / 3.0, 0.001}};
  for (const char* name : {"trace.csv", "trace.csv.gz"}) {
    write_pair_trace(file(name), trace);
    const PairTrace again = read_pair_trace(file(name));
    ASSERT_EQ(again.servo.size(), trace.servo.size());
    ASSERT_EQ(again.samples.size(), trace.samples.size());
    for (std::size_t i = 0; i < trace.servo.size(); ++i) {
      ASSERT_EQ(again.servo[i].time_s, trace.servo[i].time_s);
      ASSERT_EQ(again.servo[i].positions_W, trace.servo[i].positions_W);
      ASSERT_EQ(again.servo[i].forces_W, trace.servo[i].forces_W);
    }
    for (std::size_t i = 0; i < trace.samples.size(); ++i) {
      ASSERT_EQ(again.samples[i].delivered_s, trace.samples[i].delivered_s);
      ASSERT_EQ(again.samples[i].sample.forces_W, trace.samples[i].sample.forces_W);
    }
    EXPECT_EQ(again.contacts[0].points_W, trace.contacts[0].points_W);
    EXPECT_TRUE(is_pair_trace(file(name)));
  }
}

TEST_F(PairTraceFile, IsToldFromATraceOfOneToolByItsHeader) {
  EXPECT_TRUE(is_pair_trace(written(std::string(kHeader) + "\n")));
  EXPECT_TRUE(is_pair_trace(written("kind,t_s,p1x_m\n")));  // its reader says what is missing
  EXPECT_FALSE(is_pair_trace(written("kind,t_s,delivered_s,x_m,y_m,z_m,fx_N,fy_N,fz_N\n")));
  EXPECT_FALSE(is_pair_trace(file("none.csv")));
}

TEST_F(PairTraceFile, MalformedFilesAreRefusedWithLineAndColumn) {
  const std::string header = std::string(kHeader) + "\n";
  const std::string servo = "servo,1,,1,2,3,4,5,6,1,2,3,4,5,6\n";
  EXPECT_THAT(refusal(""), HasSubstr("is empty; expected the header kind,t_s"));
  EXPECT_THAT(refusal("kind,t_s,delivered_s,p1x_m\n"),
              HasSubstr("line 1: column 'p1y_m': is missing from the header; expected kind,t_s"));
  EXPECT_THAT(refusal(std::string(kHeader) + ",p3x_m\n"), HasSubstr("'p3x_m'; expected kind,t_s"));
  EXPECT_THAT(refusal(header), HasSubstr("has no 'servo' row"));
  EXPECT_THAT(refusal(header + servo + servo),
              HasSubstr("line 3: column 't_s': expected more than 1 s"));
  EXPECT_THAT(refusal(header + "servo,1,,1,2,3,4,5,,1,2,3,4,5,6\n"),
              HasSubstr("line 2: column 'p2z_m': is empty; expected a number"));
  EXPECT_THAT(refusal(header + "servo,1,,1,2,3,4,5,6,1,2,3,4,5,nan\n"),
              HasSubstr("column 'f2z_N': expected a finite number, found 'nan'"));
  EXPECT_THAT(refusal(header + "sample,1,.5,1,2,3,4,5,6,1,2,3,4,5,6\n"),
              HasSubstr("column 'delivered_s': expected 1 s or later"));
  EXPECT_THAT(refusal(header + "release,1,,,,,,,,,,,,,\n"),
              HasSubstr("ends where one of them lets go; cut it there"));
  EXPECT_THAT(refusal(header + "query,1,,,,,,,,,,,,,\n"),
              HasSubstr("expected sample, servo or contact, found 'query'"));
}

TEST_F(PairTraceFile, IsNotWrittenWhenItCouldNotBeReadAgain) {
  EXPECT_THROW(write_pair_trace(file("a.csv"), PairTrace{}), TraceError);
  PairTrace trace = testing::PairRamp().trace();
  trace.samples[3].sample.forces_W[4] = std::numeric_limits<double>::quiet_NaN();
  EXPECT_THROW(write_pair_trace(file("a.csv"), trace), TraceError);
  trace = testing::PairRamp().trace();
  trace.contacts = {{1.0, PairVector::Zero(), 0.5}};
  EXPECT_THROW(write_pair_trace(file("a.csv"), trace), TraceError);
  EXPECT_FALSE(std::filesystem::exists(file("a.csv")));
}

}  // namespace
}  // namespace forcegrid::evaluation
