// SPDX-License-Identifier: Apache-2.0
#include "driver/usbip_wire.h"

#include <algorithm>
#include <cstring>

namespace forcegrid::driver::usbip {
namespace {

constexpr std::uint16_t kProtocolVersion = 0x0111;
constexpr std::uint16_t kImportRequest = 0x8003;
constexpr std::uint16_t kImportReply = 0x0003;
constexpr std::size_t kBusIdOffset = 256;
constexpr std::size_t kNumbersOffset = 288;  // busnum, devnum, speed, then the descriptor's ids
constexpr std::uint32_t kFlagDirectionIn = 0x0200;

std::uint16_t get16(const std::uint8_t* bytes) noexcept {
  return static_cast<std::uint16_t>((bytes[0] << 8) | bytes[1]);
}
std::uint32_t get32(const std::uint8_t* bytes) noexcept {
  return (static_cast<std::uint32_t>(get16(bytes)) << 16) | get16(bytes + 2);
}
void put16(std::uint8_t* bytes, std::uint16_t value) noexcept {
  bytes[0] = static_cast<std::uint8_t>(value >> 8);
  bytes[1] = static_cast<std::uint8_t>(value & 0xFF);
}
void put32(std::uint8_t* bytes, std::uint32_t value) noexcept {
  put16(bytes, static_cast<std::uint16_t>(value >> 16));
  put16(bytes + 2, static_cast<std::uint16_t>(value & 0xFFFF));
}

void put_basic_header(std::span<std::uint8_t, kHeaderBytes> message, std::uint32_t code,
                      const Command& command) noexcept {
  std::fill(message.begin(), message.end(), std::uint8_t{0});
  put32(&message[0], code);
  put32(&message[4], command.sequence);
  put32(&message[8], command.device_id);
  put32(&message[12], command.direction_in ? 1 : 0);
  put32(&message[16], command.endpoint);
}

}  // namespace

std::array<std::uint8_t, kImportRequestBytes> import_request(std::string_view bus_id) noexcept {
  std::array<std::uint8_t, kImportRequestBytes> request{};
  put16(request.data(), kProtocolVersion);
  put16(request.data() + 2, kImportRequest);
  std::memcpy(request.data() + kOperationHeaderBytes, bus_id.data(),
              std::min(bus_id.size(), kBusIdBytes));
  return request;
}

bool is_import_reply(std::span<const std::uint8_t, kOperationHeaderBytes> header) noexcept {
  return get16(header.data()) == kProtocolVersion && get16(header.data() + 2) == kImportReply;
}

std::uint32_t import_status(std::span<const std::uint8_t, kOperationHeaderBytes> header) noexcept {
  return get32(header.data() + 4);
}

ImportedDevice imported_device(std::span<const std::uint8_t, kImportedDeviceBytes> bytes) noexcept {
  ImportedDevice device;
  std::memcpy(device.bus_id.data(), bytes.data() + kBusIdOffset, kBusIdBytes);
  const std::uint8_t* numbers = bytes.data() + kNumbersOffset;
  device.device_id = (get32(numbers) << 16) | (get32(numbers + 4) & 0xFFFF);
  device.vendor_id = get16(numbers + 12);
  device.product_id = get16(numbers + 14);
  return device;
}

void put_submit(std::span<std::uint8_t, kHeaderBytes> message, const Command& command,
                std::uint32_t length, std::uint32_t interval,
                const std::array<std::uint8_t, 8>& setup) noexcept {
  put_basic_header(message, kSubmit, command);
  put32(&message[20], command.direction_in ? kFlagDirectionIn : 0);
  put32(&message[24], length);
  put32(&message[36], interval);
  std::copy(setup.begin(), setup.end(), message.begin() + 40);
}

void put_unlink(std::span<std::uint8_t, kHeaderBytes> message, const Command& command,
                std::uint32_t unlinked_sequence) noexcept {
  put_basic_header(message, kUnlink, command);
  put32(&message[20], unlinked_sequence);
}

Reply reply(std::span<const std::uint8_t, kHeaderBytes> message) noexcept {
  return {.command = get32(&message[0]),
          .sequence = get32(&message[4]),
          .status = static_cast<std::int32_t>(get32(&message[20])),
          .actual_length = get32(&message[24])};
}

}  // namespace forcegrid::driver::usbip
