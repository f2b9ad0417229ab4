// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>
#include <string>
#include <vector>

namespace forcegrid::emulator {

using Bytes = std::vector<std::uint8_t>;

/// "3C 41 3E" as bytes.
Bytes hex_bytes(const std::string& text);

/// The way from a client of the Falcon to its FT232R: simulated time or a real socket.
class FalconWire {
 public:
  virtual ~FalconWire() = default;
  /// A control transfer. @returns false for STALL. `reply` gets the data of a device-to-host one.
  virtual bool control(std::uint8_t request_type, std::uint8_t request, std::uint16_t value,
                       std::uint16_t index, std::uint16_t length, Bytes* reply) = 0;
  /// One bulk OUT transfer, waited for at most 1 s. @returns bytes taken.
  virtual std::size_t write(const Bytes& data) = 0;
  /// One bulk IN transfer with a buffer of `size`, waited for at most 1 s and then cancelled.
  /// @returns what came, status bytes included.
  virtual Bytes read(std::size_t size) = 0;
};

/// What a Falcon answers to a run-time packet.
struct FalconState {
  std::array<int, 3> encoders{};
  std::uint8_t buttons = 0;
  std::uint8_t homed = 0;  ///< bit 0: axis 1
};

/// A client of the Falcon that knows the device sheet and nothing of driver/: the steps of its
/// start-up (sections 4.1 to 4.3) and the packets of section 5, each checked as the reference
/// client does.
class FalconClient {
 public:
  explicit FalconClient(FalconWire& wire) : wire_(wire) {}

  /// Section 4.1, steps 2 and 3.
  void enter_normal_mode();
  /// Section 4.1, step 4. @returns whether a valid packet came within `attempts` polls.
  bool probe(int attempts);
  /// Section 4.2, steps 1 to 7. @returns the answer to the first "\nC\r", status bytes included.
  Bytes shake_hands();
  /// Section 4.2, steps 8 to 11. @returns the packet that answers 'A', status bytes included.
  Bytes set_auto_baud();
  /// Section 4.3, in chunks of `chunk_bytes`. @returns whether every byte was echoed.
  bool download(const Bytes& image, std::size_t chunk_bytes = 62);
  /// All of it. @returns whether the firmware answers.
  bool start_up(const Bytes& image);

  /// One exchange. @param lights 2 green, 4 blue, 8 red.
  /// @returns false when no valid packet came in within ten IN transfers.
  bool exchange(const std::array<int, 3>& commands, std::uint8_t lights, bool homing,
                FalconState& state);
  bool vendor(std::uint8_t request, std::uint16_t value, std::uint16_t index = 0) {
    return wire_.control(0x40, request, value, index, 0, nullptr);
  }

  static Bytes packet(const std::array<int, 3>& commands, std::uint8_t lights, bool homing);
  /// @returns false when it is no packet.
  static bool parse(const Bytes& packet, FalconState& state);
  /// Section 4.4: without a block, and with one of two words.
  static const Bytes& image_without_blocks();
  static const Bytes& image_with_block();

 private:
  FalconWire& wire_;
};

}  // namespace forcegrid::emulator
