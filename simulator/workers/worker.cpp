// SPDX-License-Identifier: Apache-2.0
#include "simulator/workers/worker.h"

#include <poll.h>
#include <sys/resource.h>
#include <unistd.h>

#include <array>
#include <optional>
#include <ostream>
#include <string>
#include <string_view>

#include "log/log.h"
#include "rt/clock.h"
#include "rt/thread.h"
#include "simulator/mesh/error.h"
#include "simulator/solver/solver_kind.h"
#include "simulator/workers/loading.h"
#include "simulator/workers/worker_protocol.h"
#include "simulator/workers/worker_socket.h"

namespace forcegrid::simulator {
namespace {

constexpr auto kHelloPeriod = std::chrono::seconds(1);
constexpr auto kStopCheck = std::chrono::milliseconds(100);
constexpr auto kUnwelcome = std::chrono::seconds(5);
constexpr std::string_view kScheme = "tcp://";

link::Address simulators_address(const std::string& connect) {
  if (!connect.starts_with(kScheme)) {
    throw Error("worker: '" + connect +
                "' is not an address for workers; write tcp://ADDR:PORT, as 'forcegrid simulate "
                "--workers' prints it");
  }
  return link::parse_address(connect.substr(kScheme.size()), link::PortZero::kRefused,
                             link::Reach::kNetwork);
}

std::string own_name() {
  std::array<char, 256> host{};
  const bool known = ::gethostname(host.data(), host.size() - 1) == 0;
  return std::string(known ? host.data() : "unknown") + ":" + std::to_string(::getpid());
}

Scene load(const WorkerOptions& options, std::ostream& out, const std::atomic<bool>& stop) {
  const rt::Supervised supervised(
      loading_supervision(options.scene, stop, options.say_loading ? &out : nullptr));
  return make_scene(options.scene);
}

class Work {
 public:
  Work(const WorkerOptions& options, std::ostream& out, const std::atomic<bool>& stop)
      : options_(options),
        out_(out),
        address_(simulators_address(options.connect)),
        key_(link::LinkKey::load(options.key_file)),
        scene_(load(options, out, stop)),
        hello_(to_text(WorkerHello{own_name(), digest_of(scene_)})) {
    connect_as_worker(socket_, address_, key_);
  }

  std::uint64_t run(const std::atomic<bool>& stop, int stop_fd) {
    pollfd watched{stop_fd, POLLIN, 0};
    while (!stop.load(std::memory_order_relaxed) && ::poll(&watched, 1, 0) <= 0) {
      say_hello(rt::Clock::now());
      wait_for_message(socket_, kStopCheck);
      if (const auto frames = receive(socket_)) {
        take(frames->front());
      }
    }
    return answered_;
  }

 private:
  void say_hello(rt::TimePoint now) {
    if (now >= next_hello_) {
      send(socket_, {hello_});
      next_hello_ = now + kHelloPeriod;
    }
    if (!solver_ && !complained_ && now - begun_ > kUnwelcome) {
      complained_ = true;
      log::warn("worker", "worker: no welcome from " + options_.connect +
                              " yet; is there a simulator with --workers at that address, and does "
                              "it have this key? Still trying");
    }
  }

  void take(const std::string& text) {
    if (const auto job = read_job(text)) {
      const auto answer = solver_ ? std::optional(solver_->answer(job->job)) : std::nullopt;
      if (!answer || !finite(answer->equilibrium)) {
        send(socket_, {gave_up_text(job->id)});
        return;
      }
      answered_ += send(socket_, {to_text(NumberedAnswer{job->id, *answer})}) ? 1 : 0;
    } else if (const auto reason = read_refusal(text)) {
      throw Error("worker: refused by " + options_.connect + ": " + *reason);
    } else if (const auto solver = read_welcome(text, options_.solver)) {
      // A restarted simulator may have another solver.
      const bool first = !solver_;
      solver_.emplace(scene_, *solver);
      if (first) {
        out_ << "working for " << options_.connect << " on scene " << scene_.name << ", solver "
             << to_string(solver->border_tolerance > 0.0 ? SolverKind::kLocal
                                                         : SolverKind::kQuasiStatic)
             << std::endl;
      }
    }
  }

  const WorkerOptions& options_;
  std::ostream& out_;
  link::Address address_;  // an error here is reported before the scene is made
  link::LinkKey key_;
  Scene scene_;
  std::optional<QuerySolver> solver_;  // from the first welcome on
  std::string hello_;
  zmq::context_t context_{1};
  zmq::socket_t socket_{context_, zmq::socket_type::dealer};
  rt::TimePoint begun_ = rt::Clock::now();
  rt::TimePoint next_hello_ = begun_;
  bool complained_ = false;
  std::uint64_t answered_ = 0;
};

}  // namespace

std::uint64_t run_worker(const WorkerOptions& options, std::ostream& out,
                         const std::atomic<bool>& stop, int stop_fd) {
  rt::name_current_thread("fg-worker");
  ::setpriority(PRIO_PROCESS, 0, options.nice);
  const auto step = [&options](const std::string& what) {
    if (options.step) {
      options.step(what);
    }
  };
  step("Loading scene " + options.scene);
  Work work(options, out, stop);
  step("");
  return work.run(stop, stop_fd);
}

}  // namespace forcegrid::simulator
