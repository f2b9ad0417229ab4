// SPDX-License-Identifier: Apache-2.0
#include "tools/doctor.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <atomic>
#include <filesystem>
#include <fstream>
#include <string>
#include <vector>

#include "profiles/device_profile.h"
#include "tools/doctor_timing.h"

namespace forcegrid::tools {
namespace {

namespace fs = std::filesystem;
using ::testing::HasSubstr;

// A computer in a folder with which nothing is wrong, to be spoilt one thing at a time.
class Patient : public ::testing::Test {
 public:
  ~Patient() override { fs::remove_all(root_); }

 protected:
  Patient() : root_(::testing::TempDir() + "patient_" + std::to_string(getpid())) {
    fs::remove_all(root_);
    system_.roots.sysfs = root_ / "sys";
    system_.roots.dev = root_ / "dev";
    system_.roots.proc = root_ / "proc";
    system_.etc = root_ / "etc";
    system_.roots.rule_folders = {root_ / "etc/udev/rules.d"};
    system_.user.name = "ada";
    system_.user.plugdev = getgid();
    system_.user.plugdev_listed = system_.user.plugdev_active = true;
    system_.user.may_open = [](const std::string&) { return true; };
    write("etc/udev/rules.d/10-forcegrid.rules", udev_rule_text());
    fs::create_directories(root_ / "etc/security/limits.d");
    write("sys/kernel/realtime", "1\n");
    write("proc/sys/kernel/version", "#1 SMP PREEMPT_RT Debian 6.1.1\n");
    write("proc/cmdline", "root=/dev/sda1 quiet\n");
    write("proc/interrupts",
          "           CPU0\n 24:  17  PCI-MSI 327680-edge      xhci_hcd\n 30:  5  PCI-MSI  i915\n");
    for (const char* cpu : {"cpu0", "cpu1"}) {
      const std::string folder = std::string("sys/devices/system/cpu/") + cpu;
      write(folder + "/cpufreq/scaling_governor", "performance\n");
      write(folder + "/cpuidle/state0/name", "C1\n");
      write(folder + "/cpuidle/state0/latency", "2\n");
      write(folder + "/cpuidle/state1/name", "C10\n");
      write(folder + "/cpuidle/state1/latency", "890\n");
      write(folder + "/cpuidle/state1/disable", "1\n");
    }
    write("sys/devices/system/clocksource/clocksource0/current_clocksource", "tsc\n");
    for (const std::string& name : profiles::available_profiles()) {
      known_.push_back(profiles::load_device_profile(name));
    }
  }

  void write(const std::string& file, const std::string& text) const {
    fs::create_directories((root_ / file).parent_path());
    std::ofstream(root_ / file) << text;
  }

  std::vector<Finding> findings() const { return examine_system(system_, known_); }

  Finding finding(const std::string& check) const {
    for (const Finding& found : findings()) {
      if (found.check == check) {
        return found;
      }
    }
    ADD_FAILURE() << "nothing is said of " << check;
    return {};
  }

