// SPDX-License-Identifier: Apache-2.0
// Recordings with flipped, lost or overwritten bytes: each is answered or refused, soon.

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#include <chrono>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <random>
#include <string>
#include <thread>

#include "tools/recorder.h"
#include "tools/recording.h"

namespace forcegrid::tools {
namespace {

using ::testing::HasSubstr;
namespace fs = std::filesystem;

constexpr int kAnswered = 0;
constexpr int kRefused = 1;
constexpr auto kLongest = std::chrono::seconds(5);  // for some ms of work on a busy machine

std::string whole_recording() {
  const std::string file = ::testing::TempDir() + "whole_" + std::to_string(getpid()) + ".h5";
  fs::remove(file);
  RecorderOptions options;
  options.file = file;
  options.method_names = {"hold"};
  options.attributes = {{"scene", "small"}, {"rate_Hz", "500"}, {"profile_name", "vintage"}};
  {
    Recorder recorder(options);
    for (int i = 0; i < 250; ++i) {
      servo::CycleRecord cycle;
      cycle.cycle = static_cast<std::uint64_t>(i);
      cycle.time_ns = recorder.start_ns() + 2'000'000L * i;
      recorder.push(cycle);
    }
    EXPECT_EQ(recorder.finish().trouble, "");
  }
  std::ifstream in(file, std::ios::binary);
  std::string bytes{std::istreambuf_iterator<char>(in), {}};
  fs::remove(file);
  return bytes;
}

// What plot, evaluate and replay read, in a process of its own.
int read_everything(const std::string& file) {
  const pid_t child = fork();
  if (child == 0) {
    int status = kRefused;
    try {
      const Hdf5Reader reader(file);
      const RecordingHeader header = read_header(reader);
      for (const char* column : {"/cycles/time_s", "/cycles/position_W_m", "/cycles/fault"}) {
        static_cast<void>(reader.numbers(column, header.cycles));
      }
      status = kAnswered;
    } catch (const std::exception& error) {
      status = std::string(error.what()).find(file) == std::string::npos ? 3 : kRefused;
    }
    _exit(status);
  }
  const auto start = std::chrono::steady_clock::now();
  int status = 0;
  while (waitpid(child, &status, WNOHANG) == 0) {
    if (std::chrono::steady_clock::now() - start > kLongest) {
      kill(child, SIGKILL);
      waitpid(child, &status, 0);
      return -1;  // hangs
    }
    std::this_thread::sleep_for(std::chrono::milliseconds(1));
  }
  return WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
}

std::string damaged(std::string bytes, std::mt19937_64& random) {
  const auto below = [&random](std::size_t n) {
    return std::uniform_int_distribution<std::size_t>(0, n - 1)(random);
  };
  // Metadata is what HDF5 trusts: half of all damage is in the first 4 kB.
  const std::size_t reach =
      below(2) == 0 ? std::min<std::size_t>(bytes.size(), 4096) : bytes.size();
  switch (below(4)) {
    case 0:
    case 1:
      bytes[below(reach)] ^= static_cast<char>(1U << below(8));
      break;
    case 2:
      bytes.resize(below(bytes.size()));
      break;
    default:
      for (std::size_t i = below(reach), end = std::min(reach, i + 64); i < end; ++i) {
        bytes[i] = static_cast<char>(below(256));
      }
      break;
  }
  return bytes;
}

TEST(DamagedRecording, IsAnsweredOrRefusedAndNeverHangs) {
  const char* const asked = std::getenv("FORCEGRID_DAMAGED_FILES");
  const int files = asked != nullptr ? std::atoi(asked) : 50;
  const std::uint64_t seed = std::random_device{}();
  RecordProperty("seed", std::to_string(seed));
  std::mt19937_64 random(seed);
  const std::string whole = whole_recording();
  ASSERT_GT(whole.size(), 1000u);
  const std::string file = ::testing::TempDir() + "damaged_" + std::to_string(getpid()) + ".h5";
  int refused = 0;
  for (int i = 0; i < files; ++i) {
    std::ofstream(file, std::ios::binary) << damaged(whole, random);
    const int status = read_everything(file);
    EXPECT_THAT(status, ::testing::AnyOf(kAnswered, kRefused))
        << "file " << i << " of seed " << seed;
    refused += status == kRefused ? 1 : 0;
  }
  fs::remove(file);
  EXPECT_GT(refused, files / 10) << "seed " << seed;
}

// The bytes that made plot, evaluate and replay sleep for ever.
TEST(DamagedRecording, WithOneFlippedByteOfMetadataNamesWhatIsDamaged) {
  const std::string whole = whole_recording();
  const std::string file = ::testing::TempDir() + "flipped_" + std::to_string(getpid()) + ".h5";
  for (const std::size_t offset : {60U, 100U, 200U, 400U, 1000U}) {
    std::string bytes = whole;
    bytes.at(offset) = static_cast<char>(~bytes.at(offset));
    std::ofstream(file, std::ios::binary) << bytes;
    const auto start = std::chrono::steady_clock::now();
    try {
      const Hdf5Reader reader(file);
      const RecordingHeader header = read_header(reader);
      static_cast<void>(reader.numbers("/cycles/position_W_m", header.cycles));
    } catch (const Hdf5Error& error) {
      EXPECT_THAT(error.what(), HasSubstr("damaged")) << offset;
    }
    EXPECT_LT(std::chrono::steady_clock::now() - start, kLongest) << offset;
  }
  fs::remove(file);
}

}  // namespace
}  // namespace forcegrid::tools
