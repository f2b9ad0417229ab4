// SPDX-License-Identifier: Apache-2.0
// The images of `make firmware` on an emulated Cortex-M7, against the libraries of the host.
//
// random_motion.csv is a recording of `forcegrid run --scene block --motion random
// --amplitude-mm 15 --seed 3 --record FILE`, rounded to 0.1 um and 1 uN.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <iostream>
#include <map>
#include <sstream>
#include <string>
#include <vector>

#include "driver/kinematics.h"
#include "evaluation/traces/trace.h"
#include "firmware/on_board_cycle.h"
#include "firmware/small_grid.h"
#include "forcegrid/grid/grid_instances.h"
#include "forcegrid/kriging/kriging_field.h"
#include "forcegrid/methods.h"
#include "profiles/device_profile.h"
#include "tests/firmware/trace_bytes.h"
#include "tests/support/program.h"

namespace forcegrid::firmware {
namespace {

const std::string kTrace = FORCEGRID_SOURCE_DIR "/tests/firmware/random_motion.csv";
constexpr double kBudget_instructions = 200e6 / 500;  // of a cycle at 500 Hz, one each clock

std::string image_of(const std::string& method) {
  return FORCEGRID_SOURCE_DIR "/build/firmware/play_" + method + ".elf";
}

const profiles::DeviceProfile& profile() {
  static const profiles::DeviceProfile arm = profiles::load_device_profile("woodenhaptics_v2015");
  return arm;
}

std::array<double, 3> array_of(const Eigen::Vector3d& v) { return {v.x(), v.y(), v.z()}; }

/// The trace as records: twice, with half a second out of contact between, and in contact at the
/// end.
std::vector<TraceRecord> records_of(const evaluation::Trace& trace) {
  const driver::ArmKinematics kinematics(profile());
  std::vector<TraceRecord> records;
  double begin_s = 0.0;
  for (std::uint32_t pass = 1; pass <= 2; ++pass) {
    TraceRecord contact;
    contact.kind = RecordKind::kContactMade;
    contact.epoch = pass;
    contact.position_W = array_of(trace.samples.front().sample.position_W);
    records.push_back(contact);
    auto next = trace.samples.begin();
    for (const evaluation::ServoInstant& instant : trace.servo) {
      if (pass == 2 && instant.time_s > 1.0) {
        break;
      }
      for (; next != trace.samples.end() && next->delivered_s <= instant.time_s; ++next) {
        TraceRecord sample;
        sample.kind = RecordKind::kSample;
        sample.epoch = pass;
        sample.time_s = begin_s + next->sample.time_s;
        sample.position_W = array_of(next->sample.position_W);
        sample.force_W = array_of(next->sample.force_W);
        records.push_back(sample);
      }
      TraceRecord cycle;
      cycle.time_s = begin_s + instant.time_s;
      const Eigen::Vector3d counts = kinematics.inverse(instant.position_W).counts;
      for (std::size_t joint = 0; joint < 3; ++joint) {
        cycle.counts[joint] =
            static_cast<std::int32_t>(std::lround(counts[static_cast<Eigen::Index>(joint)]));
      }
      records.push_back(cycle);
    }
    if (pass == 1) {
      records.push_back({.kind = RecordKind::kContactLost});
    }
    begin_s += trace.servo.back().time_s + 0.5;
  }
  // What no trace has: a pose beyond the hard stops.
  TraceRecord beyond;
  beyond.time_s = begin_s + 10.0;
  beyond.counts = {0, 0, 30000, 0, 0, 0};
  records.push_back(beyond);
  return records;
}

/// The same on the host, through the driver's and the methods' libraries.
std::vector<CycleAnswer> expected_answers(const std::vector<TraceRecord>& records,
                                          ForceMethod& method) {
  const driver::ArmKinematics kinematics(profile());
  std::vector<CycleAnswer> answers;
  for (const TraceRecord& record : records) {
    Sample sample;
    sample.time_s = record.time_s;
    sample.position_W = Eigen::Vector3d::Map(record.position_W.data());
    sample.force_W = Eigen::Vector3d::Map(record.force_W.data());
    sample.contact_epoch = record.epoch;
    if (record.kind == RecordKind::kContactMade) {
      method.contact_made(record.epoch, sample.position_W);
    } else if (record.kind == RecordKind::kContactLost) {
      method.contact_lost();
    } else if (record.kind == RecordKind::kSample) {
      method.take_sample(sample);
    } else {
      const driver::ArmPose pose = kinematics.forward(record.counts);
      CycleAnswer answer;
      answer.pose_status = static_cast<std::uint32_t>(pose.status);
      answer.position_D = array_of(pose.position_D);
      Eigen::Matrix3d::Map(answer.jacobian_D.data()) = pose.jacobian_D;
      ForceEstimate estimate;
      if (pose.status == driver::KinematicsStatus::kOk) {
        method.observe(record.time_s, pose.position_D);
        estimate = method.force(record.time_s, pose.position_D);
        method.work(OnBoardCycle::kWorkUnits);
      }
      answer.estimate_status = static_cast<std::uint32_t>(estimate.status);
      answer.force_D = array_of(estimate.force_W);
      const double limit_N = profile().limits.max_force_N;
      const Eigen::Vector3d limited_N =
          estimate.force_W * std::min(1.0, limit_N / std::max(estimate.force_W.norm(), 1e-9));
      const auto current = kinematics.report_current(
          kinematics.motor_current_A(pose.jacobian_D.transpose() * limited_N));
      std::copy(current.current_mA.begin(), current.current_mA.end(), answer.current_mA.begin());
      answers.push_back(answer);
    }
  }
  return answers;
}

struct Playback {
  std::vector<CycleAnswer> answers;
  std::map<std::string, double> values;  ///< the player's `key value` lines
};

/// Plays the records to an image on the emulated processor.
Playback run_on_processor(const std::string& method, const std::vector<TraceRecord>& records) {
  const std::string folder = testing::fresh_folder("firmware_" + method);
  const std::string trace = folder + "/trace", answers = folder + "/answers";
  std::ofstream(trace, std::ios::binary)
      .write(reinterpret_cast<const char*>(records.data()),
             static_cast<std::streamsize>(records.size() * sizeof records[0]));
  testing::Program player({"qemu-system-arm", "-M", "mps2-an500", "-icount", "shift=0", "-display",
                           "none", "-monitor", "none", "-serial", "none", "-semihosting-config",
                           "enable=on,target=native,arg=player,arg=" + trace + ",arg=" + answers,
                           "-kernel", image_of(method)});
  EXPECT_EQ(player.wait(), 0) << player.standard_output() << player.standard_error();
  Playback run;
  // Semihosting prints to standard error.
  std::istringstream lines(player.standard_output() + player.standard_error());
  std::string key;
  for (double value = 0.0; lines >> key >> value;) {
    run.values[key] = value;
  }
  std::ifstream file(answers, std::ios::binary);
  for (CycleAnswer answer; file.read(reinterpret_cast<char*>(&answer), sizeof answer);) {
    run.answers.push_back(answer);
  }
  return run;
}

double rms_N(const std::vector<CycleAnswer>& answers) {
  double sum = 0.0;
  for (const CycleAnswer& answer : answers) {
    sum += Eigen::Vector3d::Map(answer.force_D.data()).squaredNorm();
  }
  return std::sqrt(sum / static_cast<double>(answers.size()));
}

class Firmware : public ::testing::Test {
 protected:
  void SetUp() override {
    for (const char* method : {"grid", "rls", "kriging"}) {
      if (!std::filesystem::exists(image_of(method))) {
        GTEST_SKIP() << image_of(method) << " is missing: `make firmware` builds it";
      }
    }
    if (!std::filesystem::exists("/usr/bin/qemu-system-arm")) {
      GTEST_SKIP() << "qemu-system-arm is missing: `setup/install.sh firmware` installs it";
    }
  }

