// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>

/// Numbers of USB 2.0, tables 9-2 to 9-6, that the emulated devices share.
namespace forcegrid::emulator::usb {

inline constexpr std::uint8_t kTypeMask = 0x60;
inline constexpr std::uint8_t kTypeStandard = 0x00;
inline constexpr std::uint8_t kTypeClass = 0x20;
inline constexpr std::uint8_t kTypeVendor = 0x40;
inline constexpr std::uint8_t kRecipientMask = 0x1F;
inline constexpr std::uint8_t kRecipientDevice = 0;
inline constexpr std::uint8_t kRecipientInterface = 1;
inline constexpr std::uint8_t kRecipientEndpoint = 2;

inline constexpr std::uint8_t kGetStatus = 0;
inline constexpr std::uint8_t kClearFeature = 1;
inline constexpr std::uint8_t kSetFeature = 3;
inline constexpr std::uint8_t kSetAddress = 5;
inline constexpr std::uint8_t kGetDescriptor = 6;
inline constexpr std::uint8_t kGetConfiguration = 8;
inline constexpr std::uint8_t kSetConfiguration = 9;
inline constexpr std::uint8_t kGetInterface = 10;
inline constexpr std::uint8_t kSetInterface = 11;

inline constexpr std::uint16_t kFeatureEndpointHalt = 0;
inline constexpr std::uint16_t kFeatureRemoteWakeup = 1;
inline constexpr std::uint16_t kStatusSelfPowered = 1;
inline constexpr std::uint16_t kStatusRemoteWakeup = 2;
inline constexpr std::uint16_t kStatusHalted = 1;

inline constexpr std::uint8_t kDescriptorDevice = 1;
inline constexpr std::uint8_t kDescriptorConfiguration = 2;
inline constexpr std::uint8_t kDescriptorString = 3;
inline constexpr std::uint8_t kDescriptorQualifier = 6;
inline constexpr std::uint8_t kDescriptorOtherSpeed = 7;

}  // namespace forcegrid::emulator::usb
