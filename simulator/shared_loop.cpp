// SPDX-License-Identifier: Apache-2.0
#include "simulator/shared_loop.h"

#include <poll.h>

#include <algorithm>
#include <chrono>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <variant>
#include <vector>

#include "link/simulator_endpoint.h"
#include "log/log.h"
#include "rt/clock.h"
#include "rt/percentiles.h"
#include "rt/thread.h"
#include "rt/thread_time.h"
#include "rt/vectors.h"
#include "simulator/impaired_link.h"
#include "simulator/loop_parts.h"
#include "simulator/mesh/error.h"
#include "simulator/predicted_contact.h"
#include "simulator/surface_stream.h"
#include "simulator/touch/shared_contact.h"
#include "simulator/workers/query_solver.h"

namespace forcegrid::simulator {
namespace {

// Between looks at the socket: how old a tool's position may look younger than it is.
constexpr auto kPoll = std::chrono::milliseconds(2);
// What is kept of the longest query's time, a tick and a query.
constexpr double kForgetting = 7.0 / 8.0;

std::string name_of_tool(link::ToolId tool) {
  return tool == 0 ? "the tool without a number" : "tool " + std::to_string(tool);
}

}  // namespace

void check_several_tools(const SimulatorOptions& options) {
  const std::string who = "simulator: --tools " + std::to_string(options.tools) + ": ";
  if (options.tools > link::kMostTools) {
    throw Error(who + "a simulator serves at most " + std::to_string(link::kMostTools));
  }
  if (!options.workers.empty()) {
    throw Error(who + "workers know one tool; leave --workers out");
  }
  if (!options.control.empty()) {
    throw Error(who + "the view's controls know one tool; leave --control out");
  }
  if (options.material_tolerance_percent) {
    throw Error(who + "models are compared under one tool; leave --material-tolerance-percent out");
  }
  if (options.solver_kind && *options.solver_kind != SolverKind::kQuasiStatic) {
    throw Error(who + "solver " + to_string(*options.solver_kind) +
                " knows one tool; give --solver quasi_static or leave it out");
  }
}

class SharedLoop::State {
 public:
  State(const SimulatorOptions& options, const Scene& scene, const SolverChoice& solver,
        const ToolOptions& tool)
      : options_((check_several_tools(options), options)),
        endpoint_(options.listen, kServoSilence, access_of(options), options.tools),
        contact_(scene, solver.options, tool, options.tools),
        period_(rt::from_seconds(1.0 / options.rate_Hz)) {
    for (std::size_t place = 0; place < options.tools; ++place) {
      places_.push_back(std::make_unique<Place>(
          scene, tool,
          ImpairedLink(
              [this, place](const ImpairedLink::Message& message) { send(place, message); },
              options.link_conditions, options.link_seed + place)));
    }
    if (!options.surface.empty()) {
      surface_ = std::make_unique<SurfaceStream>(scene.mesh, options.surface);
    }
    summary_.scene = scene.name;
    summary_.tool = tool.shape;
    summary_.contact = tool.contact;
    summary_.listening = link::to_string(endpoint_.address());
    summary_.vertices = contact_.vertex_count();
    summary_.springs = contact_.spring_count();
    summary_.solver = to_string(solver.kind);
    summary_.solver_why = solver.why;
    summary_.rate_Hz = options.rate_Hz;
  }

  const SimulatorSummary& summary() const noexcept { return summary_; }

  SimulatorSummary run(const std::atomic<bool>& stop, int stop_fd) {
    pollfd watched{stop_fd, POLLIN, 0};
    rt::TimePoint deadline = rt::Clock::now() + period_;
    // A negative descriptor is ignored by poll.
    while (!stop.load(std::memory_order_relaxed) && ::poll(&watched, 1, 0) <= 0) {
      const rt::TimePoint now = rt::Clock::now();
      for (const auto& place : places_) {
        place->impaired.send_due(now);
      }
      if (now < deadline) {
        if (!answer_query(now, deadline)) {
          wait_until(std::min(deadline, now + kPoll));
        }
        continue;
      }
      tick();
      show_surface();
      ++summary_.ticks;
      longest_query_s_ *= kForgetting;  // one long query does not bar all that come
      deadline += period_;
      const rt::TimePoint done = rt::Clock::now();
      summary_.late_ticks += done >= deadline ? 1 : 0;
      while (done >= deadline + period_) {
        deadline += period_;
        ++summary_.missed_ticks;
      }
    }
    finish();
    return summary_;
  }