  /// Plays the trace on both sides and compares every cycle.
  /// @param relative of the host's force, @param absolute_N largest difference, added.
  void compare(const std::string& name, ForceMethod& method, double relative, double absolute_N) {
    const std::vector<TraceRecord> records = records_of(evaluation::read_trace(kTrace));
    expected_ = expected_answers(records, method);
    run_ = run_on_processor(name, records);
    const std::vector<CycleAnswer>& found = run_.answers;
    ASSERT_EQ(found.size(), expected_.size());
    ASSERT_GT(found.size(), 2500U);
    EXPECT_GT(rms_N(expected_), 0.3);  // there is something to compare
    int known = 0;
    double worst_N = 0.0;
    for (std::size_t i = 0; i < found.size(); ++i) {
      SCOPED_TRACE("cycle " + std::to_string(i));
      const CycleAnswer& e = expected_[i];
      const CycleAnswer& f = found[i];
      ASSERT_EQ(f.pose_status, e.pose_status);
      ASSERT_EQ(f.estimate_status, e.estimate_status);
      for (std::size_t k = 0; k < 3; ++k) {
        ASSERT_NEAR(f.position_D[k], e.position_D[k], 1e-12);
        ASSERT_NEAR(f.current_mA[k], e.current_mA[k], 1 + 2000.0 * absolute_N);
      }
      for (std::size_t k = 0; k < 9; ++k) {
        ASSERT_NEAR(f.jacobian_D[k], e.jacobian_D[k], 1e-12);
      }
      const Eigen::Vector3d expected_N = Eigen::Vector3d::Map(e.force_D.data());
      const double off_N = (Eigen::Vector3d::Map(f.force_D.data()) - expected_N).norm();
      worst_N = std::max(worst_N, off_N);
      ASSERT_LE(off_N, relative * expected_N.norm() + absolute_N);
      known += e.estimate_status == static_cast<std::uint32_t>(EstimateStatus::kOk) ? 1 : 0;
    }
    EXPECT_GT(known, 2000);
    EXPECT_EQ(expected_.back().pose_status,
              static_cast<std::uint32_t>(driver::KinematicsStatus::kOutOfRange));
    EXPECT_EQ(found.back().current_mA, (std::array<std::int32_t, 4>{}));
    std::cout << "largest_difference_N " << worst_N << "\nrms_N " << rms_N(expected_) << "\n";
    for (const auto& [key, value] : run_.values) {
      std::cout << key << " " << value << "\n";
    }
    EXPECT_EQ(run_.values.at("cycles"), static_cast<double>(found.size()));
    // What it allocates at start fits, and the stack was never full.
    EXPECT_LE(run_.values.at("arena_bytes_used"), run_.values.at("arena_bytes"));
    EXPECT_LT(run_.values.at("stack_bytes_used"), run_.values.at("stack_bytes"));
    EXPECT_LT(run_.values.at("instructions_of_largest_cycle"), kBudget_instructions);
  }

