// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <string_view>

/// The client's side of the USB/IP wire format, version 0x0111. All numbers are big-endian.
/// Source: Linux Documentation/usb/usbip_protocol.rst.
/// Real-time: no allocation, lock or throw. Threads: any.
namespace forcegrid::driver::usbip {

inline constexpr std::size_t kBusIdBytes = 32;
inline constexpr std::size_t kOperationHeaderBytes = 8;
inline constexpr std::size_t kImportRequestBytes = kOperationHeaderBytes + kBusIdBytes;
inline constexpr std::size_t kImportedDeviceBytes = 312;
inline constexpr std::size_t kHeaderBytes = 48;  ///< of commands and their replies

inline constexpr std::uint32_t kSubmit = 1;
inline constexpr std::uint32_t kUnlink = 2;
inline constexpr std::uint32_t kSubmitReply = 3;
inline constexpr std::uint32_t kUnlinkReply = 4;

/// OP_REQ_IMPORT of the device `bus_id` (shorter than kBusIdBytes).
std::array<std::uint8_t, kImportRequestBytes> import_request(std::string_view bus_id) noexcept;

/// Whether `header` begins an OP_REP_IMPORT of this version.
bool is_import_reply(std::span<const std::uint8_t, kOperationHeaderBytes> header) noexcept;
/// Its status: 0 for a device that has been imported.
std::uint32_t import_status(std::span<const std::uint8_t, kOperationHeaderBytes> header) noexcept;

/// What follows the header of a successful import.
struct ImportedDevice {
  std::array<char, kBusIdBytes> bus_id{};  ///< padded with zeros
  std::uint32_t device_id = 0;             ///< of commands: bus and device number
  std::uint16_t vendor_id = 0;
  std::uint16_t product_id = 0;
};
ImportedDevice imported_device(std::span<const std::uint8_t, kImportedDeviceBytes> bytes) noexcept;

/// The part that all commands begin with.
struct Command {
  std::uint32_t sequence = 0;
  std::uint32_t device_id = 0;
  bool direction_in = false;
  std::uint32_t endpoint = 0;
};
/// CMD_SUBMIT without its payload. @param setup of control transfers, else zeros.
void put_submit(std::span<std::uint8_t, kHeaderBytes> message, const Command& command,
                std::uint32_t length, std::uint32_t interval,
                const std::array<std::uint8_t, 8>& setup) noexcept;
/// CMD_UNLINK of the command with `unlinked_sequence`.
void put_unlink(std::span<std::uint8_t, kHeaderBytes> message, const Command& command,
                std::uint32_t unlinked_sequence) noexcept;

/// Header of RET_SUBMIT or RET_UNLINK.
struct Reply {
  std::uint32_t command = 0;
  std::uint32_t sequence = 0;
  std::int32_t status = 0;
  std::uint32_t actual_length = 0;
};
Reply reply(std::span<const std::uint8_t, kHeaderBytes> message) noexcept;

}  // namespace forcegrid::driver::usbip
