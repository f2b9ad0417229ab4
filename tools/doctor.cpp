// SPDX-License-Identifier: Apache-2.0
#include "tools/doctor.h"

#include <sys/resource.h>
#include <time.h>

#include <Eigen/Core>
#include <algorithm>
#include <cctype>
#include <cerrno>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <sstream>
#include <thread>

#include "driver/sysfs_file.h"
#include "rt/thread.h"

namespace forcegrid::tools {
namespace {

namespace fs = std::filesystem;

constexpr char kRuleFile[] = "10-forcegrid.rules";
constexpr double kSlowIdle_us = 100.0;  // a twentieth of the 2 ms cycle
constexpr char kLimits[] =
    "# Real-time priority and locked memory for users of haptic devices.\n"
    "@plugdev - rtprio 95\n"
    "@plugdev - memlock unlimited\n";

std::string text_of(const fs::path& file) {
  std::ifstream stream(file);
  return {std::istreambuf_iterator<char>(stream), {}};
}

Finding rule_finding(const DoctorSystem& system) {
  Finding finding{.check = "udev rule"};
  const std::string target = system.etc + "/udev/rules.d/" + kRuleFile;
  std::string installed;
  for (const std::string& folder : system.roots.rule_folders) {
    std::error_code error;
    if (installed.empty() && fs::exists(folder + "/" + kRuleFile, error)) {
      installed = folder + "/" + kRuleFile;
    }
  }
  const std::string install = "sudo make install-udev (or: sudo cp udev/10-forcegrid.rules " +
                              target +
                              " && sudo udevadm control --reload), then plug the device in again";
  if (installed.empty()) {
    finding.verdict = Verdict::kBad;
    finding.what = std::string(kRuleFile) + " is not installed";
    finding.cost = "only root can use devices, and they may be suspended when idle";
  } else if (text_of(installed) != udev_rule_text()) {
    finding.verdict = Verdict::kWarn;
    finding.what = installed + " differs from this version's rule";
    finding.cost = "newer devices may not be covered";
  } else {
    finding.what = installed + " is this version's rule";
    return finding;
  }
  finding.remedy = install;
  finding.fixes.push_back(
      {target, udev_rule_text(),
       "installs the rule; it applies to devices plugged in after 'udevadm control --reload'"});
  return finding;
}

Finding group_finding(const SurveyUser& user) {
  Finding finding{.check = "group plugdev"};
  if (!user.plugdev) {
    finding.verdict = Verdict::kWarn;
    finding.what = "the group plugdev does not exist";
    finding.cost =
        "the rule then works only for the user at the computer, not over ssh or for services";
    finding.remedy = "sudo groupadd --system plugdev && sudo usermod -aG plugdev " + user.name +
                     ", then log in again";
  } else if (!user.plugdev_listed && user.name != "root") {
    finding.verdict = Verdict::kWarn;
    finding.what = user.name + " is not in group plugdev";
    finding.cost = "devices can be used at the computer, not over ssh or by services";
    finding.remedy = "sudo usermod -aG plugdev " + user.name + ", then log in again";
  } else if (!user.plugdev_active && user.name != "root") {
    finding.verdict = Verdict::kWarn;
    finding.what = user.name + " is in group plugdev, but not yet in this session";
    finding.cost = "the membership has no effect yet";
    finding.remedy = "log in again (or for this shell: newgrp plugdev)";
  } else {
    finding.what = user.name == "root" ? "not needed by root" : user.name + " is in it";
  }
  return finding;
}

// One file sets both limits.
FileFix limits_fix(const DoctorSystem& system) {
  return {system.etc + "/security/limits.d/95-forcegrid.conf", kLimits,
          "lets group plugdev have real-time priority and locked memory, from the next login on"};
}

std::vector<Finding> limit_findings(const DoctorSystem& system) {
  const std::string remedy =
      "printf '@plugdev - rtprio 95\\n@plugdev - memlock unlimited\\n' | sudo tee " +
      limits_fix(system).file + ", then log in again";
  Finding realtime{.check = "real-time priority"};
  realtime.what = "granted (SCHED_FIFO)";
  if (!system.grants.realtime_refused.empty()) {
    realtime.verdict = Verdict::kBad;
    realtime.what = "refused: " + system.grants.realtime_refused;
    realtime.cost = "any other program may delay the loop for milliseconds";
    realtime.remedy = remedy;
    realtime.fixes.push_back(limits_fix(system));
  }
  Finding memory{.check = "locked memory"};
  memory.what = "granted";
  if (!system.grants.memory_refused.empty()) {
    memory.verdict = Verdict::kWarn;
    memory.what = "refused: " + system.grants.memory_refused;
    memory.cost = "a swapped-out page may delay a cycle for milliseconds";
    memory.remedy = remedy;
    memory.fixes.push_back(limits_fix(system));
  }
  return {realtime, memory};
}

Finding kernel_finding(const DoctorSystem& system) {
  Finding finding{.check = "kernel preemption"};
  const std::string version = driver::first_line(system.roots.proc + "/sys/kernel/version");
  const std::string command_line = driver::first_line(system.roots.proc + "/cmdline");
  const std::string remedy =
      "sudo apt-get install linux-image-rt-amd64, then reboot into it (or with the current kernel: "
      "add preempt=full to GRUB_CMDLINE_LINUX in /etc/default/grub, sudo update-grub, reboot)";
  const bool full = command_line.find("preempt=full") != std::string::npos;
  if (driver::first_line(system.roots.sysfs + "/kernel/realtime") == "1" ||
      version.find("PREEMPT_RT") != std::string::npos) {
    finding.what = "PREEMPT_RT";
  } else if (version.empty()) {
    finding.verdict = Verdict::kUnknown;
    finding.what = "the kernel does not report it";
  } else if (version.find("PREEMPT_DYNAMIC") != std::string::npos) {
    finding.verdict = full ? Verdict::kGood : Verdict::kWarn;
    finding.what = full ? "PREEMPT_DYNAMIC, full" : "PREEMPT_DYNAMIC without preempt=full";
  } else {
    finding.verdict =
        version.find("PREEMPT") != std::string::npos ? Verdict::kGood : Verdict::kWarn;
    finding.what = finding.verdict == Verdict::kGood ? "PREEMPT" : "no preemption in the kernel";
  }
  if (finding.verdict == Verdict::kWarn) {
    finding.cost = "another program's long system call delays the loop until it ends";
    finding.remedy = remedy;
  }
  return finding;
}

std::vector<fs::path> cpu_folders(const DoctorSystem& system) {
  std::vector<fs::path> folders;
  std::error_code error;
  for (const auto& entry :
       fs::directory_iterator(system.roots.sysfs + "/devices/system/cpu", error)) {
    const std::string name = entry.path().filename().string();
    if (name.starts_with("cpu") && name.size() > 3 &&
        std::isdigit(static_cast<unsigned char>(name[3])) != 0) {
      folders.push_back(entry.path());
    }
  }
  std::sort(folders.begin(), folders.end());
  return folders;
}

Finding governor_finding(const DoctorSystem& system) {
  Finding finding{.check = "CPU governor"};
  std::size_t known = 0;
  std::string slow;
  for (const fs::path& cpu : cpu_folders(system)) {
    const fs::path file = cpu / "cpufreq/scaling_governor";
    const std::string governor = driver::first_line(file);
    known += governor.empty() ? 0 : 1;
    if (!governor.empty() && governor != "performance") {
      slow += (slow.empty() ? "" : ", ") + cpu.filename().string() + " " + governor;
      finding.fixes.push_back({file, "performance\n", "until the computer restarts"});
    }
  }
  if (known == 0) {
    finding.verdict = Verdict::kUnknown;
    finding.what = "the kernel does not control the clock frequency here (a virtual machine?)";
  } else if (slow.empty()) {
    finding.what = "performance";
  } else {
    finding.verdict = Verdict::kWarn;
    finding.what = slow;
    finding.cost =
        "cycles take longer at a low clock frequency, and the loop alone does not raise it";
    finding.remedy =
        "echo performance | sudo tee /sys/devices/system/cpu/cpu*/cpufreq/scaling_governor";
  }
  return finding;
}

Finding idle_finding(const DoctorSystem& system) {
  Finding finding{.check = "CPU idle states"};
  double deepest_us = -1.0;
  std::string name;
  for (const fs::path& cpu : cpu_folders(system)) {
    std::error_code error;
    for (const auto& state : fs::directory_iterator(cpu / "cpuidle", error)) {
      const std::string latency = driver::first_line(state.path() / "latency");
      const double latency_us = std::strtod(latency.c_str(), nullptr);
      if (!latency.empty() && driver::first_line(state.path() / "disable") != "1" &&
          latency_us > deepest_us) {
        deepest_us = latency_us;
        name = driver::first_line(state.path() / "name");
      }
    }
  }
  char text[120];
  std::snprintf(text, sizeof text, "deepest enabled: %s, %.0f us to wake up", name.c_str(),
                deepest_us);
  finding.what = text;
  if (deepest_us < 0.0) {
    finding.verdict = Verdict::kUnknown;
    finding.what = "the kernel does not manage idle states here (a virtual machine?)";
  } else if (deepest_us > kSlowIdle_us) {
    finding.verdict = Verdict::kWarn;
    std::snprintf(text, sizeof text, "up to %.0f us of every cycle, before it begins", deepest_us);
    finding.cost = text;
    finding.remedy =
        "sudo cpupower idle-set -D 100 (package linux-cpupower); it costs power; undo it with -E";
  }
  return finding;
}

Finding clock_finding(const DoctorSystem& system) {
  Finding finding{.check = "clock and timers"};
  const std::string source = driver::first_line(
      system.roots.sysfs + "/devices/system/clocksource/clocksource0/current_clocksource");
  char text[120];
  std::snprintf(text, sizeof text, "timer resolution %lld ns, clock source %s",
                static_cast<long long>(system.grants.clock_resolution_ns), source.c_str());
  finding.what = text;
  if (system.grants.clock_resolution_ns > 1000) {
    finding.verdict = Verdict::kBad;
    finding.cost = "deadlines are met only to within a kernel tick, a cycle or more";
    finding.remedy = "boot a kernel with CONFIG_HIGH_RES_TIMERS and without highres=off";
  } else if (source == "hpet" || source == "acpi_pm" || source == "refined-jiffies") {
    finding.verdict = Verdict::kWarn;
    finding.cost = "each reading of the clock takes a microsecond or more, several times per cycle";
    finding.remedy =
        "dmesg | grep -i clocksource shows why tsc was rejected; if it is sound, add tsc=reliable "
        "to the kernel's command line";
  }
  return finding;
}

Finding irq_finding(const DoctorSystem& system) {
  Finding finding{.check = "USB host controller's interrupt"};
  std::ifstream interrupts(system.roots.proc + "/interrupts");
  std::string shared;
  std::size_t controllers = 0;
  for (std::string line; std::getline(interrupts, line);) {
    const bool usb = line.find("hci_hcd") != std::string::npos;
    controllers += usb ? 1 : 0;
    if (usb && line.find(", ") != std::string::npos) {
      const std::size_t number = line.find_first_not_of(' ');
      const std::size_t names = line.rfind("  ");
      shared += (shared.empty() ? "IRQ " : "; IRQ ") +
                line.substr(number, line.find(':') - number) + ":" + line.substr(names + 1);
    }
  }
  if (controllers == 0) {
    finding.verdict = Verdict::kUnknown;
    finding.what = "no USB host controller";
  } else if (shared.empty()) {
    finding.what = "not shared";
  } else {
    finding.verdict = Verdict::kWarn;
    finding.what = "shared: " + shared;
    finding.cost = "interrupts of the other device may delay reports of the haptic device";
    finding.remedy =
        "plug the device into a port of another controller (lsusb -t shows which), or "
        "move the other device to another slot";
  }
  return finding;
}

std::vector<Finding> device_findings(const DoctorSystem& system,
                                     const std::vector<profiles::DeviceProfile>& known) {
  std::vector<Finding> findings;
  for (const FoundDevice& device : survey_devices(known, system.roots, system.user)) {
    Finding finding{.check =
                        "device at " + (device.port_path.empty() ? device.node : device.port_path)};
    finding.what = device.manufacturer + " " + device.product + ", ready";
    for (const Obstacle& obstacle : device.obstacles) {
      Finding bad = finding;
      bad.verdict = obstacle.blocks ? Verdict::kBad : Verdict::kWarn;
      bad.what = obstacle.what;
      bad.cost = obstacle.blocks                  ? "it can't be used"
                 : obstacle.kind == "open to all" ? "another account's program can move the motors"
                                                  : "it may fail in use";
      bad.remedy = obstacle.remedy;
      if (obstacle.kind == "autosuspend") {
        bad.fixes.push_back(
            {system.roots.sysfs + "/bus/usb/devices/" + device.port_path + "/power/control", "on\n",
             "until it is plugged in again"});
      }
      findings.push_back(bad);
    }
    if (device.obstacles.empty()) {
      findings.push_back(finding);
    }
  }
  if (findings.empty()) {
    findings.push_back({.check = "devices",
                        .verdict = Verdict::kUnknown,
                        .what = "no haptic device is attached (forcegrid devices)"});
  }
  return findings;
}

}  // namespace

const char* to_string(Verdict verdict) noexcept {
  switch (verdict) {
    case Verdict::kGood:
      return "good";
    case Verdict::kUnknown:
      return "unknown";
    case Verdict::kWarn:
      return "warning";
    case Verdict::kBad:
      return "bad";
  }
  return "";
}

Grants ask_kernel() {
  Grants grants;
  std::thread([&] {
    grants.realtime_refused = rt::make_current_thread_realtime(rt::kServoPriority).reason;
    grants.memory_refused = rt::lock_memory();
    rt::unlock_memory();
  }).join();
  timespec resolution{};
  clock_getres(CLOCK_MONOTONIC, &resolution);
  grants.clock_resolution_ns = resolution.tv_sec * 1'000'000'000LL + resolution.tv_nsec;
  return grants;
}

std::vector<Finding> examine_system(const DoctorSystem& system,
                                    const std::vector<profiles::DeviceProfile>& known) {
  std::vector<Finding> findings{rule_finding(system), group_finding(system.user)};
  for (Finding& finding : limit_findings(system)) {
    findings.push_back(std::move(finding));
  }
  for (Finding (*look)(const DoctorSystem&) :
       {kernel_finding, governor_finding, idle_finding, clock_finding, irq_finding}) {
    findings.push_back(look(system));
  }
  for (Finding& finding : device_findings(system, known)) {
    findings.push_back(std::move(finding));
  }
  return findings;
}

std::vector<std::string> apply_fixes(const std::vector<FileFix>& fixes) {
  std::vector<std::string> done;
  for (const FileFix& fix : fixes) {
    errno = 0;
    std::ofstream stream(fix.file);
    stream << fix.text;
    stream.close();
    const std::string reason = errno != 0 ? std::strerror(errno) : "it had no effect";
    done.push_back(stream && text_of(fix.file) == fix.text
                       ? "wrote " + fix.file + ": " + fix.words
                       : "could not write " + fix.file + " (" + reason +
                             "); run it as root: sudo "
                             "forcegrid doctor --fix");
  }
  return done;
}

}  // namespace forcegrid::tools
