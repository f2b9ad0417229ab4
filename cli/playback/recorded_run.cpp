// SPDX-License-Identifier: Apache-2.0
#include "cli/playback/recorded_run.h"

#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <ctime>
#include <filesystem>
#include <fstream>
#include <limits>
#include <sstream>
#include <stdexcept>
#include <utility>

#include "cli/common/budget_option.h"
#include "cli/run/run_command.h"
#include "cli/run/run_methods.h"
#include "cli/run/run_setup.h"
#include "cli/run/view_feed.h"
#include "forcegrid/method_variant.h"
#include "forcegrid/methods.h"
#include "forcegrid/pair_methods.h"
#include "log/log.h"
#include "servo_loop/servo_options.h"
#include "tools/config_file.h"

namespace forcegrid::cli {
namespace {

using nlohmann::json;
using tools::Hdf5Error;
using tools::Hdf5Reader;
using view_link::FeedCycle;
using view_link::FeedSample;

constexpr std::size_t kBlock = 1024;  // cycles that are read at a time
constexpr std::size_t kBlocks = 4;    // that are kept
constexpr char kDirect[] = "direct";
constexpr double kLongest_s = 1e8;  // that a nanosecond of a double still resolves well

// A file of its own, for what reads files alone. It goes with this object.
class TemporaryFile {
 public:
  TemporaryFile(const std::string& name, const std::string& text) {
    folder_ = (std::filesystem::temp_directory_path() / "forcegrid-recording-XXXXXX").string();
    if (::mkdtemp(folder_.data()) == nullptr) {
      throw std::runtime_error("can't make a folder in " +
                               std::filesystem::temp_directory_path().string() +
                               "; name another one in TMPDIR");
    }
    path_ = folder_ + "/" + name;
    std::ofstream(path_) << text;
  }
  ~TemporaryFile() {
    std::error_code ignored;
    std::filesystem::remove_all(folder_, ignored);
  }
  TemporaryFile(const TemporaryFile&) = delete;
  TemporaryFile& operator=(const TemporaryFile&) = delete;
  const std::string& path() const { return path_; }

 private:
  std::string folder_;
  std::string path_;
};

std::vector<std::string> words_of(const std::string& text) {
  std::vector<std::string> words;
  std::istringstream stream(text);
  for (std::string word; std::getline(stream, word, ';');) {
    words.push_back(word);
  }
  return words;
}

// "12", or "[1,2,3]" as a recording's settings have an array.
std::vector<double> numbers_of(const std::string& text) {
  std::vector<double> numbers;
  std::istringstream stream(text.starts_with('[') ? text.substr(1) : text);
  for (double number = 0.0; stream >> number; stream.ignore()) {  // a comma
    numbers.push_back(std::clamp(number, -1e6, 1e6));
  }
  return numbers;
}

// The run's options that its methods depend on, as far as the recording's settings have them.
RunOptions options_of(const std::string& settings, const std::vector<std::string>& methods) {
  RunOptions options;
  options.method = methods.front();
  options.evaluated.assign(methods.begin() + 1, methods.end());
  const TemporaryFile file("settings.toml", settings);
  for (const tools::ConfigValue& value : tools::read_config_file(file.path())) {
    const std::string key = value.key.substr(value.key.rfind('.') + 1);
    const std::string text = value.texts.empty() ? "" : value.texts.front();
    const std::vector<double> numbers = numbers_of(text);
    if (key == "device" && !text.empty()) {
      options.device = text;
    } else if (key == "cells" && numbers.size() == 3) {
      options.cells = {static_cast<int>(numbers[0]), static_cast<int>(numbers[1]),
                       static_cast<int>(numbers[2])};
    } else if (numbers.size() != 1) {
      continue;
    } else if (key == "fill-budget") {
      options.fill_budget = static_cast<int>(numbers[0]);
    } else if (key == "r-mm") {
      options.influence_radius_mm = numbers[0];
    } else if (key == "unit-mm") {
      options.unit_mm = numbers[0];
    } else if (key == "s") {
      options.samples_per_cell = static_cast<int>(numbers[0]);
    } else if (key == "sim-rate") {
      options.simulator_rate_Hz = numbers[0];
    } else if (key == "requests-per-s") {
      options.requests_per_s = numbers[0];
    }
  }
  return options;
}

// What the rendered method says of itself.
void describe(ViewTitle& title, const RunOptions& options) {
  constexpr double kRequests_per_s = 120.0;  // of a method that needs them, if nothing is said
  bool needs_requests = false;
  if (title.methods.front() != kDirect) {
    const MethodVariant variant = parse_pair_variant(title.methods.front(), title.method_options);
    if (is_pair_method(variant.name)) {
      title.candidates = {variant.name, kMethodOfOneTool};
      return;
    }
    const auto method = make_force_method(variant.name, variant.options);
    needs_requests = method->needs().requests;
    for (const char* name : method->candidates()) {
      title.candidates.emplace_back(name);
    }
  }
  title.requests_per_s = options.requests_per_s.value_or(needs_requests ? kRequests_per_s : 0.0);
}

std::int64_t nanoseconds(double time_s) { return std::llround(1e9 * time_s); }

// A column with `width` numbers a row. `otherwise` stands for what an old recording lacks; without
// it the column has to be there.
class Column {
 public:
  Column(const Hdf5Reader& reader, const std::string& name, std::size_t rows, std::size_t first,
         std::size_t width, std::optional<double> otherwise = {})
      : width_(width) {
    if (otherwise && !reader.has(name)) {
      values_.assign(rows * width, *otherwise);
      return;
    }
    values_ = reader.numbers(name, rows, first);
    if (values_.size() != rows * width) {
      throw Hdf5Error(reader.file() + ": damaged: a row of " + name + " has not " +
                      std::to_string(width) + " numbers");
    }
  }
  double at(std::size_t row, std::size_t i = 0) const { return values_[row * width_ + i]; }
  // Zero for a number that the type can't hold.
  template <typename Number>
  Number whole(std::size_t row, std::size_t i = 0) const {
    const double value = at(row, i);
    return value >= static_cast<double>(std::numeric_limits<Number>::lowest()) &&
                   value < static_cast<double>(std::numeric_limits<Number>::max()) + 1.0
               ? static_cast<Number>(value)
               : Number{};
  }
  std::uint8_t flag(std::size_t row) const { return at(row) != 0.0 ? 1 : 0; }
  std::array<double, 3> triple(std::size_t row, std::size_t i = 0) const {
    return {at(row, 3 * i), at(row, 3 * i + 1), at(row, 3 * i + 2)};
  }

