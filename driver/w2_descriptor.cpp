// SPDX-License-Identifier: Apache-2.0
#include <string>

#include "driver/device.h"
#include "driver/hid_descriptor.h"
#include "driver/w2_codec.h"
#include "driver/w2_device.h"

namespace forcegrid::driver {
namespace {

std::string hexadecimal(unsigned value) {
  constexpr char kDigits[] = "0123456789abcdef";
  std::string text(4, '0');
  for (std::size_t i = 0; i < 4; ++i) {
    text[3 - i] = kDigits[(value >> (4 * i)) & 0xF];
  }
  return text;
}

}  // namespace

std::string descriptor_objection(std::span<const std::uint8_t> report_descriptor,
                                 const profiles::DeviceProfile& profile) {
  HidInterface interface;
  try {
    interface = parse_hid_descriptor(report_descriptor);
  } catch (const DeviceError& error) {
    return std::string(error.what()) + "; check that it is the device of profile '" + profile.name +
           "'";
  }
  if (interface.usage_page != profile.usb.usage_page || interface.usage != profile.usb.usage) {
    return "its HID usage is " + hexadecimal(interface.usage_page) + ":" +
           hexadecimal(interface.usage) + " where profile '" + profile.name + "' has " +
           hexadecimal(profile.usb.usage_page) + ":" + hexadecimal(profile.usb.usage) +
           "; name another device or profile";
  }
  if (interface.has_report_ids) {
    return "its reports carry report IDs, which the protocol does not have; check that it is the "
           "device of profile '" +
           profile.name + "'";
  }
  if (interface.input_bytes == w2::kW1ReportBytes && interface.output_bytes == w2::kW1ReportBytes) {
    return "it speaks the older W1 protocol (reports of 8 bytes), which can't be calibrated from "
           "the host and counts the other way; install the W2 firmware (reports of 14 bytes)";
  }
  const auto wanted = static_cast<std::size_t>(profile.usb.report_bytes);
  if (interface.input_bytes != wanted || interface.output_bytes != wanted) {
    return "its reports have " + std::to_string(interface.input_bytes) + " bytes in and " +
           std::to_string(interface.output_bytes) + " out where profile '" + profile.name +
           "' has " + std::to_string(wanted) + "; name another device or profile";
  }
  return "";
}

}  // namespace forcegrid::driver
