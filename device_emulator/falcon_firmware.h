// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <random>
#include <span>

#include "device_emulator/boot_loader_faults.h"
#include "device_emulator/ft232r.h"
#include "profiles/device_profile.h"
#include "rt/clock.h"

namespace forcegrid::emulator {

/// The signal processor of a Novint Falcon at its serial line: the boot loader in its ROM, and the
/// firmware that a host has loaded.
///
///   kCold      power-up, or DTR goes high at 9600 Bd: "\nC\r" is answered with "\nD,\r";
///   kAutoBaud  after that: 'A' or 'a' at 140 kBd with DTR low is echoed and begins
///   kLoading   every byte is echoed; the image (16-bit words, low byte first: key 0x08AA, eight
///              reserved, entry address in two, then blocks of size, address in two, data, and a
///              size of 0) starts the firmware with its last byte; one with a wrong key never does
///   kRunning   at 1.5 MBd every well-formed packet of 16 bytes is answered with one; what is not
///              well-formed is skipped up to the next '<'
///
/// Anything else, and anything at another speed, is ignored. A packet is '<', three motor commands
/// or encoder counters of 16 bits as four nibbles each, least significant first, a status byte, an
/// unused one, and '>'; nibbles and status are added to 0x41. Status to the device: 0x01 homing,
/// 0x02, 0x04, 0x08 green, blue, red light; from it: buttons in bits 0 to 3, homed axes in 4 to 6.
///
/// A counter is its encoder plus an offset that is unknown until its axis is homed. With the homing
/// bit set, an axis is homed when the driven angle, after it was above `homing_out_rad`, falls
/// below `homing_in_rad`. Zeros that have been found stay; their flags show while the homing bit is
/// set.
///
/// A watchdog cuts the motors when no packet has come for kWatchdog; the vendor's firmware may have
/// none.
///
/// Source: libnifalcon FalconFirmwareNovintSDK.cpp, FalconFirmware.cpp (f7c727a) and TI's C28x boot
/// ROM stream, by way of the device's fact sheet.
/// Real-time: no allocation, lock or throw after construction. Threads: one.
class FalconFirmware final : public SerialPeer {
 public:
  static constexpr std::size_t kPacketBytes = 16;
  static constexpr rt::Duration kWatchdog = std::chrono::milliseconds(100);
  static constexpr double kBootBaud_Hz = 9600.0;
  static constexpr double kLoaderBaud_Hz = 140000.0;
  static constexpr double kRunBaud_Hz = 1456312.0;
  /// Offsets of unhomed counters are within plus and minus this [counts].
  static constexpr std::int32_t kOffsetRange_counts = 3000;

  enum class State : std::uint8_t { kCold, kAutoBaud, kLoading, kRunning };

  /// The rest of the device, as seen by the firmware's pins.
  class Board {
   public:
    virtual ~Board() = default;
    /// [rad] driven angles of legs 1 to 3 at `time`, not before that of the last call.
    [[nodiscard]] virtual std::array<double, 3> joint_angle_rad(rt::TimePoint time) noexcept = 0;
    /// The firmware sends characters from `start` on.
    virtual void send(std::span<const std::uint8_t> characters, double baud_Hz,
                      rt::TimePoint start) noexcept = 0;
  };

  struct Statistics {
    std::uint64_t handshakes = 0;         ///< "\nC\r" answered
    std::uint64_t firmware_starts = 0;    ///< images loaded completely
    std::uint64_t wrong_keys = 0;         ///< images that began with another key
    std::uint64_t bytes_loaded = 0;       ///< bytes echoed by the loader, of all images
    std::uint64_t packets_answered = 0;   ///< well-formed packets
    std::uint64_t malformed_packets = 0;  ///< '<' that no well-formed packet followed
    std::uint64_t watchdog_trips = 0;
    std::uint64_t saturated_commands = 0;  ///< beyond the limit, one per motor and packet
    std::uint64_t homings = 0;             ///< how often the last of the three axes was homed
  };

  /// @param seed of the unhomed counters' offsets.
  /// @param running the firmware is already loaded.
  /// @param homed and its axes are homed.
  FalconFirmware(const profiles::DeviceProfile& profile, Board& board, std::uint64_t seed,
                 bool running, bool homed);