 private:
  std::size_t width_;
  std::vector<double> values_;
};

// Some rows of /cycles.
class CycleColumns {
 public:
  CycleColumns(const Hdf5Reader& reader, std::size_t rows, std::size_t first, std::size_t methods)
      : reader_(reader), rows_(rows), first_(first), methods_(methods) {}

  FeedCycle cycle(std::size_t i) const {
    constexpr std::uint8_t kPaused = 4;  // of names_held_back
    FeedCycle cycle;
    cycle.cycle = number_.whole<std::uint64_t>(i);
    cycle.position_W_m = position_.triple(i);
    cycle.touching_W_m = touching_.triple(i);
    cycle.velocity_W_m_per_s = velocity_.triple(i);
    for (std::size_t method = 0; method < std::min(methods_, view_link::kFeedMethods); ++method) {
      cycle.method_force_W_N[method] = method_force_.triple(i, method);
      cycle.method_uncertainty_N[method] = uncertainty_.at(i, method);
      cycle.method_status[method] = status_.whole<std::uint8_t>(i, method);
    }
    cycle.commanded_force_W_N = force_.triple(i);  // W and D have the same axes
    cycle.period_us = period_.at(i);
    cycle.wakeup_us = wakeup_.at(i);
    cycle.compute_us = compute_.at(i);
    cycle.report_age_us = report_age_.at(i);
    cycle.sample_age_ms = sample_age_.at(i);
    cycle.gain = gain_.at(i);
    cycle.damping_gain = damping_gain_.at(i);
    cycle.energy_to_hand_J = energy_.at(i);
    cycle.passivity_scale = passivity_scale_.at(i);
    cycle.motor_warmth = warmth_.at(i);
    cycle.requests_per_s = requests_.at(i);
    cycle.budget_reads = budget_.at(i);
    cycle.contact_epoch = epoch_.whole<std::uint32_t>(i);
    cycle.missed_deadlines = missed_.whole<std::uint32_t>(i);
    cycle.rendered_candidate = candidate_.whole<std::uint8_t>(i);
    cycle.rendered_reason = reason_.whole<std::uint8_t>(i);
    cycle.rung = rung_.whole<std::uint8_t>(i);
    cycle.held_back = held_back_.whole<std::uint8_t>(i);
    cycle.limits_acted = limits_.whole<std::uint8_t>(i);
    cycle.in_contact = in_contact_.flag(i);
    cycle.fault = fault_.whole<std::uint8_t>(i);
    cycle.paused = cycle.held_back == kPaused ? 1 : 0;
    cycle.rendered_method = rendered_method_.whole<std::uint8_t>(i);
    return cycle;
  }
  std::array<std::int32_t, 6> counts(std::size_t i) const {
    std::array<std::int32_t, 6> counts{};
    for (std::size_t k = 0; k < 3; ++k) {
      counts[k] = counts_.whole<std::int32_t>(i, k);
      counts[k + 3] = gimbal_counts_.whole<std::int32_t>(i, k);
    }
    return counts;
  }

