// SPDX-License-Identifier: Apache-2.0
#include "driver/falcon_startup.h"

#include <algorithm>
#include <array>
#include <string_view>
#include <vector>

#include "driver/device.h"

namespace forcegrid::driver::falcon {
namespace {

using std::chrono::milliseconds;

constexpr double kRunDivisor = 2.0;          // 1.5 MBaud
constexpr double kHandshakeDivisor = 312.5;  // 9600 baud
constexpr double kDownloadDivisor = 21.0;    // 142.9 kBaud
constexpr milliseconds kRunLatency{1};
// The boot loader's answers must come whole: the chip waits for the rest of them this long.
constexpr milliseconds kLoadLatency{16};

constexpr std::array<std::uint8_t, 3> kHello = {0x0A, 0x43, 0x0D};
constexpr std::array<std::uint8_t, 4> kHelloReply = {0x0A, 0x44, 0x2C, 0x0D};
constexpr std::array<std::uint8_t, 1> kAutobaud = {0x41};
constexpr int kLoaderEntries = 2;

std::string byte_text(std::uint8_t byte) {
  constexpr char kDigits[] = "0123456789ABCDEF";
  return {kDigits[byte >> 4], kDigits[byte & 0xF]};
}

/// Whether a reply has the very bytes that were sent, of which all commands are zero.
bool is_echo(const InPacket& reply, const OutPacket& sent) {
  const unsigned flags = sent.leds | (sent.homing ? 1U : 0U);
  return reply.counts == std::array<std::int16_t, 3>{} && reply.buttons == (flags & 0xF) &&
         reply.homed == flags >> 4;
}

class Startup {
 public:
  Startup(ftdi::FtdiPort& port, const std::function<std::string()>& failure, const std::string& url,
          const StartupTiming& timing)
      : port_(port), failure_(failure), url_(url), timing_(timing) {}

  void enter_run_mode() {
    require(port_.set_latency(kRunLatency), "setting the latency timer");
    require(port_.set_divisor(kRunDivisor), "setting the baud rate");
    require(port_.purge(), "purging the FIFOs");
  }

  bool firmware_answers() {
    PacketParser parser;
    for (int probe = 0; probe < timing_.probes; ++probe) {
      // Something that only returns what it hears, like the boot loader, returns these lamps, too.
      const OutPacket sent{
          .leds = static_cast<std::uint8_t>(probe % 2 == 0 ? kLedRed : kLedRed | kLedBlue)};
      write(encode(sent), "probing for running firmware");
      const rt::TimePoint deadline = rt::Clock::now() + timing_.probe_reply;
      for (;;) {
        const auto read = port_.read(deadline - rt::Clock::now());
        if (!usable(read.status, "probing for running firmware")) {
          break;
        }
        InPacket packet;
        bool found = false;
        for (const std::uint8_t byte : read.data) {
          found = (parser.take(byte, packet) && !is_echo(packet, sent)) || found;
        }
        if (found) {
          // Answers to earlier probes may still be on their way.
          require(port_.purge(), "purging the FIFOs");
          return true;
        }
      }
    }
    return false;
  }

  void enter_boot_loader() {
    for (int entry = 0; entry < kLoaderEntries; ++entry) {
      if (!shake_hands()) {
        fail(port_.status_only_packets() > 0
                 ? "its USB chip answers, but neither firmware nor boot loader does; switch the "
                   "Falcon's power on (or off and on again), and try once more"
                 : "neither firmware nor boot loader answers, and its USB chip sends nothing; plug "
                   "it in again");
      }
      if (agree_on_baud_rate()) {
        return;
      }
    }
    fail(
        "the boot loader answers its greeting but does not return the 'A' from which it learns the "
        "baud rate; switch the Falcon off and on again, and try once more");
  }

  void download(const Firmware& firmware) {
    const std::span<const std::uint8_t> image(firmware.bytes);
    const std::string step = "sending the firmware";
    for (std::size_t at = 0; at < image.size();) {
      const auto chunk =
          image.subspan(at, std::min(ftdi::FtdiPort::kMaxDataBytes, image.size() - at));
      const std::string where =
          " (at byte " + std::to_string(at) + " of " + std::to_string(image.size()) + ")";
      write(chunk, step + where);
      const rt::TimePoint deadline = rt::Clock::now() + timing_.echo;
      for (std::size_t echoed = 0; echoed < chunk.size();) {
        const auto read = port_.read(deadline - rt::Clock::now());
        if (!usable(read.status, step + where)) {
          fail("the boot loader returned only " + std::to_string(echoed) + " of " +
               std::to_string(chunk.size()) + " bytes" + where +
               "; switch the Falcon off and on again, and try once more");
        }
        if (read.data.size() > chunk.size() - echoed) {
          fail("the boot loader returned more bytes than were sent" + where +
               "; switch the Falcon off and on again, and try once more");
        }
        for (const std::uint8_t byte : read.data) {
          if (byte != chunk[echoed]) {
            fail("the boot loader returned " + byte_text(byte) + " for byte " +
                 std::to_string(at + echoed) + " of '" + firmware.name + "', which is " +
                 byte_text(chunk[echoed]) +
                 "; the line is disturbed: check the cable, switch the Falcon off and on again, "
                 "and try once more");
          }
          ++echoed;
        }
      }
      at += chunk.size();
    }
  }