  /// The boot loader's faults, or null. Must outlive the firmware.
  void set_boot_loader_faults(BootLoaderFaults* faults) noexcept { faults_ = faults; }

  /// Power fails and returns: cold, motors off, zeros lost.
  void power_up() noexcept;

  void receive(std::uint8_t character, const LineSettings& line,
               rt::TimePoint time) noexcept override;
  void modem_lines_changed(const LineSettings& line, rt::TimePoint time) noexcept override;

  /// Reports that the driven angles [rad] have changed; homing depends on them.
  void turn(const std::array<double, 3>& joint_angle_rad) noexcept;
  /// Bits of the buttons that are pressed: 1 plus, 2 forward, 4 centre, 8 minus.
  void set_buttons(std::uint8_t buttons) noexcept { buttons_ = buttons & 0x0FU; }

  [[nodiscard]] std::optional<rt::TimePoint> watchdog_deadline() const noexcept;
  /// Cuts the motors when `now` has reached the watchdog's deadline.
  void check_watchdog(rt::TimePoint now) noexcept;

  [[nodiscard]] State state() const noexcept { return state_; }
  [[nodiscard]] static const char* name_of(State state) noexcept;
  /// Commands in force, within the limit; positive ones drive the arms toward smaller angles.
  [[nodiscard]] const std::array<std::int32_t, 3>& commands() const noexcept { return commands_; }
  /// What the encoder counters of the next packet would be at driven angles [rad].
  [[nodiscard]] std::array<std::int32_t, 3> counters(
      const std::array<double, 3>& joint_angle_rad) const noexcept;
  [[nodiscard]] const std::array<bool, 3>& homed() const noexcept { return homed_; }
  [[nodiscard]] bool all_homed() const noexcept { return homed_[0] && homed_[1] && homed_[2]; }
  /// Of the last packet: 0x02 green, 0x04 blue, 0x08 red.
  [[nodiscard]] std::uint8_t lights() const noexcept { return lights_; }
  /// When the last packet came; nothing if none came since the firmware started.
  [[nodiscard]] std::optional<rt::TimePoint> last_packet() const noexcept { return last_packet_; }
  [[nodiscard]] const Statistics& statistics() const noexcept { return statistics_; }

 private:
  void boot(std::uint8_t character, const LineSettings& line, rt::TimePoint time) noexcept;
  void load(std::uint8_t character, const LineSettings& line, rt::TimePoint time) noexcept;
  void load_word(std::uint16_t word) noexcept;
  void start_boot_loader() noexcept;
  void start_firmware() noexcept;
  void run(std::uint8_t character, rt::TimePoint time) noexcept;
  void answer(rt::TimePoint time) noexcept;
  void cut_motors() noexcept;
  void lose_zeros() noexcept;

  [[nodiscard]] bool stuck_at(BootStep step) const noexcept {
    return faults_ != nullptr && faults_->stuck_at(step);
  }

  Board& board_;
  BootLoaderFaults* faults_ = nullptr;
  double rad_per_count_;
  double zero_angle_rad_;
  std::int32_t command_limit_;
  double homing_out_rad_;
  double homing_in_rad_;

  State state_ = State::kCold;
  bool dtr_ = false;
  std::size_t greeting_matched_ = 0;

  /// The loader's place in the image.
  enum class Section : std::uint8_t { kKey, kHeader, kBlockSize, kBlock, kRefused };
  Section section_ = Section::kKey;
  std::optional<std::uint8_t> low_byte_;
  std::uint64_t image_byte_ = 0;  // the next one's place in the image
  std::size_t words_left_ = 0;    // of the header or the block

  std::array<std::uint8_t, kPacketBytes> packet_{};
  std::size_t packet_size_ = 0;
  std::array<std::int32_t, 3> commands_{};
  bool homing_ = false;
  std::uint8_t lights_ = 0;
  std::uint8_t buttons_ = 0;
  std::array<bool, 3> been_out_{};
  std::array<bool, 3> homed_{};
  std::array<std::int32_t, 3> offset_counts_{};
  std::mt19937_64 random_;
  std::optional<rt::TimePoint> last_packet_;
  bool watchdog_running_ = false;
  Statistics statistics_;
};

}  // namespace forcegrid::emulator
