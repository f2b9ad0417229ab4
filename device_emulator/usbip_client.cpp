// SPDX-License-Identifier: Apache-2.0
#include "device_emulator/usbip_client.h"

#include <sys/socket.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <utility>

namespace forcegrid::emulator {
namespace {

constexpr std::size_t kMaxCommandsPerFrame = 64;

}  // namespace

bool BusPort::has_bulk_endpoint() const noexcept {
  const auto endpoints = device->endpoints();
  return std::any_of(endpoints.begin(), endpoints.end(), [](const UsbEndpoint& endpoint) {
    return endpoint.type == UsbTransferType::kBulk;
  });
}

const UsbEndpoint* BusPort::endpoint(std::uint8_t address) const noexcept {
  for (const UsbEndpoint& endpoint : device->endpoints()) {
    if (endpoint.address == address) {
      return &endpoint;
    }
  }
  return nullptr;
}

void UsbipClient::receive(std::span<BusPort> ports, std::span<std::uint8_t> buffer,
                          rt::TimePoint now) {
  if (closing_) {
    return;
  }
  std::optional<CloseReason> ended;
  // The full socket holds back a client that commands faster than frames pass.
  if (received_.size() < kMaxReadPerFrame) {
    const ssize_t size = ::recv(socket_.get(), buffer.data(), buffer.size(), MSG_DONTWAIT);
    if (size > 0) {
      received_.insert(received_.end(), buffer.begin(), buffer.begin() + size);
    } else if (size == 0) {
      ended = CloseReason::kClientClosed;
    } else if (errno != EAGAIN && errno != EWOULDBLOCK && errno != EINTR) {
      ended = CloseReason::kSocketError;
    }
  }
  std::size_t consumed = 0;
  for (std::size_t i = 0; i < kMaxCommandsPerFrame && !closing_; ++i) {
    const auto rest = std::span<const std::uint8_t>(received_).subspan(consumed);
    const std::size_t size =
        device_ ? take_command(ports[*device_], rest, now) : take_operation(ports, rest);
    if (size == 0) {
      break;
    }
    consumed += size;
  }
  received_.erase(received_.begin(), received_.begin() + static_cast<std::ptrdiff_t>(consumed));
  if (ended == CloseReason::kClientClosed && !received_.empty()) {
    ended = CloseReason::kTruncated;
  }
  if (ended) {
    close(*ended);
  }
}

std::size_t UsbipClient::take_operation(std::span<BusPort> ports,
                                        std::span<const std::uint8_t> bytes) {
  if (bytes.size() < 4) {
    return 0;
  }
  if (usbip::read_uint16(bytes.first<2>()) != usbip::kVersion) {
    close(CloseReason::kBadVersion);
    return 0;
  }
  const std::uint16_t operation = usbip::read_uint16(bytes.subspan<2, 2>());
  if (operation != usbip::kOpReqDevlist && operation != usbip::kOpReqImport) {
    close(CloseReason::kUnknownOperation);
    return 0;
  }
  const std::size_t size =
      operation == usbip::kOpReqImport ? usbip::kImportRequestBytes : usbip::kOpHeaderBytes;
  if (bytes.size() < size) {
    return 0;
  }
  if (operation == usbip::kOpReqDevlist) {
    std::vector<usbip::DeviceInfo> plugged;
    for (const BusPort& port : ports) {
      if (port.available()) {
        plugged.push_back(port.info);
        plugged.back().configuration = port.device->configured() ? 1 : 0;
      }
    }
    usbip::append_devlist_reply(unsent_, plugged);
    close(CloseReason::kServed);
    return size;
  }
  const auto* text = reinterpret_cast<const char*>(bytes.data() + usbip::kOpHeaderBytes);
  import(ports, std::string_view(text, ::strnlen(text, usbip::kBusidBytes)));
  return size;
}

void UsbipClient::import(std::span<BusPort> ports, std::string_view busid) {
  auto status = usbip::OpStatus::kNoDevice;
  usbip::DeviceInfo info;
  for (std::size_t i = 0; i < ports.size(); ++i) {
    BusPort& port = ports[i];
    if (port.info.busid != busid) {
      continue;
    }
    info = port.info;
    info.configuration = port.device->configured() ? 1 : 0;
    if (!port.available()) {
      status = usbip::OpStatus::kNoDevice;
    } else if (port.attached) {
      status = usbip::OpStatus::kDeviceBusy;
    } else {
      status = usbip::OpStatus::kOk;
      port.attached = true;
      device_ = i;
    }
  }
  usbip::append_import_reply(unsent_, status, info);
  if (status != usbip::OpStatus::kOk) {
    close(CloseReason::kServed);
  }
}

std::size_t UsbipClient::take_command(BusPort& port, std::span<const std::uint8_t> bytes,
                                      rt::TimePoint now) {
  if (bytes.size() < usbip::kCommandBytes) {
    return 0;
  }
  const usbip::Command command = usbip::read_command(bytes.first<usbip::kCommandBytes>());
  const auto refuse = [this](CloseReason reason) -> std::size_t {
    close(reason);
    return 0;
  };
  if (command.command != usbip::kCmdSubmit && command.command != usbip::kCmdUnlink) {
    return refuse(CloseReason::kUnknownCommand);
  }
  if (command.devid != port.info.devid()) {
    return refuse(CloseReason::kWrongDevice);
  }
  if (command.command == usbip::kCmdUnlink) {
    unlink(command);
    return usbip::kCommandBytes;
  }
  if (command.direction > 1) {
    return refuse(CloseReason::kBadDirection);
  }
  if (command.transfer_bytes < 0 || command.transfer_bytes > usbip::kMaxTransferBytes) {
    return refuse(CloseReason::kBadTransferLength);
  }
  if (command.packets != 0 && command.packets != -1) {
    return refuse(CloseReason::kIsochronous);
  }
  const std::size_t data_bytes =
      command.direction == 0 ? static_cast<std::size_t>(command.transfer_bytes) : 0;
  if (bytes.size() < usbip::kCommandBytes + data_bytes) {
    return 0;
  }
  submit(port, command, bytes.subspan(usbip::kCommandBytes, data_bytes), now);
  return usbip::kCommandBytes + data_bytes;
}

void UsbipClient::submit(BusPort& port, const usbip::Command& command,
                         std::span<const std::uint8_t> data, rt::TimePoint now) {
  if (command.endpoint == 0) {
    control(port, command, data, now);
    return;
  }
  const bool in = command.direction == 1;
  const UsbEndpoint* endpoint =
      command.endpoint < 16
          ? port.endpoint(static_cast<std::uint8_t>(command.endpoint | (in ? 0x80U : 0U)))
          : nullptr;
  if (endpoint == nullptr) {
    usbip::append_submit_reply(unsent_, command.sequence, usbip::kStalled, 0, {});
    return;
  }
  if (std::any_of(urbs_.begin(), urbs_.end(),
                  [&command](const Urb& urb) { return urb.sequence == command.sequence; })) {
    close(CloseReason::kDuplicateSequence);
    return;
  }
  if (urbs_.size() >= kMaxPendingUrbs) {
    close(CloseReason::kTooManyUrbs);
    return;
  }
  Urb& urb = urbs_.emplace_back();
  urb.sequence = command.sequence;
  urb.endpoint = *endpoint;
  urb.buffer_bytes = static_cast<std::size_t>(command.transfer_bytes);
  urb.data.assign(data.begin(), data.end());
  urb.zero_packet = (command.transfer_flags & usbip::kFlagZeroPacket) != 0 && !data.empty();
  urb.short_is_error = (command.transfer_flags & usbip::kFlagShortNotOk) != 0;
}

void UsbipClient::control(BusPort& port, const usbip::Command& command,
                          std::span<const std::uint8_t> data, rt::TimePoint now) {
  const auto finish = [&](std::int32_t status, std::size_t actual_bytes = 0,
                          std::span<const std::uint8_t> reply = {}) {
    usbip::append_submit_reply(unsent_, command.sequence, status,
                               static_cast<std::uint32_t>(actual_bytes), reply);
  };
  const SetupPacket setup = SetupPacket::from_bytes(command.setup);
  auto reply = port.device->control(setup, data, now);
  if (reply.stalled) {
    finish(usbip::kStalled);
  } else if (setup.device_to_host()) {
    const std::size_t size =
        command.direction == 1
            ? std::min(reply.data.size(), static_cast<std::size_t>(command.transfer_bytes))
            : 0;
    finish(0, size, std::span(reply.data).first(size));
  } else {
    finish(0, data.size());
  }
}

void UsbipClient::unlink(const usbip::Command& command) {
  const std::size_t removed = std::erase_if(
      urbs_, [&command](const Urb& urb) { return urb.sequence == command.unlink_sequence; });
  usbip::append_unlink_reply(unsent_, command.sequence, removed > 0 ? usbip::kUnlinked : 0);
}

void run_without_client(EmulatedDevice& device, rt::TimePoint now) {
  std::vector<Urb> no_urbs;
  std::vector<std::uint8_t> no_replies;
  UrbHost nobody(no_urbs, no_replies);
  device.run(now, nobody);
}

void UsbipClient::run_device(BusPort& port, rt::TimePoint now) {
  EmulatedDevice& device = *port.device;
  UrbHost host(urbs_, unsent_);
  for (const UsbEndpoint& endpoint : device.endpoints()) {
    if (!device.configured()) {
      host.fail_all(endpoint.address, usbip::kBusError);
    } else if (device.halted(endpoint.address)) {
      host.fail_all(endpoint.address, usbip::kStalled);
    }
  }
  device.run(now, host);
  if (!device.plugged_in()) {
    cut_off(CloseReason::kUnplugged);
  }
}

void UsbipClient::send() {
  while (!unsent_.empty()) {
    const ssize_t sent =
        ::send(socket_.get(), unsent_.data(), unsent_.size(), MSG_DONTWAIT | MSG_NOSIGNAL);
    if (sent > 0) {
      unsent_.erase(unsent_.begin(), unsent_.begin() + sent);
    } else if (errno != EINTR) {
      if (errno != EAGAIN && errno != EWOULDBLOCK) {
        cut_off(CloseReason::kSocketError);
      }
      break;
    }
  }
  if (unsent_.size() > kMaxUnsentBytes) {
    cut_off(CloseReason::kSlowClient);
  }
}

void UsbipClient::release(std::span<BusPort> ports, rt::TimePoint now) {
  if (device_) {
    BusPort& port = ports[*device_];
    port.attached = false;
    port.device->bus_reset(now);
    device_.reset();
  }
  socket_ = FileDescriptor();
}

}  // namespace forcegrid::emulator