  [[noreturn]] void fail(const std::string& problem) const {
    throw DeviceError("device '" + url_ + "': " + problem);
  }

 private:
  /// @returns false for a time-out. @throws when the transport has ended.
  bool usable(TransportStatus status, const std::string& step) const {
    if (status == TransportStatus::kOk || status == TransportStatus::kTimeout) {
      return status == TransportStatus::kOk;
    }
    throw DeviceError(failure_() + " (while " + step + ")");
  }

  void require(TransportStatus status, const char* step) const {
    if (!usable(status, step)) {
      fail(std::string("it does not take a control request (") + step + "); plug it in again");
    }
  }

  void write(std::span<const std::uint8_t> bytes, const std::string& step) {
    if (!usable(port_.write(bytes, timing_.write).status, step)) {
      fail("it does not take data (while " + step + "); plug it in again");
    }
  }

  /// From its reset by the DTR line until the boot loader has answered.
  bool shake_hands() {
    require(port_.purge(), "purging the FIFOs");
    require(port_.set_latency(kLoadLatency), "setting the latency timer");
    require(port_.set_divisor(kHandshakeDivisor), "setting the baud rate");
    require(port_.set_8n1(), "setting the data format");
    require(port_.set_no_flow_control(), "switching flow control off");
    require(port_.set_rts(false), "setting RTS");
    require(port_.set_dtr(false), "setting DTR");
    require(port_.set_dtr(true), "setting DTR");
    for (int attempt = 0; attempt < timing_.handshakes; ++attempt) {
      write(kHello, "greeting the boot loader");
      if (answers_end_with(kHelloReply, timing_.handshake_reply, "greeting the boot loader")) {
        return true;
      }
    }
    return false;
  }

  bool agree_on_baud_rate() {
    require(port_.set_dtr(false), "setting DTR");
    require(port_.set_divisor(kDownloadDivisor), "setting the baud rate");
    write(kAutobaud, "agreeing on the baud rate");
    return answers_end_with(kAutobaud, timing_.autobaud_reply, "agreeing on the baud rate");
  }

  /// Some stacks put a spurious byte before an answer, so only its end is looked at.
  bool answers_end_with(std::span<const std::uint8_t> expected, rt::Duration timeout,
                        const char* step) {
    const rt::TimePoint deadline = rt::Clock::now() + timeout;
    std::vector<std::uint8_t> received;
    for (;;) {
      const auto read = port_.read(deadline - rt::Clock::now());
      if (!usable(read.status, step)) {
        return false;
      }
      received.insert(received.end(), read.data.begin(), read.data.end());
      if (received.size() >= expected.size() &&
          std::equal(expected.begin(), expected.end(),
                     received.end() - static_cast<std::ptrdiff_t>(expected.size()))) {
        return true;
      }
    }
  }

  ftdi::FtdiPort& port_;
  const std::function<std::string()>& failure_;
  const std::string& url_;
  const StartupTiming& timing_;
};

}  // namespace

bool bring_up(ftdi::FtdiPort& port, const std::function<std::string()>& failure,
              const std::string& url, const Firmware& firmware,
              const std::function<void(const std::string&)>& notice, const StartupTiming& timing) {
  Startup startup(port, failure, url, timing);
  startup.enter_run_mode();
  if (startup.firmware_answers()) {
    return false;
  }
  if (firmware.bytes.empty()) {
    startup.fail(std::string("no firmware runs in it, as always after power-on; ") +
                 firmware_advice());
  }
  if (notice) {
    notice("Falcon: sending firmware '" + firmware.name + "' (" +
           std::to_string(firmware.bytes.size()) + " bytes)");
  }
  startup.enter_boot_loader();
  startup.download(firmware);
  startup.enter_run_mode();
  if (!startup.firmware_answers()) {
    startup.fail("it took the firmware '" + firmware.name +
                 "', but the firmware does not answer; check that the file is for the Falcon, "
                 "switch the device off and on again, and try once more");
  }
  return true;
}

}  // namespace forcegrid::driver::falcon
