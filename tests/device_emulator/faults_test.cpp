// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <deque>
#include <optional>
#include <set>
#include <stdexcept>
#include <string>
#include <vector>

#include "device_emulator/emulated_device.h"
#include "device_emulator/fault_descriptors.h"
#include "device_emulator/fault_spec.h"
#include "device_emulator/faulty_device.h"
#include "profiles/device_profile.h"

namespace forcegrid::emulator {
namespace {

using std::chrono::milliseconds;
using Bytes = std::vector<std::uint8_t>;

rt::TimePoint at(int time_ms) { return rt::TimePoint(milliseconds(time_ms)); }

std::string refusal(const std::string& text) {
  try {
    static_cast<void>(parse_fault(text));
  } catch (const std::invalid_argument& error) {
    return error.what();
  }
  return "";
}

TEST(FaultSpec, HasDefaultsAndTakesWhatIsSaid) {
  const FaultSpec late = parse_fault("late-report");
  EXPECT_EQ(late.kind, FaultKind::kLateReport);
  EXPECT_EQ(late.milliseconds, 5.0);
  EXPECT_EQ(late.start, FaultSpec::Start::kMotors);
  EXPECT_EQ(late.duration_s, 0.0);
  EXPECT_EQ(late.count, 0u);

  const FaultSpec said = parse_fault("late-report:ms=50,when=1.5,for=2,count=3,every=4");
  EXPECT_EQ(said.milliseconds, 50.0);
  EXPECT_EQ(said.start, FaultSpec::Start::kSeconds);
  EXPECT_EQ(said.start_s, 1.5);
  EXPECT_EQ(said.duration_s, 2.0);
  EXPECT_EQ(said.count, 3u);
  EXPECT_EQ(said.every, 4u);

  EXPECT_EQ(parse_fault("frozen-encoder:axis=b").axis, 1);
  EXPECT_EQ(parse_fault("frozen-encoder:axis=f").axis, 5);
  EXPECT_FALSE(parse_fault("frozen-encoder").axis.has_value());
  EXPECT_TRUE(parse_fault("corrupt-report:size=small").small_corruption);
  EXPECT_EQ(parse_fault("wrong-way-motor").start, FaultSpec::Start::kPowerUp);
  EXPECT_EQ(parse_fault("firmware-reboot").count, 1u);
  EXPECT_EQ(parse_fault("wrong-echo:at=70").image_byte, 70u);
  EXPECT_EQ(parse_fault("stuck-boot-loader:step=baud-rate").boot_step, BootStep::kBaudRate);
}

TEST(FaultSpec, RefusesWhatItDoesNotKnowAndSaysWhatThereIs) {
  EXPECT_NE(refusal("gremlins").find("'gremlins' is unknown"), std::string::npos);
  EXPECT_NE(refusal("gremlins").find("babble"), std::string::npos);
  EXPECT_NE(refusal("babble:ms=5").find("no key 'ms'"), std::string::npos);
  EXPECT_NE(refusal("late-report:ms=-5").find("at most 60000"), std::string::npos);
  EXPECT_NE(refusal("late-report:ms=5x").find("ms=5x"), std::string::npos);
  EXPECT_NE(refusal("late-report:ms=nan").find("ms=nan"), std::string::npos);
  EXPECT_NE(refusal("late-report:every=0").find("from 1"), std::string::npos);
  EXPECT_NE(refusal("frozen-encoder:axis=g").find("for a wrist d, e, f"), std::string::npos);
  EXPECT_NE(refusal("drop-report:when").find("KEY=VALUE"), std::string::npos);
  EXPECT_NE(refusal("drop-report:").find("nothing follows"), std::string::npos);
  EXPECT_NE(refusal("drop-report:probability=1.5").find("0 to 1"), std::string::npos);
  EXPECT_NE(refusal("short-report:bytes=65").find("64"), std::string::npos);
  EXPECT_NE(refusal("stuck-boot-loader:step=lunch").find("greeting, baud-rate or start"),
            std::string::npos);
  EXPECT_NE(refusal("wrong-echo:at=-1").find("from 0"), std::string::npos);
}

TEST(FaultSpec, ListsEveryFaultByAName) {
  std::set<std::string> names;
  for (int kind = 0; kind < static_cast<int>(FaultKind::kCount); ++kind) {
    const std::string name = name_of(static_cast<FaultKind>(kind));
    EXPECT_TRUE(names.insert(name).second) << name;
    EXPECT_EQ(static_cast<int>(parse_fault(name).kind), kind);
    EXPECT_NE(fault_names_text().find("  " + name), std::string::npos);
  }
}

/// A host with one IN transfer pending in every frame and one OUT packet at a time.
class Frame final : public UsbHost {
 public:
  std::optional<std::span<const std::uint8_t>> out_packet(std::uint8_t) override {
    return out ? std::optional(std::span<const std::uint8_t>(*out)) : std::nullopt;
  }
  void take_out(std::uint8_t) override {
    taken = true;
    out.reset();
  }
  bool wants_in(std::uint8_t) override { return !in && !babbled && !overfilled; }
  bool give_in(std::uint8_t, std::span<const std::uint8_t> packet) override {
    in.emplace(packet.begin(), packet.end());
    return true;
  }
  void babble(std::uint8_t) override { babbled = true; }
  void overfill(std::uint8_t) override { overfilled = true; }

