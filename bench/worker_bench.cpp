// SPDX-License-Identifier: Apache-2.0
// The two ends of bench/worker_scaling.py: a pool that always has a job, and a worker that sleeps
// for recorded solve times instead of solving.
//
//   forcegrid_worker_bench serve ADDR:PORT KEY_FILE SCENE WORKERS SECONDS [TIMES_FILE]
//   forcegrid_worker_bench sleep tcp://ADDR:PORT KEY_FILE SCENE TIMES_FILE

#include <unistd.h>

#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <ctime>
#include <fstream>
#include <iostream>
#include <iterator>
#include <random>
#include <stdexcept>
#include <string>
#include <thread>
#include <vector>

#include "simulator/workers/worker_pool.h"
#include "simulator/workers/worker_socket.h"

namespace {

using namespace forcegrid;
using namespace forcegrid::simulator;
using std::chrono::milliseconds;

constexpr auto kJoinTimeout = std::chrono::seconds(60);
constexpr auto kHelloPeriod = std::chrono::seconds(1);

double cpu_s(clockid_t clock) {
  timespec time{};
  ::clock_gettime(clock, &time);
  return static_cast<double>(time.tv_sec) + 1e-9 * static_cast<double>(time.tv_nsec);
}

/// Positions around a tool that moves up and down, like those of requests.
class Jobs {
 public:
  link::Query query() {
    link::Query query;
    query.query_id = ++count_;
    return query;
  }
  QueryJob job() {
    constexpr double kDepth_m = 0.008;
    constexpr double kAround_m = 0.004;
    constexpr double kTurn = 1e-2;  // phase per job
    std::uniform_real_distribution<double> around(-kAround_m, kAround_m);
    QueryJob job;
    job.epoch = 1;
    job.touching = true;
    job.position_W = {around(random_), around(random_),
                      around(random_) - kDepth_m * std::sin(kTurn * count_)};
    return job;
  }

 private:
  std::uint32_t count_ = 0;
  std::mt19937 random_{1};
};

class Server {
 public:
  Server(const std::string& listen, const std::string& key_file, const std::string& scene)
      : pool_(listen, link::LinkKey::load(key_file), digest_of(make_scene(scene)), 1) {
    std::cout << "listening " << pool_.address() << std::endl;
  }

  void wait_for(std::size_t workers) {
    const rt::TimePoint until = rt::Clock::now() + kJoinTimeout;
    // Wait until all workers have passed probation and hold the object.
    while (pool_.statistics().right < workers * WorkerPool::kProbation ||
           pool_.statistics().joined < workers) {
      if (rt::Clock::now() > until) {
        throw std::runtime_error("not all workers have answered within 60 s");
      }
      turn();
    }
    solve_times_s_.clear();
  }

  void measure(std::size_t workers, double seconds, const std::string& times_file) {
    const WorkerStatistics before = pool_.statistics();
    const double thread_before_s = cpu_s(CLOCK_THREAD_CPUTIME_ID);
    const double process_before_s = cpu_s(CLOCK_PROCESS_CPUTIME_ID);
    const rt::TimePoint start = rt::Clock::now();
    while (rt::seconds(rt::Clock::now() - start) < seconds) {
      turn();
    }
    const double elapsed_s = rt::seconds(rt::Clock::now() - start);
    const WorkerStatistics after = pool_.statistics();
    const auto answers = static_cast<double>(after.answered - before.answered);
    double solve_sum_s = 0.0;
    for (const double time_s : solve_times_s_) {
      solve_sum_s += time_s;
    }
    std::printf(
        "{\"workers\": %zu, \"answers\": %.0f, \"seconds\": %.3f, \"answers_per_s\": %.3f, "
        "\"taken_back\": %llu, \"solve_mean_s\": %.6f, \"thread_cpu_s\": %.6f, "
        "\"process_cpu_s\": %.6f}\n",
        workers, answers, elapsed_s, answers / elapsed_s,
        static_cast<unsigned long long>(after.taken_back - before.taken_back),
        solve_sum_s / static_cast<double>(solve_times_s_.size()),
        cpu_s(CLOCK_THREAD_CPUTIME_ID) - thread_before_s,
        cpu_s(CLOCK_PROCESS_CPUTIME_ID) - process_before_s);
    if (!times_file.empty()) {
      std::ofstream file(times_file);
      for (const double time_s : solve_times_s_) {
        file << time_s << '\n';
      }
      if (!file) {
        throw std::runtime_error(times_file + " can't be written");
      }
    }
  }

