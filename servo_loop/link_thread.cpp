// SPDX-License-Identifier: Apache-2.0
#include "servo_loop/link_thread.h"

#include <algorithm>
#include <bit>
#include <utility>

#include "rt/exception_text.h"
#include "rt/vectors.h"

namespace forcegrid::servo {
namespace {

// How long a new tool state may wait for its datagram: short against the simulator's period.
constexpr auto kPoll = std::chrono::milliseconds(1);

// Samples taken before the next tool state goes out: as many as a servo cycle takes at most. So a
// simulator that floods the link still gets the tool's position.
constexpr int kSamplesPerExchange = 64;

Eigen::Matrix3d to_matrix(const link::Matrix3& row_major) noexcept {
  return Eigen::Map<const Eigen::Matrix<double, 3, 3, Eigen::RowMajor>>(row_major.data());
}

ArrivedSample arrived_sample(const link::ForceSample& from, rt::TimePoint now) {
  ArrivedSample arrived;
  arrived.arrived = now;
  arrived.in_contact = from.in_contact;
  arrived.echo_sequence = from.echo_sequence;
  Sample& to = arrived.sample;
  to.time_s = 1e-9 * static_cast<double>(from.echo_servo_time_ns);
  to.position_W = rt::to_vector(from.position_W_m);
  to.force_W = rt::to_vector(from.force_W_N);
  to.has_stiffness = from.has_stiffness;
  to.stiffness_W = to_matrix(from.stiffness_W_N_per_m);
  to.contact_epoch = from.contact_epoch;
  to.contact_point_W = rt::to_vector(from.contact_point_W_m);
  to.relative_residual = from.relative_residual;
  to.converged = from.converged;
  to.from_query = from.query_id != 0;
  // The simulator of several tools solves for all at once, in a time that it tells each to the
  // nanosecond.
  to.solution = to.from_query ? 0 : std::bit_cast<std::uint64_t>(from.solve_time_s);
  arrived.has_torque = from.has_torque;
  arrived.has_rotational_stiffness = from.has_rotational_stiffness;
  arrived.torque_W_Nm = rt::to_vector(from.torque_W_Nm);
  arrived.orientation_WT_wxyz = from.orientation_WT;
  arrived.rotational_stiffness_W_Nm_per_rad = to_matrix(from.rotational_stiffness_W_Nm_per_rad);
  arrived.has_torque_gradient = from.has_torque_gradient;
  arrived.torque_gradient_W_N = to_matrix(from.torque_gradient_W_N);
  arrived.influence_count = from.influence_count;
  for (std::size_t other = 0; other < from.influence_count; ++other) {
    const link::ToolInfluence& influence = from.influences[other];
    arrived.influences[other] = {.tool = influence.tool,
                                 .echo_sequence = influence.echo_sequence,
                                 .position_W = rt::to_vector(influence.position_W_m),
                                 .stiffness_W = to_matrix(influence.stiffness_W_N_per_m)};
  }
  to.has_influence = arrived.influence_count == 1;
  if (to.has_influence) {
    to.influence_W = arrived.influences[0].stiffness_W;
    to.other_position_W = arrived.influences[0].position_W;
  }
  return arrived;
}

}  // namespace

LinkThread::LinkThread(std::string_view simulator_address, ServoPorts& ports,
                       std::vector<link::LinkKey> keys, link::ToolId tool)
    : ports_(ports),
      endpoint_(simulator_address, link::ServoEndpoint::random_session_id(), std::move(keys), tool,
                link::Content::kSensitivities) {}

LinkThread::~LinkThread() { stop(); }

void LinkThread::start() {
  thread_ = std::thread([this] {
    rt::name_current_thread("link");
    // An exception that left this thread would end the program before the loop could write zero
    // current. To the loop the simulator falls silent instead, and the force fades.
    try {
      while (!stop_.load(std::memory_order_acquire)) {
        exchange();
        endpoint_.wait(kPoll);
      }
      endpoint_.say_goodbye(fault_);
    } catch (...) {
      trouble_ = std::current_exception();
    }
  });
}

std::string LinkThread::trouble() const { return rt::text_of(trouble_); }

void LinkThread::stop(bool fault) {
  fault_ = fault;
  stop_.store(true, std::memory_order_release);
  if (thread_.joinable()) {
    thread_.join();
  }
}

void LinkThread::exchange() {
  link::ToolState tool;
  if (ports_.tool.fetch(tool)) {
    endpoint_.send(tool);  // what becomes of it is in statistics()
  }
  link::Query query;
  while (ports_.queries.pop(query)) {
    endpoint_.send(query);
  }
  for (int i = 0; i < kSamplesPerExchange; ++i) {
    const auto sample = endpoint_.receive();
    if (!sample) {
      break;
    }
    take(*sample);
  }
  nobody_listens_ = endpoint_.statistics().send_no_peer > unheard_before_;
  if (const auto patch = endpoint_.next_patch()) {
    if (const auto surface = near_surface(*patch)) {
      ports_.surface.publish(*surface);
    }
  }
  look_whether_barred();
  if (const auto others = endpoint_.next_others()) {
    others_ = *others;
    if (on_others_) {
      on_others_(others_);
    }
  }
  if (const link::ClockEstimate clock = endpoint_.clock(); clock.known) {
    ports_.simulator_clock.publish(clock);
  }
}

void LinkThread::look_whether_barred() noexcept {
  Barred barred = endpoint_.simulator_knows_one_tool() ? Barred::kKnowsOneTool : Barred::kNo;
  if (const auto& refusal = endpoint_.refusal()) {
    most_tools_ = refusal->most_tools;
    switch (refusal->reason) {
      case link::Refusal::Reason::kAllPlacesTaken:
        barred = Barred::kAllPlacesTaken;
        break;
      case link::Refusal::Reason::kToolTaken:
        barred = Barred::kToolTaken;
        break;
      case link::Refusal::Reason::kOtherFault:
        barred = Barred::kOtherFault;
        break;
    }
  }
  barred_ = barred;
}

void LinkThread::take(const link::ForceSample& sample) {
  worst_solve_time_s_ = std::max(worst_solve_time_s_, sample.solve_time_s);
  worst_relative_residual_ = std::max(worst_relative_residual_, sample.relative_residual);
  samples_not_converged_ += sample.converged ? 0 : 1;
  if (sample.in_contact && !first_contact_ && sample.query_id == 0) {
    first_contact_ = FirstContact{sample.echo_servo_time_ns, sample.contact_epoch,
                                  rt::to_vector(sample.contact_point_W_m)};
  }
  const ArrivedSample arrived = arrived_sample(sample, rt::Clock::now());
  newest_sample_ns_ = arrived.arrived.time_since_epoch().count();
  unheard_before_ = endpoint_.statistics().send_no_peer;
  if (!ports_.samples.push(arrived)) {
    ++samples_lost_;
    return;
  }
  if (on_sample_) {
    on_sample_(arrived);
  }
  if (samples_to_keep_ > 0) {
    if (samples_.size() == samples_to_keep_) {
      samples_.pop_front();
    }
    samples_.push_back(arrived);
  }
}

}  // namespace forcegrid::servo
