// SPDX-License-Identifier: Apache-2.0
// The 36 functions of libHD. None lets an exception out; what a program may expect of each is in
// docs/openhaptics.md.
#pragma GCC visibility push(default)
#include <HD/hd.h>
#pragma GCC visibility pop

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <exception>
#include <limits>
#include <type_traits>

#include "compat/openhaptics/error_stack.h"
#include "compat/openhaptics/library.h"

namespace {

using namespace forcegrid::openhaptics;

// What `call` returns; `otherwise`, and an error, if it throws: there was no memory.
template <typename Call, typename Result>
Result guarded(Result otherwise, const Call& call) noexcept {
  try {
    return call(Library::instance());
  } catch (const std::exception& error) {
    std::fprintf(stderr, "forcegrid: %s\n", error.what());
  } catch (...) {
    std::fputs("forcegrid: an exception that says nothing\n", stderr);
  }
  push_error(HD_INVALID_OPERATION, 0);
  return otherwise;
}

template <typename Call>
void guarded(const Call& call) noexcept {
  guarded(0, [&](Library& library) {
    call(library);
    return 0;
  });
}

template <typename T>
bool reads(Family family) noexcept {
  if constexpr (std::is_same_v<T, HDboolean>) {
    return family == Family::kBoolean;
  } else if constexpr (std::is_same_v<T, HDlong>) {
    return family == Family::kLong;
  } else {
    return family == Family::kReal || family == Family::kInteger;
  }
}

template <typename T>
T converted(double value) noexcept {
  if constexpr (std::is_integral_v<T>) {
    constexpr auto kLow = static_cast<double>(std::numeric_limits<HDint>::min());
    constexpr auto kHigh = static_cast<double>(std::numeric_limits<HDint>::max());
    return static_cast<T>(std::isfinite(value) ? std::clamp(std::trunc(value), kLow, kHigh) : 0.0);
  } else {
    return static_cast<T>(value);
  }
}

template <typename T>
void get(HDenum name, T* values) noexcept {
  Library& library = Library::instance();
  const Parameter* const parameter = find_parameter(name);
  if (values == nullptr) {
    push_error(HD_INVALID_VALUE, library.current());
    return;
  }
  if (parameter == nullptr) {
    push_error(is_text(name) ? HD_INVALID_INPUT_TYPE : HD_INVALID_ENUM, library.current());
    *values = T{};
    return;
  }
  if (!reads<T>(parameter->family)) {
    push_error(HD_INVALID_INPUT_TYPE, library.current());
    std::fill_n(values, parameter->count, T{});
    return;
  }
  std::array<double, kMostValues> numbers{};
  library.read(*parameter, numbers.data());
  std::transform(numbers.begin(), numbers.begin() + parameter->count, values, converted<T>);
}

template <typename T>
void set(HDenum name, const T* values) noexcept {
  Library& library = Library::instance();
  const Parameter* const parameter = find_parameter(name);
  if (parameter == nullptr || parameter->setting == Setting::kNone) {
    push_error(HD_INVALID_ENUM, library.current());
    return;
  }
  if (!reads<T>(parameter->family)) {
    push_error(HD_INVALID_INPUT_TYPE, library.current());
    return;
  }
  std::array<double, kMostValues> numbers{};
  const auto is_finite = [](T value) { return std::isfinite(static_cast<double>(value)); };
  if (values == nullptr || !std::all_of(values, values + parameter->count, is_finite)) {
    push_error(HD_INVALID_VALUE, library.current());
    return;
  }
  std::copy_n(values, parameter->count, numbers.begin());
  library.set(*parameter, numbers.data());
}

}  // namespace

