// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <string_view>
#include <vector>

namespace forcegrid::emulator {

/// USB/IP messages of the server's end, byte for byte. All numbers are big-endian except the eight
/// set-up bytes, which are as on the bus.
/// Source: Linux kernel, Documentation/usb/usbip_protocol.rst (protocol version 1.1.1).
namespace usbip {

inline constexpr std::uint16_t kVersion = 0x0111;
inline constexpr std::uint16_t kOpReqDevlist = 0x8005;
inline constexpr std::uint16_t kOpRepDevlist = 0x0005;
inline constexpr std::uint16_t kOpReqImport = 0x8003;
inline constexpr std::uint16_t kOpRepImport = 0x0003;
inline constexpr std::uint32_t kCmdSubmit = 1;
inline constexpr std::uint32_t kCmdUnlink = 2;
inline constexpr std::uint32_t kRetSubmit = 3;
inline constexpr std::uint32_t kRetUnlink = 4;

inline constexpr std::size_t kOpHeaderBytes = 8;
inline constexpr std::size_t kBusidBytes = 32;
inline constexpr std::size_t kImportRequestBytes = kOpHeaderBytes + kBusidBytes;
inline constexpr std::size_t kDeviceBytes = 312;
inline constexpr std::size_t kCommandBytes = 48;
inline constexpr std::int32_t kMaxTransferBytes = 64 * 1024;

/// Status of OP replies (usbip-utils' ST_*).
enum class OpStatus : std::uint32_t {
  kOk = 0,
  kNotAvailable = 1,
  kDeviceBusy = 2,
  kDeviceError = 3,
  kNoDevice = 4
};

/// Results of URBs: negative Linux error numbers.
inline constexpr std::int32_t kStalled = -32;    ///< EPIPE
inline constexpr std::int32_t kBusError = -71;   ///< EPROTO: nobody answered
inline constexpr std::int32_t kBabble = -75;     ///< EOVERFLOW: more data than buffer
inline constexpr std::int32_t kUnlinked = -104;  ///< ECONNRESET
/// EREMOTEIO: less data than buffer, where the client has said that this is an error
inline constexpr std::int32_t kShortTransfer = -121;

/// Transfer flags of CMD_SUBMIT (the kernel's URB_...); the others are irrelevant for a device.
inline constexpr std::uint32_t kFlagShortNotOk = 0x0001;
inline constexpr std::uint32_t kFlagZeroPacket = 0x0040;

/// enum usb_device_speed of the kernel.
inline constexpr std::uint32_t kSpeedFull = 2;
inline constexpr std::uint32_t kSpeedHigh = 3;

/// What a device list or an import reply states about a device.
struct DeviceInfo {
  std::string path;
  std::string busid;
  std::uint32_t bus_number = 0;
  std::uint32_t device_number = 0;
  std::uint32_t speed = kSpeedFull;
  std::uint16_t vendor_id = 0;
  std::uint16_t product_id = 0;
  std::uint16_t device_release = 0;
  std::uint8_t configuration = 0;
  std::uint8_t interfaces = 1;  ///< all of the same class, subclass and protocol
  std::uint8_t interface_class = 0;
  std::uint8_t interface_subclass = 0;
  std::uint8_t interface_protocol = 0;

  /// The id that every URB must carry.
  [[nodiscard]] std::uint32_t devid() const noexcept { return (bus_number << 16) | device_number; }
};

/// Header of CMD_SUBMIT or CMD_UNLINK, 48 bytes.
struct Command {
  std::uint32_t command = 0;
  std::uint32_t sequence = 0;
  std::uint32_t devid = 0;
  std::uint32_t direction = 0;  ///< 0 OUT, 1 IN
  std::uint32_t endpoint = 0;
  std::uint32_t transfer_flags = 0;
  std::int32_t transfer_bytes = 0;
  std::int32_t packets = 0;  ///< isochronous only
  std::array<std::uint8_t, 8> setup{};
  std::uint32_t unlink_sequence = 0;  ///< CMD_UNLINK only
};

std::uint16_t read_uint16(std::span<const std::uint8_t, 2> bytes) noexcept;
std::uint32_t read_uint32(std::span<const std::uint8_t, 4> bytes) noexcept;
Command read_command(std::span<const std::uint8_t, kCommandBytes> bytes) noexcept;

/// The appenders write one whole message at the end of `out`.
void append_devlist_reply(std::vector<std::uint8_t>& out, std::span<const DeviceInfo> devices);
/// `device` is sent with kOk only.
void append_import_reply(std::vector<std::uint8_t>& out, OpStatus status, const DeviceInfo& device);
/// `data` follows an IN transfer; `actual_bytes` is how much an OUT transfer sent.
void append_submit_reply(std::vector<std::uint8_t>& out, std::uint32_t sequence,
                         std::int32_t status, std::uint32_t actual_bytes,
                         std::span<const std::uint8_t> data);
void append_unlink_reply(std::vector<std::uint8_t>& out, std::uint32_t sequence,
                         std::int32_t status);

}  // namespace usbip
}  // namespace forcegrid::emulator
