// SPDX-License-Identifier: Apache-2.0
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <memory>
#include <mutex>
#include <optional>
#include <set>
#include <string>
#include <utility>
#include <vector>

#include "bindings/python/arrays.h"
#include "bindings/python/bind.h"
#include "bindings/python/guarded.h"
#include "bindings/python/link_types.h"
#include "device_session/device_session.h"
#include "rt/clock.h"
#include "rt/thread.h"
#include "servo_loop/fault.h"

namespace forcegrid::python {
namespace {

using session::DeviceSession;
using session::SessionError;
using session::SessionHealth;
using session::SessionOptions;
using session::ToolState;

py::handle health_type;  // never given up, nor are the others: they may outlive the interpreter
py::handle device_error, no_device_error, device_in_use_error;

constexpr double kLeastHold_s = 0.02;  // Python's threads wait for each other for up to 5 ms
constexpr double kHoldPeriods = 5.0;
constexpr std::chrono::milliseconds kLongestWithMethod(200);
constexpr std::chrono::milliseconds kSlice(50);  // after which a wait looks for Ctrl-C

[[noreturn]] void raise(py::handle type, const std::string& what) {
  PyErr_SetString(type.ptr(), what.c_str());
  throw py::error_already_set();
}

void translate(const SessionError& error) {
  switch (error.reason()) {
    case SessionError::Reason::kAbsent:
      raise(no_device_error, error.what());
    case SessionError::Reason::kInUse:
      raise(device_in_use_error, error.what());
    case SessionError::Reason::kUnusable:
      raise(device_error, error.what());
  }
}

// A ToolState whose vectors Python sees without a copy.
struct State {
  ToolState data;
};

// A device in use. The session lives as long as this object, also when it is closed: its functions
// may be called from any thread.
class Device {
 public:
  explicit Device(SessionOptions options) : options_(std::move(options)) {
    options_.notice = [notices = notices_](const std::string& text) {
      const std::lock_guard<std::mutex> lock(notices->mutex);
      notices->texts.push_back(text);
    };
    {
      const py::gil_scoped_release release;
      session_ = DeviceSession::open(options_);
    }
    open_devices().insert(this);
  }
  ~Device() {  // NOLINT(bugprone-exception-escape): there is memory to give up
    open_devices().erase(this);
    const py::gil_scoped_release release;
    session_.reset();
  }
  Device(const Device&) = delete;
  Device& operator=(const Device&) = delete;

  DeviceSession& session() { return *session_; }
  [[nodiscard]] const SessionOptions& options() const { return options_; }

  std::vector<std::string> take_notices() {
    const std::lock_guard<std::mutex> lock(notices_->mutex);
    return std::exchange(notices_->texts, {});
  }

  // Whether a cycle after number `cycle` has ended by `deadline`. Without the GIL.
  bool wait(std::uint64_t cycle, rt::TimePoint deadline) {
    for (;;) {
      const bool over = waiting_.without_gil([&] {
        return session_->wait_for_cycle(cycle, std::min(deadline, rt::Clock::now() + kSlice));
      });
      raise_for_signals();
      if (over || rt::Clock::now() >= deadline) {
        return over;
      }
    }
  }

  bool command(const std::array<double, 3>& force_D_N, double hold_s,
               const std::array<double, 3>& torque_D_Nm = {}) {
    return forces_.alone(
        [&] { return session_->command_wrench(force_D_N, torque_D_Nm, duration_of_s(hold_s)); });
  }

  bool push_sample(std::int64_t time_ns, const std::array<double, 3>& position_D_m,
                   const std::array<double, 3>& force_D_N) {
    return forces_.alone([&] { return session_->push_sample(time_ns, position_D_m, force_D_N); });
  }

  void busy() {
    forces_.alone([&] { session_->busy(); });
  }
  void idle() {
    forces_.alone([&] { session_->idle(); });
  }

  [[nodiscard]] bool renders_samples() const { return !options_.method.empty(); }

  // Before the interpreter ends: a Device that nobody has closed gives zero current, too.
  static void close_all() {
    for (Device* const device : std::set<Device*>(open_devices())) {
      const py::gil_scoped_release release;
      device->session_->close();
    }
  }

 private:
  struct Notices {
    std::mutex mutex;
    std::vector<std::string> texts;
  };

