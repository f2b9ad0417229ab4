// SPDX-License-Identifier: Apache-2.0
#include "tools/doctor_timing.h"

#include <fcntl.h>
#include <unistd.h>

#include <algorithm>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <thread>
#include <vector>

#include "link/servo_endpoint.h"
#include "rt/clock.h"
#include "rt/processors_awake.h"
#include "rt/thread.h"

namespace forcegrid::tools {
namespace {

constexpr std::size_t kCopied_bytes = 8 << 20;  // more than the private caches of a core
constexpr std::size_t kWritten_bytes = 1 << 20;
constexpr auto kDeviceCycle = std::chrono::milliseconds(2);
constexpr auto kPoll = std::chrono::microseconds(20);
constexpr auto kAnswerTimeout = std::chrono::milliseconds(20);
constexpr auto kToolPeriod = std::chrono::milliseconds(2);
constexpr double kAbove_m = 0.05;
constexpr double kGoodShare = 0.1;         // of a period, at the 99.9th percentile
constexpr double kTolerableShare = 0.5;    // above it the next deadline is at risk
constexpr double kUnansweredShare = 0.01;  // of the commands

void copy_memory(const std::atomic<bool>& stop) {
  std::vector<char> from(kCopied_bytes, 1);
  std::vector<char> to(kCopied_bytes);
  while (!stop) {
    std::copy(from.begin(), from.end(), to.begin());
    from[0] = static_cast<char>(to[1] + 1);
  }
}

void write_to_disk(const std::atomic<bool>& stop) {
  std::string name = (std::filesystem::temp_directory_path() / "forcegrid_load_XXXXXX").string();
  const int file = ::mkstemp(name.data());
  if (file < 0) {
    return;  // no disk to load; the processors are still loaded
  }
  ::unlink(name.c_str());
  const std::vector<char> bytes(kWritten_bytes, 1);
  while (!stop) {
    if (::pwrite(file, bytes.data(), bytes.size(), 0) < 0 || ::fdatasync(file) != 0) {
      break;
    }
  }
  ::close(file);
}

double microseconds(rt::Duration duration) { return 1e6 * rt::seconds(duration); }

}  // namespace

WakeupTest measure_wakeups(double seconds, double period_s, bool load,
                           const std::atomic<bool>& stop) {
  std::atomic<bool> over{false};
  std::vector<std::thread> threads;
  if (load) {
    for (unsigned i = 0; i < std::max(1U, std::thread::hardware_concurrency()); ++i) {
      threads.emplace_back([&] { copy_memory(over); });
    }
    threads.emplace_back([&] { write_to_disk(over); });
  }
  WakeupTest test;
  std::thread sleeper([&] {
    test.realtime = rt::make_current_thread_realtime(rt::kServoPriority).realtime;
    const rt::ProcessorsAwake awake;  // as in the loop, if permitted
    const rt::Duration period = rt::from_seconds(period_s);
    const rt::TimePoint end = rt::Clock::now() + rt::from_seconds(seconds);
    for (rt::TimePoint deadline = rt::Clock::now() + period; deadline < end && !stop;) {
      rt::sleep_until(deadline);
      const rt::TimePoint now = rt::Clock::now();
      test.latency_us.add(microseconds(now - deadline));
      // As in cyclictest: after a missed deadline, continue with the next one in the future.
      for (deadline += period; deadline < now; deadline += period) {
      }
    }
  });
  sleeper.join();
  over = true;
  for (std::thread& thread : threads) {
    thread.join();
  }
  return test;
}

Finding judge_wakeups(const std::string& check, const WakeupTest& test, double period_us) {
  const rt::Percentiles& latency_us = test.latency_us;
  if (latency_us.count() == 0) {
    return {.check = check,
            .verdict = Verdict::kUnknown,
            .what = "not measured: no wake-up came",
            .remedy = "give a longer --seconds"};
  }
  Finding finding{.check = check};
  finding.histogram = latency_histogram(latency_us);
  const double p999_us = latency_us.at(0.999);
  finding.measured = {{"wakeups", static_cast<double>(latency_us.count())},
                      {"p50_us", latency_us.at(0.5)},
                      {"p99_us", latency_us.at(0.99)},
                      {"p99_9_us", p999_us},
                      {"max_us", latency_us.max()},
                      {"period_us", period_us}};
  char text[200];
  std::snprintf(text, sizeof text,
                "late by %.0f us in the median, p99 %.0f, p99.9 %.0f, worst %.0f (period %.0f)",
                latency_us.at(0.5), latency_us.at(0.99), p999_us, latency_us.max(), period_us);
  finding.what = text;
  if (p999_us <= kGoodShare * period_us) {
    return finding;
  }
  finding.verdict = p999_us <= kTolerableShare * period_us ? Verdict::kWarn : Verdict::kBad;
  std::snprintf(text, sizeof text, "one cycle of 1000 begins %.0f %% of a period late or later",
                100.0 * p999_us / period_us);
  finding.cost = text;
  finding.remedy = test.realtime ? "fix the kernel and processor findings above, first of all use "
                                   "a PREEMPT_RT kernel: sudo apt-get install linux-image-rt-amd64"
                                 : "fix the real-time priority above";
  return finding;
}

RoundTrips measure_device_round_trip(driver::Device& device, double seconds,
                                     const std::atomic<bool>& stop) {
  RoundTrips trips;
  const rt::TimePoint end = rt::Clock::now() + rt::from_seconds(seconds);
  for (rt::TimePoint cycle = rt::Clock::now(); cycle < end && !stop; cycle += kDeviceCycle) {
    rt::sleep_until(cycle);
    const rt::TimePoint sent = rt::Clock::now();
    device.command(driver::MotorCommand{});
    ++trips.sent;
    driver::DeviceReport report = device.newest_report();
    while (report.released < sent && rt::Clock::now() < sent + kAnswerTimeout && !stop) {
      std::this_thread::sleep_for(kPoll);
      report = device.newest_report();
    }
    if (report.released >= sent) {
      trips.us.add(microseconds(report.received - sent));
    } else {
      ++trips.unanswered;
    }
  }
  return trips;
}

Finding judge_round_trips(const std::string& check, const RoundTrips& trips,
                          const std::string& remedy) {
  Finding finding{.check = check};
  finding.histogram = latency_histogram(trips.us);
  finding.measured = {{"sent", static_cast<double>(trips.sent)},
                      {"unanswered", static_cast<double>(trips.unanswered)},
                      {"round_trips", static_cast<double>(trips.us.count())},
                      {"p50_us", trips.us.at(0.5)},
                      {"p99_us", trips.us.at(0.99)},
                      {"p99_9_us", trips.us.at(0.999)},
                      {"max_us", trips.us.max()}};
  char text[200];
  std::snprintf(text, sizeof text,
                "%.0f us in the median, p99 %.0f, p99.9 %.0f, worst %.0f; %llu of %llu unanswered",
                trips.us.at(0.5), trips.us.at(0.99), trips.us.at(0.999), trips.us.max(),
                static_cast<unsigned long long>(trips.unanswered),
                static_cast<unsigned long long>(trips.sent));
  finding.what = text;
  if (trips.us.count() == 0) {
    finding.verdict = Verdict::kBad;
    finding.what = "no answer at all";
    finding.cost = "nothing can be felt";
    finding.remedy = remedy;
  } else if (static_cast<double>(trips.unanswered) >
             kUnansweredShare * static_cast<double>(trips.sent)) {
    finding.verdict = Verdict::kWarn;
    finding.cost = "the force freezes or fades while no counts arrive";
    finding.remedy =
        "use a shorter cable or a port of the computer itself (lsusb -t), and check the kernel's "
        "messages: sudo dmesg | grep -i usb";
  }
  return finding;
}

Finding not_measured(const std::string& check, const std::string& reason) {
  const std::size_t end = reason.find("; ");
  Finding finding{.check = check, .verdict = Verdict::kBad, .what = reason.substr(0, end)};
  finding.cost = "nothing can be felt";
  finding.remedy = end == std::string::npos ? reason : reason.substr(end + 2);
  return finding;
}

RoundTrips measure_simulator_round_trip(const std::string& address, double seconds,
                                        const std::atomic<bool>& stop) {
  link::ServoEndpoint endpoint(address);
  RoundTrips trips;
  link::ToolState tool;
  tool.position_W_m = {0.0, 0.0, kAbove_m};
  const rt::TimePoint end = rt::Clock::now() + rt::from_seconds(seconds);
  for (rt::TimePoint at = rt::Clock::now(); at < end && !stop; at += kToolPeriod) {
    rt::sleep_until(at);
    ++tool.sequence;
    tool.servo_time_ns = rt::Clock::now().time_since_epoch().count();
    endpoint.send(tool);
    ++trips.sent;
    while (rt::Clock::now() < at + kToolPeriod && !stop) {
      endpoint.wait(at + kToolPeriod - rt::Clock::now());
      while (const auto sample = endpoint.receive()) {
        const std::int64_t now_ns = rt::Clock::now().time_since_epoch().count();
        trips.us.add(1e-3 * static_cast<double>(now_ns - sample->echo_servo_time_ns));
      }
    }
  }
  return trips;
}

}  // namespace forcegrid::tools