  fs::path root_;
  DoctorSystem system_;
  std::vector<profiles::DeviceProfile> known_;
};

TEST_F(Patient, IsWell) {
  for (const Finding& found : findings()) {
    if (found.check != "devices") {
      EXPECT_EQ(found.verdict, Verdict::kGood) << found.check << ": " << found.what;
      EXPECT_EQ(found.remedy, "") << found.check;
    }
  }
}

TEST_F(Patient, LacksTheRuleOrHasAnOldOne) {
  write("etc/udev/rules.d/10-forcegrid.rules", "# of last year\n");
  EXPECT_EQ(finding("udev rule").verdict, Verdict::kWarn);
  fs::remove(root_ / "etc/udev/rules.d/10-forcegrid.rules");
  const Finding found = finding("udev rule");
  EXPECT_EQ(found.verdict, Verdict::kBad);
  EXPECT_THAT(found.remedy, HasSubstr("udevadm control --reload"));
  ASSERT_EQ(found.fixes.size(), 1u);
  // The advice cures.
  EXPECT_THAT(apply_fixes(found.fixes).at(0), HasSubstr("wrote"));
  EXPECT_EQ(finding("udev rule").verdict, Verdict::kGood);
}

TEST_F(Patient, IsInNoGroupOrInALaterSession) {
  system_.user.plugdev_active = false;
  EXPECT_THAT(finding("group plugdev").remedy, HasSubstr("log in again"));
  system_.user.plugdev_listed = false;
  EXPECT_THAT(finding("group plugdev").remedy, HasSubstr("usermod -aG plugdev ada"));
  system_.user.plugdev.reset();
  EXPECT_THAT(finding("group plugdev").remedy, HasSubstr("groupadd"));
}

TEST_F(Patient, IsRefusedRealTimeAndMemory) {
  system_.grants.realtime_refused = "Operation not permitted";
  system_.grants.memory_refused = "Cannot allocate memory";
  const Finding realtime = finding("real-time priority");
  EXPECT_EQ(realtime.verdict, Verdict::kBad);
  EXPECT_THAT(realtime.what, HasSubstr("Operation not permitted"));
  EXPECT_THAT(realtime.remedy, HasSubstr("rtprio 95"));
  ASSERT_EQ(realtime.fixes.size(), 1u);
  EXPECT_THAT(realtime.fixes[0].text, HasSubstr("@plugdev - rtprio 95"));
  EXPECT_THAT(realtime.fixes[0].text, HasSubstr("@plugdev - memlock unlimited"));
  EXPECT_THAT(finding("locked memory").remedy, HasSubstr("memlock unlimited"));
}

TEST_F(Patient, HasAKernelThatPreemptsLittle) {
  write("sys/kernel/realtime", "0\n");
  write("proc/sys/kernel/version", "#1 SMP PREEMPT_DYNAMIC Debian 6.1.1\n");
  EXPECT_EQ(finding("kernel preemption").verdict, Verdict::kWarn);
  EXPECT_THAT(finding("kernel preemption").remedy, HasSubstr("linux-image-rt-amd64"));
  write("proc/cmdline", "quiet preempt=full\n");
  EXPECT_EQ(finding("kernel preemption").verdict, Verdict::kGood);
  write("proc/sys/kernel/version", "#1 SMP Debian 6.1.1\n");
  EXPECT_EQ(finding("kernel preemption").verdict, Verdict::kWarn);
}

TEST_F(Patient, SavesPower) {
  write("sys/devices/system/cpu/cpu1/cpufreq/scaling_governor", "powersave\n");
  const Finding governor = finding("CPU governor");
  EXPECT_EQ(governor.verdict, Verdict::kWarn);
  EXPECT_EQ(governor.what, "cpu1 powersave");
  apply_fixes(governor.fixes);
  EXPECT_EQ(finding("CPU governor").verdict, Verdict::kGood);

  write("sys/devices/system/cpu/cpu1/cpuidle/state1/disable", "0\n");
  const Finding idle = finding("CPU idle states");
  EXPECT_EQ(idle.verdict, Verdict::kWarn);
  EXPECT_THAT(idle.what, HasSubstr("C10, 890 us"));
  EXPECT_THAT(idle.remedy, HasSubstr("cpupower"));
  EXPECT_TRUE(idle.fixes.empty());  // it costs power: the user decides
}

TEST_F(Patient, HasASlowClock) {
  write("sys/devices/system/clocksource/clocksource0/current_clocksource", "hpet\n");
  EXPECT_EQ(finding("clock and timers").verdict, Verdict::kWarn);
  system_.grants.clock_resolution_ns = 4'000'000;
  EXPECT_EQ(finding("clock and timers").verdict, Verdict::kBad);
}

TEST_F(Patient, SharesTheInterruptOfTheBus) {
  write("proc/interrupts",
        "           CPU0\n 16:  17  IO-APIC  16-fasteoi   ehci_hcd:usb1, nvkm\n");
  const Finding irq = finding("USB host controller's interrupt");
  EXPECT_EQ(irq.verdict, Verdict::kWarn);
  EXPECT_THAT(irq.what, HasSubstr("IRQ 16"));
  EXPECT_THAT(irq.what, HasSubstr("nvkm"));
}

TEST_F(Patient, LetsItsDeviceFallAsleep) {
  const fs::path usb = root_ / "sys/devices/usb1/1-4";
  for (const auto& [name, text] : std::vector<std::pair<std::string, std::string>>{
           {"idVendor", "0403"}, {"idProduct", "cb48"}, {"busnum", "1"}, {"devnum", "4"}}) {
    write("sys/devices/usb1/1-4/" + name, text + "\n");
  }
  write("sys/devices/usb1/1-4/power/control", "auto\n");
  fs::create_directories(root_ / "sys/bus/usb/devices");
  fs::create_directory_symlink(usb, root_ / "sys/bus/usb/devices/1-4");
  write("dev/bus/usb/001/004", "");
  const Finding device = finding("device at 1-4");
  EXPECT_EQ(device.verdict, Verdict::kWarn);
  apply_fixes(device.fixes);
  EXPECT_EQ(finding("device at 1-4").verdict, Verdict::kGood);
}

TEST(Fixes, SayWhatCouldNotBeDone) {
  const auto done = apply_fixes({{"/proc/no-such-folder/x", "1\n", "never"}});
  ASSERT_EQ(done.size(), 1u);
  EXPECT_THAT(done[0], HasSubstr("could not write /proc/no-such-folder/x"));
  EXPECT_THAT(done[0], HasSubstr("No such file or directory"));
}

TEST(Wakeups, AreJudgedByTheShareOfAPeriod) {
  constexpr double kPeriod_us = 2000.0;
  const auto verdict_of = [&](double late_us, bool realtime) {
    WakeupTest test;
    test.realtime = realtime;
    for (int i = 0; i < 1000; ++i) {
      test.latency_us.add(i < 990 ? 9.0 : late_us);  // 1 % are late
    }
    return judge_wakeups("wake-up", test, kPeriod_us);
  };
  EXPECT_EQ(verdict_of(100.0, true).verdict, Verdict::kGood);
  EXPECT_EQ(verdict_of(500.0, true).verdict, Verdict::kWarn);
  EXPECT_EQ(verdict_of(1500.0, true).verdict, Verdict::kBad);
  EXPECT_THAT(verdict_of(1500.0, true).remedy, HasSubstr("PREEMPT_RT"));
  EXPECT_THAT(verdict_of(1500.0, false).remedy, HasSubstr("real-time priority"));
}

TEST(Wakeups, AreShownAsAHistogram) {
  rt::Percentiles latency_us;
  for (int i = 0; i < 100; ++i) {
    latency_us.add(i < 90 ? 9.0 : i < 98 ? 70.0 : 1e6);
  }
  const std::vector<LatencyBin> bins = latency_histogram(latency_us);
  ASSERT_EQ(bins.size(), 14u);  // 10, 20, 50, 100 us, ... 100 ms, and more
  EXPECT_EQ(bins[0].up_to_us, 10.0);
  EXPECT_EQ(bins[0].count, 90u);
  EXPECT_EQ(bins[3].up_to_us, 100.0);
  EXPECT_EQ(bins[3].count, 8u);
  EXPECT_EQ(bins[13].count, 2u);
  const std::vector<std::string> lines = histogram_lines(bins);
  ASSERT_EQ(lines.size(), bins.size());
  EXPECT_EQ(lines[0], "<=     10 us       90 " + std::string(45, '#'));  // 50 for all
  EXPECT_EQ(lines[13], "more                2 #");
  EXPECT_TRUE(histogram_lines(latency_histogram({})).empty());
}

TEST(RoundTrips, AreJudgedByTheAnswersThatDidNotCome) {
  RoundTrips trips;
  trips.sent = 1000;
  EXPECT_EQ(judge_round_trips("trip", trips, "do this").verdict, Verdict::kBad);
  EXPECT_EQ(judge_round_trips("trip", trips, "do this").remedy, "do this");
  for (int i = 0; i < 980; ++i) {
    trips.us.add(800.0);
  }
  trips.unanswered = 20;
  EXPECT_EQ(judge_round_trips("trip", trips, "").verdict, Verdict::kWarn);
  EXPECT_THAT(judge_round_trips("trip", trips, "").what, HasSubstr("20 of 1000 unanswered"));
  trips.unanswered = 0;
  const Finding good = judge_round_trips("trip", trips, "");
  EXPECT_EQ(good.verdict, Verdict::kGood);
  ASSERT_EQ(good.histogram.size(), 1u);
  EXPECT_EQ(good.histogram[0].up_to_us, 1000.0);
  EXPECT_EQ(good.histogram[0].count, 980u);
}

TEST(Wakeups, AreCountedOnceADeadlineThatWasMet) {
  const std::atomic<bool> stop{false};
  const WakeupTest test = measure_wakeups(0.2, 0.002, true, stop);
  EXPECT_GT(test.latency_us.count(), 0u);
  EXPECT_LE(test.latency_us.count(), 100u);
  EXPECT_EQ(test.latency_us.ignored(), 0u);  // never early
}

}  // namespace
}  // namespace forcegrid::tools