  // With the GIL.
  static std::set<Device*>& open_devices() {
    static std::set<Device*> devices;
    return devices;
  }

  static rt::Duration duration_of_s(double value_s) {
    return std::chrono::duration_cast<rt::Duration>(std::chrono::duration<double>(value_s));
  }

  SessionOptions options_;
  std::shared_ptr<Notices> notices_ = std::make_shared<Notices>();
  std::unique_ptr<DeviceSession> session_;
  Guard forces_;   // of command_force(), push_sample(), busy(), idle()
  Guard waiting_;  // of wait_for_cycle()
};

std::unique_ptr<Device> open(const std::string& device, const std::string& profile, double rate_Hz,
                             const std::string& method, bool calibrated,
                             const std::string& falcon_firmware, bool check_motors,
                             bool gravity_compensation, double ramp_in_s, bool realtime,
                             double open_timeout_s, std::optional<double> longest_callback_s,
                             const std::string& emulator_hand, const std::string& emulator_motion,
                             const std::string& emulator_wrist, double emulator_click_every_s,
                             const std::string& emulator_summary) {
  SessionOptions options;
  options.device = device;
  options.profile = profile;
  options.rate_Hz = rate_Hz;
  options.method = method;
  options.calibrated = calibrated;
  options.falcon_firmware = falcon_firmware;
  options.check_motors = check_motors;
  options.gravity_compensation = gravity_compensation;
  options.ramp_in_s = ramp_in_s;
  options.realtime = realtime;
  options.open_timeout = duration_of(open_timeout_s, "open_timeout_s");
  if (longest_callback_s) {
    options.longest_callback = duration_of(*longest_callback_s, "longest_callback_s");
  } else if (!method.empty()) {
    options.longest_callback = kLongestWithMethod;
  }
  options.emulator_hand = emulator_hand;
  options.emulator_motion = emulator_motion;
  options.emulator_wrist = emulator_wrist;
  options.emulator_click_every_s = emulator_click_every_s;
  options.emulator_summary = emulator_summary;
  return std::make_unique<Device>(std::move(options));
}

py::object read(Device& self, py::object out) {
  if (out.is_none()) {
    out = py::cast(State{});
  } else if (!py::isinstance<State>(out)) {
    throw py::type_error("out: expected a State");
  }
  out.cast<State&>().data = self.session().newest_state();
  return out;
}

bool wait(Device& self, std::uint64_t cycle, double timeout_s) {
  return self.wait(cycle, rt::Clock::now() + duration_of(timeout_s, "timeout_s"));
}

void command_force(Device& self, const py::object& force_D_N, double hold_s,
                   const py::object& torque_D_Nm = py::none()) {
  if (!(hold_s >= 0.0 && hold_s <= 1e6)) {
    throw py::value_error("hold_s: expected 0 s to 1e6 s");
  }
  const std::array<double, 3> torque_Nm =
      torque_D_Nm.is_none() ? std::array<double, 3>{} : link_vector(torque_D_Nm, "torque_D_Nm");
  if (!self.command(link_vector(force_D_N, "force_D_N"), hold_s, torque_Nm)) {
    throw py::value_error(self.renders_samples()
                              ? "force_D_N: this device renders the method '" +
                                    self.options().method + "'; use push_sample()"
                              : "force_D_N: not finite, or the device is closed");
  }
}

bool push_sample(Device& self, std::int64_t time_ns, const py::object& position_D_m,
                 const py::object& force_D_N) {
  if (!self.renders_samples()) {
    throw py::value_error(
        "push_sample: this device renders commanded forces; open it with method=\"auto\"");
  }
  const auto position = link_vector(position_D_m, "position_D_m");
  const auto force = link_vector(force_D_N, "force_D_N");
  for (std::size_t i = 0; i < 3; ++i) {
    if (!std::isfinite(position[i]) || !std::isfinite(force[i])) {
      throw py::value_error("push_sample: position and force have to be finite");
    }
  }
  return self.push_sample(time_ns, position, force);
}

void raise_unless_running(Device& self) {
  switch (self.session().health()) {
    case SessionHealth::kRunning:
    case SessionHealth::kUncalibrated:
      return;
    case SessionHealth::kLost:
      raise(no_device_error, self.session().failure());
    case SessionHealth::kFaulted:
      raise(device_error, self.session().failure());
    case SessionHealth::kClosed:
      raise(device_error, "the device is closed");
  }
}

// The time between busy() and idle(), whatever the callback does.
class Busy {
 public:
  explicit Busy(Device& device) : device_(device) { device_.busy(); }
  ~Busy() { device_.idle(); }  // NOLINT(bugprone-exception-escape): of a lock that is sound
  Busy(const Busy&) = delete;
  Busy& operator=(const Busy&) = delete;