  std::vector<CycleAnswer> expected_;
  Playback run_;
};

TEST_F(Firmware, GridAnswersAsTheHost) {
  const auto method = make_half_block_grid(small_grid(profile().limits));
  ASSERT_NE(method, nullptr);
  compare("grid", *method, 1e-5, 1e-9);
}

// Half precision costs three digits, no more: against the library's own grid in single precision.
TEST_F(Firmware, GridAnswersAsOneInSinglePrecisionWithinHalfPrecision) {
  MethodOptions options;
  const GridPlan plan = small_grid(profile().limits);
  options.grid = plan.geometry;
  options.influence_radius_m = plan.weighting.influence_radius_m;
  options.storage = GridStorage::kBlocks;
  options.pool_blocks = static_cast<int>(plan.pool_blocks);
  const auto method = make_force_method("forcegrid", options);
  compare("grid", *method, 0.0, 0.02);
}

TEST_F(Firmware, RlsAnswersAsTheHost) {
  const auto method = make_force_method("rls", {});
  compare("rls", *method, 1e-5, 1e-9);
}

TEST_F(Firmware, KrigingAnswersAsTheHost) {
  MethodOptions options;
  options.samples = kriging::kSmallSamples;
  const auto method = make_force_method("kriging", options);
  compare("kriging", *method, 0.0, 1e-3);
  EXPECT_GT(rms_N(expected_), 1.0);  // so that 1 mN is at most 1e-3 of it
}

}  // namespace
}  // namespace forcegrid::firmware