 private:
  struct Place {
    Place(const Scene& scene, const ToolOptions& tool, ImpairedLink link)
        : predicted(scene, tool), impaired(std::move(link)) {}

    PredictedContact predicted;
    ImpairedLink impaired;
    bool served = false;
    bool must_go = false;                   // its servo was here when another one failed
    std::optional<link::ToolState> newest;  // not answered yet
    link::ToolState last;                   // the newest of all
    rt::TimePoint heard{};                  // when it came
    std::uint32_t moved_by = 0;             // number of the state at which the tool stands
    SimulatorSummary::ToolUse use;
  };

  void wait_until(rt::TimePoint wake) {
    for (const auto& place : places_) {
      wake = std::min(wake, place->impaired.next().value_or(wake));
    }
    rt::sleep_until(wake);
    receive();
  }

  void receive() {
    const auto news = endpoint_.receive_all(std::chrono::nanoseconds(0));
    const rt::TimePoint now = rt::Clock::now();
    for (std::size_t p = 0; p < places_.size(); ++p) {
      Place& place = *places_[p];
      if (news[p].servo_failed) {
        fail(place.use.tool, "has ended because of a fault");
      }
      if (news[p].servo_ended || news[p].new_session) {
        let_go(p);
      }
      if (news[p].new_session) {
        ++summary_.sessions;
        ++place.use.sessions;
        place.served = true;
      }
      if (news[p].tool_state) {
        place.newest = news[p].tool_state;
        place.last = *news[p].tool_state;
        place.heard = now;
        place.use.tool = endpoint_.tool(p);
      }
      if (place.served && !endpoint_.servo_alive(p)) {
        fail(place.use.tool, "has fallen silent");
        let_go(p);
      }
    }
    report_strangers();
  }

  // Logged once only, since a stranger could fill a disk.
  void report_strangers() {
    const link::LinkStatistics& counted = endpoint_.statistics();
    if (!warned_of_strangers_ && counted.dropped() > 0 &&
        counted.not_allowed + counted.foreign_session > 0) {
      warned_of_strangers_ = true;
      log::warn("simulator", "simulator: datagrams are refused (" + link::drop_text(counted) +
                                 "); it has " + std::to_string(places_.size()) +
                                 " places for tools, each with a number of its own");
    }
  }

  void fail(link::ToolId tool, const char* how) {
    ++summary_.faults;
    for (const auto& place : places_) {
      place->must_go = options_.fault_stops_all && place->served;
    }
    log::warn("simulator", "simulator: the servo of " + name_of_tool(tool) + " " + how +
                               (options_.fault_stops_all ? "; every tool stops (--fault-stops all)"
                                                         : "; the tool lets go"));
  }

  // Whether a servo has failed and one of those that were there has not gone yet.
  bool stopped() const {
    return std::ranges::any_of(places_, [](const auto& place) { return place->must_go; });
  }

  void let_go(std::size_t p) {
    Place& place = *places_[p];
    place.must_go = false;
    contact_.reset(p);
    place.predicted.begin_anew();
    place.impaired.clear();
    place.newest.reset();
    place.served = false;
  }

  void tick() {
    receive();
    if (stopped()) {
      refuse_all();
      return;
    }
    const rt::TimePoint start = rt::Clock::now();
    bool touching = false;
    bool made_contact = false;
    for (std::size_t p = 0; p < places_.size(); ++p) {
      if (places_[p]->newest) {
        const bool was_in_contact = contact_.in_contact(p);
        move(p, *places_[p]->newest);
        const bool made = contact_.in_contact(p) && !was_in_contact;
        made_contact = made_contact || made;
        places_[p]->use.contacts += made ? 1 : 0;
        summary_.contacts += made ? 1 : 0;
      }
      touching = touching || contact_.in_contact(p);
    }
    contact_.solve();
    const double solve_s = rt::seconds(rt::Clock::now() - start);
    if (touching && !made_contact) {
      solve_us_.add(1e6 * solve_s);
    } else if (made_contact) {
      summary_.grab_max_ms = std::max(summary_.grab_max_ms, 1e3 * solve_s);
    }
    for (std::size_t p = 0; p < places_.size(); ++p) {
      if (!finite(contact_.answer(p).equilibrium)) {
        // The link would refuse it, and the state can no longer be trusted.
        ++summary_.not_finite;
        contact_.start_over();
        return;
      }
    }
    for (std::size_t p = 0; p < places_.size(); ++p) {
      if (places_[p]->newest) {
        answer(p, solve_s);
        places_[p]->newest.reset();
      }
    }
  }

