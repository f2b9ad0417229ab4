// SPDX-License-Identifier: Apache-2.0
#include "cli/run/run_servo_options.h"

#include <chrono>
#include <stdexcept>

#include "cli/common/stop_request.h"
#include "rt/vectors.h"

namespace forcegrid::cli {
namespace {

// With a coupling, the guard only observes.
void set_passivity(const RunOptions& options, servo::ServoOptions& servo_options) {
  constexpr double kBoundOverAllowance = 2.0;
  servo_options.rendering.passivity.mode = options.passivity == "control"
                                               ? servo::PassivityMode::kControl
                                               : servo::PassivityMode::kObserve;
  servo_options.rendering.passivity.allowance_J = 1e-3 * options.passivity_allowance_mJ;
  servo_options.rendering.passivity.bound_J =
      kBoundOverAllowance * servo_options.rendering.passivity.allowance_J;
  servo_options.rendering.passivity.max_damping_N_s_per_m = options.passivity_damping_N_s_per_m;
  if (options.passivity == "coupling") {
    servo_options.rendering.coupling =
        servo::CouplingOptions{options.coupling.at(0), options.coupling.at(1)};
  }
}

void set_switches(const RunOptions& options, const profiles::DeviceProfile& profile,
                  servo::ServoOptions& servo_options) {
  StopRequest::install_switches();
  servo_options.emergency_stop = &StopRequest::emergency();
  servo_options.dead_man_signal = &StopRequest::dead_man();
  if (options.dead_man == "button") {
    if (!servo::DeviceButton::can_be_held(profile)) {
      throw std::runtime_error("--dead-man button: the only button of " + profile.name +
                               " latches when pressed and does not report whether it is held; use "
                               "--dead-man signal with a separate switch");
    }
    servo_options.dead_man = servo::DeadMan::kButton;
  } else if (options.dead_man == "signal") {
    servo_options.dead_man = servo::DeadMan::kSignal;
  }
}

}  // namespace

servo::ServoOptions servo_options_of(const RunOptions& options,
                                     const profiles::DeviceProfile& profile) {
  servo::ServoOptions servo_options;
  servo_options.rate_Hz = options.rate_Hz;
  servo_options.workspace.W_origin_D = -1e-3 * rt::to_vector(options.offset_W_mm);
  servo_options.fill_budget = options.fill_budget;
  servo_options.simulator_rate_Hz = options.simulator_rate_Hz;
  servo_options.report_timeout = std::chrono::milliseconds(options.device_timeout_ms);
  servo_options.gravity_compensation = options.gravity_compensation;
  servo_options.check_motors = !options.no_motor_check;
  set_passivity(options, servo_options);
  set_switches(options, profile, servo_options);
  return servo_options;
}

}  // namespace forcegrid::cli
