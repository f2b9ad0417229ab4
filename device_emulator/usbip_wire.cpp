// SPDX-License-Identifier: Apache-2.0
#include "device_emulator/usbip_wire.h"

#include <algorithm>

namespace forcegrid::emulator::usbip {

namespace {

void put8(std::vector<std::uint8_t>& out, std::uint8_t value) { out.push_back(value); }

void put16(std::vector<std::uint8_t>& out, std::uint16_t value) {
  out.push_back(static_cast<std::uint8_t>(value >> 8));
  out.push_back(static_cast<std::uint8_t>(value & 0xFFU));
}

void put32(std::vector<std::uint8_t>& out, std::uint32_t value) {
  put16(out, static_cast<std::uint16_t>(value >> 16));
  put16(out, static_cast<std::uint16_t>(value & 0xFFFFU));
}

void put_text(std::vector<std::uint8_t>& out, std::string_view text, std::size_t size) {
  const std::size_t kept = std::min(text.size(), size - 1);
  out.insert(out.end(), text.begin(), text.begin() + static_cast<std::ptrdiff_t>(kept));
  out.insert(out.end(), size - kept, 0);
}

void put_device(std::vector<std::uint8_t>& out, const DeviceInfo& device) {
  put_text(out, device.path, 256);
  put_text(out, device.busid, kBusidBytes);
  put32(out, device.bus_number);
  put32(out, device.device_number);
  put32(out, device.speed);
  put16(out, device.vendor_id);
  put16(out, device.product_id);
  put16(out, device.device_release);
  put8(out, 0);  // class, subclass, protocol: by interface
  put8(out, 0);
  put8(out, 0);
  put8(out, device.configuration);
  put8(out, 1);  // configurations
  put8(out, device.interfaces);
}

void put_op_header(std::vector<std::uint8_t>& out, std::uint16_t code, OpStatus status) {
  put16(out, kVersion);
  put16(out, code);
  put32(out, static_cast<std::uint32_t>(status));
}

void put_return_header(std::vector<std::uint8_t>& out, std::uint32_t command,
                       std::uint32_t sequence, std::int32_t status) {
  put32(out, command);
  put32(out, sequence);
  put32(out, 0);  // devid, direction and endpoint are zero in replies
  put32(out, 0);
  put32(out, 0);
  put32(out, static_cast<std::uint32_t>(status));
}

}  // namespace

std::uint16_t read_uint16(std::span<const std::uint8_t, 2> bytes) noexcept {
  return static_cast<std::uint16_t>((bytes[0] << 8) | bytes[1]);
}

std::uint32_t read_uint32(std::span<const std::uint8_t, 4> bytes) noexcept {
  return (static_cast<std::uint32_t>(bytes[0]) << 24) |
         (static_cast<std::uint32_t>(bytes[1]) << 16) |
         (static_cast<std::uint32_t>(bytes[2]) << 8) | bytes[3];
}

Command read_command(std::span<const std::uint8_t, kCommandBytes> bytes) noexcept {
  const auto word = [&bytes](std::size_t at) {
    return read_uint32(std::span<const std::uint8_t, 4>(bytes.data() + at, 4));
  };
  Command command;
  command.command = word(0);
  command.sequence = word(4);
  command.devid = word(8);
  command.direction = word(12);
  command.endpoint = word(16);
  command.transfer_flags = word(20);
  command.unlink_sequence = word(20);
  command.transfer_bytes = static_cast<std::int32_t>(word(24));
  command.packets = static_cast<std::int32_t>(word(32));
  std::copy_n(bytes.begin() + 40, 8, command.setup.begin());
  return command;
}

void append_devlist_reply(std::vector<std::uint8_t>& out, std::span<const DeviceInfo> devices) {
  put_op_header(out, kOpRepDevlist, OpStatus::kOk);
  put32(out, static_cast<std::uint32_t>(devices.size()));
  for (const DeviceInfo& device : devices) {
    put_device(out, device);
    for (int i = 0; i < device.interfaces; ++i) {
      put8(out, device.interface_class);
      put8(out, device.interface_subclass);
      put8(out, device.interface_protocol);
      put8(out, 0);  // padding
    }
  }
}

void append_import_reply(std::vector<std::uint8_t>& out, OpStatus status,
                         const DeviceInfo& device) {
  put_op_header(out, kOpRepImport, status);
  if (status == OpStatus::kOk) {
    put_device(out, device);
  }
}

void append_submit_reply(std::vector<std::uint8_t>& out, std::uint32_t sequence,
                         std::int32_t status, std::uint32_t actual_bytes,
                         std::span<const std::uint8_t> data) {
  put_return_header(out, kRetSubmit, sequence, status);
  put32(out, actual_bytes);
  put32(out, 0);  // start_frame, number_of_packets, error_count: isochronous only
  put32(out, 0);
  put32(out, 0);
  out.insert(out.end(), 8, 0);
  out.insert(out.end(), data.begin(), data.end());
}

void append_unlink_reply(std::vector<std::uint8_t>& out, std::uint32_t sequence,
                         std::int32_t status) {
  put_return_header(out, kRetUnlink, sequence, status);
  out.insert(out.end(), 24, 0);
}

}  // namespace forcegrid::emulator::usbip
