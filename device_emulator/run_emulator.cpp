// SPDX-License-Identifier: Apache-2.0
#include "device_emulator/run_emulator.h"

#include <poll.h>

#include <chrono>
#include <cmath>
#include <ostream>
#include <stdexcept>
#include <string>
#include <string_view>

#include "log/log.h"

namespace forcegrid::emulator {

namespace {

constexpr int kStopCheck_ms = 50;
constexpr int kLingerCheck_ms = 5;
constexpr char kPathPrefix[] = "path:";

}  // namespace

ServerOptions server_options(const EmulatorOptions& options) {
  for (const double coordinate_m : options.contact_m) {
    if (!std::isfinite(coordinate_m) || std::abs(coordinate_m) > 1.0) {
      throw std::invalid_argument("contact point coordinate " + std::to_string(coordinate_m) +
                                  " m is impossible; give metres in the device frame, within the "
                                  "arm's workspace");
    }
  }
  if (!(options.tip_mass_kg >= 0.0 && options.tip_mass_kg <= kMaxTipMass_kg)) {
    throw std::invalid_argument("tip mass " + std::to_string(options.tip_mass_kg) +
                                " kg is impossible; give kilograms from 0 to 5");
  }
  if (options.hand_lets_go && parse_hand(options.hand) == HandKind::kNone) {
    throw std::invalid_argument(
        "a hand that lets go must hold the device first; use hand firm, light or arm");
  }
  if (!options.hand_target.empty() && options.hand_lets_go) {
    throw std::invalid_argument(
        "a hand that follows a target must hold the device; do not let it go");
  }
  if (!(options.click_every_s >= 0.0 && options.click_every_s <= kMaxClickEvery_s)) {
    throw std::invalid_argument("clicks every " + std::to_string(options.click_every_s) +
                                " s are impossible; give seconds from 0 (never) to 3600");
  }
  ServerOptions server;
  server.listen = options.listen;
  server.hand_target = options.hand_target;
  for (const std::string& name : options.profiles) {
    DeviceOptions device;
    device.profile = profiles::load_device_profile(name);
    device.hand = parse_hand(options.hand);
    device.hand_carries_weight = options.hand_carries_weight;
    device.tip_mass_kg = options.tip_mass_kg;
    device.operator_script.lets_go = options.hand_lets_go;
    device.frame_order = parse_frame_order(options.frame_order);
    device.random_power_up_counters = options.random_power_up_counters;
    device.firmware_loaded = options.firmware_loaded;
    device.core = options.core;
    if (!options.core.empty() &&
        (options.profiles.size() > 1 || profiles::is_delta(device.profile))) {
      throw std::invalid_argument("a second processor drives one arm: give one device, no Falcon");
    }
    if (options.click_every_s > 0.0 && !device.profile.gimbal.stylus_button) {
      throw std::invalid_argument("device '" + device.profile.name +
                                  "' has no button on its stylus to click; give a device whose "
                                  "profile has gimbal.stylus_button");
    }
    if (options.motion.starts_with(kPathPrefix)) {
      device.operator_script.motion = MotionKind::kPath;
      device.operator_script.path =
          read_recorded_path(options.motion.substr(std::string_view(kPathPrefix).size()));
    } else {
      device.operator_script.motion = parse_motion(options.motion);
    }
    device.operator_script.wrist_motion = parse_wrist_motion(options.wrist);
    device.operator_script.click_every_s = options.click_every_s;
    device.operator_script.amplitude_m = options.amplitude_m;
    device.operator_script.seed = options.seed;
    device.operator_script.calibrated = options.calibrated;
    device.operator_script.contact_D = {options.contact_m[0], options.contact_m[1],
                                        options.contact_m[2]};
    for (const std::string& fault : options.faults) {
      device.faults.push_back(parse_fault(fault));
    }
    server.devices.push_back(device);
  }
  return server;
}

std::vector<EmulatorReport> run_emulator(const EmulatorOptions& options, std::ostream& out,
                                         const std::atomic<bool>& stop, int stop_fd) {
  EmulatorServer server(server_options(options));
  server.start();
  const auto scheduling = server.statistics().scheduling;
  if (!scheduling.realtime && options.says_scheduling) {
    log::warn("emulator", "emulator frame thread: " + scheduling.reason);
  }
  for (std::size_t i = 0; i < server.device_count(); ++i) {
    out << "listening " << server.address() << " busid " << server.device(i).busid() << " device "
        << server.report(i).device << '\n';
  }
  out.flush();

  pollfd watched{stop_fd, POLLIN, 0};
  while (!stop.load(std::memory_order_acquire)) {
    // A negative descriptor is ignored by poll, which then only waits.
    if (::poll(&watched, 1, kStopCheck_ms) > 0) {
      break;
    }
  }
  const auto lingering = std::chrono::duration<double>(options.linger_s);
  const auto end = std::chrono::steady_clock::now() +
                   std::chrono::duration_cast<std::chrono::steady_clock::duration>(lingering);
  while (!stop.load(std::memory_order_acquire) && std::chrono::steady_clock::now() < end) {
    static_cast<void>(::poll(nullptr, 0, kLingerCheck_ms));
  }
  server.stop();
  std::vector<EmulatorReport> reports;
  for (std::size_t i = 0; i < server.device_count(); ++i) {
    reports.push_back(server.report(i));
  }
  return reports;
}

}  // namespace forcegrid::emulator
