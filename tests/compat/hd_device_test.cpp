// SPDX-License-Identifier: Apache-2.0
// Devices, parameters, frames and errors of libHD, on emulated arms. The numbers in names are those
// of the acceptance list in docs/openhaptics.md.
#include <HD/hd.h>
#include <HDU/hdu.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <array>
#include <atomic>
#include <cerrno>
#include <cmath>
#include <cstdlib>
#include <filesystem>
#include <iterator>
#include <string>
#include <thread>

#include "tests/compat/hd_rig.h"

namespace forcegrid::testing {
namespace {

using namespace std::chrono_literals;
using ::testing::HasSubstr;

constexpr double kCount_mm = 0.2;  // of one encoder count at the tool, at most

std::array<double, 3> position_mm() {
  std::array<double, 3> position{};
  hdGetDoublev(HD_CURRENT_POSITION, position.data());
  return position;
}

TEST(HdDevice, N09_BeforeAndAfterTheFirstInitialisation) {
  Rig rig;
  EXPECT_EQ(hdGetCurrentDevice(), 0U);
  EXPECT_EQ(last_error(), HD_SUCCESS);
  EXPECT_EQ(hdInitDevice(HD_DEFAULT_DEVICE), 0U);
  EXPECT_EQ(last_error(), HD_SUCCESS);
  EXPECT_EQ(hdGetCurrentDevice(), 0U);
  EXPECT_EQ(hdIsEnabled(HD_FORCE_OUTPUT), HD_FALSE);
  EXPECT_EQ(hdIsEnabled(HD_MAX_FORCE_CLAMPING), HD_TRUE);
  EXPECT_EQ(hdCheckCalibration(), static_cast<HDenum>(HD_CALIBRATION_OK));  // 22
  hdUpdateCalibration(HD_CALIBRATION_AUTO | HD_CALIBRATION_INKWELL);
  EXPECT_EQ(last_error(), HD_SUCCESS);
}

TEST(HdDevice, N10_ASecondInitialisationIsRefusedUntilItIsDisabled) {
  Rig rig;
  ASSERT_EQ(hdInitDevice("Right"), 0U);
  for (const char* name : {"Right", "Default Device", ""}) {
    EXPECT_EQ(hdInitDevice(name), HD_INVALID_HANDLE);
    EXPECT_EQ(last_error(), static_cast<HDerror>(HD_DEVICE_ALREADY_INITIATED)) << name;
  }
  EXPECT_EQ(hdGetCurrentDevice(), 0U);
  hdDisableDevice(0);
  EXPECT_EQ(hdInitDevice("Default PHANToM"), 0U);
  hdDisableDevice(0);
  EXPECT_EQ(last_error(), HD_SUCCESS);
  hdDisableDevice(0);
  EXPECT_EQ(last_error(), static_cast<HDerror>(HD_BAD_HANDLE));
}

int entries_of(const char* folder) {
  const std::filesystem::directory_iterator files(folder);
  return static_cast<int>(std::distance(begin(files), end(files)));
}

// $FORCEGRID_TEST_OPENINGS changes how often.
TEST(HdDevice, N10_OpeningAndClosingAgainAndAgainLeavesNothingBehind) {
  Rig rig;
  const char* const asked = std::getenv("FORCEGRID_TEST_OPENINGS");
  const int openings = asked != nullptr ? std::atoi(asked) : 25;
  int descriptors = 0;
  int threads = 0;
  for (int k = 0; k < openings; ++k) {
    ASSERT_EQ(hdInitDevice(HD_DEFAULT_DEVICE), 0U) << k;
    hdEnable(HD_FORCE_OUTPUT);
    hdStartScheduler();
    rig.synchronous([] {});
    hdStopScheduler();
    hdDisableDevice(0);
    if (k == 2) {
      descriptors = entries_of("/proc/self/fd");
      threads = entries_of("/proc/self/task");
    }
  }
  EXPECT_EQ(count_errors(), 0);
  // The emulator's connection, which is in this process, too, ends a little later.
  EXPECT_TRUE(wait_until(
      [&] {
        return entries_of("/proc/self/fd") <= descriptors &&
               entries_of("/proc/self/task") <= threads;
      },
      2s));
}

TEST(HdDevice, N11_ProbesFindTheConfiguredArmsAlone) {
  Rig rig({.arms = 2});
  ASSERT_EQ(hdInitDevice(HD_DEFAULT_DEVICE), 0U);
  int found = 0;
  for (const char* name : {"Phantom2", "Phantom3", "Phantom4", "Right", "Left"}) {
    const HHD arm = hdInitDevice(name);
    const HDErrorInfo error = hdGetError();
    EXPECT_EQ(arm == HD_INVALID_HANDLE, HD_DEVICE_ERROR(error)) << name;
    found += arm != HD_INVALID_HANDLE ? 1 : 0;
  }
  EXPECT_EQ(found, 1);  // "Right" is the default
  EXPECT_EQ(hdGetCurrentDevice(), 1U);
  EXPECT_TRUE(rig.report(0).attached);
  EXPECT_TRUE(rig.report(1).attached);
  hdDisableDevice(hdGetCurrentDevice());  // the other one becomes current
  hdDisableDevice(hdGetCurrentDevice());
  EXPECT_EQ(last_error(), HD_SUCCESS);
}

TEST(HdDevice, RefusesAConfigurationThatCannotBeUsed) {
  Rig rig({.lines = "hold_ms = -3\n"});
  EXPECT_EQ(hdInitDevice(HD_DEFAULT_DEVICE), HD_INVALID_HANDLE);
  EXPECT_EQ(last_error(), static_cast<HDerror>(HD_COMM_CONFIG_ERROR));
}

TEST(HdDevice, AnAbsentDeviceIsACommunicationError) {
  Rig rig;
  setenv("FORCEGRID_DEVICE", "usbip://127.0.0.1:1/1-1", 1);
  const rt::TimePoint began = rt::Clock::now();
  EXPECT_EQ(hdInitDevice(HD_DEFAULT_DEVICE), HD_INVALID_HANDLE);
  EXPECT_EQ(last_error(), static_cast<HDerror>(HD_COMM_ERROR));
  EXPECT_LT(rt::Clock::now() - began, 2500ms);
}

TEST(HdDevice, N15_CallsWithoutAFrameReadAndWritesAreRefused) {
  Rig rig;
  const HHD arm = hdInitDevice(HD_DEFAULT_DEVICE);
  EXPECT_GT(std::abs(position_mm()[1]), 1.0);
  EXPECT_EQ(last_error(), HD_SUCCESS);
  const double force[3] = {1, 0, 0};
  hdSetDoublev(HD_CURRENT_FORCE, force);
  EXPECT_EQ(last_error(), static_cast<HDerror>(HD_FRAME_ERROR));
  hdSetDoublev(HD_CURRENT_TORQUE, force);
  EXPECT_EQ(last_error(), HD_SUCCESS);
  hdEndFrame(arm);
  EXPECT_EQ(last_error(), static_cast<HDerror>(HD_ILLEGAL_END));
  double seen[3] = {9, 9, 9};
  hdBeginFrame(arm);
  hdBeginFrame(arm);  // they nest
  hdGetDoublev(HD_CURRENT_FORCE, seen);
  EXPECT_EQ(seen[0], 0);
  hdSetDoublev(HD_CURRENT_FORCE, force);
  hdEndFrame(arm);
  hdGetDoublev(HD_CURRENT_FORCE, seen);
  EXPECT_EQ(seen[0], 1);
  hdEndFrame(arm);
  hdGetDoublev(HD_LAST_FORCE, seen);
  EXPECT_EQ(seen[0], 1);
  EXPECT_EQ(last_error(), HD_SUCCESS);
  hdBeginFrame(7);
  EXPECT_EQ(last_error(), static_cast<HDerror>(HD_BAD_HANDLE));
  const double not_finite[3] = {0, NAN, 0};
  hdBeginFrame(arm);
  hdSetDoublev(HD_CURRENT_FORCE, force);
  hdSetDoublev(HD_CURRENT_FORCE, not_finite);
  EXPECT_EQ(last_error(), static_cast<HDerror>(HD_INVALID_VALUE));
  hdGetDoublev(HD_CURRENT_FORCE, seen);
  EXPECT_EQ(seen[0], 1);  // the one before
  hdEndFrame(arm);
  EXPECT_EQ(count_errors(), 0);
}

TEST(HdDevice, N16_N17_AFrameIsOneInstantAndThePoseTheEmulators) {
  Rig rig({.motion = emulator::MotionKind::kLissajous});
  const HHD arm = hdInitDevice(HD_DEFAULT_DEVICE);
  hdStartScheduler();
  int frames = 0;
  int moved = 0;
  std::array<double, 3> before{};
  const auto in_frame = [&] {
    std::array<double, 16> first{};
    std::array<double, 16> second{};
    std::array<double, 3> position{};
    std::array<double, 3> last{};
    hdBeginFrame(arm);
    hdGetDoublev(HD_CURRENT_TRANSFORM, first.data());
    std::this_thread::sleep_for(3ms);
    hdGetDoublev(HD_CURRENT_TRANSFORM, second.data());
    hdGetDoublev(HD_CURRENT_POSITION, position.data());
    hdGetDoublev(HD_LAST_POSITION, last.data());
    hdEndFrame(arm);
    EXPECT_EQ(first, second);
    EXPECT_TRUE(std::equal(position.begin(), position.end(), first.begin() + 12));
    EXPECT_EQ(first[0], 1);
    EXPECT_EQ(first[5], 1);
    EXPECT_EQ(first[15], 1);
    if (frames++ > 0) {
      EXPECT_EQ(last, before);
      moved += position != before ? 1 : 0;
    }
    before = position;
  };
  while (frames < 150) {
    rig.synchronous(in_frame);
  }
  EXPECT_GT(moved, 50);
  // Between the two looks at the emulator the tool was where libHD says, along each axis.
  const Eigen::Vector3d earlier = rig.tip_mm();
  const std::array<double, 3> said = position_mm();
  std::this_thread::sleep_for(5ms);
  const Eigen::Vector3d later = rig.tip_mm();
  const double way_mm = 1.0 + 3 * (later - earlier).norm();
  for (int i = 0; i < 3; ++i) {
    EXPECT_NEAR(said[static_cast<std::size_t>(i)], earlier[i], way_mm);
  }
}

TEST(HdDevice, N16_N17_ARestingArmIsBitIdenticalAndWhereTheEmulatorHasIt) {
  Rig rig;
  hdInitDevice(HD_DEFAULT_DEVICE);
  ASSERT_TRUE(rig.hand_is_there());
  std::array<double, 16> first{};
  std::array<double, 16> again{};
  hdGetDoublev(HD_CURRENT_TRANSFORM, first.data());
  std::this_thread::sleep_for(50ms);
  hdGetDoublev(HD_CURRENT_TRANSFORM, again.data());
  EXPECT_EQ(first, again);
  const Eigen::Vector3d truth = rig.tip_mm();
  for (int i = 0; i < 3; ++i) {
    EXPECT_NEAR(first[static_cast<std::size_t>(12 + i)], truth[i], kCount_mm);
  }
  HDlong encoders[6];
  hdGetLongv(HD_CURRENT_ENCODER_VALUES, encoders);
  for (std::size_t i = 0; i < 6; ++i) {
    EXPECT_EQ(encoders[i], rig.report().counters[i]);
  }
}

// Every parameter by every typed call, with bytes behind the buffer that stay.
template <typename T>
void read_guarded(void (*call)(HDenum, T*), HDenum name, std::size_t count, bool is_read) {
  std::array<unsigned char, 40 * sizeof(T)> buffer;
  buffer.fill(0xA5);
  call(name, reinterpret_cast<T*>(buffer.data()));
  const HDerror error = last_error();
  EXPECT_EQ(error, is_read ? HDerror{HD_SUCCESS} : HDerror{HD_INVALID_INPUT_TYPE})
      << std::hex << name;
  for (std::size_t i = count * sizeof(T); i < buffer.size(); ++i) {
    ASSERT_EQ(buffer[i], 0xA5) << std::hex << name << " byte " << i;
  }
  for (std::size_t i = 0; !is_read && i < count * sizeof(T); ++i) {
    ASSERT_EQ(buffer[i], 0) << std::hex << name;
  }
}

TEST(HdDevice, N18_N19_EveryParameterWritesItsCountByEveryCall) {
  Rig rig;
  hdInitDevice(HD_DEFAULT_DEVICE);
  struct Known {
    HDenum name;
    std::size_t count;
    char family;  // d real, i integer, b boolean, l long
  };
  const Known parameters[] = {{HD_CURRENT_BUTTONS, 1, 'i'},
                              {HD_CURRENT_SAFETY_SWITCH, 1, 'b'},
                              {HD_CURRENT_INKWELL_SWITCH, 1, 'b'},
                              {HD_CURRENT_ENCODER_VALUES, 6, 'l'},
                              {HD_CURRENT_PINCH_VALUE, 1, 'd'},
                              {HD_CURRENT_POSITION, 3, 'd'},
                              {HD_CURRENT_VELOCITY, 3, 'd'},
                              {HD_CURRENT_TRANSFORM, 16, 'd'},
                              {HD_CURRENT_JACOBIAN, 36, 'd'},
                              {HD_CURRENT_GIMBAL_ANGLES, 3, 'd'},
                              {HD_LAST_BUTTONS, 1, 'i'},
                              {HD_LAST_INKWELL_SWITCH, 1, 'b'},
                              {HD_LAST_ENCODER_VALUES, 6, 'l'},
                              {HD_LAST_TRANSFORM, 16, 'd'},
                              {HD_DEVICE_FIRMWARE_VERSION, 1, 'd'},
                              {HD_MAX_WORKSPACE_DIMENSIONS, 6, 'd'},
                              {HD_TABLETOP_OFFSET, 1, 'd'},
                              {HD_INPUT_DOF, 1, 'i'},
                              {HD_UPDATE_RATE, 1, 'i'},
                              {HD_INSTANTANEOUS_UPDATE_RATE, 1, 'i'},
                              {HD_NOMINAL_MAX_FORCE, 1, 'd'},
                              {HD_MOTOR_TEMPERATURE, 3, 'd'},
                              {HD_FORCE_RAMPING_RATE, 1, 'd'},
                              {HD_NOMINAL_MAX_TORQUE_FORCE, 1, 'd'},
                              {HD_CURRENT_FORCE, 3, 'd'},
                              {HD_CURRENT_JOINT_TORQUE, 3, 'd'},
                              {HD_LAST_GIMBAL_TORQUE, 3, 'd'},
                              {HD_USER_STATUS_LIGHT, 1, 'i'}};
  for (const Known& one : parameters) {
    const bool number = one.family == 'd' || one.family == 'i';
    read_guarded(hdGetDoublev, one.name, one.count, number);
    read_guarded(hdGetFloatv, one.name, one.count, number);
    read_guarded(hdGetIntegerv, one.name, one.count, number);
    read_guarded(hdGetBooleanv, one.name, one.count, one.family == 'b');
    read_guarded(hdGetLongv, one.name, one.count, one.family == 'l');
  }
  HDlong dac[6] = {};
  hdGetLongv(HD_CURRENT_MOTOR_DAC_VALUES, dac);
  EXPECT_EQ(last_error(), static_cast<HDerror>(HD_INVALID_ENUM));
  const double velocity[3] = {};
  hdSetDoublev(HD_CURRENT_ANGULAR_VELOCITY, velocity);
  EXPECT_EQ(last_error(), static_cast<HDerror>(HD_INVALID_ENUM));
  hdSetDoublev(HD_FORCE_OUTPUT, velocity);
  EXPECT_EQ(last_error(), static_cast<HDerror>(HD_INVALID_ENUM));
  HDboolean out = 0;
  hdGetBooleanv(HD_CURRENT_INKWELL_SWITCH, &out);
  EXPECT_EQ(out, 1);
}

void expect_wrist(const char* profile, const Eigen::Vector3d& gimbal_rad,
                  const Eigen::Vector3d& gimbal_HD_rad) {
  RigOptions options;
  options.profile = profile;
  options.motion = emulator::MotionKind::kPath;
  options.path = {{0.0, Eigen::Vector3d::Zero(), gimbal_rad},
                  {1.0, Eigen::Vector3d::Zero(), gimbal_rad}};
  options.click_every_s = 0.6;
  Rig rig(options);
  hdInitDevice(HD_DEFAULT_DEVICE);
  HDint axes = 0;
  hdGetIntegerv(HD_INPUT_DOF, &axes);
  EXPECT_EQ(axes, 6);
  hdGetIntegerv(HD_OUTPUT_DOF, &axes);
  EXPECT_EQ(axes, 3);
  ASSERT_TRUE(wait_until([] {
    HDint buttons = 0;
    hdGetIntegerv(HD_CURRENT_BUTTONS, &buttons);
    return buttons == HD_DEVICE_BUTTON_1;
  })) << "the hand moves and clicks";
  ASSERT_TRUE(rig.hand_is_there());

  std::array<double, 16> transform{};
  std::array<double, 3> gimbal{};
  std::array<double, 3> turning{};
  hdBeginFrame(hdGetCurrentDevice());
  hdGetDoublev(HD_CURRENT_TRANSFORM, transform.data());
  hdGetDoublev(HD_CURRENT_GIMBAL_ANGLES, gimbal.data());
  hdGetDoublev(HD_CURRENT_ANGULAR_VELOCITY, turning.data());
  EXPECT_EQ(position_mm(), (std::array<double, 3>{transform[12], transform[13], transform[14]}));
  hdEndFrame(hdGetCurrentDevice());
  // Right, down and clockwise are positive; a count of the wrist is 6.1 mrad.
  constexpr double kCount_rad = 0.0062;
  for (std::size_t i = 0; i < 3; ++i) {
    EXPECT_NEAR(gimbal[i], gimbal_HD_rad[static_cast<Eigen::Index>(i)], kCount_rad) << i;
  }
  EXPECT_LT(std::hypot(turning[0], turning[1], turning[2]), 0.3) << "the hand keeps still";
  // The emulator's rotation in D, with D's y, z, x as HD's x, y, z on both sides.
  const auto wxyz = rig.report().wrist->orientation_wxyz;
  const Eigen::Matrix3d in_D =
      Eigen::Quaterniond(wxyz[0], wxyz[1], wxyz[2], wxyz[3]).toRotationMatrix();
  constexpr int kAxis_D[3] = {1, 2, 0};
  for (int row = 0; row < 3; ++row) {
    for (int column = 0; column < 3; ++column) {
      EXPECT_NEAR(transform[static_cast<std::size_t>(4 * column + row)],
                  in_D(kAxis_D[row], kAxis_D[column]), 3 * kCount_rad)
          << row << ", " << column;
    }
  }
}

TEST(HdDevice, HasTheRotationGimbalAnglesAndButtonOfAWrist) {
  expect_wrist("woodenhaptics_v2015_wrist", {0.5, -0.4, 0.8}, {0.5, -0.4, -0.8});
}

// Its first axis, the forearm's, points down: a positive turn is to the left.
TEST(HdDevice, HasTheGimbalOfAPhantom) {
  expect_wrist("phantom_desktop_wrist", {0.5, -1.2, 0.8}, {-0.5, -1.2, -0.8});
}

TEST(HdDevice, GivesTheIdentityWithoutAWrist) {
  Rig rig;
  hdInitDevice(HD_DEFAULT_DEVICE);
  std::array<double, 16> transform{};
  hdGetDoublev(HD_CURRENT_TRANSFORM, transform.data());
  for (std::size_t i = 0; i < 11; ++i) {
    EXPECT_EQ(transform[i], i % 5 == 0 ? 1.0 : 0.0) << i;
  }
  HDint axes = 0;
  hdGetIntegerv(HD_INPUT_DOF, &axes);
  EXPECT_EQ(axes, 3);
  std::array<double, 3> three{1.0, 1.0, 1.0};
  hdGetDoublev(HD_CURRENT_GIMBAL_ANGLES, three.data());
  EXPECT_EQ(three, (std::array<double, 3>{}));
  hdGetDoublev(HD_CURRENT_ANGULAR_VELOCITY, three.data());
  EXPECT_EQ(three, (std::array<double, 3>{}));
}

TEST(HdDevice, HasTheProfilesNumbersInMillimetres) {
  Rig rig;
  hdInitDevice(HD_DEFAULT_DEVICE);
  double box[6];
  hdGetDoublev(HD_USABLE_WORKSPACE_DIMENSIONS, box);
  const double expected[6] = {-80, -60, -60, 80, 60, 60};  // D: y, z, x
  for (int i = 0; i < 6; ++i) {
    EXPECT_NEAR(box[i], expected[i], 1e-9);
  }
  double value = 0;
  hdGetDoublev(HD_TABLETOP_OFFSET, &value);
  EXPECT_NEAR(value, -80, 1e-9);
  hdGetDoublev(HD_NOMINAL_MAX_FORCE, &value);
  EXPECT_EQ(value, 5);
  hdGetDoublev(HD_NOMINAL_MAX_CONTINUOUS_FORCE, &value);
  EXPECT_NEAR(value, 1.0, 1e-9);  // 5 N x 1.2 A / 6 A
  hdGetDoublev(HD_NOMINAL_MAX_STIFFNESS, &value);
  EXPECT_EQ(value, 1);
  HDfloat damping = 0;
  hdGetFloatv(HD_NOMINAL_MAX_DAMPING, &damping);
  EXPECT_FLOAT_EQ(damping, 0.008F);
  HDint rate = 0;
  hdGetIntegerv(HD_UPDATE_RATE, &rate);
  EXPECT_EQ(rate, 1000);
  hdGetIntegerv(HD_INSTANTANEOUS_UPDATE_RATE, &rate);
  EXPECT_EQ(rate, 1000);  // before the first tick
  const double limit = 250;
  hdSetDoublev(HD_SOFTWARE_VELOCITY_LIMIT, &limit);
  hdGetDoublev(HD_SOFTWARE_VELOCITY_LIMIT, &value);
  EXPECT_EQ(value, 250);
  const HDint light = LED_STATUS_SOLID_GRN;
  hdSetIntegerv(HD_USER_STATUS_LIGHT, &light);
  hdEnable(HD_USER_STATUS_LIGHT);
  HDint lit = 0;
  hdGetIntegerv(HD_USER_STATUS_LIGHT, &lit);
  EXPECT_EQ(lit, light);
  EXPECT_EQ(count_errors(), 0);
  hdEnable(0x4711);
  EXPECT_EQ(last_error(), static_cast<HDerror>(HD_INVALID_ENUM));
}

TEST(HdDevice, N25_EveryTextIsThere) {
  Rig rig;
  for (HDenum name = HD_VERSION; name <= HD_DEVICE_SERIAL_NUMBER; ++name) {
    EXPECT_NE(hdGetString(name), nullptr);  // without a device, too
  }
  count_errors();
  hdInitDevice(HD_DEFAULT_DEVICE);
  EXPECT_STREQ(hdGetString(HD_DEVICE_MODEL_TYPE), "woodenhaptics_v2015");
  EXPECT_STREQ(hdGetString(HD_DEVICE_VENDOR), "mbed.org");
  EXPECT_STREQ(hdGetString(HD_DEVICE_SERIAL_NUMBER), "0123456789");
  EXPECT_THAT(hdGetString(HD_DEVICE_DRIVER_VERSION), HasSubstr("forcegrid"));
  EXPECT_EQ(count_errors(), 0);
  EXPECT_STREQ(hdGetString(HD_CURRENT_POSITION), "");
  EXPECT_EQ(last_error(), static_cast<HDerror>(HD_INVALID_INPUT_TYPE));
  EXPECT_STREQ(hdGetString(0x4711), "");
  EXPECT_EQ(last_error(), static_cast<HDerror>(HD_INVALID_ENUM));
}

TEST(HdDevice, WithoutADeviceEverythingAnswers) {
  Rig rig;
  double transform[16];
  hdGetDoublev(HD_CURRENT_TRANSFORM, transform);
  EXPECT_EQ(transform[0], 1);
  EXPECT_EQ(transform[15], 1);
  EXPECT_EQ(last_error(), static_cast<HDerror>(HD_BAD_HANDLE));
  hdEnable(HD_FORCE_OUTPUT);
  EXPECT_EQ(last_error(), static_cast<HDerror>(HD_BAD_HANDLE));
  EXPECT_NE(hdCheckCalibration(), static_cast<HDenum>(HD_CALIBRATION_OK));
  count_errors();
  bool ran = false;
  rig.synchronous([&] { ran = true; });  // as programs do in a clean-up after a failed start
  EXPECT_TRUE(ran);
  hdStartScheduler();
  hdStopScheduler();
  hdUnschedule(HD_INVALID_HANDLE);
  EXPECT_EQ(hdWaitForCompletion(0, HD_WAIT_INFINITE), HD_FALSE);
  EXPECT_EQ(hdGetSchedulerTimeStamp(), 0.0);
  EXPECT_EQ(hdDeploymentLicense("a", "b", "c"), HD_TRUE);
  EXPECT_EQ(count_errors(), 0);
  hdSetSchedulerRate(7);
  EXPECT_EQ(last_error(), static_cast<HDerror>(HD_INVALID_VALUE));
  hdSetSchedulerRate(1000);
  EXPECT_EQ(hdScheduleAsynchronous(nullptr, nullptr, 0), HD_INVALID_HANDLE);
  EXPECT_EQ(last_error(), static_cast<HDerror>(HD_INVALID_VALUE));
}

TEST(HdDevice, N22_AnArmThatIsNotCalibratedSaysSoUntilItIs) {
  Rig rig({.calibrated = false});
  ASSERT_EQ(hdInitDevice(HD_DEFAULT_DEVICE), 0U);
  EXPECT_EQ(hdCheckCalibration(), static_cast<HDenum>(HD_CALIBRATION_NEEDS_MANUAL_INPUT));
  HDint style = 0;
  hdGetIntegerv(HD_CALIBRATION_STYLE, &style);
  EXPECT_EQ(style, HD_CALIBRATION_AUTO);
  EXPECT_EQ(hdCheckCalibrationStyle(), static_cast<HDenum>(HD_CALIBRATION_AUTO));
  // The emulated person presses the button.
  EXPECT_TRUE(wait_until([&] {
    hdUpdateCalibration(static_cast<HDenum>(style));
    return hdCheckCalibration() == HD_CALIBRATION_OK;
  }));
  EXPECT_EQ(count_errors(), 0);
}

TEST(HdDevice, N23_ErrorsStayInTheirThread) {
  Rig rig;
  hdInitDevice(HD_DEFAULT_DEVICE);
  hdStartScheduler();
  std::atomic<int> seen{0};
  std::atomic<int> ticks{0};
  const ClearsAtEnd end(rig);
  rig.recurring([&] {
    seen += count_errors();
    ++ticks;
    return HDCallbackCode{HD_CALLBACK_CONTINUE};
  });
  for (int i = 0; i < 20; ++i) {
    hdEndFrame(0);
  }
  ASSERT_TRUE(wait_until([&] { return ticks > 20; }));
  EXPECT_EQ(seen, 0);
  EXPECT_EQ(count_errors(), 20);
}

}  // namespace
}  // namespace forcegrid::testing
