// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>

#include "profiles/device_profile.h"

namespace forcegrid::emulator {

/// The 64 words of an FT232R's EEPROM, as request 0x90 reads them.
using Ft232rEeprom = std::array<std::uint16_t, 64>;

/// EEPROM with the numbers and strings of `usb`, which `ftdi_eeprom --read-eeprom` accepts. Low
/// byte first; by byte address:
///
///   00, 01  00: FT232R, virtual COM port, low drive current; 40: packets of 64 bytes, no external
///           oscillator
///   02-07   vendor, product, release, each as in the device descriptor
///   08, 09  attributes and power, as in the configuration descriptor
///   0A      08: has a serial number
///   0B-0D   inverted pins: none; the rest unused
///   0E-13   manufacturer, product, serial: address (0x80 added) and length of each descriptor
///   14-16   functions of CBUS 0 to 4, four bits each: the chip's defaults
///   18-7D   the three string descriptors, then zeros
///   7E, 7F  checksum: c = 0xAAAA; for each of the 63 words before it: c = rotl(c xor word, 1)
///
/// Source: libftdi, doc/EEPROM-structure (type R); FTDI, FT232R data sheet, table 9.1 for the
/// defaults.
/// @throws std::invalid_argument when a string is not ASCII, or when the three have more than the
///         48 characters for which the chip has room.
Ft232rEeprom ft232r_eeprom(const profiles::DeviceProfile::Usb& usb, std::uint8_t attributes,
                           std::uint8_t max_power);

}  // namespace forcegrid::emulator