 private:
  Column column(const char* name, std::size_t width = 1,
                std::optional<double> otherwise = {}) const {
    return {reader_, std::string("/cycles/") + name, rows_, first_, width, otherwise};
  }

  static constexpr double kUnknown = std::numeric_limits<double>::quiet_NaN();
  const Hdf5Reader& reader_;
  std::size_t rows_, first_, methods_;
  Column number_ = column("cycle");
  Column position_ = column("position_W_m", 3);
  Column touching_ =
      column(reader_.has("/cycles/touching_W_m") ? "touching_W_m" : "position_W_m", 3);
  Column velocity_ = column("velocity_W_m_per_s", 3);
  Column method_force_ = column("asked_force_W_N", 3 * methods_);
  Column uncertainty_ = column("method_uncertainty_N", methods_);
  Column status_ = column("method_status", methods_);
  Column force_ = column("sent_force_D_N", 3);
  Column period_ = column("period_us");
  Column wakeup_ = column("wakeup_us");
  Column compute_ = column("compute_us");
  Column report_age_ = column("report_age_us");
  Column sample_age_ = column("sample_age_ms");
  Column gain_ = column("gain");
  Column damping_gain_ = column("damping_gain", 1, kUnknown);
  Column energy_ = column("energy_to_hand_J");
  Column passivity_scale_ = column("passivity_scale");
  Column warmth_ = column("motor_warmth", 1, kUnknown);
  // Unknown: the methods keep what the hello says.
  Column requests_ = column("requests_per_s", 1, kUnknown);
  Column budget_ = column("budget_reads", 1, kUnknown);
  Column epoch_ = column("contact_epoch");
  Column missed_ = column("missed_deadlines");
  Column candidate_ = column("rendered_member");
  Column reason_ = column("rendered_reason");
  Column rung_ = column("rung");
  Column held_back_ = column("held_back", 1, 0.0);
  Column limits_ = column("limits_acted");
  Column in_contact_ = column("in_contact");
  Column fault_ = column("fault");
  Column rendered_method_ = column("rendered_method", 1, 0.0);
  Column counts_ = column("counts", 3);
  Column gimbal_counts_ = column("gimbal_counts", 3, 0.0);
};

}  // namespace

// Cycles that were read, and their encoder counts.
struct RecordedRun::Block {
  std::size_t first = 0;
  std::vector<FeedCycle> cycles;
  std::vector<std::array<std::int32_t, 6>> counts;
};

RecordedRun::RecordedRun(const std::string& file)
    : reader_(file), header_(tools::read_header(reader_)) {
  if (header_.cycles == 0) {
    throw Hdf5Error(file + ": the recording has no cycle; there is nothing to show");
  }
  if (header_.method_names.empty()) {
    throw Hdf5Error(file + ": damaged: it names no method");
  }
  methods_ = header_.method_names.size();
  workspace_.W_origin_D = -header_.offset_W_m;
  start_ns_ = std::strtoll(reader_.attribute("start_monotonic_ns").c_str(), nullptr, 10);
  std::int64_t newest_ns = std::numeric_limits<std::int64_t>::min();
  for (const double time_s : reader_.numbers("/cycles/time_s", header_.cycles)) {
    if (!(std::abs(time_s) < kLongest_s)) {
      throw Hdf5Error(file + ": damaged: /cycles/time_s has a time that is none");
    }
    newest_ns = std::max(newest_ns, start_ns_ + nanoseconds(time_s));
    time_ns_.push_back(newest_ns);
  }
  std::uint32_t missed = 0;
  for (const double deadlines : reader_.numbers("/cycles/missed_deadlines", header_.cycles)) {
    missed += static_cast<std::uint32_t>(std::clamp(deadlines, 0.0, 1e6));
    missed_.push_back(missed);
  }
  read_samples();
  read_arrivals();
  read_hello();
  hello_["controls"] = {"play", "seek"};
  shared_ = {0, 1, time_ns_.front(), time_ns_.back(), 0};
  surface_.emplace(reader_, 1e-9 * static_cast<double>(time_ns_.front() - start_ns_));
  shared_.surface_frames = surface_->entries().size();
  describe_recording();
}

void RecordedRun::share(const SharedPlace& shared) {
  shared_ = shared;
  surface_.emplace(reader_, 1e-9 * static_cast<double>(shared.first_ns - start_ns_));
  describe_recording();
}

void RecordedRun::describe_recording() {
  hello_["recording"] = {{"file", std::filesystem::path(file()).filename().string()},
                         {"started_utc", reader_.attribute("started_utc")},
                         {"first_ns", shared_.first_ns},
                         {"duration_s", duration_s()},
                         {"complete", header_.complete},
                         {"tools", shared_.tools},
                         {"surface", shared_.surface_frames > 0},
                         {"surface_frames", shared_.surface_frames}};
}

std::optional<double> RecordedRun::clock_zero_utc_s() const {
  std::tm started{};
  const std::string text = reader_.attribute("started_utc");
  if (::strptime(text.c_str(), "%Y-%m-%dT%H:%M:%SZ", &started) == nullptr) {
    return std::nullopt;
  }
  return static_cast<double>(::timegm(&started)) - 1e-9 * static_cast<double>(start_ns_);
}

RecordedRun::~RecordedRun() = default;

void RecordedRun::read_samples() {
  const std::size_t rows = header_.samples;
  const auto column = [&](const char* name, std::size_t width) {
    return Column(reader_, name, rows, 0, width);
  };
  const Column time_s = column("/samples/time_s", 1);
  const Column delivered_s = column("/samples/delivered_s", 1);
  const Column position = column("/samples/position_W_m", 3);
  const Column force = column("/samples/force_W_N", 3);
  const Column contact_point = column("/samples/contact_point_W_m", 3);
  const Column has_stiffness = column("/samples/has_stiffness", 1);
  const Column stiffness = column("/samples/stiffness_W_N_per_m", 9);
  const Column in_contact = column("/samples/in_contact", 1);
  const Column epoch = column("/samples/contact_epoch", 1);
  const Column residual = column("/samples/relative_residual", 1);
  const Column converged = column("/samples/converged", 1);
  const Column from_query = column("/samples/from_query", 1);
  const double start_s = 1e-9 * static_cast<double>(start_ns_);
  for (std::size_t i = 0; i < rows; ++i) {
    FeedSample sample;
    sample.arrived_ns = start_ns_ + nanoseconds(std::clamp(delivered_s.at(i), -1e8, 1e8));
    sample.time_s = start_s + time_s.at(i);
    sample.position_W_m = position.triple(i);
    sample.force_W_N = force.triple(i);
    sample.contact_point_W_m = contact_point.triple(i);
    for (std::size_t number = 0; number < 9; ++number) {
      sample.stiffness_W_N_per_m[number] = stiffness.at(i, number);
    }
    sample.contact_epoch = epoch.whole<std::uint32_t>(i);
    sample.in_contact = in_contact.flag(i);
    sample.has_stiffness = has_stiffness.flag(i);
    sample.requested = from_query.flag(i);
    sample.converged = converged.flag(i);
    sample.relative_residual = residual.at(i);
    samples_.push_back(sample);
  }
}

// An old recording counts the samples along the path alone: the answers to requests are placed by
// their times of arrival.
void RecordedRun::read_arrivals() {
  const bool old = !reader_.has("/cycles/arrivals_taken");
  const Column taken(reader_, old ? "/cycles/samples_taken" : "/cycles/arrivals_taken",
                     time_ns_.size(), 0, 1);
  std::uint64_t arrivals = 0;
  std::uint64_t along_the_path = 0;
  for (std::size_t i = 0; i < time_ns_.size(); ++i) {
    const auto count = taken.whole<std::uint64_t>(i);
    if (!old) {
      arrivals = std::max(arrivals, std::min<std::uint64_t>(count, samples_.size()));
    }
    while (old && arrivals < samples_.size() &&
           (samples_[arrivals].requested != 0 ? samples_[arrivals].arrived_ns <= time_ns_[i]
                                              : along_the_path < count)) {
      along_the_path += samples_[arrivals].requested != 0 ? 0 : 1;
      ++arrivals;
    }
    arrivals_.push_back(arrivals);
  }
}

void RecordedRun::read_hello() {
  const std::string profile = reader_.attribute("profile");
  const std::string name = reader_.attribute("profile_name");
  try {
    const TemporaryFile file("profile.toml", profile);
    profile_ = profiles::load_device_profile(file.path());
  } catch (const std::exception& error) {
    throw Hdf5Error(reader_.file() + ": damaged: its device profile '" + name +
                    "' can't be used: " + error.what());
  }
  profile_->name = name;
  mechanism_ = driver::make_mechanism(*profile_);
  const std::string told = reader_.attribute("view_hello");
  if (told.empty()) {
    hello_ = hello_of_old_recording();
    return;
  }
  hello_ = json::parse(told, nullptr, false);
  if (!hello_.is_object() || !hello_.contains("methods") || !hello_["methods"].is_array() ||
      hello_["methods"].size() != methods_) {
    throw Hdf5Error(reader_.file() + ": damaged: its attribute view_hello can't be used");
  }
}

json RecordedRun::hello_of_old_recording() {
  ViewTitle title;
  title.version = reader_.attribute("forcegrid_version");
  title.methods = words_of(reader_.attribute("method_names"));
  title.scene = reader_.attribute("scene");
  title.rate_Hz = std::strtod(reader_.attribute("rate_Hz").c_str(), nullptr);
  RunOptions options;
  std::string no_field;
  try {
    options = options_of(reader_.attribute("settings"), title.methods);
    title.method_options = method_options(options, *profile_, servo::WorkspaceMap());
    describe(title, options);
  } catch (const std::exception& error) {
    no_field = std::string("no field: the settings can't be used: ") + error.what();
    log::warn("view", reader_.file() + ": " + no_field);
  }
  title.device = options.device;
  title.emulated = options.device.starts_with("emulated:");
  title.simulator_rate_Hz = options.simulator_rate_Hz;
  title.fill_budget = options.fill_budget;
  json hello = view_hello(title, *profile_, servo::WorkspaceMap());
  for (const auto& [key, attribute] : {std::pair{"reasons", "names_rendered_reason"},
                                       {"statuses", "names_method_status"},
                                       {"rungs", "names_rung"},
                                       {"faults", "names_fault"}}) {
    const std::vector<std::string> names = words_of(reader_.attribute(attribute));
    if (!names.empty()) {
      hello[key] = names;
    }
  }
  if (!no_field.empty()) {
    hello.erase("copies");
  }
  return hello;
}

std::size_t RecordedRun::cycle_at(double time_s) const noexcept {
  const double clamped_s = std::clamp(time_s, 0.0, kLongest_s);
  return static_cast<std::size_t>(std::lower_bound(time_ns_.begin(), time_ns_.end(),
                                                   shared_.first_ns + nanoseconds(clamped_s)) -
                                  time_ns_.begin());
}

std::uint64_t RecordedRun::missed_deadlines_before(std::size_t cycle) const {
  return cycle == 0 ? 0 : missed_.at(cycle - 1);
}

const RecordedRun::Block& RecordedRun::block_of(std::size_t cycle) {
  const std::size_t first = cycle / kBlock * kBlock;
  const auto found = std::find_if(blocks_.begin(), blocks_.end(),
                                  [first](const auto& block) { return block->first == first; });
  if (found != blocks_.end()) {
    return **found;
  }
  if (blocks_.size() == kBlocks) {
    blocks_.erase(blocks_.begin());
  }
  blocks_.push_back(read_block(first));
  return *blocks_.back();
}

std::unique_ptr<RecordedRun::Block> RecordedRun::read_block(std::size_t first) {
  const std::size_t rows = std::min(kBlock, time_ns_.size() - first);
  const CycleColumns columns(reader_, rows, first, methods_);
  auto block = std::make_unique<Block>();
  block->first = first;
  for (std::size_t i = 0; i < rows; ++i) {
    FeedCycle cycle = columns.cycle(i);
    cycle.time_ns = time_ns_[first + i];
    cycle.arrivals_taken = arrivals_[first + i];
    block->cycles.push_back(cycle);
    block->counts.push_back(columns.counts(i));
  }
  return block;
}

std::vector<FeedCycle> RecordedRun::cycles(std::size_t first, std::size_t count) {
  std::vector<FeedCycle> found;
  const std::size_t end = std::min(time_ns_.size(), first + count);
  for (std::size_t cycle = first; cycle < end;) {
    const Block& block = block_of(cycle);
    const std::size_t from = cycle - block.first;
    const std::size_t to = std::min(block.cycles.size(), end - block.first);
    found.insert(found.end(), block.cycles.begin() + static_cast<std::ptrdiff_t>(from),
                 block.cycles.begin() + static_cast<std::ptrdiff_t>(to));
    cycle = block.first + to;
  }
  return found;
}

view_link::Frame RecordedRun::arm(std::size_t cycle) {
  const Block& block = block_of(cycle);
  return arm_frame(*profile_, *mechanism_, workspace_, block.counts.at(cycle - block.first));
}

}  // namespace forcegrid::cli