  void move(std::size_t p, const link::ToolState& state) {
    if (state.has_orientation) {
      const link::Quaternion& q = state.orientation_WT;
      contact_.turn_to(p, Eigen::Quaterniond(q[0], q[1], q[2], q[3]));
    }
    contact_.move(p, rt::to_vector(state.position_W_m));
    places_[p]->moved_by = state.sequence;
  }

  // One query of the next tool that has one, if there is time. The state is as of the last tick.
  bool answer_query(rt::TimePoint now, rt::TimePoint deadline) {
    if (stopped() || now + rt::from_seconds(longest_query_s_) >= deadline) {
      return false;
    }
    for (std::size_t tried = 0; tried < places_.size(); ++tried) {
      turn_ = (turn_ + 1) % places_.size();
      const auto query = endpoint_.next_query(turn_);
      if (!query) {
        continue;
      }
      // Its own work: where others hold the core, a tick is late whatever came before it.
      const double start_s = rt::thread_time_s();
      const SharedContact::Answer answer = contact_.ask(turn_, rt::to_vector(query->position_W_m));
      if (!finite(answer.equilibrium)) {
        ++summary_.not_finite;
        contact_.start_over();
        return true;
      }
      const rt::TimePoint done = rt::Clock::now();
      longest_query_s_ = std::max(rt::thread_time_s() - start_s, kForgetting * longest_query_s_);
      link::ForceSample sample = link::answer_to(*query);
      fill(sample, answer, options_.send_stiffness);
      sample.solve_time_s = rt::seconds(done - now);
      places_[turn_]->impaired.send(sample, done);
      receive();
      return true;
    }
    return false;
  }

  // After the samples were sent, which must not wait for it.
  void show_surface() {
    if (!surface_) {
      return;
    }
    surface_->touch();
    show_timed(
        *surface_,
        [this](const std::vector<std::int32_t>& vertices, std::vector<Eigen::Vector3d>& at_W) {
          contact_.copy_positions(vertices, at_W);
        },
        surface_us_);
  }

  // A servo of version 1 does not know refusals: its force fades without samples.
  void refuse_all() {
    const link::Refusal refusal = {link::Refusal::Reason::kOtherFault,
                                   static_cast<std::uint32_t>(places_.size())};
    for (std::size_t p = 0; p < places_.size(); ++p) {
      places_[p]->impaired.clear();
      if (std::exchange(places_[p]->newest, std::nullopt) && endpoint_.tool(p) != 0) {
        endpoint_.send(refusal, p);
      }
    }
  }

  void answer(std::size_t p, double solve_s) {
    Place& place = *places_[p];
    const link::ToolState& state = *place.newest;
    const SharedContact::Answer& answer = contact_.answer(p);
    const Eigen::Vector3d position_W = rt::to_vector(state.position_W_m);
    const Eigen::Vector3d velocity_W = rt::to_vector(state.velocity_W_m_per_s);
    place.predicted.look(
        [&](double within_s) {
          return contact_.expected_touch(p, position_W, velocity_W, within_s);
        },
        velocity_W);
    if (answer.in_contact) {
      count(answer.equilibrium);
    }
    link::ForceSample sample = link::answer_to(state);
    fill(sample, answer, options_.send_stiffness);
    if (place.predicted.expected_W()) {
      sample.contact_point_W_m = rt::to_array(*place.predicted.expected_W());
    }
    sample.solve_time_s = solve_s;
    if (options_.send_stiffness && endpoint_.knows_sensitivities(p)) {
      tell_influences(p, sample);
    }
    const rt::TimePoint now = rt::Clock::now();
    place.impaired.send(sample, now);
    link::SurfacePatch patch = link::patch_for(state);
    patch.contact_epoch = sample.contact_epoch;
    if (!answer.in_contact && place.predicted.cut(patch)) {
      place.impaired.send(patch, now);
    }
    if (endpoint_.tool(p) == 0) {
      return;  // version 1 has no message for it
    }
    const link::OtherTools others = others_of(p, now);
    if (others.count > 0) {
      place.impaired.send(others, now);
    }
  }

  // How the force changes with each of the other tools in contact.
  void tell_influences(std::size_t p, link::ForceSample& sample) const {
    for (std::size_t other = 0; other < places_.size(); ++other) {
      const auto stiffness_W = other == p ? std::nullopt : contact_.stiffness_W(p, other);
      if (stiffness_W) {
        link::ToolInfluence& influence = sample.influences[sample.influence_count++];
        influence.tool = places_[other]->use.tool;
        influence.echo_sequence = places_[other]->moved_by;
        influence.position_W_m = rt::to_array(contact_.answer(other).position_W);
        to_row_major(*stiffness_W, influence.stiffness_W_N_per_m);
      }
    }
  }

