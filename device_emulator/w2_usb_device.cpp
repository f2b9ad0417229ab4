#include "device_emulator/w2_usb_device.h"

#include <algorithm>
#include <stdexcept>
#include <string>

namespace forcegrid::emulator {

namespace {

// USB 2.0, tables 9-2 to 9-6; HID 1.11, section 7.
constexpr std::uint8_t kTypeMask = 0x60;
constexpr std::uint8_t kTypeStandard = 0x00;
constexpr std::uint8_t kTypeClass = 0x20;
constexpr std::uint8_t kRecipientMask = 0x1F;
constexpr std::uint8_t kRecipientDevice = 0;
constexpr std::uint8_t kRecipientInterface = 1;
constexpr std::uint8_t kRecipientEndpoint = 2;

constexpr std::uint8_t kGetStatus = 0;
constexpr std::uint8_t kClearFeature = 1;
constexpr std::uint8_t kSetFeature = 3;
constexpr std::uint8_t kSetAddress = 5;
constexpr std::uint8_t kGetDescriptor = 6;
constexpr std::uint8_t kGetConfiguration = 8;
constexpr std::uint8_t kSetConfiguration = 9;
constexpr std::uint8_t kGetInterface = 10;
constexpr std::uint16_t kFeatureEndpointHalt = 0;
constexpr std::uint16_t kStatusSelfPowered = 1;
constexpr std::uint16_t kStatusHalted = 1;

constexpr std::uint8_t kDescriptorDevice = 1;
constexpr std::uint8_t kDescriptorConfiguration = 2;
constexpr std::uint8_t kDescriptorString = 3;
constexpr std::uint8_t kDescriptorHid = 0x21;
constexpr std::uint8_t kDescriptorReport = 0x22;

constexpr std::uint8_t kClassSetReport = 9;
// The library takes its maximum report size as the only length of SET_REPORT.
constexpr std::uint16_t kSetReportLength = 63;

constexpr std::size_t kHidDescriptorOffset = 18;
constexpr std::size_t kHidDescriptorBytes = 9;
constexpr int kReportBytes = 14;

std::uint8_t low(std::uint16_t word) { return static_cast<std::uint8_t>(word & 0xFFU); }
std::uint8_t high(std::uint16_t word) { return static_cast<std::uint8_t>(word >> 8); }

ControlReply stall() { return {}; }
ControlReply done() { return {false, {}}; }
ControlReply word(std::uint16_t value) { return {false, {low(value), high(value)}}; }

}  // namespace

W2UsbDevice::W2UsbDevice(const profiles::DeviceProfile::Usb& usb) {
  if (usb.protocol != "w2" || usb.report_bytes != kReportBytes) {
    throw std::invalid_argument("protocol '" + usb.protocol + "' with reports of " +
                                std::to_string(usb.report_bytes) +
                                " bytes can't be emulated; the emulator speaks 'w2' with 14 bytes");
  }
  const std::uint16_t vendor = usb.vendor_id;
  const std::uint16_t product = usb.product_id;
  const std::uint16_t release = usb.device_release;
  device_descriptor_ = {0x12,         0x01,          0x00,         0x02,          0x00,
                        0x00,         0x00,          0x40,         low(vendor),   high(vendor),
                        low(product), high(product), low(release), high(release), 0x01,
                        0x02,         0x03,          0x01};
  const auto report_bytes = static_cast<std::uint8_t>(usb.report_bytes);
  report_descriptor_ = {0x06,
                        low(usb.usage_page),
                        high(usb.usage_page),  // Usage Page (vendor)
                        0x0A,
                        low(usb.usage),
                        high(usb.usage),  // Usage
                        0xA1,
                        0x01,  // Collection (Application)
                        0x75,
                        0x08,  // Report Size 8
                        0x15,
                        0x00,
                        0x25,
                        0xFF,  // Logical Minimum, Maximum
                        0x95,
                        report_bytes,
                        0x09,
                        0x01,
                        0x81,
                        0x02,  // Input (Data,Var,Abs)
                        0x95,
                        report_bytes,
                        0x09,
                        0x02,
                        0x91,
                        0x02,   // Output (Data,Var,Abs)
                        0xC0};  // End Collection
  const auto report_descriptor_bytes = static_cast<std::uint8_t>(report_descriptor_.size());
  configuration_descriptor_ = {
      0x09, 0x02, 0x29,         0x00, 0x01, 0x01, 0x00, 0xC0,
      0x00,  // configuration 1, self-powered
      0x09, 0x04, 0x00,         0x00, 0x02, 0x03, 0x00, 0x00,
      0x00,  // interface 0: HID
      0x09, 0x21, 0x11,         0x01, 0x00, 0x01, 0x22, report_descriptor_bytes,
      0x00,                                              // HID 1.11
      0x07, 0x05, kEndpointIn,  0x03, 0x40, 0x00, 0x01,  // interrupt, 64 bytes, every frame
      0x07, 0x05, kEndpointOut, 0x03, 0x40, 0x00, 0x01};
  string_descriptors_ = {std::vector<std::uint8_t>{0x04, 0x03, 0x09, 0x04},  // English (US)
                         usb_string_descriptor(usb.manufacturer),
                         usb_string_descriptor(usb.product),
                         usb_string_descriptor(usb.serial),
                         usb_string_descriptor("01"),
                         usb_string_descriptor("HID")};
}

void W2UsbDevice::bus_reset() noexcept {
  configuration_ = 0;
  in_halted_ = false;
  out_halted_ = false;
}

bool W2UsbDevice::halted(std::uint8_t endpoint_address) const noexcept {
  return (endpoint_address == kEndpointIn && in_halted_) ||
         (endpoint_address == kEndpointOut && out_halted_);
}

ControlReply W2UsbDevice::control(const SetupPacket& setup, std::span<const std::uint8_t> data) {
  ControlReply reply;
  const std::uint8_t type = setup.request_type & kTypeMask;
  if (type == kTypeStandard) {
    reply = standard(setup);
  } else if (type == kTypeClass && !setup.device_to_host() &&
             (setup.request_type & kRecipientMask) == kRecipientInterface &&
             setup.request == kClassSetReport && setup.length == kSetReportLength &&
             data.size() == kSetReportLength) {
    reply = done();  // taken and ignored: output reports go through EP1 OUT
  }
  if (reply.data.size() > setup.length) {
    reply.data.resize(setup.length);
  }
  return reply;
}

ControlReply W2UsbDevice::standard(const SetupPacket& setup) {
  const std::uint8_t recipient = setup.request_type & kRecipientMask;
  const bool to_host = setup.device_to_host();
  const auto endpoint = static_cast<std::uint8_t>(setup.index & 0x8FU);
  const bool known_endpoint = endpoint == kEndpointIn || endpoint == kEndpointOut;
  const bool control_endpoint = (endpoint & 0x0FU) == 0;

  if (to_host && setup.request == kGetStatus) {
    if (recipient == kRecipientDevice) {
      return word(kStatusSelfPowered);
    }
    if (recipient == kRecipientInterface) {
      return word(0);
    }
    if (recipient == kRecipientEndpoint && (known_endpoint || control_endpoint)) {
      return word(halted(endpoint) ? kStatusHalted : 0);
    }
    return stall();
  }
  if (to_host && setup.request == kGetDescriptor) {
    return get_descriptor(setup);
  }
  if (to_host && setup.request == kGetConfiguration && recipient == kRecipientDevice) {
    return {false, {configuration_}};
  }
  if (to_host && setup.request == kGetInterface && recipient == kRecipientInterface) {
    return configured() ? ControlReply{false, {0}} : stall();
  }
  if (!to_host && (setup.request == kClearFeature || setup.request == kSetFeature)) {
    // The only feature that the library knows; not before the device is configured.
    if (recipient != kRecipientEndpoint || setup.value != kFeatureEndpointHalt || !configured() ||
        !known_endpoint) {
      return stall();
    }
    (endpoint == kEndpointIn ? in_halted_ : out_halted_) = setup.request == kSetFeature;
    return done();
  }
  if (!to_host && setup.request == kSetAddress && recipient == kRecipientDevice) {
    return done();  // the address is the bus's affair, and this bus has none
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
  return stall();  // SET_INTERFACE, SYNCH_FRAME, SET_DESCRIPTOR and the unknown
}

ControlReply W2UsbDevice::get_descriptor(const SetupPacket& setup) const {
  const std::uint8_t recipient = setup.request_type & kRecipientMask;
  const std::uint8_t type = high(setup.value);
  const std::uint8_t index = low(setup.value);
  if (recipient == kRecipientDevice) {
    switch (type) {
      case kDescriptorDevice:
        return {false, {device_descriptor_.begin(), device_descriptor_.end()}};
      case kDescriptorConfiguration:
        // One configuration, whichever index is asked for, as in the library.
        return {false, configuration_descriptor_};
      case kDescriptorString:
        return index < string_descriptors_.size() ? ControlReply{false, string_descriptors_[index]}
                                                  : stall();
      default:
        return stall();  // device qualifier: full speed only
    }
  }
  if (recipient == kRecipientInterface && type == kDescriptorHid) {
    const auto begin = configuration_descriptor_.begin() + kHidDescriptorOffset;
    return {false, {begin, begin + kHidDescriptorBytes}};
  }
  if (recipient == kRecipientInterface && type == kDescriptorReport) {
    return {false, report_descriptor_};
  }
  return stall();
}

}  // namespace forcegrid::emulator
