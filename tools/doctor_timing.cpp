#include "tools/doctor_timing.h"

#include <fcntl.h>
#include <unistd.h>

#include <algorithm>
#include <cstdlib>
#include <filesystem>
#include <thread>
#include <vector>

#include "link/servo_endpoint.h"
#include "rt/clock.h"
#include "rt/thread.h"

namespace forcegrid::tools {
namespace {

constexpr std::size_t kCopied_bytes = 8 << 20;  // beyond the caches that a core has to itself
constexpr std::size_t kWritten_bytes = 1 << 20;
constexpr auto kDeviceCycle = std::chrono::milliseconds(2);
constexpr auto kPoll = std::chrono::microseconds(20);
constexpr auto kAnswerTimeout = std::chrono::milliseconds(20);
constexpr auto kToolPeriod = std::chrono::milliseconds(2);
constexpr double kAbove_m = 0.05;

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
    return;  // no disk to load; the processors are loaded all the same
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
    const rt::Duration period = rt::from_seconds(period_s);
    const rt::TimePoint end = rt::Clock::now() + rt::from_seconds(seconds);
    for (rt::TimePoint deadline = rt::Clock::now() + period; deadline < end && !stop;) {
      rt::sleep_until(deadline);
      const rt::TimePoint now = rt::Clock::now();
      test.latency_us.add(microseconds(now - deadline));
      // As cyclictest: after a deadline that was missed altogether comes the next one ahead.
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

rt::Percentiles measure_device_round_trip(driver::Device& device, double seconds,
                                          const std::atomic<bool>& stop) {
  rt::Percentiles round_trip_us;
  const rt::TimePoint end = rt::Clock::now() + rt::from_seconds(seconds);
  for (rt::TimePoint cycle = rt::Clock::now(); cycle < end && !stop; cycle += kDeviceCycle) {
    rt::sleep_until(cycle);
    const rt::TimePoint sent = rt::Clock::now();
    device.command(driver::MotorCommand{});
    driver::DeviceReport report = device.newest_report();
    while (report.released < sent && rt::Clock::now() < sent + kAnswerTimeout && !stop) {
      std::this_thread::sleep_for(kPoll);
      report = device.newest_report();
    }
    if (report.released >= sent) {
      round_trip_us.add(microseconds(report.received - sent));
    }
  }
  return round_trip_us;
}

rt::Percentiles measure_simulator_round_trip(const std::string& address, double seconds,
                                             const std::atomic<bool>& stop) {
  link::ServoEndpoint endpoint(address);
  rt::Percentiles round_trip_us;
  link::ToolState tool;
  tool.position_W_m = {0.0, 0.0, kAbove_m};
  const rt::TimePoint end = rt::Clock::now() + rt::from_seconds(seconds);
  for (rt::TimePoint at = rt::Clock::now(); at < end && !stop; at += kToolPeriod) {
    rt::sleep_until(at);
    ++tool.sequence;
    tool.servo_time_ns = rt::Clock::now().time_since_epoch().count();
    endpoint.send(tool);
    while (rt::Clock::now() < at + kToolPeriod && !stop) {
      endpoint.wait(at + kToolPeriod - rt::Clock::now());
      while (const auto sample = endpoint.receive()) {
        const std::int64_t now_ns = rt::Clock::now().time_since_epoch().count();
        round_trip_us.add(1e-3 * static_cast<double>(now_ns - sample->echo_servo_time_ns));
      }
    }
  }
  return round_trip_us;
}

}  // namespace forcegrid::tools