  std::optional<Bytes> out;
  std::optional<Bytes> in;
  bool taken = false;
  bool babbled = false;
  bool overfilled = false;
};

/// A W2 device with one fault from power-up on, its firmware started, a frame a millisecond. The
/// hand keeps still; the counters are those of the calibration pose, 0, 0, 6000.
class Bus {
 public:
  explicit Bus(const std::string& fault, const char* profile = "woodenhaptics_v2015") {
    DeviceOptions options;
    options.profile = profiles::load_device_profile(profile);
    options.operator_script.calibrated = true;
    options.operator_script.motion = MotionKind::kStill;
    options.faults = {parse_fault(fault)};
    device = make_emulated_device(options, at(0));
    EXPECT_FALSE(device->control({0x00, 9, 1, 0, 0}, {}, at(0)).stalled);
    while (now_ms < 1000) {
      frame();
    }
  }
  /// @param out taken along until it is taken.
  Frame frame(const Bytes* out = nullptr) {
    ++now_ms;
    Frame host;
    if (out != nullptr) {
      host.out = *out;
    }
    device->run(at(now_ms), host);
    if (host.in) {
      reports.push_back({now_ms, *host.in});
    }
    return host;
  }
  /// A report of zero current in every frame.
  void drive(int frames) {
    const Bytes zero(14, 0);
    for (int i = 0; i < frames; ++i) {
      frame(&zero);
    }
  }
  std::uint64_t acted() const { return device->report().faults.at(0).times; }

