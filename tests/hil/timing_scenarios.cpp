// SPDX-License-Identifier: Apache-2.0
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <netinet/in.h>
#include <signal.h>
#include <sys/socket.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <chrono>
#include <cstdint>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <optional>
#include <sstream>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "tests/hil/hil_bench.h"

namespace forcegrid::hil {
namespace {

using ::testing::HasSubstr;

/// Wake-up latencies by whole microseconds, as cyclictest prints them.
struct Histogram {
  std::vector<std::uint64_t> wakeups;  ///< by latency [us]
  std::uint64_t count = 0;

  /// [us] that `share` of the wake-ups did not exceed.
  double at(double share) const {
    std::uint64_t passed = 0;
    for (std::size_t us = 0; us < wakeups.size(); ++us) {
      passed += wakeups[us];
      if (static_cast<double>(passed) >= share * static_cast<double>(count)) {
        return static_cast<double>(us);
      }
    }
    return static_cast<double>(wakeups.size());
  }
};

/// Lines of two numbers; what else cyclictest says begins with another character.
Histogram histogram_of(const std::string& text) {
  Histogram histogram;
  std::istringstream lines(text);
  for (std::string line; std::getline(lines, line);) {
    std::istringstream words(line);
    std::size_t us = 0;
    std::uint64_t count = 0;
    if (!line.empty() && line[0] >= '0' && line[0] <= '9' && words >> us >> count) {
      histogram.wakeups.resize(us + 1);
      histogram.wakeups[us] = count;
      histogram.count += count;
    }
  }
  return histogram;
}

constexpr std::array<std::pair<const char*, double>, 4> kParts = {
    {{"p50", 0.5}, {"p99", 0.99}, {"p999", 0.999}, {"max", 1.0}}};

/// Latencies [us] by part, as kParts.
using Wakeups = std::array<double, kParts.size()>;

Wakeups cyclictest(int rate_Hz, int seconds) {
  const ShellResult said = shell("cyclictest --quiet --mlockall --priority=80 --interval=" +
                                 std::to_string(1000000 / rate_Hz) +
                                 " --duration=" + std::to_string(seconds) + " --histogram=200000");
  EXPECT_EQ(said.status, 0) << said.text;
  EXPECT_THAT(said.text, HasSubstr("# Histogram Overflows: 00000"));
  const Histogram histogram = histogram_of(said.text);
  EXPECT_GT(histogram.count, 100U) << said.text.substr(0, 1000);
  Wakeups wakeups_us{};
  for (std::size_t i = 0; i < kParts.size(); ++i) {
    wakeups_us[i] = histogram.at(kParts[i].second);
  }
  return wakeups_us;
}

/// Of a line "`name` p50 1.0 p99 2.0 ..." in what a program said.
Wakeups percentiles_of(const std::string& said, const std::string& name) {
  Wakeups values_us{};
  std::istringstream words(said.substr(std::min(said.find(name), said.size())));
  std::string word;
  words >> word;
  for (std::size_t i = 0; i < kParts.size(); ++i) {
    words >> word >> values_us[i];
    EXPECT_EQ(word, kParts[i].first) << said;
  }
  EXPECT_GE(values_us.back(), values_us.front());
  return values_us;
}

/// The loop with its method, guards, telemetry and recorder, and a device that answers at once.
Wakeups null_loop(int rate_Hz, int seconds) {
  const ShellResult said = shell("forcegrid_null_loop /tmp/null_loop.h5 " +
                                 std::to_string(rate_Hz) + " " + std::to_string(seconds));
  EXPECT_EQ(said.status, 0) << said.text;  // 3: without real-time scheduling
  return percentiles_of(said.text, "wakeup_us");
}

/// By the host's clock a pause of the host would be one of the loop.
bool time_goes_by_instructions() {
  const char* machine = std::getenv("HIL_MACHINE");
  return machine != nullptr && std::string(machine) == "instructions";
}

double median_of_three(std::array<double, 3> values) {
  std::sort(values.begin(), values.end());
  return values[1];
}

// Cyclictest and the loop alternate; the median over the slices is told, and of what the loop adds
// that over the pairs. @returns what it adds at the 99.9th percentile [us].
double measure_three_pairs(int rate_Hz, const std::string& condition) {
  constexpr int kSliceSeconds = 2;
  std::array<Wakeups, 3> plain_us{};
  std::array<Wakeups, 3> loop_us{};
  for (std::size_t pair = 0; pair < plain_us.size(); ++pair) {
    plain_us[pair] = cyclictest(rate_Hz, kSliceSeconds);
    loop_us[pair] = null_loop(rate_Hz, kSliceSeconds);
  }
  double added_at_p999_us = 0.0;
  for (std::size_t i = 0; i < kParts.size(); ++i) {
    const std::string name = condition + std::to_string(rate_Hz) + "_" + kParts[i].first;
    const auto median = [i](const std::array<Wakeups, 3>& slices) {
      return median_of_three({slices[0][i], slices[1][i], slices[2][i]});
    };
    const double added_us =
        median_of_three({loop_us[0][i] - plain_us[0][i], loop_us[1][i] - plain_us[1][i],
                         loop_us[2][i] - plain_us[2][i]});
    measured("cyclictest_" + name, median(plain_us), "us");
    measured("loop_" + name, median(loop_us), "us");
    measured("added_" + name, added_us, "us");
    added_at_p999_us = kParts[i].second == 0.999 ? added_us : added_at_p999_us;
  }
  return added_at_p999_us;
}

// A slice has one or two thousand wake-ups, so that a few that the kernel makes late by itself can
// be its 99.9th percentile: then all is measured once more.
void measure_in_pairs(int rate_Hz, const std::string& condition) {
  constexpr double kGoal_us = 20.0;
  double added_us = measure_three_pairs(rate_Hz, condition);
  if (!time_goes_by_instructions()) {
    return;
  }
  if (added_us > kGoal_us) {
    added_us = measure_three_pairs(rate_Hz, condition);
  }
  EXPECT_LE(added_us, kGoal_us) << condition << rate_Hz;
}

// bench/realtime.py's comparison in a machine in which nothing else happens.
TEST(LongTiming, OfTheLoopAloneBesideCyclictest) {
  for (const int rate_Hz : {500, 1000}) {
    measure_in_pairs(rate_Hz, "idle_");
  }
}

// And with its load, on the one processor that cyclictest and the loop have as well. A stock kernel
// has stretches of more than a millisecond there in which nothing preempts it, and which of the two
// meets one is chance.
TEST(PreemptRtTiming, OfTheLoopAloneBesideCyclictestUnderLoad) {
  testing::Program load({"/usr/bin/stress-ng", "--cpu", "1", "--vm", "1", "--vm-bytes", "64M",
                         "--hdd", "1", "--hdd-bytes", "16M", "--sock", "1", "--temp-path", "/tmp",
                         "--quiet"});
  measure_in_pairs(1000, "load_");
  EXPECT_FALSE(load.wait(std::chrono::seconds(0)).has_value()) << load.standard_error();
  load.send_signal(SIGTERM);
  EXPECT_TRUE(load.wait(std::chrono::seconds(10)).has_value());
}

// What a motor thread's cycles took [us].
struct LoopTimes {
  Wakeups wakeup_us{};
  Wakeups compute_us{};
  double compute_p10_us = 0.0;
};

/// The number after `name` in what a program said.
double number_after(const std::string& said, const std::string& name) {
  double value = 0.0;
  std::string word;
  std::istringstream(said.substr(std::min(said.find(name), said.size()))) >> word >> value;
  return value;
}

LoopTimes bare_loop(const std::string& seconds) {
  const ShellResult said = shell("forcegrid_driver_loop hid:1234:0006 " + seconds);
  EXPECT_EQ(said.status, 0) << said.text;
  EXPECT_THAT(said.text, HasSubstr("realtime 1"));
  return {percentiles_of(said.text, "wakeup_us"), percentiles_of(said.text, "compute_us"),
          number_after(said.text, "compute_p10_us")};
}

// Its frames' times are told, too.
LoopTimes loop_of_program(const std::string& seconds) {
  covers_host("forcegrid-hidraw");
  std::filesystem::create_directories("/etc/forcegrid");
  std::ofstream("/etc/forcegrid/openhaptics.toml")
      << "[device.Arm]\nurl = \"hid:1234:0006\"\ncalibrated = true\n";
  const ShellResult said =
      shell("FORCEGRID_TIMING=/tmp/timing.json forcegrid_hd_spring " + seconds);
  EXPECT_EQ(said.status, 0) << said.text;
  double frame_us = 0.0;
  std::string word;
  std::istringstream(said.text.substr(std::min(said.text.find("frame_us"), said.text.size()))) >>
      word >> word >> frame_us;
  measured("program_frame_p50", frame_us, "us");
  std::ifstream file("/tmp/timing.json");
  const auto timing = nlohmann::json::parse(file, nullptr, false);
  LoopTimes times;
  if (!timing.is_object()) {
    ADD_FAILURE() << "no times of the motor thread: " << said.text;
    return times;
  }
  EXPECT_EQ(timing.at("realtime"), true);
  for (std::size_t i = 0; i < kParts.size(); ++i) {
    times.wakeup_us[i] = timing.at("wakeup_us").at(kParts[i].first).get<double>();
    times.compute_us[i] = timing.at("compute_us").at(kParts[i].first).get<double>();
  }
  times.compute_p10_us = timing.at("compute_us").at("p10").get<double>();
  return times;
}

// One spring at 1 kHz on one emulated arm: in the cycle of the driver's loop, and in the callback
// of a program on libHD, whose motor thread has the same guards.
TEST(LongTiming, OfAProgramOnLibHdBesideTheDriversLoop) {
  constexpr double kMostWakeup_us = 20.0;
  constexpr double kMostCompute_us = 2.0;
  const char* const asked = std::getenv("HIL_TIMING_SECONDS");
  const std::string seconds = asked == nullptr ? "10" : asked;
  Bench bench({"woodenhaptics_v2015"}, {"--calibrated"});
  const LoopTimes bare = bare_loop(seconds);
  const LoopTimes program = loop_of_program(seconds);
  for (std::size_t i = 0; i < kParts.size(); ++i) {
    const std::string part = std::string("_") + kParts[i].first;
    measured("bare_wakeup" + part, bare.wakeup_us[i], "us");
    measured("program_wakeup" + part, program.wakeup_us[i], "us");
    measured("bare_compute" + part, bare.compute_us[i], "us");
    measured("program_compute" + part, program.compute_us[i], "us");
  }
  measured("bare_compute_p10", bare.compute_p10_us, "us");
  measured("program_compute_p10", program.compute_p10_us, "us");
  EXPECT_GT(bare.compute_p10_us, 0.0);
  EXPECT_EQ(bench.end().at("final_current_mA"), nlohmann::json({0.0, 0.0, 0.0}));
  if (time_goes_by_instructions()) {
    EXPECT_LE(program.wakeup_us[2] - bare.wakeup_us[2], kMostWakeup_us);
    // On the one processor another thread may run for 12 us within each cycle, as long as the
    // phases of loop and bus happen to be so: the cycles in which none does are compared.
    EXPECT_LE(program.compute_p10_us - bare.compute_p10_us, kMostCompute_us);
  }
}

/// A page that looks on: a WebSocket that reads whatever the live view sends.
class Onlooker {
 public:
  /// @param url  as `run --view` prints it.
  explicit Onlooker(const std::string& url) {
    const std::string host = url.substr(7, url.find('/', 7) - 7);
    socket_ = ::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_port =
        htons(static_cast<std::uint16_t>(std::stoi(host.substr(host.find(':') + 1))));
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    const std::string request =
        "GET /ws?" + url.substr(url.find("token=")) + " HTTP/1.1\r\nHost: " + host +
        "\r\nUpgrade: websocket\r\nConnection: Upgrade\r\n"
        "Sec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==\r\nSec-WebSocket-Version: 13\r\n\r\n";
    EXPECT_EQ(::connect(socket_, reinterpret_cast<const sockaddr*>(&address), sizeof(address)), 0);
    EXPECT_EQ(::send(socket_, request.data(), request.size(), MSG_NOSIGNAL),
              static_cast<ssize_t>(request.size()));
    reader_ = std::thread([this] {
      std::array<char, 65536> piece{};
      for (ssize_t got = 1; got > 0;) {
        got = ::recv(socket_, piece.data(), piece.size(), 0);
        bytes_ += static_cast<std::uint64_t>(std::max<ssize_t>(got, 0));
      }
    });
  }
  ~Onlooker() {
    ::shutdown(socket_, SHUT_RDWR);
    reader_.join();
    ::close(socket_);
  }
  Onlooker(const Onlooker&) = delete;
  Onlooker& operator=(const Onlooker&) = delete;