  link::OtherTools others_of(std::size_t p, rt::TimePoint now) const {
    link::OtherTools others;
    for (std::size_t other = 0; other < places_.size(); ++other) {
      const Place& place = *places_[other];
      if (other != p && place.served) {
        others.tools[others.count++] = {
            .tool = place.use.tool,
            .in_contact = contact_.in_contact(other),
            .age_ns =
                std::chrono::duration_cast<std::chrono::nanoseconds>(now - place.heard).count(),
            .position_W_m = place.last.position_W_m};
      }
    }
    return others;
  }

  void count(const Equilibrium& equilibrium) {
    iterations_ += static_cast<std::uint64_t>(equilibrium.iterations);
    ++answers_in_contact_;
    summary_.unconverged += equilibrium.converged ? 0 : 1;
    summary_.branch_changes += equilibrium.left_branch ? 1 : 0;
    summary_.not_reached += equilibrium.reached ? 0 : 1;
    summary_.worst_relative_residual =
        std::max(summary_.worst_relative_residual, equilibrium.relative_residual);
  }

  // To the socket.
  void send(std::size_t p, const ImpairedLink::Message& message) {
    link::SendStatus status = link::SendStatus::kSent;
    if (const auto* const sample = std::get_if<link::ForceSample>(&message)) {
      status = endpoint_.send(*sample, p);
      const bool sent = status == link::SendStatus::kSent;
      if (sample->query_id != 0) {
        summary_.replies += sent ? 1 : 0;
      } else {
        summary_.answers += sent ? 1 : 0;
        places_[p]->use.answers += sent ? 1 : 0;
      }
    } else if (const auto* const patch = std::get_if<link::SurfacePatch>(&message)) {
      status = endpoint_.send(*patch, p);
      summary_.patches += status == link::SendStatus::kSent ? 1 : 0;
    } else {
      status = endpoint_.send(std::get<link::OtherTools>(message), p);
    }
    summary_.send_failures += status == link::SendStatus::kSent ? 0 : 1;
  }

  void finish() {
    summary_.dropped = link::drop_reasons(endpoint_.statistics());
    for (const auto& place : places_) {
      summary_.delayed += place->impaired.counts().delayed;
      summary_.lost_on_purpose += place->impaired.counts().lost;
      summary_.tools.push_back(place->use);
    }
    if (surface_) {
      summary_.surface = surface_use(*surface_, surface_us_);
    }
    summary_.link = options_.link_conditions;
    summary_.solve_mean_ms = 1e-3 * solve_us_.mean();
    summary_.solve_p50_ms = 1e-3 * solve_us_.at(0.5);
    summary_.solve_p99_ms = 1e-3 * solve_us_.at(0.99);
    summary_.solve_max_ms = 1e-3 * solve_us_.max();
    summary_.iterations_mean =
        answers_in_contact_ == 0
            ? 0.0
            : static_cast<double>(iterations_) / static_cast<double>(answers_in_contact_);
  }

  SimulatorOptions options_;
  link::SimulatorEndpoint endpoint_;
  SharedContact contact_;
  rt::Duration period_;
  std::vector<std::unique_ptr<Place>> places_;
  std::size_t turn_ = 0;          // of the place whose query was answered last
  double longest_query_s_ = 0.0;  // [s] processor time, of the newest ones
  bool warned_of_strangers_ = false;
  std::unique_ptr<SurfaceStream> surface_;  // null: nobody watches
  rt::Percentiles surface_us_;
  rt::Percentiles solve_us_;
  std::uint64_t iterations_ = 0;
  std::uint64_t answers_in_contact_ = 0;
  SimulatorSummary summary_;
};

SharedLoop::SharedLoop(const SimulatorOptions& options, const Scene& scene,
                       const SolverChoice& solver, const ToolOptions& tool)
    : state_(std::make_unique<State>(options, scene, solver, tool)) {}
SharedLoop::~SharedLoop() = default;
const SimulatorSummary& SharedLoop::summary() const noexcept { return state_->summary(); }
SimulatorSummary SharedLoop::run(const std::atomic<bool>& stop, int stop_fd) {
  return state_->run(stop, stop_fd);
}

}  // namespace forcegrid::simulator