#pragma GCC visibility push(default)
// NOLINTBEGIN(readability-identifier-naming): the names are those of the interface.
extern "C" {

HHD hdInitDevice(HDstring name) {
  return guarded(HHD{HD_INVALID_HANDLE}, [name](Library& library) { return library.open(name); });
}

void hdDisableDevice(HHD device) {
  guarded([device](Library& library) { library.close(device); });
}

HHD hdGetCurrentDevice(void) { return Library::instance().current(); }

void hdMakeCurrentDevice(HHD device) { Library::instance().make_current(device); }

void hdBeginFrame(HHD device) { Library::instance().begin_frame(device); }

void hdEndFrame(HHD device) { Library::instance().end_frame(device); }

HDErrorInfo hdGetError(void) { return errors_of_this_thread().pop(); }

HDstring hdGetErrorString(HDerror code) { return error_text(code); }

void hdEnable(HDenum capability) { Library::instance().enable(capability, true); }

void hdDisable(HDenum capability) { Library::instance().enable(capability, false); }

HDboolean hdIsEnabled(HDenum capability) {
  return Library::instance().is_enabled(capability) ? HD_TRUE : HD_FALSE;
}

void hdGetBooleanv(HDenum parameter, HDboolean* values) { get(parameter, values); }

void hdGetIntegerv(HDenum parameter, HDint* values) { get(parameter, values); }

void hdGetFloatv(HDenum parameter, HDfloat* values) { get(parameter, values); }

void hdGetDoublev(HDenum parameter, HDdouble* values) { get(parameter, values); }

void hdGetLongv(HDenum parameter, HDlong* values) { get(parameter, values); }

HDstring hdGetString(HDenum parameter) {
  Library& library = Library::instance();
  if (!is_text(parameter)) {
    push_error(find_parameter(parameter) != nullptr ? HD_INVALID_INPUT_TYPE : HD_INVALID_ENUM,
               library.current());
    return "";
  }
  return library.text(parameter);
}

void hdSetBooleanv(HDenum parameter, const HDboolean* values) { set(parameter, values); }

void hdSetIntegerv(HDenum parameter, const HDint* values) { set(parameter, values); }

void hdSetFloatv(HDenum parameter, const HDfloat* values) { set(parameter, values); }

void hdSetDoublev(HDenum parameter, const HDdouble* values) { set(parameter, values); }

void hdSetLongv(HDenum parameter, const HDlong* values) { set(parameter, values); }

HDenum hdCheckCalibration(void) { return Library::instance().calibration(); }

HDenum hdCheckCalibrationStyle(void) { return HD_CALIBRATION_AUTO; }

void hdUpdateCalibration(HDenum /*style*/) {
  guarded([](Library& library) { library.update_calibration(); });
}

void hdUpdateCalibrationMessage(HDenum style) { hdUpdateCalibration(style); }

void hdScaleGimbalAngles(HDdouble /*scale_x*/, HDdouble /*scale_y*/, HDdouble /*scale_z*/,
                         HDdouble transform[16]) {
  hdGetDoublev(HD_CURRENT_TRANSFORM, transform);
}

HDboolean hdDeploymentLicense(const char* /*vendor*/, const char* /*application*/,
                              const char* /*password*/) {
  return HD_TRUE;
}

void hdStartScheduler(void) {
  guarded([](Library& library) { library.start(); });
}

void hdStopScheduler(void) {
  guarded([](Library& library) { library.stop(); });
}

void hdSetSchedulerRate(HDulong rate_Hz) {
  Library& library = Library::instance();
  if (!library.scheduler().set_rate(static_cast<double>(rate_Hz))) {
    push_error(HD_INVALID_VALUE, library.current());
  }
}

HDdouble hdGetSchedulerTimeStamp(void) { return Library::instance().scheduler().seconds_in_tick(); }

// From here on callbacks may run: what ends their thread has to get through.
void hdScheduleSynchronous(HDSchedulerCallback callback, void* data, HDushort priority) {
  Library& library = Library::instance();
  if (callback == nullptr) {
    push_error(HD_INVALID_VALUE, library.current());
  } else if (!library.scheduler().synchronous(callback, data, priority)) {
    push_error(HD_SCHEDULER_FULL, library.current());
  }
}

HDSchedulerHandle hdScheduleAsynchronous(HDSchedulerCallback callback, void* data,
                                         HDushort priority) {
  Library& library = Library::instance();
  if (callback == nullptr) {
    push_error(HD_INVALID_VALUE, library.current());
    return HD_INVALID_HANDLE;
  }
  const HDSchedulerHandle handle = library.scheduler().asynchronous(callback, data, priority);
  if (handle == 0) {
    push_error(HD_SCHEDULER_FULL, library.current());
    return HD_INVALID_HANDLE;
  }
  return handle;
}

void hdUnschedule(HDSchedulerHandle callback) {
  Library& library = Library::instance();
  if (!library.scheduler().unschedule(callback)) {
    push_error(HD_TIMER_ERROR, library.current());
  }
}

HDboolean hdWaitForCompletion(HDSchedulerHandle callback, HDWaitCode wait) {
  Scheduler& scheduler = Library::instance().scheduler();
  if (wait == HD_WAIT_INFINITE) {
    scheduler.wait_for(callback);
  }
  return scheduler.is_scheduled(callback) ? HD_TRUE : HD_FALSE;
}

}  // extern "C"
// NOLINTEND(readability-identifier-naming)
#pragma GCC visibility pop
