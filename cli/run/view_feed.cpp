// SPDX-License-Identifier: Apache-2.0
#include "cli/run/view_feed.h"

#include <fcntl.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <cmath>
#include <cstring>
#include <limits>
#include <nlohmann/json.hpp>
#include <utility>

#include "cli/common/stop_request.h"
#include "driver/linkage_lines.h"
#include "log/log.h"
#include "rt/vectors.h"
#include "view_link/little_endian.h"

namespace forcegrid::cli {
namespace {

using nlohmann::json;
using view_link::FeedCycle;
using view_link::FeedSample;
using view_link::FeedType;

constexpr std::int64_t kArm_ns = 16'000'000;  // between two pictures of the arm
constexpr std::size_t kMostCycles = 128;      // in one frame, which holds 64 KiB
constexpr std::size_t kMostSamples = 128;     // likewise
constexpr std::size_t kMostBegun = 16'384;    // cycles that a page may still report: 4 s at 4 kHz
constexpr int kFaults = static_cast<int>(servo::Fault::kZeroNotDelivered) + 1;
constexpr int kStatuses = static_cast<int>(EstimateStatus::kNotFinite) + 1;

static_assert(view_link::kFeedMethods == servo::kMaxMethods);
static_assert(kMostCycles * sizeof(FeedCycle) <= view_link::kLargestFeedPayload);
static_assert(kMostSamples * sizeof(FeedSample) <= view_link::kLargestFeedPayload);

std::uint16_t type_of(FeedType type) { return static_cast<std::uint16_t>(type); }

// The names behind the numbers 0 to count - 1 of an enumeration.
template <typename Enum, typename Name>
json names_of(int count, Name name) {
  json names = json::array();
  for (int i = 0; i < count; ++i) {
    names.push_back(name(static_cast<Enum>(i)));
  }
  return names;
}

json triple(const Eigen::Vector3d& vector) { return {vector.x(), vector.y(), vector.z()}; }

// What a copy of the methods is made of.
json copy_facts(const ViewTitle& title) {
  const MethodOptions& options = title.method_options;
  return {{"low_W_m", triple(options.grid.min_W)},
          {"high_W_m", triple(options.grid.max_W)},
          {"cells", {options.grid.cells.x(), options.grid.cells.y(), options.grid.cells.z()}},
          {"influence_radius_m", options.influence_radius_m},
          {"unit_m", options.unit_m},
          {"samples_per_cell", options.samples_per_cell},
          {"budget_reads", options.budget_reads ? json(*options.budget_reads) : json(nullptr)},
          {"fill_budget", title.fill_budget},
          {"requests_per_s", title.requests_per_s}};
}

}  // namespace

json view_hello(const ViewTitle& title, const profiles::DeviceProfile& profile,
                const servo::WorkspaceMap& workspace, const json& settings) {
  const auto& limits = profile.limits;
  json controls = {"stop", "pause", "method", "set"};
  if (!title.hand_socket.empty()) {
    controls.push_back("hand");
  }
  return {
      {"version", title.version},
      {"device", title.device},
      {"profile", profile.name},
      {"scene", title.scene},
      {"rate_Hz", title.rate_Hz},
      {"simulator_rate_Hz", title.simulator_rate_Hz},
      {"methods", title.methods},
      {"candidates", title.candidates},
      {"reasons", names_of<ChoiceReason>(kChoiceReasons,
                                         [](ChoiceReason reason) { return to_string(reason); })},
      {"statuses", names_of<EstimateStatus>(
                       kStatuses, [](EstimateStatus status) { return to_string(status); })},
      {"rungs", names_of<servo::Rung>(servo::kRungs,
                                      [](servo::Rung rung) { return servo::to_string(rung); })},
      {"held_back",
       {"force is rendered", "no samples", "motor check", "dead-man's switch", "paused"}},
      {"limits", {"not finite", "force", "slew", "torque", "current", "warm"}},
      {"faults",
       names_of<servo::Fault>(kFaults, [](servo::Fault fault) { return servo::name_of(fault); })},
      {"workspace_W_m",
       {{"low", triple(workspace.position_W(driver::array_of(limits.workspace_min_m).matrix()))},
        {"high", triple(workspace.position_W(driver::array_of(limits.workspace_max_m).matrix()))}}},
      {"emulated", title.emulated},
      {"controls", controls},
      {"settings", settings},
      {"tour", title.tour},
      {"largest_force_N", limits.max_force_N},
      {"copies", copy_facts(title)}};
}

view_link::Frame arm_frame(const profiles::DeviceProfile& profile, driver::Mechanism& mechanism,
                           const servo::WorkspaceMap& workspace,
                           const std::array<std::int32_t, 6>& counts) {
  const auto lines = driver::linkage_lines(profile, mechanism.forward(counts));
  view_link::Frame frame{type_of(FeedType::kArm), 0, {}};
  view_link::append(frame.payload, static_cast<std::uint32_t>(lines.size()));
  for (const driver::LinkageLine& line : lines) {
    view_link::append(frame.payload, static_cast<std::uint32_t>(line.size()));
    for (const Eigen::Vector3d& point_D : line) {
      const Eigen::Vector3f point_W = workspace.position_W(point_D).cast<float>();
      view_link::append(frame.payload, std::span<const float>(point_W.data(), 3));
    }
  }
  return frame;
}

view_link::FeedCycle cycle_of(const servo::CycleRecord& record) {
  FeedCycle cycle;
  cycle.cycle = record.cycle;
  cycle.time_ns = record.time_ns;
  cycle.arrivals_taken = record.arrivals_taken;
  cycle.position_W_m = record.position_W_m;
  cycle.touching_W_m = record.touching_W_m;
  cycle.velocity_W_m_per_s = record.velocity_W_m_per_s;
  cycle.method_force_W_N = record.method_force_W_N;
  cycle.method_uncertainty_N = record.method_uncertainty_N;
  cycle.commanded_force_W_N = record.commanded_force_D_N;  // W and D have the same axes
  cycle.period_us = record.period_us;
  cycle.wakeup_us = record.wakeup_us;
  cycle.compute_us = record.compute_us;
  cycle.report_age_us = record.report_age_us;
  cycle.sample_age_ms = record.sample_age_ms;
  cycle.gain = record.gain;
  cycle.damping_gain = record.damping_gain;
  cycle.energy_to_hand_J = record.energy_to_hand_J;
  cycle.passivity_scale = record.passivity_scale;
  cycle.motor_warmth = record.motor_warmth;
  cycle.sample_period_ms = record.sample_period_ms;
  cycle.requests_per_s = record.requests_per_s;
  cycle.budget_reads = record.budget_reads;
  cycle.contact_epoch = record.contact_epoch;
  cycle.missed_deadlines = record.missed_deadlines;
  std::transform(record.method_status.begin(), record.method_status.end(),
                 cycle.method_status.begin(),
                 [](EstimateStatus status) { return static_cast<std::uint8_t>(status); });
  cycle.rendered_method = record.rendered_method;
  cycle.rendered_candidate = record.rendered_candidate;
  cycle.rendered_reason = static_cast<std::uint8_t>(record.rendered_reason);
  cycle.rung = static_cast<std::uint8_t>(record.rung);
  cycle.held_back = static_cast<std::uint8_t>(record.held_back);
  cycle.limits_acted = record.limits_acted;
  cycle.in_contact = record.in_contact ? 1 : 0;
  cycle.paused = record.held_back == servo::HeldBack::kPaused ? 1 : 0;
  cycle.fault = static_cast<std::uint8_t>(record.fault);
  return cycle;
}

view_link::FeedSample sample_of(const servo::ArrivedSample& arrived) {
  const Sample& sample = arrived.sample;
  FeedSample sent;
  sent.arrived_ns = arrived.arrived.time_since_epoch().count();
  sent.time_s = sample.time_s;
  sent.position_W_m = rt::to_array(sample.position_W);
  sent.force_W_N = rt::to_array(sample.force_W);
  sent.contact_point_W_m = rt::to_array(sample.contact_point_W);
  Eigen::Map<Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(sent.stiffness_W_N_per_m.data()) =
      sample.stiffness_W;
  sent.contact_epoch = sample.contact_epoch;
  sent.in_contact = arrived.in_contact ? 1 : 0;
  sent.has_stiffness = sample.has_stiffness ? 1 : 0;
  sent.requested = sample.from_query ? 1 : 0;
  sent.converged = sample.converged ? 1 : 0;
  sent.relative_residual = sample.relative_residual;
  return sent;
}

ViewFeed::ViewFeed(const std::string& socket, const ViewTitle& title,
                   const profiles::DeviceProfile& profile, const servo::WorkspaceMap& workspace,
                   servo::ServoPorts& ports)
    : profile_(profile),
      workspace_(workspace),
      ports_(ports),
      mechanism_(driver::make_mechanism(profile)),
      methods_(title.methods.size()),
      hand_socket_(title.hand_socket) {
  if (!hand_socket_.empty()) {
    hand_ = ::socket(AF_UNIX, SOCK_DGRAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);
  }
  view_link::FrameSender::Options options;
  options.path = socket;
  options.on_frame = [this](const view_link::Frame& frame) { take_command(frame); };
  options.on_lost = [](const std::string& why) {
    log::warn("view", "the live view is gone (" + why + "); the run goes on without it");
  };
  controls_ = std::make_unique<ViewControls>(
      title.controls, ports,
      ViewControls::Calls{
          .acknowledge = [this](std::int64_t id, bool done,
                                const std::string& text) { acknowledge(id, "set", done, text); },
          .changed =
              [this](const json& settings) {
                sender_->push(view_link::text_frame(type_of(FeedType::kSettings),
                                                    json{{"settings", settings}}.dump()));
              },
          .restart = title.restart});
  const std::lock_guard lock(mutex_);  // a command waits until the sender is there to answer
  sender_ = std::make_unique<view_link::FrameSender>(std::move(options));
  view_link::Frame hello =
      view_link::text_frame(type_of(FeedType::kHello),
                            view_hello(title, profile, workspace, controls_->settings()).dump());
  hello.object = title.tool;
  sender_->push(hello);
}

ViewFeed::~ViewFeed() {
  controls_->stop();  // its thread uses the sender
  sender_.reset();    // its thread uses what comes before
  if (hand_ >= 0) {
    ::close(hand_);
  }
}

void ViewFeed::push(const servo::CycleRecord& cycle) {
  controls_->cycle_ended(cycle);
  const std::lock_guard lock(mutex_);
  acknowledge_what_was_done(cycle);
  cycles_.push_back(cycle_of(cycle));
  begun_.emplace_back(cycle.cycle, cycle.time_ns);
  if (begun_.size() > kMostBegun) {
    begun_.pop_front();
  }
  if (cycles_.size() >= kMostCycles) {
    queue_samples();
    queue_cycles();
  }
  const auto& [a, b, c] = cycle.counts;
  const auto& [d, e, f] = cycle.gimbal_counts;
  counts_ = {a, b, c, d, e, f};
  newest_ns_ = cycle.time_ns;
}

void ViewFeed::push(const servo::ArrivedSample& sample) {
  const std::lock_guard lock(mutex_);
  samples_.push_back(sample_of(sample));
  if (samples_.size() >= kMostSamples) {
    queue_samples();
  }
}

void ViewFeed::send() {
  const std::lock_guard lock(mutex_);
  queue_samples();
  queue_cycles();
  if (newest_ns_ - last_arm_ns_ >= kArm_ns) {
    last_arm_ns_ = newest_ns_;
    queue_arm();
  }
  sender_->send();
}

void ViewFeed::note(const std::string& level, const std::string& component,
                    const std::string& text) {
  const json message = {{"level", level}, {"component", component}, {"text", text}};
  sender_->push(view_link::text_frame(
      type_of(FeedType::kNote), message.dump(-1, ' ', false, json::error_handler_t::replace)));
}

void ViewFeed::finish(const std::string& ended_by, int exit_status, const std::string& text,
                      bool motors_are_off) {
  {
    const std::lock_guard lock(mutex_);
    queue_samples();
    queue_cycles();
    if (stop_id_) {
      acknowledge(*stop_id_, "stop", motors_are_off,
                  motors_are_off ? "the device has taken zero current"
                                 : "the loop has ended; the device did not confirm zero current");
      stop_id_.reset();
    }
  }
  const json message = {{"ended_by", ended_by}, {"exit_status", exit_status}, {"text", text}};
  sender_->push(view_link::text_frame(
      type_of(FeedType::kEnd), message.dump(-1, ' ', false, json::error_handler_t::replace)));
  sender_->finish();
}

// With mutex_ held, as the next two. Samples go before the cycles that have used them.
void ViewFeed::queue_samples() {
  if (samples_.empty()) {
    return;
  }
  view_link::Frame frame{type_of(FeedType::kSamples), 0, {}};
  view_link::append(frame.payload, std::span<const FeedSample>(samples_));
  samples_.clear();
  sender_->queue(frame);
}

void ViewFeed::queue_cycles() {
  if (cycles_.empty()) {
    return;
  }
  view_link::Frame frame{type_of(FeedType::kCycles), 0, {}};
  view_link::append(frame.payload, std::span<const FeedCycle>(cycles_));
  cycles_.clear();
  sender_->queue(frame);
}

void ViewFeed::queue_arm() {
  sender_->queue_newest(arm_frame(profile_, *mechanism_, workspace_, counts_));
}

// With mutex_ held: the servo's own record says that it has obeyed.
void ViewFeed::acknowledge_what_was_done(const servo::CycleRecord& cycle) {
  if (stop_id_ && cycle.fault == servo::Fault::kEmergencyStop) {
    acknowledge(*stop_id_, "stop", true, "the servo has commanded zero current");
    stop_id_.reset();
  }
  const bool paused = cycle.held_back == servo::HeldBack::kPaused;
  if (method_id_ && cycle.rendered_method == ports_.rendered_method.load()) {
    acknowledge(*method_id_, "method", true, "the force fades to the chosen method's");
    method_id_.reset();
  }
  if (pause_id_ && paused == ports_.force_paused.load()) {
    acknowledge(*pause_id_, "pause", true, paused ? "the force fades out" : "the force ramps in");
    pause_id_.reset();
  }
}

void ViewFeed::acknowledge(std::int64_t id, const char* what, bool done, const std::string& text) {
  const json message = {{"id", id}, {"what", what}, {"done", done}, {"text", text}};
  sender_->push(
      view_link::text_frame(type_of(FeedType::kAcknowledged),
                            message.dump(-1, ' ', false, json::error_handler_t::replace)));
}

// On the sender's thread.
void ViewFeed::take_command(const view_link::Frame& frame) {
  if (frame.type != type_of(FeedType::kCommand) ||
      frame.payload.size() > view_link::kLargestCommand) {
    return;
  }
  const json command = json::parse(view_link::text_of(frame), nullptr, false);
  if (!command.is_object()) {
    return;
  }
  const auto number = command.find("id");
  const std::int64_t id =
      number != command.end() && number->is_number_integer() ? number->get<std::int64_t>() : 0;
  const auto named = command.find("what");
  const std::string what = named != command.end() && named->is_string() ? *named : json("");
  const std::lock_guard lock(mutex_);
  if (what == "stop") {
    stop_id_ = id;
    StopRequest::request_emergency(servo::EmergencySource::kView);
  } else if (what == "pause" && command.contains("value") && command["value"].is_boolean()) {
    pause_id_ = id;
    ports_.force_paused.store(command["value"].get<bool>());
  } else if (what == "hand" && command.contains("target_W_m")) {
    const json& target = command["target_W_m"];
    const bool is_point = target.is_array() && target.size() == 3 &&
                          std::all_of(target.begin(), target.end(),
                                      [](const json& value) { return value.is_number(); });
    if (is_point || target.is_null()) {
      move_hand(id, is_point ? std::optional(target.get<servo::Triple>()) : std::nullopt);
      return;
    }
    acknowledge(id, "hand", false, "target_W_m is three numbers [m], or null");
  } else if (what == "method" && command.contains("method") &&
             command["method"].is_number_unsigned() &&
             command["method"].get<std::uint64_t>() < methods_) {
    method_id_ = id;
    ports_.rendered_method.store(command["method"].get<std::uint8_t>());
  } else if (what == "set" && command.contains("name") && command["name"].is_string() &&
             command.contains("value")) {
    controls_->set(id, command["name"].get<std::string>(), command["value"]);
  } else if (what == "shown" && command.contains("cycle") &&
             command["cycle"].is_number_unsigned()) {
    take_shown(command["cycle"].get<std::uint64_t>());
  } else {
    acknowledge(id, what.c_str(), false, "this command is not known, or its value is missing");
  }
}

// The page has drawn this cycle, modulo 2^24.
void ViewFeed::take_shown(std::uint64_t cycle) {
  const auto shown = std::find_if(begun_.rbegin(), begun_.rend(), [cycle](const auto& one) {
    return one.first % (std::uint64_t{1} << 24) == cycle;
  });
  if (shown != begun_.rend()) {
    const std::int64_t now_ns = rt::Clock::now().time_since_epoch().count();
    picture_delay_ms_.add(1e-6 * static_cast<double>(now_ns - shown->second));
  }
}

rt::Percentiles ViewFeed::picture_delay_ms() {
  const std::lock_guard lock(mutex_);
  return picture_delay_ms_;
}

// The emulator has a socket for the hand's target: three doubles [m], frame D; NaN lets go.
void ViewFeed::move_hand(std::int64_t id, const std::optional<servo::Triple>& target_W_m) {
  if (hand_ < 0) {
    acknowledge(id, "hand", false, "only the hand of an emulated device can be moved");
    return;
  }
  constexpr double kNone = std::numeric_limits<double>::quiet_NaN();
  servo::Triple target_D_m{kNone, kNone, kNone};
  if (target_W_m) {
    target_D_m = rt::to_array(Eigen::Vector3d(rt::to_vector(*target_W_m) + workspace_.W_origin_D));
  }
  sockaddr_un address{};
  address.sun_family = AF_UNIX;
  hand_socket_.copy(address.sun_path, sizeof(address.sun_path) - 1);
  if (::sendto(hand_, target_D_m.data(), sizeof(target_D_m), MSG_NOSIGNAL,
               reinterpret_cast<const sockaddr*>(&address), sizeof(address)) < 0 &&
      errno != EAGAIN) {
    acknowledge(id, "hand", false, std::string("the emulated hand: ") + std::strerror(errno));
  }
}

}  // namespace forcegrid::cli
