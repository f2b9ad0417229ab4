// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <span>

/// What a fuzzer feeds with bytes: every place where bytes of a stranger come in. A target returns
/// for any input; a crash, a sanitizer's finding, an exception it does not expect, a hang or a
/// broken promise (require()) is the fault looked for.
namespace forcegrid::fuzz {

using Input = std::span<const std::uint8_t>;

void usbip_server(Input input);     ///< what a client sends to the emulator's USB/IP server
void usbip_client(Input input);     ///< what a USB/IP server answers to the driver
void w2_report(Input input);        ///< reports of the device, currents for it, HID descriptors
void device_profile(Input input);   ///< TOML files
void link_datagram(Input input);    ///< datagrams of the other end of the link
void sealed_datagram(Input input);  ///< the same of a link with a key
void view_streams(Input input);     ///< what a run or a simulator sends to the live view
void view_command(Input input);     ///< what a page sends to it, and a request's names

/// Ends the process with `promise` on standard error unless `kept`.
void require(bool kept, const char* promise);

}  // namespace forcegrid::fuzz
