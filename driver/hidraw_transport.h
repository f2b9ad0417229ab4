// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>

#include "driver/hidraw_nodes.h"
#include "driver/transport.h"

namespace forcegrid::driver {

/// Opens a hidraw node through hidapi's hidraw back end. Reports carry no report ID; hidapi's
/// leading zero byte is added here.
/// @throws DeviceError with the system's words and the remedy.
std::unique_ptr<Transport> open_hidraw_transport(const HidrawNode& node);

}  // namespace forcegrid::driver
