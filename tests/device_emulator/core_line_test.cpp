// SPDX-License-Identifier: Apache-2.0
#include "device_emulator/core_line.h"

#include <gtest/gtest.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include <cmath>
#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "device_emulator/emulated_w2.h"
#include "device_emulator/listen_socket.h"
#include "device_emulator/run_emulator.h"

namespace forcegrid::emulator {
namespace {

using std::chrono::milliseconds;
using Bytes = std::vector<std::uint8_t>;

rt::TimePoint at(int time_ms) { return rt::TimePoint(milliseconds(time_ms)); }

Bytes hex(const std::string& text) {
  Bytes bytes;
  for (std::size_t i = 0; i + 1 < text.size(); i += 3) {
    bytes.push_back(static_cast<std::uint8_t>(std::stoi(text.substr(i, 2), nullptr, 16)));
  }
  return bytes;
}

// Made with Python's struct and zlib.crc32: cycle 7, counters 1, -2, 6000, 0xC0, 0xDB, 0.
const Bytes kState7 =
    hex("07 00 00 00 01 00 00 00 fe ff ff ff 70 17 00 00 db dc 00 00 00 db dd 00 00 00 00 00 00 00 "
        "bf 2f c7 9b c0");
// The answer to cycle 7: -1500, 192 and 3 mA.
const Bytes kAnswer7 = hex("07 00 00 00 24 fa db dc 00 03 00 00 00 81 97 22 b1 c0");

/// The processor's end of the line.
class Processor {
 public:
  explicit Processor(const std::string& name)
      : path_(::testing::TempDir() + "core_" + std::to_string(getpid()) + name) {
    sockaddr_un address{};
    address.sun_family = AF_UNIX;
    path_.copy(address.sun_path, sizeof address.sun_path - 1);
    EXPECT_EQ(bind(listening_, reinterpret_cast<const sockaddr*>(&address), sizeof address), 0);
    EXPECT_EQ(listen(listening_, 1), 0);
  }
  ~Processor() {
    close(line_);
    close(listening_);
    std::filesystem::remove(path_);
  }
  Processor(const Processor&) = delete;
  Processor& operator=(const Processor&) = delete;

  const std::string& path() const { return path_; }
  void accept_line() { line_ = accept(listening_, nullptr, nullptr); }
  void say(const Bytes& bytes) const {
    EXPECT_EQ(::send(line_, bytes.data(), bytes.size(), MSG_NOSIGNAL),
              static_cast<ssize_t>(bytes.size()));
  }
  Bytes heard() const {
    Bytes bytes(4096);
    const ssize_t size = recv(line_, bytes.data(), bytes.size(), MSG_DONTWAIT);
    bytes.resize(static_cast<std::size_t>(std::max<ssize_t>(size, 0)));
    return bytes;
  }

 private:
  std::string path_;
  int listening_ = socket(AF_UNIX, SOCK_STREAM, 0);
  int line_ = -1;
};

TEST(CoreLine, SendsTheBytesOfAState) {
  Processor processor("state");
  CoreLine line(processor.path());
  processor.accept_line();
  line.send(7, {1, -2, 6000, 0xC0, 0xDB, 0});
  EXPECT_EQ(processor.heard(), kState7);
}

TEST(CoreLine, TakesTheNewestWholeAnswer) {
  Processor processor("answer");
  CoreLine line(processor.path());
  processor.accept_line();
  EXPECT_FALSE(line.receive());
  Bytes both = kAnswer7;
  both.insert(both.end(), kAnswer7.begin(), kAnswer7.begin() + 5);
  processor.say(both);
  const auto answer = line.receive();
  ASSERT_TRUE(answer);
  EXPECT_EQ(answer->number, 7U);
  EXPECT_EQ(answer->current_mA, (std::array<std::int16_t, 3>{-1500, 192, 3}));
  EXPECT_FALSE(line.receive());
  processor.say(Bytes(kAnswer7.begin() + 5, kAnswer7.end()));
  EXPECT_TRUE(line.receive());
  EXPECT_EQ(line.broken_frames(), 0U);
}

TEST(CoreLine, LeavesOutAndCountsBrokenFrames) {
  Processor processor("broken");
  CoreLine line(processor.path());
  processor.accept_line();
  for (std::size_t i = 0; i + 1 < kAnswer7.size(); ++i) {
    Bytes broken = kAnswer7;
    broken[i] ^= 0x10;
    processor.say(broken);
    EXPECT_FALSE(line.receive()) << i;
  }
  EXPECT_GE(line.broken_frames(), kAnswer7.size() - 2);
  processor.say(Bytes(200, 0x55));  // longer than any frame
  processor.say({0xC0});
  EXPECT_FALSE(line.receive());
  processor.say(kAnswer7);
  EXPECT_TRUE(line.receive());
}

TEST(CoreLine, SaysWhatToDoWithoutAProcessor) {
  try {
    const CoreLine line("/nowhere/arm");
    FAIL();
  } catch (const EmulatorError& error) {
    EXPECT_NE(std::string(error.what()).find("/nowhere/arm"), std::string::npos);
    EXPECT_NE(std::string(error.what()).find("start it first"), std::string::npos);
  }
  EmulatorOptions options;
  options.profiles = {"falcon"};
  options.core = "/nowhere/arm";
  EXPECT_THROW(server_options(options), std::invalid_argument);
}

/// A host that answers every report with currents of its own.
class Host final : public UsbHost {
 public:
  std::optional<std::span<const std::uint8_t>> out_packet(std::uint8_t) override {
    return present ? std::optional(std::span<const std::uint8_t>(out)) : std::nullopt;
  }
  void take_out(std::uint8_t) override {}
  bool wants_in(std::uint8_t) override { return true; }
  void babble(std::uint8_t) override {}
  void overfill(std::uint8_t) override {}
  bool give_in(std::uint8_t, std::span<const std::uint8_t>) override { return true; }

