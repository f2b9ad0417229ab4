// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cmath>
#include <cstddef>
#include <functional>
#include <limits>
#include <string>
#include <utility>

#include "rt/local_datagrams.h"
#include "simulator/impaired_link.h"

namespace forcegrid::simulator {

/// What can be changed while a simulator runs.
struct SimulatorControls {
  double rate_Hz = 30.0;  ///< answers per second; in (0, 1000]
  LinkConditions link;
  /// [m] Height in W of a stiff, flat wall that a tool which holds the object runs into from below;
  /// infinite: there is none.
  double wall_m = std::numeric_limits<double>::infinity();
  bool cut = false;  ///< the object is cut around the tool, see ColumnCut

  static constexpr double kMostRate_Hz = 1000.0;
  [[nodiscard]] bool usable() const noexcept {
    return rate_Hz > 0.0 && rate_Hz <= kMostRate_Hz && link.usable() && !std::isnan(wall_m);
  }
};

/// A Unix datagram socket that takes changes of a simulator's controls (docs/view_protocol.md): 56
/// bytes, a u64 of the sender's choice, and six f64, all little-endian: the rate [Hz], the delay
/// [ms], the jitter [ms], the loss [%], the wall's height [mm] and the cut (0 or 1); NaN leaves one
/// as it is. The answer has the same form: the u64, and what holds now. A change with any value out
/// of range, or one that is not admitted, changes nothing.
///
/// Real-time: no. Threads: one.
class ControlSocket {
 public:
  static constexpr std::size_t kBytes = 56;
  static constexpr int kMostAtOnce = 16;

  /// @param admits  whether usable controls may replace those that hold.
  /// @throws std::runtime_error naming the path and the remedy.
  ControlSocket(const std::string& path, std::function<bool(const SimulatorControls&)> admits)
      : socket_(path), admits_(std::move(admits)) {}

  /// Takes what has come. @param controls  as they are; changed as was asked.
  /// @returns how many values were changed, one after another; several in a datagram count each.
  std::size_t receive(SimulatorControls& controls);

 private:
  rt::LocalDatagrams socket_;
  std::function<bool(const SimulatorControls&)> admits_;
};

}  // namespace forcegrid::simulator
