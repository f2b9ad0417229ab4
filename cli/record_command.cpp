// SPDX-License-Identifier: Apache-2.0
#include "cli/record_command.h"

#include <algorithm>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <iomanip>
#include <nlohmann/json.hpp>
#include <ostream>
#include <stdexcept>

#include "cli/common/number_check.h"
#include "cli/common/options.h"
#include "cli/common/progress_line.h"
#include "cli/common/tools_names.h"
#include "device_emulator/operator_script.h"
#include "profiles/device_profile.h"
#include "simulator/mesh/scene.h"
#include "text/output_file.h"
#include "tools/path_comparison.h"
#include "tools/recording.h"
#include "tools/recording_plot.h"

namespace forcegrid::cli {
namespace {

using nlohmann::ordered_json;
using tools::Hdf5Reader;
using tools::RecordingHeader;
using tools::TimedPath;

// Time that the emulated operator needs from the first cycle to the first point of the path.
constexpr double kBeforePath_s = emulator::OperatorScript::kApproach_s +
                                 emulator::OperatorScript::kDescent_s +
                                 emulator::OperatorScript::kPause_s;
constexpr double kSpare_s = 1.0;
constexpr double kLongestRecording_s = 1e7;

TimedPath path_of(const Hdf5Reader& reader, const RecordingHeader& header) {
  return {reader.numbers("/cycles/time_s", header.cycles),
          tools::read_vectors(reader, "/cycles/position_W_m", header.cycles)};
}

struct ReplayedPart {
  TimedPath tool;    ///< positions of the tool, in W
  TimedPath target;  ///< positions that the hand aimed at, in the device's frame D
  /// [rad] Joint angles of the wrist at the same times; empty: the recorded device has none.
  std::vector<Eigen::Vector3d> gimbal_rad;
};

// Of a device with a wrist; a recording of an earlier version has no such column.
std::vector<Eigen::Vector3d> gimbal_angles(const Hdf5Reader& reader,
                                           const RecordingHeader& header) {
  if (!reader.has("/cycles/has_orientation") || header.cycles == 0 ||
      reader.numbers("/cycles/has_orientation", 1)[0] == 0.0) {
    return {};
  }
  return tools::read_vectors(reader, "/cycles/gimbal_angle_rad", header.cycles);
}

// The path from the first contact on (without any: from the start), at most `seconds` long (0:
// all). The force sent deflected the hand by its stiffness, so the hand's target lies beyond the
// tool.
ReplayedPart part_to_replay(const ReplayOptions& options, const Hdf5Reader& reader,
                            const RecordingHeader& header, double hand_stiffness_N_per_m) {
  const TimedPath whole = path_of(reader, header);
  const auto force_N = tools::read_vectors(reader, "/cycles/sent_force_D_N", header.cycles);
  const std::vector<Eigen::Vector3d> gimbal_rad = gimbal_angles(reader, header);
  const std::vector<double> in_contact = reader.numbers("/cycles/in_contact", header.cycles);
  const auto touched = std::find(in_contact.begin(), in_contact.end(), 1.0);
  ReplayedPart part;
  for (auto i =
           static_cast<std::size_t>(touched == in_contact.end() ? 0 : touched - in_contact.begin());
       i < whole.time_s.size(); ++i) {
    if (options.seconds > 0.0 && !part.tool.time_s.empty() &&
        whole.time_s[i] > part.tool.time_s.front() + options.seconds) {
      break;
    }
    part.tool.time_s.push_back(whole.time_s[i]);
    part.tool.position_m.push_back(whole.position_m[i]);
    part.target.time_s.push_back(whole.time_s[i]);
    part.target.position_m.push_back(whole.position_m[i] - header.offset_W_m -
                                     force_N[i] / hand_stiffness_N_per_m);
    if (!gimbal_rad.empty()) {
      part.gimbal_rad.push_back(gimbal_rad[i]);
    }
  }
  if (part.tool.time_s.size() < 2) {
    throw std::runtime_error(options.file +
                             ": fewer than two cycles to replay; record for longer, or give more "
                             "--seconds");
  }
  return part;
}

void write_path(const std::string& file, const TimedPath& path,
                const std::vector<Eigen::Vector3d>& gimbal_rad) {
  text::OutputFile output(file);
  std::ostream& stream = output.stream();
  stream << "time_s,x_m,y_m,z_m" << std::setprecision(12)
         << (gimbal_rad.empty() ? "\n" : ",gimbal_1_rad,gimbal_2_rad,gimbal_3_rad\n");
  for (std::size_t i = 0; i < path.time_s.size(); ++i) {
    const Eigen::Vector3d& p = path.position_m[i];
    stream << path.time_s[i] << ',' << p.x() << ',' << p.y() << ',' << p.z();
    if (!gimbal_rad.empty()) {
      const Eigen::Vector3d& g = gimbal_rad[i];
      stream << ',' << g.x() << ',' << g.y() << ',' << g.z();
    }
    stream << '\n';
  }
  output.finish();
}

std::string text_of(double value) {
  char text[32];
  std::snprintf(text, sizeof text, "%g", value);
  return text;
}

void make_folder(const std::string& folder) {
  std::error_code error;
  std::filesystem::create_directories(folder, error);
  if (error) {
    throw std::runtime_error("folder '" + folder + "' can't be made (" + error.message() +
                             "); choose another with --out");
  }
}

RunOptions run_options(const ReplayOptions& options, const RecordingHeader& header,
                       const std::string& profile, const TimedPath& path) {
  const emulator::OperatorScript::Options operator_defaults;
  RunOptions run;
  run.device = "emulated:" + profile;
  run.scene = !options.scene.empty()  ? options.scene
              : !header.scene.empty() ? header.scene
                                      : run.scene;
  run.method = !options.method.empty() ? options.method : header.method_names.at(0);
  run.evaluated.clear();
  run.rate_Hz = header.rate_Hz;
  run.seconds = path.time_s.back() - path.time_s.front() + kBeforePath_s + kSpare_s;
  run.motion = "path:" + options.out + "/replayed_path.csv";
  run.contact_m =
      std::array<double, 3>{path.position_m.front().x(), path.position_m.front().y(),
                            path.position_m.front().z() + operator_defaults.contact_depth_m};
  const Eigen::Vector3d offset_mm = 1e3 * header.offset_W_m;
  run.device_offsets_mm = {text_of(offset_mm.x()) + "," + text_of(offset_mm.y()) + "," +
                           text_of(offset_mm.z())};
  run.record = options.out + "/replay.h5";
  run.no_reference = true;
  run.out = options.out;
  run.json = {true, options.out + "/replay_run.json"};
  run.text_on_stderr = options.json.on_stdout();
  run.settings = "# replay of " + options.file + "\n";
  return run;
}

}  // namespace

void add_replay(Command& app, ReplayOptions& o, std::function<int()>& action) {
  Command& replay = app.add_subcommand("replay", tools_description("replay"));
  replay.add_option("FILE", o.file, "Recording of forcegrid record")->required();
  replay.add_option("--device", o.device,
                    "Profile of the emulated device (default: the recording's)");
  replay.add_option("--scene", o.scene, "Object to feel (default: the recording's, else block)");
  replay.add_option("--method", o.method, "Force method (default: the recording's)");
  replay.add_option("--seconds", o.seconds, "How much of it, from the first contact; 0 means all")
      ->check(between(0.0, 86400.0))
      ->type_name("FLOAT s")
      ->show_default();
  replay.add_option("--out", o.out, "Folder for the path, replay.h5 and pictures")->show_default();
  replay.callback([&o, &action] { action = [&o] { return replay_command(o); }; });
}

void add_plot(Command& app, PlotOptions& o, std::function<int()>& action) {
  Command& plot = app.add_subcommand("plot", tools_description("plot"));
  plot.add_option("FILE", o.file, "Recording of forcegrid record; also of a run that was killed")
      ->required();
  plot.add_option("--out", o.out, "Folder for recording.svg, .png and .csv")->show_default();
  Option* const from =
      plot.add_option("--from", o.from_s, "Begin there, in seconds since the recording's start")
          ->check(between(0.0, kLongestRecording_s))
          ->type_name("FLOAT s")
          ->not_in_config();
  Option* const to =
      plot.add_option("--to", o.to_s, "End there, in seconds since the recording's start")
          ->check(between(0.0, kLongestRecording_s))
          ->type_name("FLOAT s")
          ->not_in_config();
  plot.add_option("--zoom", o.zoom,
                  "contact: from just before the first contact to just after the last, so that the "
                  "approach does not flatten it")
      ->check(one_of({"contact"}))
      ->excludes(from)
      ->excludes(to)
      ->not_in_config();
  plot.add_option("--format", o.formats, "Pictures to draw: svg, png, pdf, separated by commas")
      ->separated_by(',')
      ->check(one_of({"svg", "png", "pdf"}))
      ->show_default();
  plot.add_option("--width", o.width_px,
                  "Width of the pictures; their height is 1.3 times that, and 96 pixels of a pdf "
                  "are an inch")
      ->check(whole_between(300, 10000))
      ->type_name("INT px")
      ->show_default();
  plot.callback([&o, &action] { action = [&o] { return plot_command(o); }; });
}

int replay_command(const ReplayOptions& options) {
  ReplayedPart part;
  RunOptions run;
  int tool_number = 0;
  {
    ProgressLine line;
    line.begin("Reading " + options.file);
    const Hdf5Reader reader(options.file);
    const RecordingHeader header = tools::read_header(reader);
    tool_number = header.tool_number;
    const std::string profile = options.device.empty() ? header.profile : options.device;
    part = part_to_replay(options, reader, header,
                          profiles::load_device_profile(profile).firm_hand.stiffness_N_per_m);
    run = run_options(options, header, profile, part.target);
  }
  if (tool_number > 0) {
    say_result(options.json, "replay",
               "Note: " + options.file + " is of tool " + std::to_string(tool_number) +
                   " of several; the replay has the object to itself, so its force differs");
  }
  make_folder(options.out);
  write_path(options.out + "/replayed_path.csv", part.target, part.gimbal_rad);
  const int status = run_command(run);

  ProgressLine line;
  line.begin("Comparing the paths");
  const Hdf5Reader reader(run.record);
  const RecordingHeader header = tools::read_header(reader);
  ordered_json json{
      {"replayed", options.file}, {"seconds", part.tool.time_s.back() - part.tool.time_s.front()},
      {"method", run.method},     {"device", run.device},
      {"recording", run.record},  {"run_summary", run.json.file}};
  std::string sentence;
  try {
    const tools::PathComparison followed = tools::compare_paths(part.tool, path_of(reader, header));
    json["followed_rms_mm"] = 1e3 * followed.rms_m;
    json["followed_max_mm"] = 1e3 * followed.max_m;
    json["began_after_s"] = followed.lag_s;
    char text[160];
    std::snprintf(text, sizeof text,
                  "Replay: the tool followed the recorded path within %.2f mm RMS, %.2f mm at most",
                  1e3 * followed.rms_m, 1e3 * followed.max_m);
    sentence = text;
  } catch (const std::invalid_argument& error) {
    json["followed_rms_mm"] = nullptr;
    sentence = "Replay: ended before the recorded path did (" + std::string(error.what()) + ")";
  }
  line.clear();
  say_result(options.json, "replay", sentence);
  write_json(options.json, json.dump(2));
  return status;
}

int plot_command(const PlotOptions& options) {
  if (options.from_s && options.to_s && *options.from_s >= *options.to_s) {
    throw std::runtime_error("--from " + text_of(*options.from_s) + " is not before --to " +
                             text_of(*options.to_s) + "; give the earlier time first");
  }
  make_folder(options.out);
  ProgressLine line;
  line.begin("Drawing " + options.file);
  const Hdf5Reader reader(options.file);
  tools::RecordingPlotOptions drawing{
      options.from_s, options.to_s, options.zoom == "contact", {}, options.width_px};
  for (const std::string& format : options.formats) {
    if (std::find(drawing.formats.begin(), drawing.formats.end(), format) ==
        drawing.formats.end()) {
      drawing.formats.push_back(format);
    }
  }
  const tools::RecordingPlot plot = tools::plot_recording(reader, options.out, drawing);
  line.clear();
  char text[160];
  std::snprintf(text, sizeof text, "; %llu cycles, %.1f s, %llu missed deadlines",
                static_cast<unsigned long long>(plot.header.cycles), plot.duration_s,
                static_cast<unsigned long long>(plot.missed_deadlines));
  say_result(options.json, "plot",
             options.file + ": " +
                 (plot.header.complete ? "complete" : "not closed by its writer, but readable") +
                 text);
  if (plot.contact_from_s) {
    std::snprintf(text, sizeof text, "Contact from %.2f to %.2f s; drawn from %.2f to %.2f s%s",
                  *plot.contact_from_s, *plot.contact_to_s, plot.drawn_from_s, plot.drawn_to_s,
                  drawing.contact_only || options.from_s || options.to_s
                      ? ""
                      : " (--zoom contact draws the contact alone)");
  } else {
    std::snprintf(text, sizeof text, "No contact; drawn from %.2f to %.2f s", plot.drawn_from_s,
                  plot.drawn_to_s);
  }
  say_result(options.json, "plot", text);
  const auto or_null = [](const std::optional<double>& value) {
    return value ? ordered_json(*value) : ordered_json(nullptr);
  };
  ordered_json files = plot.files;
  for (const std::string& file : plot.files) {
    say_result(options.json, "plot", "  " + file);
  }
  write_json(options.json, ordered_json{{"file", options.file},
                                        {"complete", plot.header.complete},
                                        {"forcegrid_version", plot.header.version},
                                        {"device_profile", plot.header.profile},
                                        {"methods", plot.header.method_names},
                                        {"cycles", plot.header.cycles},
                                        {"cycles_lost", plot.cycles_lost},
                                        {"samples", plot.header.samples},
                                        {"duration_s", plot.duration_s},
                                        {"missed_deadlines", plot.missed_deadlines},
                                        {"period_max_us", plot.period_max_us},
                                        {"force_max_N", plot.force_max_N},
                                        {"contact_from_s", or_null(plot.contact_from_s)},
                                        {"contact_to_s", or_null(plot.contact_to_s)},
                                        {"drawn_from_s", plot.drawn_from_s},
                                        {"drawn_to_s", plot.drawn_to_s},
                                        {"files", files}}
                               .dump(2));
  return 0;
}

}  // namespace forcegrid::cli