 private:
  Device& device_;
};

struct RunSettings {
  std::optional<rt::Duration> period;  // none: every cycle
  rt::Duration cycle;
  double hold_s;
  std::optional<rt::TimePoint> end;
};

// One call of the callback. @returns whether to go on.
bool call_once(Device& self, const py::object& state, const py::function& callback,
               const RunSettings& settings) {
  py::object force;
  try {
    const Busy busy(self);
    force = callback(state);
  } catch (py::error_already_set& error) {
    if (error.matches(PyExc_StopIteration)) {
      return false;
    }
    throw;
  }
  if (force.is_none()) {
    return true;
  }
  const std::array<double, 3> force_D_N = link_vector(force, "the callback's force");
  if (!self.renders_samples()) {
    command_force(self, py::make_tuple(force_D_N[0], force_D_N[1], force_D_N[2]), settings.hold_s);
  } else {
    const ToolState& data = state.cast<State&>().data;
    push_sample(self, data.time_ns,
                py::make_tuple(data.position_D_m[0], data.position_D_m[1], data.position_D_m[2]),
                py::make_tuple(force_D_N[0], force_D_N[1], force_D_N[2]));
  }
  return true;
}

// Until the last cycle before `due` has begun. Without the GIL.
void sleep_until_due(rt::TimePoint due, const RunSettings& settings) {
  const rt::TimePoint end = due - settings.cycle;
  while (rt::Clock::now() < end) {
    {
      const py::gil_scoped_release release;
      rt::sleep_until(std::min(end, rt::Clock::now() + kSlice));
    }
    raise_for_signals();
  }
}

std::uint64_t loop(Device& self, const py::function& callback, const RunSettings& settings) {
  const py::object state = read(self, py::none());
  ToolState& data = state.cast<State&>().data;
  std::uint64_t calls = 0;
  rt::TimePoint due = rt::Clock::now();
  for (;;) {
    if (settings.period) {
      sleep_until_due(due, settings);
      data.cycle = self.session().newest_state().cycle;
    }
    const bool new_cycle = self.wait(data.cycle, rt::Clock::now() + 2 * kSlice);
    raise_unless_running(self);
    if (settings.end && rt::Clock::now() >= *settings.end) {
      return calls;
    }
    if (!new_cycle) {
      continue;
    }
    data = self.session().newest_state();
    ++calls;
    if (!call_once(self, state, callback, settings)) {
      return calls;
    }
    if (settings.period) {  // a call that came late is not caught up with
      due = std::max(due + *settings.period, rt::Clock::now());
    }
  }
}

std::uint64_t run(Device& self, const py::function& callback, std::optional<double> rate_Hz,
                  std::optional<double> seconds, std::optional<double> hold_s) {
  const double rate = rate_Hz.value_or(self.options().rate_Hz);
  if (!(rate > 0.0 && rate <= self.options().rate_Hz)) {
    throw py::value_error("rate_Hz: expected above 0 and at most the device's " +
                          std::to_string(std::lround(self.options().rate_Hz)) + " Hz");
  }
  const auto duration = [](double value_s) {
    return std::chrono::duration_cast<rt::Duration>(std::chrono::duration<double>(value_s));
  };
  RunSettings settings{std::nullopt, duration(1.0 / self.options().rate_Hz),
                       hold_s.value_or(std::max(kLeastHold_s, kHoldPeriods / rate)), std::nullopt};
  if (rate < self.options().rate_Hz) {
    settings.period = duration(1.0 / rate);
  }
  if (seconds) {
    settings.end = rt::Clock::now() + duration_of(*seconds, "seconds");
  }
  const auto zero = [&] {
    if (!self.renders_samples()) {
      self.command({0.0, 0.0, 0.0}, 0.0);
    }
  };
  try {
    const std::uint64_t calls = loop(self, callback, settings);
    zero();
    return calls;
  } catch (...) {
    zero();
    self.session().enable_force(false);
    throw;
  }
}

bool close(Device& self) {
  const py::gil_scoped_release release;
  return self.session().close();
}

// A vector or matrix of `self`'s own memory.
template <typename Numbers>
py::array view(const py::object& self, const Numbers& numbers,
               const std::vector<py::ssize_t>& shape) {
  using Number = typename Numbers::value_type;
  py::array array(py::dtype::of<Number>(), shape, numbers.data(), self);
  py::detail::array_proxy(array.ptr())->flags &= ~py::detail::npy_api::NPY_ARRAY_WRITEABLE_;
  return array;
}

template <auto kMember>
auto vector_view(std::vector<py::ssize_t> shape = {3}) {
  return [shape](const py::object& self) {
    return view(self, self.cast<State&>().data.*kMember, shape);
  };
}

template <auto kMember>
auto number() {
  return [](const State& self) { return self.data.*kMember; };
}

void bind_state(py::module_& module) {
  py::class_<State>(
      module, "State",
      R"(Where the tool is and what the motors do, after one cycle of the motor thread.

Frame D: x toward the user, y to the user's right, z up. The arrays are views of this object, which
read(out=state) and run() overwrite: copy() what has to stay.)")
      .def_property_readonly("cycle", number<&ToolState::cycle>(),
                             "Number of the cycle, from 1 on.")
      .def_property_readonly("time_ns", number<&ToolState::time_ns>(),
                             "time.monotonic_ns() at the start of the cycle.")
      .def_property_readonly("position_D_m", vector_view<&ToolState::position_D_m>(),
                             "[m] shape (3,)")
      .def_property_readonly("velocity_D_m_per_s", vector_view<&ToolState::velocity_D_m_per_s>(),
                             "[m/s] shape (3,)")
      .def_property_readonly("has_orientation", number<&ToolState::has_orientation>(),
                             "Whether the device has a wrist; else the identity and zeros follow.")
      .def_property_readonly("orientation_DT_wxyz",
                             vector_view<&ToolState::orientation_DT_wxyz>({4}),
                             "Unit quaternion w, x, y, z from the tool's frame to D, shape (4,); w "
                             "is not negative")
      .def_property_readonly("angular_velocity_D_rad_per_s",
                             vector_view<&ToolState::angular_velocity_D_rad_per_s>(),
                             "[rad/s] of the tool's frame, shape (3,)")
      .def_property_readonly("gimbal_angle_rad", vector_view<&ToolState::gimbal_angle_rad>(),
                             "[rad] of the wrist's joints from the arm outward, shape (3,)")
      .def_property_readonly("joint_angle_rad", vector_view<&ToolState::joint_angle_rad>(),
                             "[rad] shape (3,)")
      .def_property_readonly("jacobian_D_m_per_rad",
                             vector_view<&ToolState::jacobian_D_m_per_rad>({3, 3}),
                             "d(position)/dq, shape (3, 3)")
      .def_property_readonly("commanded_force_D_N", vector_view<&ToolState::commanded_force_D_N>(),
                             "[N] after every limit, shape (3,)")
      .def_property_readonly(
          "commanded_torque_D_Nm", vector_view<&ToolState::commanded_torque_D_Nm>(),
          "[N m] about the tip, after every limit, shape (3,); zero without motors "
          "in a wrist")
      .def_property_readonly("current_A", vector_view<&ToolState::current_A>(), "[A] shape (3,)")
      .def_property_readonly("counts", vector_view<&ToolState::counts>({6}),
                             "Encoder counts, int32 of shape (6,)")
      .def_property_readonly("motor_warmth", number<&ToolState::motor_warmth>(),
                             "Of the warmest motor; 1: its limit.")
      .def_property_readonly("force_gain", number<&ToolState::force_gain>(),
                             "Of ramp and fade, 0 to 1.")
      .def_property_readonly("buttons", number<&ToolState::buttons>(), "Bit i: button i + 1.")
      .def_property_readonly("limits_acted", number<&ToolState::limits_acted>(),
                             "What shortened the force: 1 not finite, 2 force, 4 slew, 8 torque, "
                             "16 current, 32 warm motor.")
      .def_property_readonly("missed_deadlines", number<&ToolState::missed_deadlines>(),
                             "Of the motor thread, in all.")
      .def_property_readonly(
          "fault",
          [](const State& self) {
            return self.data.fault == 0
                       ? std::string()
                       : std::string(servo::name_of(static_cast<servo::Fault>(self.data.fault)));
          },
          "Name of the fault that ended the motor thread; empty: none.")
      .def(
          "copy", [](const State& self) { return self; }, "A State that stays as it is.")
      .def("__repr__", [](const State& self) {
        return py::str("<forcegrid.State of cycle {}>").format(self.data.cycle);
      });
}

void bind_errors(py::module_& module) {
  device_error = py::exception<SessionError>(module, "DeviceError", PyExc_OSError).release();
  no_device_error = py::exception<SessionError>(module, "NoDeviceError", device_error).release();
  device_in_use_error =
      py::exception<SessionError>(module, "DeviceInUseError", device_error).release();
  device_error.attr("__doc__") = "A device that can't be used. The text says what to do.";
  no_device_error.attr("__doc__") = "No such device, it does not answer, or it is lost.";
  device_in_use_error.attr("__doc__") = "Another program, or another Device, has it.";
  // NOLINTNEXTLINE(performance-unnecessary-value-param): pybind11 hands it over so
  py::register_exception_translator([](std::exception_ptr thrown) {
    try {
      if (thrown) {
        std::rethrow_exception(thrown);
      }
    } catch (const SessionError& error) {
      try {
        translate(error);
      } catch (py::error_already_set& set) {
        set.restore();
      }
    }
  });
}

void add_forces(py::class_<Device>& type) {
  type.def(
          "enable_force", [](Device& self, bool on) { self.session().enable_force(on); },
          py::arg("on") = true,
          "On: the force begins at zero and ramps in. Off: zero force in the next cycle.")
      .def_property_readonly("force_enabled",
                             [](Device& self) { return self.session().force_enabled(); })
      .def("command_force", &command_force, py::arg("force_D_N"), py::arg("hold_s") = 0.1,
           py::arg("torque_D_Nm") = py::none(),
           R"(The force of the device on the hand from now on, for hold_s [s], then falling to zero.

force_D_N: [N] three numbers, frame D; longer than the profile's max_force_N: shortened.
torque_D_Nm: [N m] about the tip, exerted by a device with motors in its wrist. Raises ValueError for
what is not finite.)")
      .def("push_sample", &push_sample, py::arg("time_ns"), py::arg("position_D_m"),
           py::arg("force_D_N"),
           R"(One force of the object on a tool at a place, for the device's method.

time_ns: time.monotonic_ns() when the tool was there, State.time_ns. position_D_m [m], force_D_N
[N]: three numbers, frame D; zero force: not in contact. Returns False if samples come
faster than they are taken.)")
      .def("run", &run, py::arg("callback"), py::kw_only(), py::arg("rate_Hz") = py::none(),
           py::arg("seconds") = py::none(), py::arg("hold_s") = py::none(),
           R"(Calls callback(state) again and again and renders the forces that it returns.

The callback returns a force [N], three numbers in frame D, or None: nothing new. It is called in
this thread, after a cycle of the motor thread, which goes on by itself: a slow callback makes
forces old (they fall to zero after hold_s), never the motors. With a method the force is a sample
at the state's position and time. While a call lasts longer than longest_callback_s there is zero
force.
rate_Hz: calls per second; None: one for each cycle. seconds: for how long; None: until the callback
raises StopIteration. hold_s: 5 periods, at least 20 ms.
Returns the number of calls. Any exception ends it with force switched off. Raises DeviceError after
a fault and NoDeviceError when the device is lost.)");
}

void add_facts(py::class_<Device>& type) {
  type.def_property_readonly(
          "profile",
          [](Device& self) -> const profiles::DeviceProfile& { return self.session().profile(); },
          py::return_value_policy::reference_internal)
      .def_property_readonly("url", [](Device& self) { return self.session().url(); })
      .def_property_readonly("serial", [](Device& self) { return self.session().serial(); })
      .def_property_readonly("manufacturer",
                             [](Device& self) { return self.session().manufacturer(); })
      .def_property_readonly("product", [](Device& self) { return self.session().product(); })
      .def_property_readonly("rate_Hz", [](Device& self) { return self.options().rate_Hz; })
      .def_property_readonly(
          "method", [](Device& self) { return self.options().method; },
          "The force method that renders samples; empty: forces as commanded.")
      .def_property_readonly(
          "health",
          [](Device& self) { return health_type(static_cast<int>(self.session().health())); })
      .def_property_readonly(
          "failure", [](Device& self) { return self.session().failure(); },
          "One sentence about why health is not RUNNING; empty while it is.")
      .def("take_notices", &Device::take_notices,
           "What a person should know and was not given here yet: list of texts.")
      .def(
          "calibrate_now",
          [](Device& self) {
            std::string why_not;
            {
              const py::gil_scoped_release release;
              why_not = self.session().calibrate_now();
            }
            if (!why_not.empty()) {
              raise(device_error, why_not);
            }
          },
          "Sets the counters of an arm in its calibration pose. Raises DeviceError.");
}

}  // namespace

void bind_device(py::module_& module) {
  bind_errors(module);
  bind_state(module);
  health_type =
      int_enum(module, "Health", "How a device is.",
               {{"RUNNING", 0}, {"UNCALIBRATED", 1}, {"LOST", 2}, {"FAULTED", 3}, {"CLOSED", 4}})
          .release();
  py::class_<Device> type(
      module, "Device",
      R"(A haptic device in use: a motor thread runs it, with all limits and guards.

    with forcegrid.Device("emulated:woodenhaptics_v2015") as device:
        device.enable_force()
        device.run(lambda state: -200.0 * state.position_D_m, seconds=5)

No Python runs in the motor thread. No force is rendered before enable_force(). Leaving `with` gives
zero current. Frame D: x toward the user, y to the user's right, z up; SI units. Threads: any.)");
  type.def(py::init(&open), py::arg("device") = SessionOptions().device, py::kw_only(),
           py::arg("profile") = "", py::arg("rate_Hz") = 1000.0, py::arg("method") = "",
           py::arg("calibrated") = false, py::arg("falcon_firmware") = "",
           py::arg("check_motors") = true, py::arg("gravity_compensation") = false,
           py::arg("ramp_in_s") = 0.2, py::arg("realtime") = true, py::arg("open_timeout_s") = 2.0,
           py::arg("longest_callback_s") = py::none(), py::arg("emulator_hand") = "firm",
           py::arg("emulator_motion") = "still", py::arg("emulator_wrist") = "still",
           py::arg("emulator_click_every_s") = 0.0, py::arg("emulator_summary") = "",
           R"(Opens a device; its first state is there when this returns.

device: a URL as `forcegrid run --device` takes it, or "emulated:PROFILE", which starts an emulator.
profile: name or TOML file; empty: the device's own. rate_Hz: of the motor thread, 100 to 4000.
method: empty: forces as commanded; "auto": samples, rendered at rate_Hz. calibrated: the counters
are absolute already. longest_callback_s: None: 0.05 s, with a method 0.2 s.
emulator_hand: "firm", "light", "none"; emulator_motion: "still", "chirp", "lissajous", ...;
emulator_wrist, of a device with a wrist: "still", "turn", "twist"; emulator_click_every_s: how often
that hand presses the button on a stylus, 0: never;
emulator_summary: file for what the emulated motors did (JSON).
Raises NoDeviceError, DeviceInUseError or DeviceError saying what to do.)");
  type.def("read", &read, py::arg("out") = py::none(),
           "The newest State; out: one to overwrite, so that nothing is allocated.")
      .def(
          "wait", &wait, py::arg("cycle"), py::arg("timeout_s") = 1.0,
          "Waits without the GIL until a cycle after number `cycle` has ended. Returns whether one "
          "has within timeout_s [s].")
      .def("close", &close,
           "Zero force, then the end of motor thread, device and emulator. Returns whether zero "
           "current is known to have been delivered.")
      .def("__enter__", [](py::object self) { return self; })
      .def("__exit__", [](Device& self, const py::args&) { close(self); })
      .def("__repr__",
           [](Device& self) { return "<forcegrid.Device " + self.session().url() + ">"; });
  add_forces(type);
  add_facts(type);
  py::module_::import("atexit").attr("register")(py::cpp_function(&Device::close_all));
}

}  // namespace forcegrid::python
