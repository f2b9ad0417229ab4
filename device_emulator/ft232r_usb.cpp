// SPDX-License-Identifier: Apache-2.0
#include "device_emulator/ft232r_usb.h"

#include <string>

#include "device_emulator/control_replies.h"
#include "device_emulator/usb_numbers.h"

namespace forcegrid::emulator {

namespace {

using namespace usb;

// Requests of the chip (FTDI_SIO_... in the source).
constexpr std::uint8_t kReset = 0x00;
constexpr std::uint8_t kModemControl = 0x01;
constexpr std::uint8_t kFlowControl = 0x02;
constexpr std::uint8_t kBaudRate = 0x03;
constexpr std::uint8_t kDataFormat = 0x04;
constexpr std::uint8_t kModemStatus = 0x05;
constexpr std::uint8_t kEventCharacter = 0x06;
constexpr std::uint8_t kErrorCharacter = 0x07;
constexpr std::uint8_t kSetLatency = 0x09;
constexpr std::uint8_t kGetLatency = 0x0A;
constexpr std::uint8_t kBitMode = 0x0B;
constexpr std::uint8_t kReadPins = 0x0C;
constexpr std::uint8_t kReadEeprom = 0x90;

constexpr std::uint16_t kResetAll = 0;
constexpr std::uint16_t kPurgeTransmit = 1;  // what FTDI calls RX, the chip's view of USB
constexpr std::uint16_t kPurgeReceive = 2;

constexpr std::uint8_t kAttributes = 0xA0;  // bus-powered, remote wake-up
constexpr std::uint8_t kMaxPower = 0x2D;    // 90 mA
constexpr std::uint8_t kVendorClass = 0xFF;

constexpr std::array<std::uint8_t, 32> kConfigurationDescriptor = {
    0x09, 0x02, 0x20, 0x00, 0x01, 0x01, 0x00, kAttributes, kMaxPower,  // configuration 1
    0x09, 0x04, 0x00, 0x00, 0x02, 0xFF, 0xFF, 0xFF,        0x02,       // interface 0
    0x07, 0x05, 0x81, 0x02, 0x40, 0x00, 0x00,                          // bulk IN
    0x07, 0x05, 0x02, 0x02, 0x40, 0x00, 0x00};                         // bulk OUT

constexpr std::array<UsbEndpoint, 2> kEndpoints = {
    UsbEndpoint{Ft232rUsb::kEndpointIn, UsbTransferType::kBulk, Ft232r::kPacketBytes},
    UsbEndpoint{Ft232rUsb::kEndpointOut, UsbTransferType::kBulk, Ft232r::kPacketBytes}};

}  // namespace

Ft232rUsb::Ft232rUsb(const profiles::DeviceProfile::Usb& usb)
    : identity_{.vendor_id = usb.vendor_id,
                .product_id = usb.product_id,
                .device_release = usb.device_release,
                .interface_class = kVendorClass,
                .interface_subclass = kVendorClass,
                .interface_protocol = kVendorClass},
      device_descriptor_{0x12,
                         0x01,
                         0x00,
                         0x02,
                         0x00,
                         0x00,
                         0x00,
                         0x08,
                         low_byte(usb.vendor_id),
                         high_byte(usb.vendor_id),
                         low_byte(usb.product_id),
                         high_byte(usb.product_id),
                         low_byte(usb.device_release),
                         high_byte(usb.device_release),
                         0x01,
                         0x02,
                         0x03,
                         0x01},
      string_descriptors_{std::vector<std::uint8_t>{0x04, 0x03, 0x09, 0x04},  // English (US)
                          usb_string_descriptor(usb.manufacturer),
                          usb_string_descriptor(usb.product), usb_string_descriptor(usb.serial)},
      eeprom_(ft232r_eeprom(usb, kAttributes, kMaxPower)) {}

std::span<const UsbEndpoint> Ft232rUsb::endpoints() const noexcept { return kEndpoints; }

void Ft232rUsb::bus_reset() noexcept {
  configuration_ = 1;
  remote_wakeup_ = false;
  in_halted_ = false;
  out_halted_ = false;
}

ControlReply Ft232rUsb::control(const SetupPacket& setup, Ft232r& bridge, SerialPeer& peer,
                                rt::TimePoint now) {
  ControlReply reply;
  const std::uint8_t type = setup.request_type & kTypeMask;
  const std::uint8_t recipient = setup.request_type & kRecipientMask;
  if (type == kTypeStandard) {
    reply = standard(setup);
  } else if (type == kTypeVendor && recipient == kRecipientDevice) {
    reply =
        setup.device_to_host() ? vendor_in(setup, bridge) : vendor_out(setup, bridge, peer, now);
  }
  if (reply.data.size() > setup.length) {
    reply.data.resize(setup.length);
  }
  return reply;
}

ControlReply Ft232rUsb::standard(const SetupPacket& setup) {
  const std::uint8_t recipient = setup.request_type & kRecipientMask;
  const bool to_host = setup.device_to_host();
  const auto endpoint = static_cast<std::uint8_t>(setup.index & 0x8FU);
  const bool known_endpoint = endpoint == kEndpointIn || endpoint == kEndpointOut;

  if (to_host && setup.request == kGetStatus) {
    if (recipient == kRecipientDevice) {
      return word_reply(remote_wakeup_ ? kStatusRemoteWakeup : 0);
    }
    if (recipient == kRecipientInterface) {
      return word_reply(0);
    }
    if (recipient == kRecipientEndpoint && (known_endpoint || (endpoint & 0x0FU) == 0)) {
      return word_reply(halted(endpoint) ? kStatusHalted : 0);
    }
    return stall();
  }
  if (to_host && setup.request == kGetDescriptor && recipient == kRecipientDevice) {
    return get_descriptor(setup);
  }
  if (to_host && setup.request == kGetConfiguration && recipient == kRecipientDevice) {
    return {false, {configuration_}};
  }
  if (to_host && setup.request == kGetInterface && recipient == kRecipientInterface) {
    return configured() && setup.index == 0 ? ControlReply{false, {0}} : stall();
  }
  if (!to_host && (setup.request == kClearFeature || setup.request == kSetFeature)) {
    const bool set = setup.request == kSetFeature;
    if (recipient == kRecipientDevice && setup.value == kFeatureRemoteWakeup) {
      remote_wakeup_ = set;
      return done();
    }
    if (recipient == kRecipientEndpoint && setup.value == kFeatureEndpointHalt && configured() &&
        known_endpoint) {
      (endpoint == kEndpointIn ? in_halted_ : out_halted_) = set;
      return done();
    }
    return stall();
  }
  if (!to_host && setup.request == kSetAddress && recipient == kRecipientDevice) {
    return done();  // the bus assigns the address, and this bus has none
  }
  if (!to_host && setup.request == kSetConfiguration && recipient == kRecipientDevice) {
    if (setup.value > 1) {
      return stall();
    }
    configuration_ = static_cast<std::uint8_t>(setup.value);
    in_halted_ = false;
    out_halted_ = false;
    return done();
  }
  if (!to_host && setup.request == kSetInterface && recipient == kRecipientInterface) {
    const bool only_one = configured() && setup.index == 0 && setup.value == 0;
    if (only_one) {
      in_halted_ = false;
      out_halted_ = false;
    }
    return only_one ? done() : stall();
  }
  return stall();
}

ControlReply Ft232rUsb::get_descriptor(const SetupPacket& setup) const {
  const std::uint8_t index = low_byte(setup.value);
  switch (high_byte(setup.value)) {
    case kDescriptorDevice:
      return {false, {device_descriptor_.begin(), device_descriptor_.end()}};
    case kDescriptorConfiguration:
      return index == 0
                 ? ControlReply{false,
                                {kConfigurationDescriptor.begin(), kConfigurationDescriptor.end()}}
                 : stall();
    case kDescriptorString:
      return index < string_descriptors_.size() ? ControlReply{false, string_descriptors_[index]}
                                                : stall();
    default:
      return stall();  // device qualifier: full speed only
  }
}

ControlReply Ft232rUsb::vendor_out(const SetupPacket& setup, Ft232r& bridge, SerialPeer& peer,
                                   rt::TimePoint now) const {
  const std::uint16_t value = setup.value;
  switch (setup.request) {
    case kReset:
      if (value == kResetAll) {
        bridge.reset(peer, now);
      } else if (value == kPurgeTransmit) {
        bridge.purge_transmit();
      } else if (value == kPurgeReceive) {
        bridge.purge_receive();
      } else {
        return stall();
      }
      return done();
    case kModemControl: {
      // High byte: which lines change; low byte: their new levels.
      const auto line = [value](unsigned bit) {
        return (value >> 8 & bit) != 0 ? std::optional((value & bit) != 0) : std::nullopt;
      };
      bridge.set_modem_lines(line(1), line(2), peer, now);
      return done();
    }
    case kFlowControl: {
      const std::uint8_t protocol = high_byte(setup.index);
      if (protocol != 0 && protocol != 1 && protocol != 2 && protocol != 4) {
        return stall();
      }
      bridge.set_flow_control(static_cast<Ft232r::FlowControl>(protocol));
      return done();
    }
    case kBaudRate: {
      const auto baud_Hz =
          Ft232r::baud_of_divisor(value | static_cast<std::uint32_t>(setup.index & 1U) << 16);
      if (!baud_Hz) {
        return stall();
      }
      bridge.set_baud(*baud_Hz);
      return done();
    }
    case kDataFormat: {
      const std::uint8_t data_bits = low_byte(value);
      const auto parity = static_cast<std::uint8_t>(value >> 8 & 7U);
      const auto stop_bits = static_cast<std::uint8_t>(value >> 11 & 7U);
      if ((data_bits != 7 && data_bits != 8) || parity > 4 || stop_bits > 2) {
        return stall();
      }
      bridge.set_format(data_bits, parity, stop_bits, (value & 0x4000U) != 0);
      return done();
    }
    case kEventCharacter:
      bridge.set_event_character((value & 0x100U) != 0 ? std::optional(low_byte(value))
                                                       : std::nullopt);
      return done();
    case kErrorCharacter:
      return done();  // replaces characters with a parity error, which never occurs on this line
    case kSetLatency:
      if (value < 1 || value > 255) {
        return stall();
      }
      bridge.set_latency_ms(low_byte(value));
      return done();
    case kBitMode:
      bridge.set_bit_mode(high_byte(value));
      return done();
    default:
      return stall();
  }
}

ControlReply Ft232rUsb::vendor_in(const SetupPacket& setup, const Ft232r& bridge) const {
  switch (setup.request) {
    case kModemStatus: {
      const auto status = bridge.status();
      return {false, {status.begin(), status.end()}};
    }
    case kGetLatency:
      return {false, {bridge.latency_ms()}};
    case kReadPins:
      return {false, {0}};
    case kReadEeprom:
      return word_reply(eeprom_[setup.index % eeprom_.size()]);
    default:
      return stall();
  }
}

}  // namespace forcegrid::emulator
