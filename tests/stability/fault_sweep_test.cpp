// SPDX-License-Identifier: Apache-2.0
#include "stability/fault_sweep.h"

#include <gtest/gtest.h>

#include <map>

#include "forcegrid/methods.h"

namespace forcegrid::stability {
namespace {

constexpr std::uint64_t kSeed = 20;

SweepOptions options(int runs) {
  SweepOptions options;
  options.methods = {kDefaultMethod, "hold", "rls"};
  options.runs = runs;
  options.seed = kSeed;
  return options;
}

class FaultSweep : public ::testing::Test {
 protected:
  static void SetUpTestSuite() { runs_ = sweep_faults(options(57)); }
  static std::vector<SweptRun> runs_;
};

std::vector<SweptRun> FaultSweep::runs_;

TEST_F(FaultSweep, NoFaultGivesForceAboveTheLimitOrEnergyAfterwards) {
  const auto profile = profiles::load_device_profile("woodenhaptics_v2015");
  for (const SweptRun& run : runs_) {
    const std::string what = std::string(to_string(run.fault)) + ", " + run.method + ", " +
                             run.hand + " hand, " + std::to_string(run.stiffness_N_per_m) +
                             " N/m, seed " + std::to_string(run.seed);
    EXPECT_FALSE(force_above_limit(run, profile)) << what << ": " << run.largest_force_N << " N";
    EXPECT_FALSE(energy_after_fault(run))
        << what << ": " << 1e3 * run.energy_after_fault_J << " mJ to the hand, "
        << 1e3 * run.work_after_end_J << " mJ of the motors after the end";
  }
}

TEST_F(FaultSweep, TheForceWasThereBeforeItWentWrong) {
  for (const SweptRun& run : runs_) {
    EXPECT_GT(run.largest_force_N, 0.05) << to_string(run.fault) << ", seed " << run.seed;
  }
}

TEST_F(FaultSweep, WhatTheServoCannotGoOnWithEndsIt) {
  std::map<SweptFault, servo::Fault> expected = {
      {SweptFault::kReportsStop, servo::Fault::kStaleReports},
      {SweptFault::kUnplugged, servo::Fault::kUnplugged},
      {SweptFault::kEncoderJumps, servo::Fault::kImplausibleJump},
      {SweptFault::kNone, servo::Fault::kNone},
      {SweptFault::kSimulatorStops, servo::Fault::kNone},
      {SweptFault::kCut, servo::Fault::kNone}};
  for (const SweptRun& run : runs_) {
    if (const auto found = expected.find(run.fault); found != expected.end()) {
      EXPECT_EQ(run.ended_by, found->second)
          << to_string(run.fault) << ": " << servo::name_of(run.ended_by) << ", seed " << run.seed;
    }
  }
}

TEST_F(FaultSweep, TheSameSeedGivesTheSameRunsWhateverTheThreads) {
  SweepOptions alone = options(19);
  alone.jobs = 1;
  const auto again = sweep_faults(alone);
  for (std::size_t i = 0; i < again.size(); ++i) {
    EXPECT_EQ(again[i].seed, runs_[i].seed);
    EXPECT_EQ(again[i].largest_force_N, runs_[i].largest_force_N);
    EXPECT_EQ(again[i].energy_after_fault_J, runs_[i].energy_after_fault_J);
    EXPECT_EQ(again[i].ended_by, runs_[i].ended_by);
  }
}

TEST_F(FaultSweep, TheTableCountsEveryRunOnce) {
  const auto table = sweep_table(runs_, profiles::load_device_profile("woodenhaptics_v2015"));
  EXPECT_EQ(table.size(), swept_faults().size());
  for (const SweepLine& line : table) {
    int ended = 0;
    for (const auto& [name, count] : line.ended_by) {
      ended += count;
    }
    EXPECT_EQ(line.runs, 3);
    EXPECT_EQ(line.survivors + ended, line.runs) << to_string(line.fault);
  }
}

TEST(FaultSweepDevices, NoFaultGivesForceAboveTheLimitOrEnergyOnOtherMechanisms) {
  for (const char* const device : {"phantom_desktop", "falcon"}) {
    SweepOptions swept = options(19);
    swept.device = device;
    swept.methods = {"rls"};
    const auto profile = profiles::load_device_profile(device);
    for (const SweptRun& run : sweep_faults(swept)) {
      const std::string what =
          run.device + ", " + to_string(run.fault) + ", seed " + std::to_string(run.seed);
      EXPECT_EQ(run.device, device);
      EXPECT_GT(run.largest_force_N, 0.05) << what;
      EXPECT_GT(run.largest_drive_fraction, 0.0) << what;
      EXPECT_FALSE(force_above_limit(run, profile)) << what << ": " << run.largest_force_N << " N";
      EXPECT_FALSE(energy_after_fault(run))
          << what << ": " << 1e3 * run.energy_after_fault_J << " mJ to the hand, "
          << 1e3 * run.work_after_end_J << " mJ of the motors after the end";
      if (run.fault == SweptFault::kNone) {
        EXPECT_EQ(run.ended_by, servo::Fault::kNone)
            << what << ": " << servo::name_of(run.ended_by);
      }
    }
  }
}

TEST(FaultSweepChecks, SeeForceAndEnergyThatShouldNotBe) {
  const auto profile = profiles::load_device_profile("woodenhaptics_v2015");
  SweptRun run;
  EXPECT_FALSE(force_above_limit(run, profile));
  EXPECT_FALSE(energy_after_fault(run));
  run.largest_force_N = 1.01 * profile.limits.max_force_N;
  run.energy_after_fault_J = 2e-3;
  EXPECT_TRUE(force_above_limit(run, profile));
  EXPECT_TRUE(energy_after_fault(run));
  run = {};
  run.largest_drive_fraction = 1.01;
  run.work_after_end_J = 1e-6;
  EXPECT_TRUE(force_above_limit(run, profile));
  EXPECT_TRUE(energy_after_fault(run));
}

}  // namespace
}  // namespace forcegrid::stability