  bool present = true;
  Bytes out = hex("e8 03 e8 03 e8 03 00 00 00 00 00 00 00 00");  // 1 A each
};

class OnBoardW2 : public ::testing::Test {
 protected:
  void SetUp() override {
    DeviceOptions options;
    options.profile = profiles::load_device_profile("woodenhaptics_v2015");
    options.hand = HandKind::kFirm;
    options.operator_script.calibrated = true;
    options.core = processor_.path();
    device_ = std::make_unique<EmulatedW2>(options, at(0));
    processor_.accept_line();
    EXPECT_FALSE(device_->control({0x00, 9, 1, 0, 0}, {}, at(0)).stalled);
  }
  void run_until(int time_ms) {
    while (now_ms_ < time_ms) {
      device_->run(at(++now_ms_), host_);
    }
  }
  std::uint64_t states() const { return device_->report().core->cycles; }

  Processor processor_{"w2"};
  Host host_;
  std::unique_ptr<EmulatedW2> device_;
  int now_ms_ = 0;
};

TEST_F(OnBoardW2, DrivesTheMotorsByTheProcessorAndNotByTheHost) {
  run_until(900);
  EXPECT_EQ(states(), 0U);  // no host has been heard: nothing feeds the watchdog
  run_until(1100);
  EXPECT_NEAR(static_cast<double>(states()), 50.0, 2.0);  // every 2 ms
  EXPECT_TRUE(device_->current_A().isZero(0.0));          // the host's ampere is not applied
  EXPECT_FALSE(processor_.heard().empty());
  processor_.say(kAnswer7);
  run_until(1101);
  EXPECT_NEAR(device_->current_A()[0], -1.5, 1e-9);
  EXPECT_NEAR(device_->current_A()[1], 0.192, 1e-9);
  EXPECT_NEAR(device_->current_A()[2], 0.003, 1e-9);
  EXPECT_EQ(device_->report().core->answers, 1U);
}

TEST_F(OnBoardW2, StopsTheMotorsWhenTheProcessorFallsSilent) {
  run_until(1100);
  processor_.say(kAnswer7);
  run_until(1150);
  EXPECT_FALSE(device_->current_A().isZero(0.0));
  run_until(1152);
  EXPECT_TRUE(device_->current_A().isZero(0.0));
  EXPECT_EQ(device_->report().core->silences, 1U);
  processor_.say(kAnswer7);
  run_until(1153);
  EXPECT_FALSE(device_->current_A().isZero(0.0));
}

TEST_F(OnBoardW2, StopsTheMotorsWithoutAHostWhateverTheProcessorSays) {
  run_until(1100);
  processor_.say(kAnswer7);
  run_until(1110);
  EXPECT_FALSE(device_->current_A().isZero(0.0));
  const std::uint64_t sent = states();
  host_.present = false;
  while (now_ms_ < 1700) {
    processor_.say(kAnswer7);
    run_until(now_ms_ + 5);
    EXPECT_EQ(device_->current_A().isZero(0.0), now_ms_ > 1160) << now_ms_;
  }
  EXPECT_LE(states(), sent + 26);
  EXPECT_EQ(device_->report().watchdog_trips, 1U);
}

TEST_F(OnBoardW2, StopsTheMotorsWhenTheHostLetsGo) {
  run_until(1100);
  processor_.say(kAnswer7);
  run_until(1101);
  EXPECT_FALSE(device_->current_A().isZero(0.0));
  device_->bus_reset(at(1101));
  EXPECT_TRUE(device_->current_A().isZero(0.0));
}

}  // namespace
}  // namespace forcegrid::emulator