  struct Report {
    int time_ms = 0;
    Bytes bytes;
    std::int16_t counter(std::size_t axis) const {
      return static_cast<std::int16_t>(
          static_cast<std::uint16_t>(bytes.at(2 * axis) | (bytes.at(2 * axis + 1) << 8)));
    }
  };
  std::unique_ptr<EmulatedDevice> device;
  std::vector<Report> reports;
  int now_ms = 0;
};

// The first report is armed after a second and collected in the next frame.
constexpr std::size_t kHundredFrames = 100;

TEST(FaultyDevice, DropsEveryNthReport) {
  Bus bus("drop-report:every=10,when=power-up");
  bus.drive(100);
  EXPECT_GE(bus.acted(), 9u);
  EXPECT_EQ(bus.reports.size() + bus.acted(), kHundredFrames + 1);
}

TEST(FaultyDevice, ItsHandFollowsAPointerToo) {
  Bus bus("drop-report:every=1000,when=power-up");
  bus.drive(3500);  // until the hand is at the contact point
  const Eigen::Vector3d pointer_D(0.01, -0.02, 0.02);
  bus.device->point_hand_at(pointer_D);
  bus.drive(1000);
  const auto tip_m = bus.device->report().tip_position_m;
  EXPECT_LT((Eigen::Vector3d(tip_m[0], tip_m[1], tip_m[2]) - pointer_D).norm(), 1e-3);
}

TEST(FaultyDevice, SendsReportsTwice) {
  Bus bus("duplicate-report:every=10,count=1,when=power-up");
  bus.drive(30);
  ASSERT_EQ(bus.acted(), 1u);
  std::size_t twins = 0;
  for (std::size_t i = 1; i < bus.reports.size(); ++i) {
    twins += bus.reports[i].time_ms == bus.reports[i - 1].time_ms + 1 &&
                     bus.reports[i].bytes == bus.reports[i - 1].bytes
                 ? 1
                 : 0;
  }
  EXPECT_GE(twins, 1u);
}

TEST(FaultyDevice, HoldsReportsBack) {
  Bus bus("late-report:ms=50,count=1,when=power-up");
  bus.drive(100);
  ASSERT_EQ(bus.acted(), 1u);
  // Armed when the firmware had started, 1000 ms after its configuration.
  ASSERT_FALSE(bus.reports.empty());
  EXPECT_GE(bus.reports.front().time_ms, 1050);
  EXPECT_LE(bus.reports.front().time_ms, 1052);
}

TEST(FaultyDevice, ChangesTheLengthOfReports) {
  for (const std::size_t bytes : {0U, 7U, 20U, 64U}) {
    Bus bus(
        (bytes < 14 ? "short-report:when=power-up,bytes=" : "long-report:when=power-up,bytes=") +
        std::to_string(bytes));
    bus.drive(3);
    ASSERT_FALSE(bus.reports.empty());
    EXPECT_EQ(bus.reports.back().bytes.size(), bytes);
  }
}

TEST(FaultyDevice, CorruptsCountersByAnythingOrByTheirLowestBits) {
  Bus large("corrupt-report:when=power-up");
  large.drive(50);
  std::set<std::int16_t> seen;
  for (const auto& report : large.reports) {
    seen.insert(report.counter(2));
  }
  EXPECT_GT(seen.size(), 40u);
  Bus small("corrupt-report:size=small,when=power-up");
  small.drive(50);
  for (const auto& report : small.reports) {
    EXPECT_NEAR(report.counter(0), 0, 3);
    EXPECT_NEAR(report.counter(2), 6000, 3);
  }
}

TEST(FaultyDevice, MakesEncodersJumpAndSaturate) {
  Bus jumps("jumping-encoder:counts=500,every=5,axis=a,when=power-up");
  jumps.drive(20);
  EXPECT_EQ(std::count_if(jumps.reports.begin(), jumps.reports.end(),
                          [](const auto& report) { return report.counter(0) >= 499; }),
            static_cast<std::ptrdiff_t>(jumps.acted()));
  Bus ends("saturated-encoder:axis=c,when=power-up");
  ends.drive(5);
  EXPECT_EQ(ends.reports.back().counter(2), 32767);
  EXPECT_NEAR(ends.reports.back().counter(0), 0, 2);
}

TEST(FaultyDevice, SpoilsTheCountersOfAWristOneByOne) {
  constexpr const char* kWrist = "woodenhaptics_v2015_wrist";
  Bus jumps("jumping-encoder:counts=300,axis=e,when=power-up", kWrist);
  jumps.drive(5);
  EXPECT_EQ(jumps.reports.back().counter(3), 0);
  EXPECT_EQ(jumps.reports.back().counter(4), 300);
  EXPECT_EQ(jumps.reports.back().counter(5), 0);
  EXPECT_NEAR(jumps.reports.back().counter(0), 0, 2);
  Bus ends("saturated-encoder:axis=f,when=power-up", kWrist);
  ends.drive(5);
  EXPECT_EQ(ends.reports.back().counter(5), 32767);
  EXPECT_EQ(ends.reports.back().counter(4), 0);
  Bus all("jumping-encoder:counts=300,axis=all,when=power-up", kWrist);
  all.drive(5);
  EXPECT_NEAR(all.reports.back().counter(1), 300, 2);
  EXPECT_EQ(all.reports.back().counter(4), 0) << "all are those of the arm";
}

TEST(FaultyDevice, StallsItsEndpoints) {
  Bus in("stall-in:when=power-up");
  EXPECT_TRUE(in.device->halted(0x81));
  EXPECT_FALSE(in.device->halted(0x01));
  Bus out("stall-out:when=power-up");
  EXPECT_TRUE(out.device->halted(0x01));
  EXPECT_FALSE(out.device->halted(0x81));
}

TEST(FaultyDevice, TakesNoReportWhileItAnswersNak) {
  Bus bus("nak-out:when=power-up,for=1.05");
  const Bytes zero(14, 0);
  int taken_at_ms = 0;
  while (taken_at_ms == 0 && bus.now_ms < 2000) {
    if (bus.frame(&zero).taken) {
      taken_at_ms = bus.now_ms;
    }
  }
  EXPECT_EQ(taken_at_ms, 1050);
}

TEST(FaultyDevice, BabblesOnceForEachTimeThatItIsAskedFor) {
  Bus bus("babble:count=3,when=power-up");
  int babbles_later = 0;
  for (int i = 0; i < 10; ++i) {
    babbles_later += bus.frame().babbled ? 1 : 0;
  }
  // The first one came with the first report, a second after the configuration.
  EXPECT_EQ(babbles_later, 2);
  EXPECT_EQ(bus.acted(), 3u);
  EXPECT_FALSE(bus.reports.empty());
}

TEST(FaultyDevice, HasItsReportOverfilledOnTheWay) {
  Bus bus("over-long-payload:count=1,when=power-up");
  bus.drive(5);
  EXPECT_EQ(bus.acted(), 1u);
  // The first one never reached the host; the ping-pong went on.
  EXPECT_EQ(bus.device->report().reports_sent, bus.reports.size() + 1);
}

TEST(FaultyDevice, IsBusyAfterEachReportThatItTakes) {
  Bus bus("slow-firmware:ms=20,when=power-up");
  bus.drive(200);
  // At most one OUT every 20 ms, and not more reports than OUTs but for the first.
  EXPECT_GE(bus.reports.size(), 5u);
  EXPECT_LE(bus.reports.size(), 11u);
  EXPECT_LE(bus.acted(), 10u);
}

TEST(FaultyDevice, LetsTheWatchdogTripAlthoughReportsCome) {
  Bus bus("watchdog-trip:when=1.2");
  bus.drive(1000);
  EXPECT_EQ(bus.device->report().watchdog_trips, 1u);
  EXPECT_GT(bus.reports.size(), 900u);
  EXPECT_GT(bus.device->report().short_reports, 700u);
}

TEST(FaultyDevice, TurnsTheCurrentsOfItsMotorsRoundButNotTheCountersThatItIsGiven) {
  Bus bus("wrong-way-motor:axis=b");
  Bytes out(14, 0);
  out[0] = 100;  // mA, a
  out[2] = 100;  // mA, b
  bus.frame(&out);
  bus.frame(&out);
  const auto current_mA = bus.device->report().final_current_mA;
  EXPECT_NEAR(current_mA[0], 100.0, 1e-6);
  EXPECT_NEAR(current_mA[1], -100.0, 1e-6);
  Bytes load(14, 0);
  load[2] = 5;  // counter e
  load[6] = 1;
  bus.frame(&load);
  bus.frame();
  EXPECT_EQ(bus.device->report().counters[4], 5);
}

TEST(FaultyDevice, TurnsTheMotorsOfAWristRoundOneByOne) {
  Bus bus("wrong-way-motor:axis=e", "emulated_6dof");
  Bytes out(20, 0);
  for (const std::size_t motor : {0, 1, 2, 7, 8, 9}) {  // words of the report, docs/wrist.md
    out[2 * motor] = 100;                               // mA
  }
  bus.frame(&out);
  bus.frame(&out);
  const EmulatorReport report = bus.device->report();
  const auto& wrist_mA = report.wrist->final_current_mA;
  for (std::size_t i = 0; i < 3; ++i) {
    EXPECT_NEAR(report.final_current_mA[i], 100.0, 1e-6) << i;
    EXPECT_NEAR(wrist_mA[i], i == 1 ? -100.0 : 100.0, 1e-6) << i;
  }
}

TEST(FaultyDevice, LosesItsCountersWithItsPowerAndIsGoneForAWhile) {
  Bus bus("firmware-reboot:ms=100,when=1.2");
  bus.drive(190);
  EXPECT_TRUE(bus.device->plugged_in());
  EXPECT_NEAR(bus.device->report().counters[2], 6000, 2);
  bus.drive(20);
  EXPECT_FALSE(bus.device->plugged_in());
  EXPECT_FALSE(bus.device->configured());
  EXPECT_NEAR(bus.device->report().counters[2], 0, 2);
  bus.drive(100);
  EXPECT_TRUE(bus.device->plugged_in());
}

TEST(FaultyDevice, WaitsUntilTheMotorsHavePushedForHalfASecond) {
  Bus bus("frozen-encoder");
  Bytes out(14, 0);
  out[0] = 50;
  for (int i = 0; i < 490; ++i) {
    bus.frame(&out);
  }
  EXPECT_EQ(bus.acted(), 0u);
  bus.drive(5);  // a pause restarts the half second
  for (int i = 0; i < 495; ++i) {
    bus.frame(&out);
  }
  EXPECT_EQ(bus.acted(), 0u);
  for (int i = 0; i < 20; ++i) {
    bus.frame(&out);
  }
  EXPECT_GT(bus.acted(), 5u);
  const std::int16_t stuck = bus.reports.back().counter(2);
  bus.drive(30);
  EXPECT_EQ(bus.reports.back().counter(2), stuck);
  ASSERT_TRUE(bus.device->report().faults[0].seconds_until_motors_off);
  EXPECT_NEAR(*bus.device->report().faults[0].seconds_until_motors_off, 0.015, 0.01);
}

TEST(FaultyDevice, RefusesFaultsThatItsDeviceCannotHave) {
  DeviceOptions options;
  options.profile = profiles::load_device_profile("woodenhaptics_v2015");
  const auto refusal_of = [&](const char* fault, const char* protocol) -> std::string {
    try {
      profiles::DeviceProfile profile = options.profile;
      profile.usb.protocol = protocol;
      FaultyDevice(make_emulated_device(options, at(0)), profile, {parse_fault(fault)}, at(0));
    } catch (const std::invalid_argument& error) {
      return error.what();
    }
    return "";
  };
  for (const char* fault : {"frozen-encoder", "wrong-way-motor", "corrupt-report"}) {
    EXPECT_NE(refusal_of(fault, "another").find("use it with a w2, w3 or falcon device"),
              std::string::npos);
  }
  EXPECT_NE(refusal_of("watchdog-trip", "falcon").find("use it with a w2 or w3 device"),
            std::string::npos);
  for (const char* fault : {"status-only", "wrong-echo", "stuck-boot-loader"}) {
    EXPECT_NE(refusal_of(fault, "w2").find("use it with a falcon device"), std::string::npos);
  }
  EXPECT_EQ(refusal_of("nak-out", "another"), "");
  EXPECT_NE(refusal_of("wrong-way-motor:axis=d", "w2").find("a wrist does not have"),
            std::string::npos);
  EXPECT_NE(refusal_of("wrong-way-motor:axis=d", "w2").find("use it with a w6 device"),
            std::string::npos);
  EXPECT_NE(refusal_of("frozen-encoder:axis=d", "falcon").find("use it with a w2 or w3 device"),
            std::string::npos);
  options.faults = {parse_fault("frozen-encoder:axis=d")};
  try {
    static_cast<void>(make_emulated_device(options, at(0)));
    ADD_FAILURE() << "an arm without a wrist froze a counter of it";
  } catch (const std::invalid_argument& error) {
    EXPECT_NE(std::string(error.what()).find("'woodenhaptics_v2015' has none"), std::string::npos);
  }
}

TEST(DescriptorMutations, AreTheSameForTheSameNumbersAndOthersForOthers) {
  const Bytes device = {0x12, 0x01, 0x00, 0x02, 0x00, 0x00, 0x00, 0x40, 0x34,
                        0x12, 0x06, 0x00, 0x01, 0x00, 0x01, 0x02, 0x03, 0x01};
  std::set<Bytes> seen;
  int stalled = 0;
  for (std::uint64_t set = 0; set < 1000; ++set) {
    const DescriptorMutations mutations(11, set);
    const auto once = mutations.apply(1, 0, 0, device);
    EXPECT_EQ(once, mutations.apply(1, 0, 0, device));
    if (once) {
      seen.insert(*once);
    } else {
      ++stalled;
    }
  }
  EXPECT_GT(stalled, 0);
  EXPECT_GT(seen.size(), 200u);
  EXPECT_TRUE(seen.contains(device));  // some are left alone
}

}  // namespace
}  // namespace forcegrid::emulator
