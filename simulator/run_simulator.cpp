#include "simulator/run_simulator.h"

#include <poll.h>
#include <sys/resource.h>

#include <algorithm>
#include <cerrno>
#include <chrono>
#include <cmath>
#include <cstring>
#include <deque>
#include <nlohmann/json.hpp>
#include <optional>
#include <ostream>

#include "link/simulator_endpoint.h"
#include "rt/clock.h"
#include "rt/percentiles.h"
#include "rt/thread.h"
#include "simulator/error.h"
#include "simulator/scene.h"

namespace forcegrid::simulator {
namespace {

constexpr double kMaxRate_Hz = 1000.0;
constexpr double kMaxDelay_s = 10.0;
constexpr int kMaxNice = 19;
constexpr auto kSilence = std::chrono::seconds(2);  // of a servo, until another may come
constexpr auto kStopCheck = std::chrono::milliseconds(50);
// A query is only begun when this many times the last one's time is left before the deadline.
constexpr double kQueryMargin = 2.0;
constexpr double kExpectedWithin_s = 0.3;
constexpr double kExpectedApart_m = 0.002;  // taking hold of another patch takes a while
constexpr double kQueryDecay = 0.7;         // of the expected time, each time that there was none

link::Access access(const SimulatorOptions& options) {
  link::Access access;
  access.keys = link::load_keys(options.key_files);
  for (const std::string& range : options.allowed) {
    access.allowed.emplace_back(range);
  }
  return access;
}

void check(const SimulatorOptions& options) {
  if (!(options.rate_Hz > 0.0 && options.rate_Hz <= kMaxRate_Hz)) {
    throw Error("simulator: rate is " + std::to_string(options.rate_Hz) +
                " Hz; give more than 0 and at most " + std::to_string(kMaxRate_Hz));
  }
  if (!(options.answer_delay_s >= 0.0 && options.answer_delay_s <= kMaxDelay_s)) {
    throw Error("simulator: answer delay is " + std::to_string(options.answer_delay_s) +
                " s; give 0 to " + std::to_string(kMaxDelay_s));
  }
  if (options.nice < 0 || options.nice > kMaxNice) {
    throw Error("simulator: nice is " + std::to_string(options.nice) + "; give 0 to " +
                std::to_string(kMaxNice));
  }
}

link::Vector3 to_array(const Eigen::Vector3d& v) { return {v.x(), v.y(), v.z()}; }
Eigen::Vector3d to_vector(const link::Vector3& a) { return {a[0], a[1], a[2]}; }

void fill(link::ForceSample& sample, const StickyContact::Answer& answer, bool send_stiffness) {
  sample.contact_epoch = answer.epoch;
  sample.in_contact = answer.in_contact;
  sample.converged = answer.equilibrium.converged;
  sample.position_W_m = to_array(answer.position_W);
  sample.force_W_N = to_array(answer.equilibrium.force_W);
  sample.has_stiffness = send_stiffness;
  if (send_stiffness) {
    for (std::size_t row = 0; row < 3; ++row) {
      for (std::size_t column = 0; column < 3; ++column) {
        sample.stiffness_W_N_per_m[3 * row + column] = answer.equilibrium.stiffness_W(
            static_cast<Eigen::Index>(row), static_cast<Eigen::Index>(column));
      }
    }
  }
  sample.contact_point_W_m = to_array(answer.point_W);
  sample.relative_residual = answer.equilibrium.relative_residual;
  sample.solve_time_s = answer.equilibrium.solve_time_s;
}

bool finite(const Equilibrium& equilibrium) {
  return equilibrium.force_W.allFinite() && equilibrium.stiffness_W.allFinite() &&
         std::isfinite(equilibrium.relative_residual);
}

class Loop {
 public:
  Loop(const SimulatorOptions& options, const Scene& scene, std::ostream& log)
      : options_(options),
        log_(log),
        endpoint_(options.listen, kSilence, access(options)),
        object_(scene.mesh, options.solver),
        query_object_(scene.mesh, options.solver),
        patch_radius_m_(scene.patch_radius_m),
        contact_(scene.mesh, {.patch_radius_m = scene.patch_radius_m}),
        period_(rt::from_seconds(1.0 / options.rate_Hz)),
        delay_(rt::from_seconds(options.answer_delay_s)) {
    summary_.scene = scene.name;
    summary_.listening = link::to_string(endpoint_.address());
    summary_.vertices = object_.vertex_count();
    summary_.springs = object_.spring_count();
    summary_.rate_Hz = options.rate_Hz;
  }