  std::uint64_t bytes() const { return bytes_; }

 private:
  int socket_ = -1;
  std::atomic<std::uint64_t> bytes_{0};
  std::thread reader_;
};

/// [s] Processor time of the process with this name so far; negative: there is none.
double processor_s(const std::string& name) {
  for (const auto& entry : std::filesystem::directory_iterator("/proc")) {
    if (first_line(entry.path() / "comm") == name) {
      const std::string stat = first_line(entry.path() / "stat");
      std::istringstream words(stat.substr(stat.rfind(')') + 1));
      std::vector<std::string> fields;
      for (std::string word; words >> word;) {
        fields.push_back(word);
      }
      // Fields 14 and 15 of proc(5), of which the third is the first here.
      const double ticks = std::stod(fields.at(11)) + std::stod(fields.at(12));
      return ticks / static_cast<double>(::sysconf(_SC_CLK_TCK));
    }
  }
  return -1.0;
}

// JSON moves without throwing, by functions that could.
// NOLINTNEXTLINE(bugprone-exception-escape)
struct ViewedRun {
  nlohmann::json summary;
  double view_share = 0.0;  ///< of a processor, that forcegrid-view took
};

ViewedRun run_with_onlooker(const std::string& seconds) {
  covers_host("forcegrid-hidraw");
  const std::string folder = testing::fresh_folder("viewed");
  testing::Program program = testing::Program::forcegrid(
      run_arguments("hid:1234:0006", std::stod(seconds), folder, {"--view"}));
  ViewedRun viewed;
  if (!program.wait_for_text("its first cycle is over", std::chrono::seconds(40))) {
    ADD_FAILURE() << program.standard_error();
    return viewed;
  }
  const std::string said = program.standard_error();
  const std::size_t begin = said.find("http://");
  const Onlooker page(said.substr(begin, said.find('\n', begin) - begin));
  const double before_s = processor_s("forcegrid-view");
  const auto since = std::chrono::steady_clock::now();
  std::this_thread::sleep_for(std::chrono::milliseconds(long(900 * std::stod(seconds))));
  const double passed_s =
      std::chrono::duration<double>(std::chrono::steady_clock::now() - since).count();
  viewed.view_share = (processor_s("forcegrid-view") - before_s) / passed_s;
  EXPECT_GE(before_s, 0.0);
  EXPECT_EQ(program.wait(std::chrono::seconds(60)), 0) << program.standard_error();
  EXPECT_GT(page.bytes(), 10'000U) << "the view sent the run";
  std::ifstream file(folder + "/summary.json");
  viewed.summary = nlohmann::json::parse(file, nullptr, false);
  return viewed;
}

// The same run without and with a live view, to which a page is connected. @returns what the view
// adds to the wake-ups, by part [us]; nothing after a failure.
std::optional<Wakeups> compare_with_a_viewed_run(const std::string& seconds) {
  constexpr double kMostShare = 0.15;
  EndedRun alone;
  {
    const Bench bench;  // each run is its device's first, which a person holds in its pose
    alone = run("hid:1234:0006", std::stod(seconds));
  }
  EXPECT_EQ(alone.status, 0) << alone.text;
  Bench bench;
  const ViewedRun viewed = run_with_onlooker(seconds);
  EXPECT_TRUE(viewed.summary.is_object());
  if (::testing::Test::HasFailure()) {
    return std::nullopt;
  }
  Wakeups added_us{};
  for (std::size_t i = 0; i < kParts.size(); ++i) {
    const std::string part = kParts[i].first;
    const double alone_us = alone.summary.at("wakeup_us").at(part);
    const double viewed_us = viewed.summary.at("wakeup_us").at(part);
    measured("alone_wakeup_" + part, alone_us, "us");
    measured("viewed_wakeup_" + part, viewed_us, "us");
    measured("added_by_view_" + part, viewed_us - alone_us, "us");
    added_us[i] = viewed_us - alone_us;
  }
  measured("view_share_of_a_processor", viewed.view_share, "1");
  EXPECT_EQ(bench.end().at("final_current_mA"), nlohmann::json({0.0, 0.0, 0.0}));
  if (time_goes_by_instructions()) {
    EXPECT_LE(viewed.view_share, kMostShare);
  }
  return added_us;
}

// A run of 10 s has five wake-ups above its 99.9th percentile, which so differs by 2 us from run to
// run, with or without a view. Of three times as long ones it still is anywhere from 5.4 to 6.9 us,
// with and without: by how loop, bus and tick happen to lie in time. A view that makes wake-ups
// late (3.1 to 5.3 us, when it was served while the loop ran) does so in every pair, so what is
// above the goal is measured up to twice more.
void compare_with_viewed_runs() {
  constexpr double kMostAdded_us = 1.0;
  constexpr int kPairs = 3;
  const char* const asked = std::getenv("HIL_TIMING_SECONDS");
  const std::string seconds = std::to_string(3 * std::stoi(asked == nullptr ? "10" : asked));
  auto added_us = compare_with_a_viewed_run(seconds);
  for (int pair = 1;
       pair < kPairs && added_us && time_goes_by_instructions() && (*added_us)[2] > kMostAdded_us;
       ++pair) {
    added_us = compare_with_a_viewed_run(seconds);
  }
  ASSERT_TRUE(added_us);
  if (time_goes_by_instructions()) {
    EXPECT_LE((*added_us)[1], kMostAdded_us);
    EXPECT_LE((*added_us)[2], kMostAdded_us);
  }
}

// Three processes more share the one processor. The stock kernel lets nobody preempt one that is in
// a system call, but what the view gets is sent while the loop sleeps.
TEST(LongTiming, OfTheServoLoopWithItsLiveView) { compare_with_viewed_runs(); }
TEST(PreemptRtTiming, OfTheServoLoopWithItsLiveView) { compare_with_viewed_runs(); }

// What this kernel on this machine can do at all, and what the servo loop makes of it, one after
// the other in the same boot: both sleep to absolute times with real-time priority 80, 500 times a
// second.
TEST(LongTiming, OfTheServoLoopBesideCyclictest) {
  constexpr double kSeconds = 4.0;
  const Wakeups plain_us = cyclictest(500, 4);
  for (std::size_t i = 0; i < kParts.size(); ++i) {
    measured(std::string("cyclictest_wakeup_") + kParts[i].first, plain_us[i], "us");
  }

  Bench bench;
  const EndedRun felt = run("hid:1234:0006", kSeconds);
  ASSERT_EQ(felt.status, 0) << felt.text;
  for (const char* what : {"wakeup_us", "period_us", "compute_us", "report_age_us"}) {
    const std::string name(what, std::string(what).size() - 3);
    for (const auto& [part, share] : kParts) {
      measured("servo_" + name + "_" + part, felt.summary.at(what).at(part).get<double>(), "us");
    }
    EXPECT_LE(felt.summary.at(what).at("p50"), felt.summary.at(what).at("max")) << what;
  }
  EXPECT_GT(felt.summary.at("wakeup_us").at("p50").get<double>(), 0.0);
  measured("servo_rate", felt.summary.at("servo_rate_Hz").get<double>(), "Hz");
  measured("missed_deadlines", felt.summary.at("missed_deadlines").get<double>(), "1");
  EXPECT_EQ(bench.end().at("final_current_mA"), nlohmann::json({0.0, 0.0, 0.0}));
}

}  // namespace
}  // namespace forcegrid::hil
