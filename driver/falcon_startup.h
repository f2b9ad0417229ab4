// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>
#include <string>

#include "driver/falcon_codec.h"
#include "driver/falcon_firmware.h"
#include "driver/ftdi_port.h"

namespace forcegrid::driver::falcon {

/// How patient the start-up is. The defaults are generous for a bus frame of 1 ms.
struct StartupTiming {
  int probes = 10;
  rt::Duration probe_reply = std::chrono::milliseconds(50);
  int handshakes = 10;
  rt::Duration handshake_reply = std::chrono::milliseconds(200);
  rt::Duration autobaud_reply = std::chrono::milliseconds(500);
  rt::Duration echo = std::chrono::seconds(1);  ///< of one chunk of the download
  rt::Duration write = std::chrono::milliseconds(500);
};

/// Brings a Falcon from whatever state it is in to running firmware that answers packets:
///
///   1. 1.5 MBaud, latency 1 ms, FIFOs purged; firmware that runs already answers a zero command.
///   2. If none does: latency 16 ms, 9600 baud, a pulse on DTR wakes the boot loader, which answers
///      "\nC\r" with "\nD,\r"; at 142.9 kBaud it measures the rate of an 'A' and returns it; the
///      image goes out in chunks of 62 bytes, and every byte of its echo is compared.
///   3. As 1 again.
///
/// Motor commands are zero in every packet.
/// @param failure   the transport's words for a lost device.
/// @param url       names the device in messages.
/// @param firmware  sent only if none runs; empty: then that is an error which says what to do.
/// @param notice    called with what the user should know while it takes; may be empty.
/// @returns whether firmware was sent.
/// @throws DeviceError naming the step, what happened and the remedy.
/// Source: device fact sheet, section 4. Real-time: no. Threads: as the port's.
bool bring_up(ftdi::FtdiPort& port, const std::function<std::string()>& failure,
              const std::string& url, const Firmware& firmware,
              const std::function<void(const std::string&)>& notice, const StartupTiming& timing);

}  // namespace forcegrid::driver::falcon