  const SimulatorSummary& summary() const { return summary_; }

  SimulatorSummary run(const std::atomic<bool>& stop, int stop_fd) {
    pollfd watched{stop_fd, POLLIN, 0};
    rt::TimePoint deadline = rt::Clock::now() + period_;
    // A negative descriptor is ignored by poll.
    while (!stop.load(std::memory_order_relaxed) && ::poll(&watched, 1, 0) <= 0) {
      const rt::TimePoint now = rt::Clock::now();
      send_due(now);
      if (now < deadline) {
        wait_until(deadline);
        continue;
      }
      tick();
      ++summary_.ticks;
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
  struct Delayed {
    rt::TimePoint due;
    link::ForceSample sample;
  };

  void wait_until(rt::TimePoint deadline) {
    if (answer_one_query(deadline)) {
      return;
    }
    rt::TimePoint wake = std::min(deadline, rt::Clock::now() + kStopCheck);
    if (!delayed_.empty()) {
      wake = std::min(wake, delayed_.front().due);
    }
    rt::sleep_until(wake);
    receive();
  }

  void receive() {
    const link::SimulatorEndpoint::News news = endpoint_.receive(std::chrono::nanoseconds(0));
    if (news.new_session) {
      ++summary_.sessions;
      begin_anew();
    }
    if (news.servo_ended) {
      begin_anew();
    }
    if (news.tool_state) {
      newest_ = news.tool_state;
    }
    queries_ = news.queries;
    report_strangers();
  }

  // Who wonders why no force comes is told; once, since a stranger could fill a disk.
  void report_strangers() {
    using link::SealStatus;
    const link::LinkStatistics& counted = endpoint_.statistics();
    const auto refused = [&](SealStatus status) {
      return counted.seal_refused[static_cast<std::size_t>(status)];
    };
    if (told_of_strangers_ || counted.not_allowed + refused(SealStatus::kNotSealed) +
                                      refused(SealStatus::kUnknownKey) +
                                      refused(SealStatus::kForged) ==
                                  0) {
      return;
    }
    told_of_strangers_ = true;
    log_ << "simulator: datagrams are refused (" << link::drop_text(counted)
         << "); if they are your servo's, give it this simulator's key, and --allow its address"
         << std::endl;
  }

  void begin_anew() {
    contact_.reset(object_);
    query_object_.release();
    newest_.reset();
    delayed_.clear();
    contact_answer_.reset();
    expected_W_.reset();
    epoch_ = 0;
    lost_epochs_ = 0;
  }

  void tick() {
    receive();
    if (!newest_) {
      return;
    }
    link::ForceSample sample = link::answer_to(*newest_);
    const Eigen::Vector3d position_W = to_vector(newest_->position_W_m);
    const Eigen::Vector3d velocity_W = to_vector(newest_->velocity_W_m_per_s);
    newest_.reset();
    const bool was_in_contact = contact_.in_contact();
    const rt::TimePoint start = rt::Clock::now();
    const StickyContact::Answer answer = contact_.step(object_, position_W);
    const double solve_s = rt::seconds(rt::Clock::now() - start);
    if (!finite(answer.equilibrium)) {
      // The link would refuse it, and the state can't be trusted any more.
      ++summary_.not_finite;
      lost_epochs_ += answer.epoch;
      contact_.reset(object_);
      return;
    }
    epoch_ = answer.epoch;
    expect_contact(position_W, velocity_W);
    if (answer.in_contact) {
      count(answer, was_in_contact, 1e3 * solve_s);
      contact_answer_ = answer;
    }
    fill(sample, answer, options_.send_stiffness);
    if (expected_W_) {
      sample.contact_point_W_m = to_array(*expected_W_);
    }
    sample.solve_time_s = solve_s;
    sample.contact_epoch += lost_epochs_;
    if (delay_ > rt::Duration::zero()) {
      delayed_.push_back({rt::Clock::now() + delay_, sample});
    } else {
      send(sample);
    }
  }

  void expect_contact(const Eigen::Vector3d& position_W, const Eigen::Vector3d& velocity_W) {
    const auto touch_W = contact_.expected_touch(position_W, velocity_W, kExpectedWithin_s);
    if (!touch_W) {
      expected_W_.reset();
    } else if (!expected_W_ || (*touch_W - *expected_W_).norm() > kExpectedApart_m) {
      expected_W_ = touch_W;
    }
  }

  void count(const StickyContact::Answer& answer, bool was_in_contact, double solve_ms) {
    const Equilibrium& equilibrium = answer.equilibrium;
    if (was_in_contact) {
      solve_ms_.add(solve_ms);
      iterations_ += static_cast<std::uint64_t>(equilibrium.iterations);
    } else {
      ++summary_.contacts;
      summary_.grab_max_ms = std::max(summary_.grab_max_ms, solve_ms);
    }
    summary_.unconverged += equilibrium.converged ? 0 : 1;
    summary_.branch_changes += equilibrium.left_branch ? 1 : 0;
    summary_.not_reached += equilibrium.reached ? 0 : 1;
    summary_.worst_relative_residual =
        std::max(summary_.worst_relative_residual, equilibrium.relative_residual);
  }

  void send(const link::ForceSample& sample) {
    if (endpoint_.send(sample) == link::SendStatus::kSent) {
      ++summary_.answers;
    } else {
      ++summary_.send_failures;
    }
  }

  void send_due(rt::TimePoint now) {
    while (!delayed_.empty() && delayed_.front().due <= now) {
      send(delayed_.front().sample);
      delayed_.pop_front();
    }
  }

  // @returns true when it took time over one.
  bool answer_one_query(rt::TimePoint deadline) {
    if (queries_ == 0) {
      return false;
    }
    if (rt::seconds(deadline - rt::Clock::now()) < kQueryMargin * expected_query_s_) {
      expected_query_s_ *= kQueryDecay;  // one slow answer must not be the last
      return false;
    }
    const std::optional<link::Query> query = endpoint_.next_query();
    if (!query) {
      queries_ = 0;
      return false;
    }
    --queries_;
    rt::TimePoint start = rt::Clock::now();
    link::ForceSample reply = link::answer_to(*query);
    StickyContact::Answer answer;
    answer.position_W = to_vector(query->position_W_m);
    answer.point_W = answer.position_W;
    answer.equilibrium.converged = true;
    const bool held = contact_.in_contact() && contact_answer_;
    if (held || expected_W_) {
      answer.in_contact = true;
      answer.epoch = epoch_ + lost_epochs_;
      answer.point_W = held ? contact_answer_->point_W : *expected_W_;
      if (!query_object_.grabbed() || query_point_W_ != answer.point_W) {
        query_object_.release();
        query_point_W_ = answer.point_W;
        answer.in_contact = query_object_.grab(answer.point_W, patch_radius_m_) > 0;
        start = rt::Clock::now();  // once a contact, and no measure of the answers to come
      }
    }
    if (answer.in_contact) {
      answer.equilibrium = query_object_.move_to(answer.position_W - answer.point_W);
      answer.position_W = answer.point_W + answer.equilibrium.displacement_W;
    }
    expected_query_s_ = rt::seconds(rt::Clock::now() - start);
    if (!finite(answer.equilibrium)) {
      ++summary_.not_finite;
      query_object_.release();
      return true;
    }
    fill(reply, answer, options_.send_stiffness);
    reply.solve_time_s = expected_query_s_;
    if (endpoint_.send(reply) == link::SendStatus::kSent) {
      ++summary_.replies;
    } else {
      ++summary_.send_failures;
    }
    return true;
  }

  void finish() {
    summary_.dropped = link::drop_reasons(endpoint_.statistics());
    summary_.solve_mean_ms = solve_ms_.mean();
    summary_.solve_p50_ms = solve_ms_.at(0.5);
    summary_.solve_p99_ms = solve_ms_.at(0.99);
    summary_.solve_max_ms = solve_ms_.max();
    summary_.iterations_mean = solve_ms_.count() == 0 ? 0.0
                                                      : static_cast<double>(iterations_) /
                                                            static_cast<double>(solve_ms_.count());
  }

  SimulatorOptions options_;
  std::ostream& log_;
  bool told_of_strangers_ = false;
  link::SimulatorEndpoint endpoint_;
  ElasticObject<float> object_;
  ElasticObject<float> query_object_;  // queries must not disturb the warm start along the path
  double patch_radius_m_;
  StickyContact contact_;
  rt::Duration period_;
  rt::Duration delay_;
  std::optional<link::ToolState> newest_;
  std::optional<StickyContact::Answer> contact_answer_;
  std::uint32_t epoch_ = 0;                    ///< of the newest answer, without the lost ones
  std::optional<Eigen::Vector3d> expected_W_;  ///< where the tool will touch soon
  Eigen::Vector3d query_point_W_ = Eigen::Vector3d::Zero();  ///< where query_object_ is held
  std::size_t queries_ = 0;
  double expected_query_s_ = 0.0;  ///< how long an answer takes, from the last one
  std::uint32_t lost_epochs_ = 0;
  std::deque<Delayed> delayed_;
  rt::Percentiles solve_ms_;
  std::uint64_t iterations_ = 0;
  SimulatorSummary summary_;
};

}  // namespace

SimulatorSummary run_simulator(const SimulatorOptions& options, std::ostream& out,
                               std::ostream& log, const std::atomic<bool>& stop, int stop_fd) {
  check(options);
  const Scene scene = make_scene(options.scene, options.top_centre_W);
  if (!scene.note.empty()) {
    log << "scene " << scene.name << ": " << scene.note << '\n';
  }
  Loop loop(options, scene, log);
  rt::name_current_thread("fg-simulator");
  if (::setpriority(PRIO_PROCESS, 0, options.nice) != 0) {
    log << "simulator: nice " << options.nice << " was refused (" << std::strerror(errno)
        << "); it runs at the priority it was started with\n";
  }
  const SimulatorSummary& summary = loop.summary();
  out << "listening " << summary.listening << " scene " << summary.scene << " vertices "
      << summary.vertices << " springs " << summary.springs << std::endl;
  return loop.run(stop, stop_fd);
}

nlohmann::json to_json(const SimulatorSummary& summary) {
  return {{"scene", summary.scene},
          {"listening", summary.listening},
          {"vertices", summary.vertices},
          {"springs", summary.springs},
          {"rate_Hz", summary.rate_Hz},
          {"sessions", summary.sessions},
          {"ticks", summary.ticks},
          {"answers", summary.answers},
          {"replies", summary.replies},
          {"late_ticks", summary.late_ticks},
          {"missed_ticks", summary.missed_ticks},
          {"send_failures", summary.send_failures},
          {"datagrams_dropped",
           nlohmann::json::object_t(summary.dropped.begin(), summary.dropped.end())},
          {"contacts", summary.contacts},
          {"unconverged", summary.unconverged},
          {"branch_changes", summary.branch_changes},
          {"not_reached", summary.not_reached},
          {"not_finite", summary.not_finite},
          {"worst_relative_residual", summary.worst_relative_residual},
          {"solve_ms",
           {{"mean", summary.solve_mean_ms},
            {"p50", summary.solve_p50_ms},
            {"p99", summary.solve_p99_ms},
            {"max", summary.solve_max_ms}}},
          {"grab_max_ms", summary.grab_max_ms},
          {"iterations_mean", summary.iterations_mean}};
}

}  // namespace forcegrid::simulator
