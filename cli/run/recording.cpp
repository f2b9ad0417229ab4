// SPDX-License-Identifier: Apache-2.0
#include "cli/run/recording.h"

#include <algorithm>
#include <cctype>
#include <ctime>
#include <fstream>
#include <optional>
#include <sstream>
#include <stdexcept>
#include <utility>

#include "cli/common/json_target.h"
#include "cli/common/revision.h"
#include "evaluation/files/text_file.h"
#include "log/log.h"
#include "rt/vectors.h"
#include "tools/hdf5_file.h"
#include "tools/library_versions.h"
#include "tools/recording.h"

namespace forcegrid::cli {
namespace {

std::string text_of(const std::string& file) {
  std::ifstream stream(file);
  std::ostringstream text;
  text << stream.rdbuf();
  return text.str();
}

// "nlohmann-json" becomes the attribute version_nlohmann_json.
std::string version_key(std::string name) {
  std::transform(name.begin(), name.end(), name.begin(), [](unsigned char character) {
    return std::isalnum(character) != 0 ? static_cast<char>(std::tolower(character)) : '_';
  });
  return "version_" + name;
}

}  // namespace

bool records_trace(const RunOptions& options) {
  return !options.record.empty() && !tools::is_recording_name(options.record);
}

void check_recording(const RunOptions& options) {
  if (options.record_surface && (options.record.empty() || records_trace(options))) {
    throw std::runtime_error(
        "--record-surface adds the surface to a recording in HDF5, and there is none; give "
        "--record FILE.h5, too");
  }
  if (options.record.empty()) {
    return;
  }
  if (!records_trace(options)) {
    const std::string why_not = why_not_writable(options.record);
    if (!why_not.empty()) {
      throw std::runtime_error("--record " + options.record + ": can't be written (" + why_not +
                               "); name a file in a folder that exists");
    }
    return;
  }
  if (!options.record.ends_with(".csv") && !options.record.ends_with(".csv.gz")) {
    throw std::runtime_error("--record " + options.record +
                             ": the name must end in .h5 (a recording of everything), or in .csv "
                             "or .csv.gz (a trace for 'forcegrid evaluate')");
  }
  if (options.no_reference) {
    throw std::runtime_error(
        "--record of a trace needs reference forces, but --no-reference skips them; leave one of "
        "the two out");
  }
  if (!options.simulator.empty()) {
    throw std::runtime_error(
        "--record of a trace needs reference forces, which only the scenes of 'forcegrid simulate' "
        "have; use --scene instead of --simulator");
  }
  try {
    const evaluation::TextWriter probe(options.record);
  } catch (const evaluation::FileError& error) {
    throw evaluation::TraceError(std::string("--record ") + error.what());
  }
}

std::unique_ptr<tools::Recorder> start_recorder(const RunOptions& options,
                                                const profiles::DeviceProfile& profile,
                                                const std::vector<std::string>& methods,
                                                const std::string& device_url,
                                                const driver::DeviceIdentity& identity,
                                                const std::string& view_hello) {
  if (options.record.empty() || records_trace(options)) {
    return nullptr;
  }
  tools::RecorderOptions recorder;
  recorder.file = options.record;
  recorder.rate_Hz = options.rate_Hz;
  recorder.method_names = methods;
  recorder.surface = options.record_surface;
  recorder.other_tools = options.tool_number > 0;
  recorder.trouble = [](const std::string& sentence) {
    log::error("recorder", "--record: " + sentence);
  };
  std::time_t now = std::time(nullptr);
  char started[32];
  std::strftime(started, sizeof started, "%Y-%m-%dT%H:%M:%SZ", std::gmtime(&now));
  recorder.attributes = {{"forcegrid_version", program_version()},
                         {"forcegrid_commit", program_commit()},
                         {"started_utc", started},
                         {"settings", options.settings},
                         {"view_hello", view_hello},
                         {"rate_Hz", std::to_string(options.rate_Hz)},
                         {"scene", options.simulator.empty() ? options.scene : ""},
                         {"profile_name", profile.name},
                         {"profile", text_of(profile.file)},
                         {"device_url", device_url},
                         {"device_product", identity.product},
                         {"device_manufacturer", identity.manufacturer},
                         {"device_serial", identity.serial}};
  const auto& offset_mm = options.offset_W_mm;
  recorder.attributes.emplace_back("offset_W_mm", std::to_string(offset_mm[0]) + "," +
                                                      std::to_string(offset_mm[1]) + "," +
                                                      std::to_string(offset_mm[2]));
  if (options.tool_number > 0) {
    recorder.attributes.emplace_back("tool_number", std::to_string(options.tool_number));
  }
  for (const tools::PartVersion& part : tools::library_versions()) {
    recorder.attributes.emplace_back(version_key(part.name), part.version);
  }
  return std::make_unique<tools::Recorder>(std::move(recorder));
}

void complete_recording(const tools::Recorder& recorder, const std::string& file,
                        const std::vector<const servo::CycleRecord*>& cycles,
                        const std::vector<Eigen::Vector3d>& reference_W,
                        const std::string& summary) {
  using tools::Hdf5Type;
  std::vector<std::pair<tools::Hdf5Column, std::vector<double>>> columns;
  if (!reference_W.empty()) {
    std::vector<double> time_s;
    std::vector<double> position_W_m;
    std::vector<double> force_W_N;
    for (std::size_t i = 0; i < reference_W.size(); ++i) {
      time_s.push_back(1e-9 * static_cast<double>(cycles[i]->time_ns - recorder.start_ns()));
      for (std::size_t axis = 0; axis < 3; ++axis) {
        position_W_m.push_back(cycles[i]->position_W_m[axis]);
        force_W_N.push_back(reference_W[i][static_cast<Eigen::Index>(axis)]);
      }
    }
    columns = {{{"/truth/time_s", Hdf5Type::kFloat64, {}, "of the cycle"}, time_s},
               {{"/truth/position_W_m", Hdf5Type::kFloat64, {3}, "of the tool"}, position_W_m},
               {{"/truth/force_W_N", Hdf5Type::kFloat64, {3}, "reference force there"}, force_W_N}};
  }
  tools::add_to_hdf5(file, {{"summary_json", summary}, {"ended", "by its writer"}}, columns);
}

evaluation::Trace trace_of(const std::deque<servo::ArrivedSample>& samples,
                           const std::vector<const servo::CycleRecord*>& cycles,
                           const std::vector<Eigen::Vector3d>& reference_W,
                           std::int64_t contact_ns) {
  const double contact_s = 1e-9 * static_cast<double>(contact_ns);
  evaluation::Trace trace;
  for (std::size_t i = 0; i < cycles.size(); ++i) {
    trace.servo.push_back({1e-9 * static_cast<double>(cycles[i]->time_ns - contact_ns),
                           rt::to_vector(cycles[i]->touching_W_m), reference_W.at(i)});
  }
  // The epoch of the present contact as known to the servo.
  std::optional<std::uint32_t> contact;
  for (const servo::ArrivedSample& arrived : samples) {
    if (arrived.sample.from_query) {
      continue;
    }
    evaluation::DeliveredSample row;
    row.sample = arrived.sample;
    row.sample.time_s -= contact_s;
    row.delivered_s = rt::seconds(arrived.arrived.time_since_epoch()) - contact_s;
    if (!arrived.in_contact) {
      if (contact) {
        trace.events.push_back(
            {row.sample.time_s, false, Eigen::Vector3d::Zero(), row.delivered_s});
        contact.reset();
      }
      continue;
    }
    if (contact != arrived.sample.contact_epoch) {
      trace.events.push_back(
          {row.sample.time_s, true, arrived.sample.contact_point_W, row.delivered_s});
      contact = arrived.sample.contact_epoch;
    }
    trace.samples.push_back(row);
  }
  return trace;
}

}  // namespace forcegrid::cli
