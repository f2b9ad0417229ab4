// SPDX-License-Identifier: Apache-2.0
#include "calibration/procedure.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <optional>
#include <random>
#include <sstream>

#include "tests/calibration/simulated_rig.h"

namespace forcegrid::calibration {
namespace {

using ::testing::HasSubstr;

constexpr double kLargestTorqueConstantError = 0.03;
constexpr double kLargestFrictionError = 0.10;
constexpr double kHandLetsGo_s = 3.0;

// The numbers of "[1, 2, 3]".
std::vector<double> numbers(std::string text) {
  std::replace_if(
      text.begin(), text.end(), [](char c) { return c == '[' || c == ']' || c == ','; }, ' ');
  std::istringstream stream(text);
  std::vector<double> values;
  for (double value = 0.0; stream >> value;) {
    values.push_back(value);
  }
  return values;
}

std::vector<double> changed(const ProcedureResult& result, const std::string& key) {
  for (const auto& [name, value] : result.changes) {
    if (name == key) {
      return numbers(value);
    }
  }
  return {};
}

std::string all_checks(const ProcedureResult& result) {
  std::string text;
  for (const Check& check : result.checks) {
    text += std::string(check.passed ? "" : "FAILED ") + check.name + ": " + check.text + "\n";
  }
  return text;
}

// A profile that is wrong in everything a calibration shall find, and by how much.
struct Wrong {
  profiles::DeviceProfile profile;
  std::array<std::int32_t, 3> counter_error{};
};

Wrong wrong_about(const profiles::DeviceProfile& reference, unsigned seed) {
  std::mt19937 random(seed);
  const auto within = [&](double low, double high) {
    return low + (high - low) * static_cast<double>(random()) / std::mt19937::max();
  };
  Wrong wrong{reference, {}};
  for (std::size_t i = 0; i < 3; ++i) {
    wrong.profile.motors.torque_constant_Nm_per_A[i] *= random() % 2 == 0 ? 1.2 : 0.8;
    wrong.profile.dynamics.coulomb_friction_Nm[i] *= within(0.5, 2.0);
    wrong.profile.dynamics.viscous_friction_Nm_s_per_rad[i] *= within(0.0, 3.0);
    wrong.counter_error[i] = static_cast<std::int32_t>(within(-60.0, 60.0));
    wrong.profile.calibration.pose_counts[i] += wrong.counter_error[i];
  }
  return wrong;
}

struct Case {
  const char* device;
  double known_mass_kg;
  bool quick;
  unsigned seed;
};

class ArmProcedure : public ::testing::TestWithParam<Case> {};

TEST_P(ArmProcedure, FindsTorqueConstantsFrictionAndOffsetsOfAWrongProfile) {
  const Case& c = GetParam();
  SCOPED_TRACE(std::string(c.device) + ", seed " + std::to_string(c.seed));
  const auto reference = profiles::load_device_profile(c.device);
  const Wrong wrong = wrong_about(reference, c.seed);
  SimulatedRig rig(reference, {.known_mass_kg = c.known_mass_kg,
                               .counter_error = wrong.counter_error,
                               .hand_lets_go_at_s = kHandLetsGo_s});
  const ProcedureResult result =
      run_procedure(rig, wrong.profile, {.known_mass_kg = c.known_mass_kg, .quick = c.quick});
  ASSERT_TRUE(result.passed()) << all_checks(result);
  EXPECT_TRUE(result.absolute);
  EXPECT_FALSE(rig.motors_on());

  const auto torque_constants = changed(result, "motors.torque_constant_Nm_per_A");
  const auto coulomb = changed(result, "dynamics.coulomb_friction_Nm");
  const auto viscous = changed(result, "dynamics.viscous_friction_Nm_s_per_rad");
  const auto pose_counts = changed(result, "calibration.pose_counts");
  ASSERT_EQ(torque_constants.size(), 3U);
  ASSERT_EQ(coulomb.size(), 3U);
  ASSERT_EQ(viscous.size(), 3U);
  ASSERT_EQ(pose_counts.size(), 6U);
  for (std::size_t i = 0; i < 3; ++i) {
    SCOPED_TRACE("joint " + std::to_string(i));
    EXPECT_NEAR(torque_constants[i] / reference.motors.torque_constant_Nm_per_A[i], 1.0,
                kLargestTorqueConstantError);
    EXPECT_NEAR(coulomb[i] / reference.dynamics.coulomb_friction_Nm[i], 1.0, kLargestFrictionError);
    EXPECT_NEAR(viscous[i] / reference.dynamics.viscous_friction_Nm_s_per_rad[i], 1.0,
                kLargestFrictionError);
    EXPECT_EQ(pose_counts[i], reference.calibration.pose_counts[i]);
    // By the believed torque constant at most half of the profile's limits, so by the true one:
    EXPECT_LE(rig.largest_torque_Nm[static_cast<int>(i)],
              0.5 * 1.26 * reference.limits.max_joint_torque_Nm[i]);
    EXPECT_LE(result.largest_current_A[i], 0.5 * reference.motors.max_current_A[i] + 1e-3);
  }
  EXPECT_LT(result.largest_tip_speed_m_per_s, 0.6 * reference.limits.max_speed_m_per_s);
}

INSTANTIATE_TEST_SUITE_P(Devices, ArmProcedure,
                         ::testing::Values(Case{"woodenhaptics_v2015", 0.1, false, 11},
                                           Case{"woodenhaptics_v2019", 0.1, true, 12},
                                           Case{"woodenhaptics_teensy", 0.1, true, 15},
                                           Case{"polhem_v1", 0.1, true, 13},
                                           Case{"phantom_desktop", 0.1, true, 14}),
                         [](const auto& test) { return std::string(test.param.device); });

// Unbalanced, with motors that just bear it: half of what they give can't hold the arm stretched
// out.
TEST(Procedure, AnArmThatItsMotorsJustBearIsIdentifiedAwayFromTheStopsItCantHold) {
  const auto reference = profiles::load_device_profile("vintage");
  Wrong wrong = wrong_about(reference, 16);
  for (std::size_t i = 0; i < 3; ++i) {
    wrong.profile.motors.torque_constant_Nm_per_A[i] =
        reference.motors.torque_constant_Nm_per_A[i] * (i == 0 ? 0.8 : 1.1);
  }
  for (const std::size_t unseen : {1U, 2U}) {  // whose counters no stop corrects
    wrong.counter_error[unseen] = 0;
    wrong.profile.calibration.pose_counts[unseen] = reference.calibration.pose_counts[unseen];
  }
  SimulatedRig rig(reference, {.known_mass_kg = 0.01,
                               .counter_error = wrong.counter_error,
                               .hand_lets_go_at_s = kHandLetsGo_s});
  const ProcedureResult result =
      run_procedure(rig, wrong.profile, {.known_mass_kg = 0.01, .quick = true});
  ASSERT_TRUE(result.passed()) << all_checks(result);
  EXPECT_NE(all_checks(result).find("not measured: at the stop"), std::string::npos)
      << all_checks(result);
  const auto torque_constants = changed(result, "motors.torque_constant_Nm_per_A");
  const auto coulomb = changed(result, "dynamics.coulomb_friction_Nm");
  const auto viscous = changed(result, "dynamics.viscous_friction_Nm_s_per_rad");
  ASSERT_EQ(torque_constants.size(), 3U);
  ASSERT_EQ(coulomb.size(), 3U);
  ASSERT_EQ(viscous.size(), 3U);
  for (std::size_t i = 0; i < 3; ++i) {
    EXPECT_NEAR(torque_constants[i] / reference.motors.torque_constant_Nm_per_A[i], 1.0,
                kLargestTorqueConstantError)
        << "joint " << i;
    EXPECT_NEAR(viscous[i] / reference.dynamics.viscous_friction_Nm_s_per_rad[i], 1.0,
                kLargestFrictionError)
        << "joint " << i;
    EXPECT_NEAR(coulomb[i] / reference.dynamics.coulomb_friction_Nm[i], 1.0, kLargestFrictionError)
        << "joint " << i;
  }
  EXPECT_EQ(changed(result, "calibration.pose_counts").at(0), reference.calibration.pose_counts[0]);
  EXPECT_FALSE(rig.motors_on());
}

TEST(Procedure, WhatAHostThatPausesLeavesOfTheStrokesIsEnough) {
  const auto reference = profiles::load_device_profile("phantom_desktop");
  Wrong wrong = wrong_about(reference, 5);
  for (const double pause_s : {0.02, 0.06, 0.12}) {
    SCOPED_TRACE("paused for " + std::to_string(pause_s));
    SimulatedRig rig(reference, {.known_mass_kg = 0.03,
                                 .counter_error = wrong.counter_error,
                                 .pause_every_s = 1.3,
                                 .pause_s = pause_s});
    const ProcedureResult result =
        run_procedure(rig, wrong.profile, {.known_mass_kg = 0.03, .range = false});
    ASSERT_TRUE(result.passed()) << all_checks(result);
    const auto torque_constants = changed(result, "motors.torque_constant_Nm_per_A");
    const auto coulomb = changed(result, "dynamics.coulomb_friction_Nm");
    for (std::size_t i = 0; i < 3; ++i) {
      EXPECT_NEAR(torque_constants.at(i) / reference.motors.torque_constant_Nm_per_A[i], 1.0,
                  kLargestTorqueConstantError);
      EXPECT_NEAR(coulomb.at(i) / reference.dynamics.coulomb_friction_Nm[i], 1.0,
                  kLargestFrictionError);
    }
  }
}

TEST(Procedure, FindsTheGainAndFrictionOfADelta) {
  const auto reference = profiles::load_device_profile("falcon");
  for (const double wrongness : {0.8, 1.2}) {
    SCOPED_TRACE(wrongness);
    auto believed = reference;
    believed.falcon.torque_gain_per_Nm *= wrongness;
    believed.limits.max_joint_torque_Nm = {0.3, 0.3, 0.3};
    believed.dynamics.coulomb_friction_Nm = {0.008, 0.003, 0.006};
    SimulatedRig rig(reference, {.known_mass_kg = 0.1, .hand_lets_go_at_s = kHandLetsGo_s});
    rig.believed_gain_per_Nm = believed.falcon.torque_gain_per_Nm;
    const ProcedureResult result = run_procedure(rig, believed, {.known_mass_kg = 0.1});
    ASSERT_TRUE(result.passed()) << all_checks(result);
    const auto gain = changed(result, "falcon.torque_gain_per_Nm");
    ASSERT_EQ(gain.size(), 1U);
    EXPECT_NEAR(gain[0] / reference.falcon.torque_gain_per_Nm, 1.0, kLargestTorqueConstantError);
    const auto coulomb = changed(result, "dynamics.coulomb_friction_Nm");
    const auto viscous = changed(result, "dynamics.viscous_friction_Nm_s_per_rad");
    for (std::size_t i = 0; i < 3; ++i) {
      EXPECT_NEAR(coulomb.at(i) / reference.dynamics.coulomb_friction_Nm[i], 1.0,
                  kLargestFrictionError);
      EXPECT_NEAR(viscous.at(i) / reference.dynamics.viscous_friction_Nm_s_per_rad[i], 1.0,
                  kLargestFrictionError);
    }
    EXPECT_TRUE(changed(result, "calibration.pose_counts").empty()) << "it homes itself";
  }
}

TEST(Procedure, ADeltasKnobMeetsTheBodyWhereTheProfileSaysOrItsAnglesAreWrong) {
  const auto reference = profiles::load_device_profile("falcon");
  for (const double zero_error_rad : {0.0, 0.08, -0.08}) {
    SCOPED_TRACE(zero_error_rad);
    auto believed = reference;
    believed.delta.zero_angle_rad += zero_error_rad;
    SimulatedRig rig(reference, {.hand_lets_go_at_s = kHandLetsGo_s});
    rig.believed_gain_per_Nm = reference.falcon.torque_gain_per_Nm;
    const ProcedureResult result = run_procedure(rig, believed, {.identify = false});
    EXPECT_EQ(result.passed(), zero_error_rad == 0.0) << all_checks(result);
    ASSERT_TRUE(result.knob_travel);
    if (zero_error_rad == 0.0) {
      // A count moves the knob by up to 0.05 mm.
      EXPECT_NEAR(result.knob_travel->in_m, reference.delta.knob_min_z_m, 2e-4);
      EXPECT_NEAR(result.knob_travel->out_m, reference.delta.knob_max_z_m, 2e-4);
    } else {
      EXPECT_THAT(all_checks(result), HasSubstr("FAILED range of the knob"));
      EXPECT_THAT(all_checks(result), HasSubstr("zero_angle_rad"));
    }
    EXPECT_TRUE(result.changes.empty());
    EXPECT_FALSE(rig.motors_on());
  }
}

TEST(Procedure, WithoutAKnownMassOnlyFrictionOverTorqueConstantIsFound) {
  const auto reference = profiles::load_device_profile("woodenhaptics_v2015");
  const Wrong wrong = wrong_about(reference, 21);
  SimulatedRig rig(reference, {.hand_lets_go_at_s = kHandLetsGo_s});
  const ProcedureResult result = run_procedure(rig, wrong.profile, {.range = false, .quick = true});
  ASSERT_TRUE(result.passed()) << all_checks(result);
  EXPECT_FALSE(result.absolute);
  EXPECT_TRUE(changed(result, "motors.torque_constant_Nm_per_A").empty());
  EXPECT_THAT(all_checks(result), HasSubstr("by the profile's torque constant"));
  const auto coulomb = changed(result, "dynamics.coulomb_friction_Nm");
  const auto viscous = changed(result, "dynamics.viscous_friction_Nm_s_per_rad");
  for (std::size_t i = 0; i < 3; ++i) {
    const double true_A =
        reference.dynamics.coulomb_friction_Nm[i] / reference.motors.torque_constant_Nm_per_A[i];
    const double believed_A = coulomb.at(i) / wrong.profile.motors.torque_constant_Nm_per_A[i];
    EXPECT_NEAR(believed_A / true_A, 1.0, kLargestFrictionError);
    EXPECT_NEAR(viscous.at(i) / wrong.profile.motors.torque_constant_Nm_per_A[i] /
                    (reference.dynamics.viscous_friction_Nm_s_per_rad[i] /
                     reference.motors.torque_constant_Nm_per_A[i]),
                1.0, kLargestFrictionError);
  }
}

TEST(Procedure, AMotorWithSwappedLeadsIsNamedAndNothingMovesAfterIt) {
  const auto reference = profiles::load_device_profile("woodenhaptics_v2015");
  for (int joint = 0; joint < 3; ++joint) {
    SimulatedRig::Options options{.hand_lets_go_at_s = 1e6};
    options.motor_sign[joint] = -1.0;
    SimulatedRig rig(reference, options);
    const ProcedureResult result = run_procedure(rig, reference, {});
    EXPECT_FALSE(result.passed());
    const Check& check = result.checks.at(static_cast<std::size_t>(joint));
    EXPECT_FALSE(check.passed);
    EXPECT_THAT(check.text, HasSubstr("wrong way"));
    EXPECT_TRUE(result.changes.empty());
    EXPECT_EQ(result.checks.size(), 3U) << "only directions";
    EXPECT_LT(rig.time_s(), 5.0);
    EXPECT_FALSE(rig.motors_on());
  }
}

TEST(Procedure, AJointThatCountsTheOtherWayHasItsStopsElsewhere) {
  const auto reference = profiles::load_device_profile("woodenhaptics_v2015");
  auto believed = reference;
  believed.kinematics.encoder_sign[1] = -1.0;  // a push still seems to go the right way
  SimulatedRig rig(reference, {.hand_lets_go_at_s = kHandLetsGo_s});
  try {
    const ProcedureResult result = run_procedure(rig, believed, {});
    EXPECT_FALSE(result.passed());
    EXPECT_TRUE(result.changes.empty());
    EXPECT_THAT(all_checks(result), HasSubstr("encoder_sign"));
  } catch (const CalibrationError& error) {
    EXPECT_THAT(error.what(), HasSubstr("joint b"));
    EXPECT_THAT(error.what(), HasSubstr("encoder_sign"));
  }
  EXPECT_FALSE(rig.motors_on());
}

// A person who moves the tip by 60 mm along each direction that they are asked for.
ProcedureResult with_a_person(SimulatedRig& rig, const profiles::DeviceProfile& believed) {
  constexpr double kMove_m = 0.06;
  constexpr double kMove_s = 1.0;
  double begun_s = 0.0;
  ProcedureOptions options{.range = false, .identify = false};
  options.say = [&](const std::string& line, std::optional<double>) {
    const Eigen::Vector3d along_D =
        line.find("right") != std::string::npos ? Eigen::Vector3d::UnitY()
        : line.find("up") != std::string::npos  ? Eigen::Vector3d::UnitZ()
                                                : Eigen::Vector3d::UnitX();
    if (line.starts_with("Move the tip")) {
      begun_s = rig.time_s();
      rig.hand_velocity_D_m_per_s = kMove_m / kMove_s * along_D;
    }
  };
  options.person_done = [&] {
    const bool done = rig.time_s() - begun_s > kMove_s;
    if (done) {
      rig.hand_velocity_D_m_per_s.setZero();
    }
    return done;
  };
  return run_procedure(rig, believed, options);
}

TEST(Procedure, APersonSeesABaseThatIsMirroredWherePushesAndStopsDoNot) {
  const auto reference = profiles::load_device_profile("woodenhaptics_v2015");
  SimulatedRig rig(reference, {.hand_lets_go_at_s = 1e6});
  const ProcedureResult right = with_a_person(rig, reference);
  EXPECT_TRUE(right.passed()) << all_checks(right);
  EXPECT_EQ(right.checks.size(), 6U);

  auto believed = reference;
  believed.kinematics.encoder_sign[0] = -1.0;
  SimulatedRig mirrored_rig(reference, {.hand_lets_go_at_s = 1e6});
  const ProcedureResult mirrored = with_a_person(mirrored_rig, believed);
  EXPECT_FALSE(mirrored.passed());
  EXPECT_THAT(all_checks(mirrored), HasSubstr("FAILED moved to your right"));
  EXPECT_THAT(all_checks(mirrored), HasSubstr("encoder_sign"));
  EXPECT_FALSE(mirrored_rig.motors_on());
}

TEST(Procedure, AnEncoderOfOtherCountsHasAnotherRange) {
  const auto reference = profiles::load_device_profile("woodenhaptics_v2015");
  auto believed = reference;
  believed.kinematics.encoder_counts_per_turn[0] = 2200;
  SimulatedRig rig(reference, {.hand_lets_go_at_s = kHandLetsGo_s});
  const ProcedureResult result = run_procedure(rig, believed, {.identify = false});
  EXPECT_FALSE(result.passed());
  EXPECT_TRUE(result.changes.empty());
  EXPECT_THAT(all_checks(result), HasSubstr("FAILED range of joint a"));
  EXPECT_THAT(all_checks(result), HasSubstr("encoder_counts_per_turn"));
}

TEST(Procedure, SaysHowLongWhatItDoesIsLikelyToTake) {
  const auto reference = profiles::load_device_profile("phantom_desktop");
  SimulatedRig rig(reference, {.hand_lets_go_at_s = kHandLetsGo_s});
  struct Announced {
    std::string line;
    std::optional<double> length_s;
    double at_s = 0.0;
  };
  std::vector<Announced> lines;
  ProcedureOptions options{.quick = true};
  options.say = [&](const std::string& line, std::optional<double> length_s) {
    lines.push_back({line, length_s, rig.time_s()});
  };
  const ProcedureResult result = run_procedure(rig, reference, options);
  ASSERT_TRUE(result.passed()) << all_checks(result);
  lines.push_back({"the end", std::nullopt, rig.time_s()});
  int judged = 0;
  for (std::size_t i = 0; i + 1 < lines.size(); ++i) {
    if (lines[i].length_s) {
      ++judged;
      const double took_s = lines[i + 1].at_s - lines[i].at_s;
      EXPECT_GT(took_s, 0.75 * *lines[i].length_s) << lines[i].line;
      // Pauses in which motors cool are not foreseen; this arm's need none.
      EXPECT_LT(took_s, 1.5 * *lines[i].length_s + 1.0) << lines[i].line;
    }
  }
  EXPECT_GE(judged, 7) << "letting go, three pairs of stops, three sets of strokes";
}

TEST(Procedure, WhoDoesNotLetGoIsAskedTo) {
  const auto reference = profiles::load_device_profile("woodenhaptics_v2015");
  SimulatedRig rig(reference, {.hand_lets_go_at_s = 1e6});
  try {
    static_cast<void>(run_procedure(rig, reference, {}));
    FAIL() << "the hand is stronger";
  } catch (const CalibrationError& error) {
    EXPECT_THAT(error.what(), HasSubstr("let go"));
    EXPECT_THAT(error.what(), HasSubstr("no current"));
  }
  EXPECT_FALSE(rig.motors_on());
}

TEST(Procedure, EndsAtOnceWhenAskedTo) {
  const auto reference = profiles::load_device_profile("woodenhaptics_v2015");
  for (const double stop_at_s : {0.1, 4.0, 20.0}) {
    SimulatedRig rig(reference, {.hand_lets_go_at_s = kHandLetsGo_s, .stop_at_s = stop_at_s});
    EXPECT_THROW(static_cast<void>(run_procedure(rig, reference, {})), Stopped);
    EXPECT_LT(rig.time_s(), stop_at_s + 0.01);
    EXPECT_FALSE(rig.motors_on());
  }
}

TEST(Procedure, AMassThatTheMotorsCantBearIsRefusedBeforeAnythingMoves) {
  const auto reference = profiles::load_device_profile("woodenhaptics_v2015");
  SimulatedRig rig(reference, {.known_mass_kg = 1.0, .hand_lets_go_at_s = kHandLetsGo_s});
  try {
    static_cast<void>(run_procedure(rig, reference, {.known_mass_kg = 1.0}));
    FAIL() << "1 kg is too much";
  } catch (const CalibrationError& error) {
    EXPECT_THAT(error.what(), HasSubstr("1.000 kg"));
    EXPECT_THAT(error.what(), HasSubstr("fasten less"));
  }
  EXPECT_LT(rig.time_s(), kHandLetsGo_s) << "still held";
}

}  // namespace
}  // namespace forcegrid::calibration
