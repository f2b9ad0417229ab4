// SPDX-License-Identifier: Apache-2.0
#include "device_emulator/w2_usb_device.h"

#include <initializer_list>
#include <stdexcept>
#include <string>

#include "device_emulator/control_replies.h"
#include "device_emulator/usb_numbers.h"

namespace forcegrid::emulator {

namespace {

using namespace usb;

// HID 1.11, section 7.
constexpr std::uint8_t kDescriptorHid = 0x21;
constexpr std::uint8_t kDescriptorReport = 0x22;

constexpr std::uint16_t kEnglish = 0x0409;

constexpr std::uint8_t kClassSetReport = 9;
// The library takes its maximum report size as the only length of SET_REPORT.
constexpr std::uint16_t kSetReportLength = 63;

// The size of the Teensy core's buffer for the data stage on endpoint 0.
constexpr std::uint16_t kTeensyControlBytes = 8;
constexpr std::uint8_t kTeensyLastEndpoint = 7;

constexpr std::size_t kHidDescriptorBytes = 9;

/// Usage page and usage of 16 bits, then `report_bytes` each way: the shape of both libraries.
/// @param logical_maximum  the item as the library writes it.
std::vector<std::uint8_t> report_descriptor_of(
    const profiles::DeviceProfile::Usb& usb, std::initializer_list<std::uint8_t> logical_maximum) {
  const auto size = static_cast<std::uint8_t>(usb.report_bytes);
  std::vector<std::uint8_t> bytes;
  const auto add = [&bytes](std::initializer_list<std::uint8_t> items) {
    for (const std::uint8_t byte : items) {
      bytes.push_back(byte);
    }
  };
  add({0x06, low_byte(usb.usage_page), high_byte(usb.usage_page)});
  add({0x0A, low_byte(usb.usage), high_byte(usb.usage)});
  add({0xA1, 0x01});              // Collection (Application)
  add({0x75, 0x08, 0x15, 0x00});  // Report Size 8, Logical Minimum 0
  add(logical_maximum);
  add({0x95, size, 0x09, 0x01, 0x81, 0x02});  // Input (Data,Var,Abs)
  add({0x95, size, 0x09, 0x02, 0x91, 0x02});  // Output (Data,Var,Abs)
  add({0xC0});                                // End Collection
  return bytes;
}

UsbEndpoint interrupt(std::uint8_t address, std::size_t packet_bytes) {
  return {address, UsbTransferType::kInterrupt, packet_bytes};
}

}  // namespace

W2UsbDevice::W2UsbDevice(const profiles::DeviceProfile::Usb& usb)
    : teensy_(usb.protocol == "w3"), high_speed_(usb.frame_period_us < 1000) {
  const bool six_motors = usb.protocol == "w6";
  if (usb.report_bytes != (teensy_      ? 64
                           : six_motors ? 20
                                        : 14) ||
      (!teensy_ && !six_motors && usb.protocol != "w2")) {
    throw std::invalid_argument("protocol '" + usb.protocol + "' with reports of " +
                                std::to_string(usb.report_bytes) +
                                " bytes can't be emulated; the emulator speaks 'w2' with 14 "
                                "bytes, 'w3' with 64 and 'w6' with 20");
  }
  const std::uint16_t vendor = usb.vendor_id;
  const std::uint16_t product = usb.product_id;
  const std::uint16_t release = usb.device_release;
  device_descriptor_ = {0x12,
                        0x01,
                        0x00,
                        0x02,
                        0x00,
                        0x00,
                        0x00,
                        0x40,
                        low_byte(vendor),
                        high_byte(vendor),
                        low_byte(product),
                        high_byte(product),
                        low_byte(release),
                        high_byte(release),
                        0x01,
                        0x02,
                        0x03,
                        0x01};
  string_descriptors_ = {std::vector<std::uint8_t>{0x04, 0x03, 0x09, 0x04},  // English (US)
                         usb_string_descriptor(usb.manufacturer),
                         usb_string_descriptor(usb.product), usb_string_descriptor(usb.serial)};
  teensy_ ? describe_teensy(usb) : describe_mbed(usb);
}

void W2UsbDevice::describe_mbed(const profiles::DeviceProfile::Usb& usb) {
  endpoint_in_ = 0x81;
  endpoint_out_ = 0x01;
  endpoints_ = {interrupt(endpoint_in_, 64), interrupt(endpoint_out_, 64)};
  report_descriptors_ = {report_descriptor_of(usb, {0x25, 0xFF})};
  const auto report_descriptor_bytes = static_cast<std::uint8_t>(report_descriptor().size());
  configuration_descriptor_ = {
      0x09, 0x02, 0x29,          0x00, 0x01, 0x01, 0x00, 0xC0,
      0x00,  // configuration 1, self-powered
      0x09, 0x04, 0x00,          0x00, 0x02, 0x03, 0x00, 0x00,
      0x00,  // interface 0: HID
      0x09, 0x21, 0x11,          0x01, 0x00, 0x01, 0x22, report_descriptor_bytes,
      0x00,                                               // HID 1.11
      0x07, 0x05, endpoint_in_,  0x03, 0x40, 0x00, 0x01,  // interrupt, 64 bytes, every frame
      0x07, 0x05, endpoint_out_, 0x03, 0x40, 0x00, 0x01};
  hid_descriptor_offsets_ = {18};
  string_descriptors_.push_back(usb_string_descriptor("01"));
  string_descriptors_.push_back(usb_string_descriptor("HID"));
}

void W2UsbDevice::describe_teensy(const profiles::DeviceProfile::Usb& usb) {
  endpoint_in_ = 0x83;
  endpoint_out_ = 0x04;
  // Teensy 4 (high speed) and Teensy 3 (full speed) differ in one endpoint number.
  const std::uint8_t serial_in = high_speed_ ? 0x82 : 0x81;
  const std::uint8_t serial_out = 0x02;
  endpoints_ = {interrupt(endpoint_in_, 64), interrupt(endpoint_out_, 64), interrupt(serial_in, 64),
                interrupt(serial_out, 32)};
  report_descriptors_ = {
      report_descriptor_of(usb, {0x26, 0xFF, 0x00}),
      {0x06, 0xC9, 0xFF, 0x09, 0x04, 0xA1, 0x5C,  // usage FFC9:0004, a vendor's collection
       0x75, 0x08, 0x15, 0x00, 0x26, 0xFF, 0x00,  // bytes
       0x95, 0x40, 0x09, 0x75, 0x81, 0x02,        // 64 in
       0x95, 0x20, 0x09, 0x76, 0x91, 0x02,        // 32 out
       0x95, 0x04, 0x09, 0x76, 0xB1, 0x02,        // 4 of a feature
       0xC0}};
  const auto report_bytes = static_cast<std::uint8_t>(report_descriptors_[0].size());
  const auto serial_bytes = static_cast<std::uint8_t>(report_descriptors_[1].size());
  configuration_descriptor_ = {
      0x09,         0x02, 0x49, 0x00, 0x02, 0x01, 0x00, 0xC0,
      0x32,  // configuration 1, 100 mA
      0x09,         0x04, 0x00, 0x00, 0x02, 0x03, 0x00, 0x00,
      0x00,  // interface 0: RawHID
      0x09,         0x21, 0x11, 0x01, 0x00, 0x01, 0x22, report_bytes,  0x00, 0x07, 0x05,
      endpoint_in_, 0x03, 0x40, 0x00, 0x01, 0x07, 0x05, endpoint_out_, 0x03, 0x40, 0x00,
      0x01,         0x09, 0x04, 0x01, 0x00, 0x02, 0x03, 0x00,          0x00,
      0x00,  // interface 1: emulated serial line
      0x09,         0x21, 0x11, 0x01, 0x00, 0x01, 0x22, serial_bytes,  0x00, 0x07, 0x05,
      serial_in,    0x03, 0x40, 0x00, 0x01, 0x07, 0x05, serial_out,    0x03, 0x20, 0x00,
      0x02};
  hid_descriptor_offsets_ = {18, 50};
}

void W2UsbDevice::bus_reset() noexcept {
  configuration_ = 0;
  halted_ = 0;
}

bool W2UsbDevice::halted(std::uint8_t endpoint_address) const noexcept {
  return (halted_ >> ((endpoint_address & 0x0FU) + ((endpoint_address & 0x80U) != 0 ? 16 : 0)) &
          1U) != 0;
}

void W2UsbDevice::set_halted(std::uint8_t endpoint_address, bool halted) noexcept {
  const std::uint32_t bit =
      1U << ((endpoint_address & 0x0FU) + ((endpoint_address & 0x80U) != 0 ? 16 : 0));
  halted_ = halted ? halted_ | bit : halted_ & ~bit;
}

ControlReply W2UsbDevice::control(const SetupPacket& setup, std::span<const std::uint8_t> data) {
  ControlReply reply = teensy_ ? teensy(setup, data) : mbed(setup, data);
  if (reply.data.size() > setup.length) {
    reply.data.resize(setup.length);
  }
  return reply;
}

ControlReply W2UsbDevice::mbed(const SetupPacket& setup, std::span<const std::uint8_t> data) {
  const std::uint8_t type = setup.request_type & kTypeMask;
  const std::uint8_t recipient = setup.request_type & kRecipientMask;
  const bool to_host = setup.device_to_host();
  if (type == kTypeClass && !to_host && recipient == kRecipientInterface &&
      setup.request == kClassSetReport && setup.length == kSetReportLength &&
      data.size() == kSetReportLength) {
    return done();  // taken and ignored: output reports go through EP1 OUT
  }
  if (type != kTypeStandard) {
    return stall();
  }
  const auto endpoint = static_cast<std::uint8_t>(setup.index & 0x8FU);
  const bool known_endpoint = endpoint == endpoint_in_ || endpoint == endpoint_out_;
  const bool control_endpoint = (endpoint & 0x0FU) == 0;

  if (to_host && setup.request == kGetStatus) {
    if (recipient == kRecipientDevice) {
      return word_reply(kStatusSelfPowered);
    }
    if (recipient == kRecipientInterface) {
      return word_reply(0);
    }
    if (recipient == kRecipientEndpoint && (known_endpoint || control_endpoint)) {
      return word_reply(halted(endpoint) ? kStatusHalted : 0);
    }
    return stall();
  }
  if (to_host && setup.request == kGetDescriptor) {
    return mbed_descriptor(setup);
  }
  if (to_host && setup.request == kGetConfiguration && recipient == kRecipientDevice) {
    return {false, {configuration_}};
  }
  if (to_host && setup.request == kGetInterface && recipient == kRecipientInterface) {
    return configured() ? ControlReply{false, {0}} : stall();
  }
  if (!to_host && (setup.request == kClearFeature || setup.request == kSetFeature)) {
    // The only feature that the library knows, and only after configuration.
    if (recipient != kRecipientEndpoint || setup.value != kFeatureEndpointHalt || !configured() ||
        !known_endpoint) {
      return stall();
    }
    set_halted(endpoint, setup.request == kSetFeature);
    return done();
  }
  if (!to_host && setup.request == kSetAddress && recipient == kRecipientDevice) {
    return done();  // the bus assigns the address, and this bus has none
  }
  if (!to_host && setup.request == kSetConfiguration && recipient == kRecipientDevice) {
    if (setup.value > 1) {
      return stall();
    }
    configuration_ = static_cast<std::uint8_t>(setup.value);
    halted_ = 0;
    return done();
  }
  return stall();  // SET_INTERFACE, SYNCH_FRAME, SET_DESCRIPTOR and the unknown
}

ControlReply W2UsbDevice::hid_descriptor(std::size_t interface) const {
  const auto begin = configuration_descriptor_.begin() +
                     static_cast<std::ptrdiff_t>(hid_descriptor_offsets_[interface]);
  return {false, {begin, begin + kHidDescriptorBytes}};
}

ControlReply W2UsbDevice::mbed_descriptor(const SetupPacket& setup) const {
  const std::uint8_t recipient = setup.request_type & kRecipientMask;
  const std::uint8_t type = high_byte(setup.value);
  const std::uint8_t index = low_byte(setup.value);
  if (recipient == kRecipientDevice) {
    switch (type) {
      case kDescriptorDevice:
        return {false, {device_descriptor_.begin(), device_descriptor_.end()}};
      case kDescriptorConfiguration:
        // One configuration for every index, as in the library.
        return {false, configuration_descriptor_};
      case kDescriptorString:
        return index < string_descriptors_.size() ? ControlReply{false, string_descriptors_[index]}
                                                  : stall();
      default:
        return stall();  // device qualifier: full speed only
    }
  }
  if (recipient == kRecipientInterface && type == kDescriptorHid) {
    return hid_descriptor(0);
  }
  if (recipient == kRecipientInterface && type == kDescriptorReport) {
    return {false, report_descriptor()};
  }
  return stall();
}

// The core matches requests by their first two bytes as a whole. It stalls everything else,
// including SET_IDLE, SET_INTERFACE and the status of an interface.
ControlReply W2UsbDevice::teensy(const SetupPacket& setup, std::span<const std::uint8_t> data) {
  const auto endpoint = static_cast<std::uint8_t>(setup.index & 0xFFU);
  const bool known_endpoint = (endpoint & 0x7FU) <= kTeensyLastEndpoint;
  switch (setup.request << 8 | setup.request_type) {
    case kGetDescriptor << 8 | 0x80:
    case kGetDescriptor << 8 | 0x81:
      return teensy_descriptor(setup);
    case kSetAddress << 8:
      return done();
    case kSetConfiguration << 8:
      configuration_ = low_byte(setup.value);
      halted_ = 0;
      return done();
    case kGetConfiguration << 8 | 0x80:
      return {false, {configuration_}};
    case kGetStatus << 8 | 0x80:
      return word_reply(0);  // although the configuration says self-powered
    case kGetStatus << 8 | 0x82:
      return known_endpoint ? word_reply(halted(endpoint) ? kStatusHalted : 0) : stall();
    case kSetFeature << 8 | 0x02:
    case kClearFeature << 8 | 0x02:
      if (!known_endpoint) {
        return stall();
      }
      set_halted(endpoint, setup.request == kSetFeature);
      return done();
    case kClassSetReport << 8 | 0x21:
      // The serial line's control reports; RawHID's output reports go through EP4 OUT.
      return setup.length <= kTeensyControlBytes && data.size() == setup.length ? done() : stall();
    default:
      return stall();
  }
}

ControlReply W2UsbDevice::teensy_descriptor(const SetupPacket& setup) const {
  const std::uint8_t type = high_byte(setup.value);
  const std::uint8_t index = low_byte(setup.value);
  if (type == kDescriptorString) {
    const bool known =
        index < string_descriptors_.size() && setup.index == (index == 0 ? 0 : kEnglish);
    return known ? ControlReply{false, string_descriptors_[index]} : stall();
  }
  if (index != 0) {
    return stall();
  }
  if ((type == kDescriptorHid || type == kDescriptorReport) && setup.index < interfaces()) {
    return type == kDescriptorHid ? hid_descriptor(setup.index)
                                  : ControlReply{false, report_descriptors_[setup.index]};
  }
  if (setup.index != 0) {
    return stall();
  }
  switch (type) {
    case kDescriptorDevice:
      return {false, {device_descriptor_.begin(), device_descriptor_.end()}};
    case kDescriptorConfiguration:
      return {false, configuration_descriptor_};
    case kDescriptorOtherSpeed: {
      ControlReply reply{false, configuration_descriptor_};
      reply.data[1] = kDescriptorOtherSpeed;
      return reply;
    }
    case kDescriptorQualifier:
      return {false, {0x0A, kDescriptorQualifier, 0x00, 0x02, 0x00, 0x00, 0x00, 0x40, 0x01, 0x00}};
    default:
      return stall();
  }
}

}  // namespace forcegrid::emulator
