// SPDX-License-Identifier: Apache-2.0
#include "simulator/control_socket.h"

#include <array>
#include <bit>
#include <cmath>
#include <cstring>

namespace forcegrid::simulator {
namespace {

static_assert(std::endian::native == std::endian::little, "a datagram is copied as it is");

struct Datagram {
  std::uint64_t number = 0;
  double rate_Hz = 0.0;
  double delay_ms = 0.0;
  double jitter_ms = 0.0;
  double loss_percent = 0.0;
  double wall_mm = 0.0;
  double cut = 0.0;
};
static_assert(sizeof(Datagram) == ControlSocket::kBytes);

SimulatorControls changed(SimulatorControls controls, const Datagram& wanted) {
  const auto take = [](double value, double unit, double& into) {
    if (!std::isnan(value)) {
      into = value * unit;
    }
  };
  take(wanted.rate_Hz, 1.0, controls.rate_Hz);
  take(wanted.delay_ms, 1e-3, controls.link.delay_s);
  take(wanted.jitter_ms, 1e-3, controls.link.jitter_s);
  take(wanted.loss_percent, 1e-2, controls.link.loss);
  take(wanted.wall_mm, 1e-3, controls.wall_m);
  if (!std::isnan(wanted.cut)) {
    controls.cut = wanted.cut != 0.0;
  }
  return controls;
}

std::size_t differences(const SimulatorControls& a, const SimulatorControls& b) {
  return static_cast<std::size_t>(a.rate_Hz != b.rate_Hz) +
         static_cast<std::size_t>(a.link.delay_s != b.link.delay_s) +
         static_cast<std::size_t>(a.link.jitter_s != b.link.jitter_s) +
         static_cast<std::size_t>(a.link.loss != b.link.loss) +
         static_cast<std::size_t>(a.wall_m != b.wall_m) + static_cast<std::size_t>(a.cut != b.cut);
}

}  // namespace

std::size_t ControlSocket::receive(SimulatorControls& controls) {
  std::size_t changes = 0;
  for (int i = 0; i < kMostAtOnce; ++i) {
    std::array<std::uint8_t, kBytes> bytes{};
    const ssize_t taken = socket_.receive(bytes);
    if (taken < 0) {
      break;
    }
    if (taken != static_cast<ssize_t>(kBytes)) {
      continue;
    }
    auto datagram = std::bit_cast<Datagram>(bytes);
    const SimulatorControls wanted = changed(controls, datagram);
    if (wanted.usable() && admits_(wanted)) {
      changes += differences(controls, wanted);
      controls = wanted;
    }
    datagram = {datagram.number,
                controls.rate_Hz,
                1e3 * controls.link.delay_s,
                1e3 * controls.link.jitter_s,
                1e2 * controls.link.loss,
                1e3 * controls.wall_m,
                controls.cut ? 1.0 : 0.0};
    static_cast<void>(socket_.reply(std::bit_cast<std::array<std::uint8_t, kBytes>>(datagram)));
  }
  return changes;
}

}  // namespace forcegrid::simulator