 private:
  // The workers' part of one turn of the simulator's loop, without solving for the checks.
  void turn() {
    pool_.wait(rt::Clock::now() + milliseconds(2));
    pool_.poll(rt::Clock::now());
    while (const auto answered = pool_.next_answer()) {
      solve_times_s_.push_back(answered->answer.equilibrium.solve_time_s);
      if (answered->to_check) {
        pool_.judge(answered->worker, Verdict::kRight);
      }
    }
    while (pool_.next_taken_back()) {
    }
    while (pool_.available() && pool_.give(jobs_.query(), jobs_.job(), rt::Clock::now())) {
    }
  }

  WorkerPool pool_;
  Jobs jobs_;
  std::vector<double> solve_times_s_;
};

std::vector<double> read_times(const std::string& file_name) {
  std::ifstream file(file_name);
  std::vector<double> times_s{std::istream_iterator<double>(file), {}};
  if (times_s.empty()) {
    throw std::runtime_error(file_name + " holds no times; let 'serve' write it first");
  }
  return times_s;
}

// Ends with its parent, by a signal.
[[noreturn]] void sleep_for_a_living(const std::string& connect, const std::string& key_file,
                                     const std::string& scene, const std::string& times_file) {
  const std::vector<double> times_s = read_times(times_file);
  const std::string scheme = "tcp://";
  zmq::context_t context{1};
  zmq::socket_t socket{context, zmq::socket_type::dealer};
  connect_as_worker(socket,
                    link::parse_address(connect.substr(scheme.size()), link::PortZero::kRefused,
                                        link::Reach::kNetwork),
                    link::LinkKey::load(key_file));
  const std::string hello =
      to_text(WorkerHello{"sleeper:" + std::to_string(::getpid()), digest_of(make_scene(scene))});
  rt::TimePoint next_hello = rt::Clock::now();
  std::size_t next =
      static_cast<std::size_t>(::getpid());  // each starts at another place of the record
  for (;;) {
    if (rt::Clock::now() >= next_hello) {
      send(socket, {hello});
      next_hello = rt::Clock::now() + kHelloPeriod;
    }
    wait_for_message(socket, milliseconds(100));
    const auto frames = receive(socket);
    const auto job = frames ? read_job(frames->front()) : std::nullopt;
    if (!job) {
      continue;
    }
    NumberedAnswer answer;
    answer.id = job->id;
    answer.answer.epoch = job->job.answer_epoch();
    answer.answer.in_contact = job->job.touching;
    answer.answer.position_W = job->job.position_W;
    answer.answer.equilibrium.converged = true;
    answer.answer.equilibrium.solve_time_s = times_s[next++ % times_s.size()];
    std::this_thread::sleep_for(
        std::chrono::duration<double>(answer.answer.equilibrium.solve_time_s));
    send(socket, {to_text(answer)});
  }
}

int run(const std::vector<std::string>& arguments) {
  if ((arguments.size() == 6 || arguments.size() == 7) && arguments[0] == "serve") {
    const std::size_t workers = std::stoul(arguments[4]);
    Server server(arguments[1], arguments[2], arguments[3]);
    server.wait_for(workers);
    server.measure(workers, std::stod(arguments[5]), arguments.size() == 7 ? arguments[6] : "");
    return 0;
  }
  if (arguments.size() == 5 && arguments[0] == "sleep") {
    sleep_for_a_living(arguments[1], arguments[2], arguments[3], arguments[4]);
  }
  std::cerr << "usage: forcegrid_worker_bench serve ADDR:PORT KEY_FILE SCENE WORKERS SECONDS "
               "[TIMES_FILE]\n"
               "       forcegrid_worker_bench sleep tcp://ADDR:PORT KEY_FILE SCENE TIMES_FILE\n";
  return 2;
}

}  // namespace

int main(int argc, char** argv) {
  try {
    return run({argv + 1, argv + argc});
  } catch (const std::exception& error) {
    std::cerr << "forcegrid_worker_bench: " << error.what() << std::endl;
    return 1;
  }
}
