// SPDX-License-Identifier: Apache-2.0
#include "cli/run/run_devices.h"

#include <algorithm>
#include <atomic>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <exception>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <stdexcept>
#include <thread>
#include <utility>

#include "cli/common/json_target.h"
#include "cli/common/option_values.h"
#include "cli/common/stop_request.h"
#include "cli/run/run.h"
#include "cli/run/run_checks.h"
#include "cli/run/run_methods.h"
#include "cli/run/run_setup.h"
#include "log/log.h"
#include "rt/thread.h"
#include "rt/vectors.h"
#include "servo_loop/tool_exchange.h"
#include "servo_loop/tool_touch.h"

namespace forcegrid::cli {
namespace {

using std::chrono::milliseconds;

constexpr double kApart_mm = 30.0;
// Tools nearer to each other would want to hold the same part of the object.
constexpr double kLeastApart_mm = 10.0;
constexpr double kFarthest_mm = 1000.0;

// Nothing if the text is no offset.
std::optional<std::array<double, 3>> parse_offset(const std::string& text) {
  std::array<double, 3> offset_mm{};
  int used = 0;
  if (std::sscanf(text.c_str(), "%lf,%lf,%lf%n", &offset_mm[0], &offset_mm[1], &offset_mm[2],
                  &used) != 3 ||
      static_cast<std::size_t>(used) != text.size() ||
      !std::ranges::all_of(offset_mm, [](double value) {
        return std::isfinite(value) && std::abs(value) <= kFarthest_mm;
      })) {
    return std::nullopt;
  }
  return offset_mm;
}

// The device that a fault is of, 0 for every one, and the fault.
std::pair<int, std::string> parse_device_fault(const std::string& text) {
  const bool numbered = text.size() > 2 && text[0] >= '1' && text[0] <= '9' && text[1] == ':';
  return numbered ? std::pair(text[0] - '0', text.substr(2)) : std::pair(0, text);
}

// "hold,chirp" are two; a recorded path is one, whatever its file is called.
std::vector<std::string> parse_motions(const std::string& text) {
  std::vector<std::string> motions;
  for (std::size_t begin = 0; begin <= text.size();) {
    const std::size_t end =
        text.starts_with("path:") ? text.size() : std::min(text.find(',', begin), text.size());
    motions.push_back(text.substr(begin, end - begin));
    begin = end + 1;
  }
  return motions;
}

std::string motion_of(const RunOptions& options, std::size_t device, std::size_t count) {
  const std::vector<std::string> motions = parse_motions(options.motion);
  if (motions.size() > 1 && motions.size() != count) {
    throw std::runtime_error("--motion " + options.motion + " has " +
                             std::to_string(motions.size()) + " motions for " +
                             std::to_string(count) + (count == 1 ? " device" : " devices") +
                             "; give one for all, or one for each");
  }
  return motions.size() > 1 ? motions[device] : options.motion;
}

// "run.h5" becomes "run_device_2.h5"; a name without a known ending is refused later.
std::string with_device_number(const std::string& file, std::size_t number) {
  for (const char* const ending : {".csv.gz", ".csv", ".hdf5", ".h5"}) {
    if (file.ends_with(ending)) {
      const std::string stem = file.substr(0, file.size() - std::string(ending).size());
      return stem + "_device_" + std::to_string(number) + ending;
    }
  }
  return file;
}

std::string several(const RunOptions& options) {
  return std::to_string(options.devices.size()) + " devices (--device)";
}

void refuse(bool given, const RunOptions& options, const char* what) {
  if (given) {
    throw std::runtime_error(several(options) + ": " + what);
  }
}

void check_excluded(const RunOptions& options) {
  if (options.devices.size() > kMostDevices) {
    throw std::runtime_error(several(options) + ": a simulator serves at most " +
                             std::to_string(kMostDevices) + " tools");
  }
  refuse(options.tour, options, "the tour is for one; leave --tour out");
  refuse(options.live, options, "the dashboard shows one; leave --live out");
  refuse(options.workers > 0, options, "workers know one tool; leave --workers out");
  refuse(options.reconnect, options,
         "the others would render on without it meanwhile; leave --reconnect out");
  refuse(!options.core.empty(), options, "a second processor belongs to one arm; leave --core out");
  refuse(options.material_tolerance_percent.has_value(), options,
         "models are compared under one tool; leave --material-tolerance-percent out");
  refuse(options.solver != "auto" && options.solver != "quasi_static", options,
         "several tools are solved by quasi_static; leave --solver out");
  const auto is_direct = [](const std::string& method) { return method == kDirect; };
  refuse(is_direct(options.method) || std::ranges::any_of(options.evaluated, is_direct), options,
         "method direct solves the object under one tool; choose another method");
  refuse(tool_of(options).slides(), options,
         "a tool that slides is solved alone with its object; use --contact sticky");
  refuse(options.device_offsets_mm.size() > options.devices.size(), options,
         "--device-offset-mm is given more often than --device");
}

void check_distinct(const RunOptions& options) {
  for (auto device = options.devices.begin(); device != options.devices.end(); ++device) {
    const bool emulated = device->starts_with(kEmulatedPrefix);  // each time another process
    if (!emulated && std::find(options.devices.begin(), device, *device) != device) {
      throw std::runtime_error(
          "--device " + *device +
          " is given twice, and a device has one tool; 'forcegrid devices' "
          "lists the USB ports, which tell two of a kind apart: hid:path=PORT");
    }
  }
}

void check_apart(const std::vector<RunOptions>& each) {
  for (std::size_t b = 1; b < each.size(); ++b) {
    for (std::size_t a = 0; a < b; ++a) {
      const double apart_mm =
          (rt::to_vector(each[a].offset_W_mm) - rt::to_vector(each[b].offset_W_mm)).norm();
      if (apart_mm < kLeastApart_mm) {
        throw std::runtime_error(
            "--device-offset-mm: devices " + std::to_string(a + 1) + " and " +
            std::to_string(b + 1) + " stand " + std::to_string(std::lround(apart_mm)) +
            " mm apart in the scene, so that their tools would hold the same part of it; place "
            "them at least " +
            std::to_string(std::lround(kLeastApart_mm)) + " mm apart");
      }
    }
  }
}

// [N/m] As asked for, or what every device allows.
double tool_stiffness_N_per_m(const RunOptions& options,
                              const std::vector<std::unique_ptr<Run>>& runs) {
  double largest_N_per_m = kLargestToolStiffness_N_per_m;
  for (const auto& run : runs) {
    largest_N_per_m = std::min(
        largest_N_per_m, servo::largest_tool_stiffness_N_per_m(run->profile(), options.rate_Hz));
  }
  const double asked_N_per_m =
      options.tool_stiffness_N_per_m.value_or(std::min(kToolStiffness_N_per_m, largest_N_per_m));
  if (asked_N_per_m > largest_N_per_m) {
    throw std::runtime_error("--tool-stiffness-N-per-m " +
                             std::to_string(std::lround(asked_N_per_m)) +
                             ": between two light hands of these devices at --rate " +
                             std::to_string(std::lround(options.rate_Hz)) + " more than " +
                             std::to_string(std::lround(std::floor(largest_N_per_m))) +
                             " N/m would shake; give at most that, or a higher --rate");
  }
  return asked_N_per_m;
}

// Where two devices' workspaces overlap their tools may meet.
void say_overlaps(const std::vector<std::unique_ptr<Run>>& runs,
                  const std::vector<RunOptions>& each, bool touch) {
  const auto corner = [&](std::size_t k, bool upper) {
    const auto& limits = runs[k]->profile().limits;
    return Eigen::Vector3d(
        1e3 * rt::to_vector(upper ? limits.workspace_max_m : limits.workspace_min_m) +
        rt::to_vector(each[k].offset_W_mm));
  };
  for (std::size_t b = 1; b < runs.size(); ++b) {
    for (std::size_t a = 0; a < b; ++a) {
      const Eigen::Vector3d common_mm =
          corner(a, true).cwiseMin(corner(b, true)) - corner(a, false).cwiseMax(corner(b, false));
      if ((common_mm.array() > 0.0).all()) {
        char text[200];
        std::snprintf(text, sizeof text,
                      "The workspaces of devices %zu and %zu have %.0f x %.0f x %.0f mm of the "
                      "scene in common, where their tools %s each other.",
                      a + 1, b + 1, common_mm.x(), common_mm.y(), common_mm.z(),
                      touch ? "touch" : "pass through");
        log::info("run", text);
      }
    }
  }
}

int status_of_all(const std::vector<std::unique_ptr<Run>>& runs) {
  const auto first =
      std::ranges::min_element(runs, {}, [](const auto& run) { return run->summary().end; });
  const int status = (*first)->summary().exit_status;
  const auto failed =
      std::ranges::find_if(runs, [](const auto& run) { return run->summary().exit_status != 0; });
  return status != 0 || failed == runs.end() ? status : (*failed)->summary().exit_status;
}

void write_all(const RunOptions& options, const std::vector<std::unique_ptr<Run>>& runs,
               int status) {
  nlohmann::json devices = nlohmann::json::array();
  for (const auto& run : runs) {
    devices.push_back(run->json());
  }
  write_json(options.json, nlohmann::json{{"devices", devices},
                                          {"fault_stops", options.fault_stops},
                                          {"exit_status", status}}
                               .dump(2));
}

// A loop and its watch on a thread of each run; the keys stay with this one.
void render_all(std::vector<std::unique_ptr<Run>>& runs, SharedRun& shared, TerminalKeys& keys) {
  shared.keys = nullptr;
  std::atomic<std::size_t> over{0};
  std::vector<std::exception_ptr> problems(runs.size());
  std::vector<std::jthread> threads;
  for (std::size_t k = 0; k < runs.size(); ++k) {
    threads.emplace_back([&, k] {
      rt::name_current_thread("run");
      try {
        runs[k]->render();
      } catch (...) {
        problems[k] = std::current_exception();
        StopRequest::request();
      }
      ++over;
    });
  }
  while (over < runs.size()) {
    if (keys.emergency_pressed(milliseconds(20))) {
      StopRequest::request_emergency(servo::EmergencySource::kKey);
    }
  }
  threads.clear();
  shared.keys = &keys;
  StopRequest::forget();  // of a fault; nothing else has to be hurried for it
  for (const std::exception_ptr& problem : problems) {
    if (problem) {
      std::rethrow_exception(problem);
    }
  }
}

}  // namespace

std::vector<std::array<double, 3>> default_offsets_mm(std::size_t count) {
  std::vector<std::array<double, 3>> offsets_mm;
  for (std::size_t k = 0; k < count; ++k) {
    const double from_middle = static_cast<double>(k) - 0.5 * static_cast<double>(count - 1);
    offsets_mm.push_back({0.0, kApart_mm * from_middle, 0.0});
  }
  return offsets_mm;
}

Check offset_check() {
  return Check{[](const std::string& input) {
                 return parse_offset(input) ? std::string()
                                            : "'" + input +
                                                  "' is no offset; write X,Y,Z in mm, each within "
                                                  "-1000 to 1000, for example 0,-15,0";
               },
               "X,Y,Z"};
}

Check device_fault_check() {
  const Check plain = fault_check();
  return Check{
      [plain](const std::string& input) { return plain.problem(parse_device_fault(input).second); },
      "[N:]" + plain.form};
}

Check motions_check() {
  const Check one = motion_check();
  return Check{[one](const std::string& input) {
                 for (const std::string& motion : parse_motions(input)) {
                   if (std::string problem = one.problem(motion); !problem.empty()) {
                     return problem;
                   }
                 }
                 return std::string();
               },
               one.form + "[,...]"};
}

std::vector<RunOptions> options_of_each(const RunOptions& options) {
  const std::size_t count = options.devices.size();
  std::vector<RunOptions> each(count, options);
  const auto defaults_mm = default_offsets_mm(count);
  for (std::size_t k = 0; k < count; ++k) {
    RunOptions& own = each[k];
    own.device = count > 1 ? options.devices[k] : options.device;
    own.offset_W_mm = k < options.device_offsets_mm.size()
                          ? *parse_offset(options.device_offsets_mm[k])
                          : defaults_mm[k];
    own.seed = options.seed + k;
    own.motion = motion_of(options, k, count);
    own.faults.clear();
    for (const std::string& text : options.faults) {
      const auto [number, fault] = parse_device_fault(text);
      if (number > static_cast<int>(count)) {
        throw std::runtime_error("--fault " + text + ": there is no device " +
                                 std::to_string(number) + "; give 1 to " + std::to_string(count));
      }
      if (number == 0 || number == static_cast<int>(k) + 1) {
        own.faults.push_back(fault);
      }
    }
    if (count > 1) {
      own.device_number = static_cast<int>(k) + 1;
      own.tool_number = std::max(options.tool_number, 1) + static_cast<int>(k);
      own.started_tools = static_cast<int>(count);
      own.out = options.out + "/device_" + std::to_string(k + 1);
      own.open_view = options.open_view && k == 0;
      own.record_surface = options.record_surface && k == 0;  // it has started the simulator
      own.record = with_device_number(options.record, k + 1);
    }
  }
  if (count > 1) {
    check_excluded(options);
    check_distinct(options);
    check_apart(each);
  }
  return each;
}

RunOptions the_only_device(const RunOptions& options) {
  if (options.tool_number > 0 && options.simulator.empty()) {
    throw std::runtime_error(
        "--tool-number: the simulator that run starts for one device serves no other tool; give "
        "--simulator ADDR:PORT of one that was started with --tools");
  }
  if (options.device_offsets_mm.size() > 1) {
    throw std::runtime_error("--device-offset-mm is given " +
                             std::to_string(options.device_offsets_mm.size()) +
                             " times, for one --device");
  }
  RunOptions only = options_of_each(options).front();
  if (options.device_offsets_mm.empty()) {
    only.offset_W_mm = {};
  }
  return only;
}

int run_devices(const RunOptions& options) {
  const std::vector<RunOptions> each = options_of_each(options);
  std::unique_ptr<ViewProcess> view;  // of all: it outlives every run
  SharedRun shared;
  shared.fault_stops_all = options.fault_stops == "all";
  TerminalKeys keys;
  shared.keys = &keys;
  servo::ToolExchange exchange(each.size());  // outlives the loops
  std::vector<std::unique_ptr<Run>> runs;
  for (const RunOptions& own : each) {
    runs.push_back(std::make_unique<Run>(own, view, &shared));
  }
  const double stiffness_N_per_m = tool_stiffness_N_per_m(options, runs);
  for (const auto& run : runs) {
    run->touch_others(exchange, stiffness_N_per_m);
  }
  say_overlaps(runs, each, stiffness_N_per_m > 0.0);
  std::size_t prepared = 0;
  while (prepared < runs.size() && runs[prepared]->prepare()) {
    shared.simulator = runs[prepared++]->simulator_address();
  }
  if (prepared < runs.size()) {
    // No loop has begun, so no motor has had any current.
    for (std::size_t k = 0; k <= prepared; ++k) {
      runs[k]->finish_uncalibrated();
    }
    const int status = status_of_all(runs);
    write_all(options, runs, status);
    return status;
  }
  for (const auto& run : runs) {
    run->begin();
  }
  render_all(runs, shared, keys);
  std::vector<ToolRun> tools;
  for (const auto& run : runs) {
    run->end_view();
    tools.push_back(run->tool_run());
  }
  shared.reference.emplace(paths_of(tools, 1.0 / options.simulator_rate_Hz));
  for (const auto& run : runs) {
    run->finish();
  }
  rt::unlock_memory();
  const int status = status_of_all(runs);
  write_all(options, runs, status);
  return status;
}

}  // namespace forcegrid::cli
