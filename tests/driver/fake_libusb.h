// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "scripted_falcon.h"

namespace forcegrid::driver {

/// Stands in for libusb: the test program defines the functions that the transport calls, so that
/// transfers, cancellation and unplugging can be watched without a kernel. One bus, used by one
/// thread at a time. Errors are libusb's numbers.
struct FakeLibusb {
  struct Device {
    std::uint16_t vendor_id = 0x0403;
    std::uint16_t product_id = 0xCB48;
    std::string serial = "FV001";
    std::vector<std::uint8_t> ports = {2};
    std::uint8_t interface_class = 0xFF;
    int open_error = 0;
    int claim_error = 0;
    std::shared_ptr<ScriptedFalcon> falcon;
  };

  std::vector<Device> devices;
  bool takes_out = true;        ///< false: OUT is NAKed for ever
  bool stalls_in = false;       ///< IN stalls
  bool stalls_out = false;      ///< OUT stalls
  bool answers_control = true;  ///< false: control requests stall
  bool cancels = true;          ///< false: a cancelled transfer never ends
  int submit_error = 0;
  int events_error = 0;

  int contexts = 0;  ///< alive
  int handles = 0;   ///< open
  int claimed = 0;
  bool auto_detach = false;
  int allocated = 0;     ///< transfers, ever
  int freed = 0;         ///< transfers, ever
  int freed_in_use = 0;  ///< of those, while libusb had them
  int submitted = 0;
  int most_pending_in = 0;

  /// The bus of the running test. Made anew by reset().
  static FakeLibusb& bus();
  static void reset();
};

}  // namespace forcegrid::driver
