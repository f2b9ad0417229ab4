// SPDX-License-Identifier: Apache-2.0
#include "simulator/workers/worker_pool.h"

#include <algorithm>
#include <bitset>
#include <deque>
#include <random>
#include <utility>
#include <vector>

#include "link/address.h"
#include "rt/thread.h"
#include "simulator/workers/curve_authenticator.h"
#include "simulator/workers/worker_socket.h"

namespace forcegrid::simulator {
namespace {

constexpr int kMaxMessagesPerPoll = 256;
constexpr std::size_t kRouterFrames = 2;  // of a router: sender, message

template <typename T>
std::optional<T> take_front(std::deque<T>& queue) {
  if (queue.empty()) {
    return std::nullopt;
  }
  T front = std::move(queue.front());
  queue.pop_front();
  return front;
}

}  // namespace

struct WorkerPool::Worker {
  struct Given {
    link::Query query;
    QueryJob job;
    bool witness = false;
    rt::TimePoint since;
  };
  WorkerId id = 0;
  std::string identity;  ///< ZeroMQ's for the connection
  rt::TimePoint last_heard;
  rt::TimePoint last_given;
  std::uint64_t asked_id = 0;  ///< of the job that it still has to answer, even if late; 0: none
  std::optional<Given> given;  ///< until it is taken back
  std::uint64_t unjudged = 0;
  unsigned right_in_a_row = 0;
  std::bitset<kRecentChecks> recently_wrong;
  WorkerRecord record;

  [[nodiscard]] bool on_probation() const noexcept { return right_in_a_row < kProbation; }
  [[nodiscard]] bool available() const noexcept {
    return asked_id == 0 && !record.expelled && !(on_probation() && unjudged > 0);
  }
  void note(bool wrong) noexcept {
    recently_wrong <<= 1;
    recently_wrong[0] = wrong;
    right_in_a_row = wrong ? 0 : right_in_a_row + 1;
    ++(wrong ? record.wrong : record.right);
  }
};

struct WorkerPool::State {
  State(ObjectDigest wanted, const link::LinkKey& key, std::uint32_t seed,
        const SolverOptions& solver)
      : object(std::move(wanted)),
        welcome(welcome_text(solver)),
        authenticator(context, key),
        random(seed) {}

  void take(const std::string& identity, const std::string& text, rt::TimePoint now);
  void take_hello(const std::string& identity, const WorkerHello& hello, rt::TimePoint now);
  void take_answer(Worker& worker, const NumberedAnswer& numbered, rt::TimePoint now);
  void take_giving_up(Worker& worker);
  void take_back(Worker& worker);
  void forget(std::vector<Worker>::iterator worker);
  void blame(Worker& worker);
  void refuse(const std::string& identity, const std::string& reason);
  bool give(Worker& worker, const link::Query& query, const QueryJob& job, bool witness,
            rt::TimePoint now);
  template <typename Wanted>
  bool give_to_longest_waiting(const link::Query& query, const QueryJob& job, bool witness,
                               rt::TimePoint now, Wanted wanted);
  Worker* find(WorkerId id);

  ObjectDigest object;
  std::string welcome;
  zmq::context_t context{1};
  CurveAuthenticator authenticator;
  zmq::socket_t router{context, zmq::socket_type::router};
  std::vector<Worker> workers;
  std::vector<WorkerRecord> former;
  std::deque<Answered> answers;
  std::deque<TakenBack> taken_back;
  std::uint64_t next_job_id = 1;
  WorkerId next_worker_id = 1;
  std::mt19937 random;
  WorkerStatistics statistics;
};

WorkerPool::Worker* WorkerPool::State::find(WorkerId id) {
  const auto found = std::ranges::find(workers, id, &Worker::id);
  return found == workers.end() ? nullptr : &*found;
}

void WorkerPool::State::refuse(const std::string& identity, const std::string& reason) {
  send(router, {identity, refusal_text(reason)});
}

void WorkerPool::State::take_hello(const std::string& identity, const WorkerHello& hello,
                                   rt::TimePoint now) {
  const auto known = std::ranges::find(workers, identity, &Worker::identity);
  if (known != workers.end()) {
    known->last_heard = now;
    return;
  }
  if (!same_object(object, hello.object)) {
    ++statistics.refused;
    refuse(identity,
           "this simulator has scene '" + object.scene + "' of " + std::to_string(object.vertices) +
               " vertices and " + std::to_string(object.springs) + " springs, the worker '" +
               hello.object.scene + "' of " + std::to_string(hello.object.vertices) + " and " +
               std::to_string(hello.object.springs) +
               ", or with other stiffnesses or lengths; start the worker with the same --scene");
    return;
  }
  if (workers.size() >= kMaxWorkers) {
    ++statistics.refused;
    refuse(identity, "there are " + std::to_string(kMaxWorkers) + " workers already");
    return;
  }
  ++statistics.joined;
  Worker worker;
  worker.id = next_worker_id++;
  worker.identity = identity;
  worker.last_heard = now;
  worker.record.name = hello.name;
  workers.push_back(std::move(worker));
  send(router, {identity, welcome});
}

void WorkerPool::State::take_answer(Worker& worker, const NumberedAnswer& numbered,
                                    rt::TimePoint now) {
  if (worker.asked_id == 0 || numbered.id != worker.asked_id) {
    ++statistics.unasked;
    blame(worker);
    return;
  }
  worker.asked_id = 0;
  if (!worker.given || numbered.answer.epoch != worker.given->job.answer_epoch()) {
    if (worker.given) {
      take_back(worker);
    }
    ++worker.record.late;
    ++statistics.late;
    return;
  }
  ++statistics.answered;
  ++worker.record.answers;
  ++worker.record.round_trips;
  worker.record.round_trip_sum_s += rt::seconds(now - worker.given->since);
  Answered answered;
  answered.query = worker.given->query;
  answered.job = worker.given->job;
  answered.answer = numbered.answer;
  // The pool knows the point; the worker's own statement is not used.
  answered.answer.point_W = answered.job.touching ? answered.job.point_W : answered.job.position_W;
  answered.worker = worker.id;
  answered.witness = worker.given->witness;
  answered.to_check = !answered.witness && (worker.on_probation() || random() % kCheckOneIn == 0);
  worker.unjudged += answered.to_check || answered.witness ? 1 : 0;
  answers.push_back(std::move(answered));
  worker.given.reset();
}

void WorkerPool::State::take(const std::string& identity, const std::string& text,
                             rt::TimePoint now) {
  if (const auto hello = read_hello(text)) {
    take_hello(identity, *hello, now);
    return;
  }
  const auto worker = std::ranges::find(workers, identity, &Worker::identity);
  const auto answer = read_answer(text);
  const auto gave_up = answer ? std::nullopt : read_gave_up(text);
  statistics.malformed += answer || gave_up ? 0 : 1;
  if (worker == workers.end() || worker->record.expelled) {
    return;
  }
  worker->last_heard = now;
  if (answer) {
    take_answer(*worker, *answer, now);
  } else if (gave_up && *gave_up == worker->asked_id && worker->asked_id != 0) {
    take_giving_up(*worker);
  } else {
    blame(*worker);
  }
}

void WorkerPool::State::take_back(Worker& worker) {
  ++statistics.taken_back;
  taken_back.push_back({worker.given->query, worker.given->job, worker.given->witness});
  worker.given.reset();
}

void WorkerPool::State::take_giving_up(Worker& worker) {
  worker.asked_id = 0;
  ++statistics.given_up;
  if (worker.given) {
    take_back(worker);
  }
}

void WorkerPool::State::blame(Worker& worker) {
  worker.note(true);
  ++statistics.wrong;
  if (worker.record.expelled || worker.recently_wrong.count() < kMaxWrong) {
    return;
  }
  worker.record.expelled = true;
  ++statistics.expelled;
  if (worker.given) {
    take_back(worker);
  }
  refuse(worker.identity,
         "answers of this worker were checked and wrong; look at its scene, its version of the "
         "program and its machine");
}

void WorkerPool::State::forget(std::vector<Worker>::iterator worker) {
  ++statistics.gone;
  if (worker->given) {
    take_back(*worker);
  }
  worker->record.present = false;
  if (former.size() < WorkerStatistics::kMaxRecords) {
    former.push_back(worker->record);
  }
}

bool WorkerPool::State::give(Worker& worker, const link::Query& query, const QueryJob& job,
                             bool witness, rt::TimePoint now) {
  const std::uint64_t id = next_job_id++;
  if (!send(router, {worker.identity, to_text(NumberedJob{id, job})})) {
    return false;
  }
  worker.asked_id = id;
  worker.given = Worker::Given{query, job, witness, now};
  worker.last_given = now;
  ++statistics.given;
  return true;
}

template <typename Wanted>
bool WorkerPool::State::give_to_longest_waiting(const link::Query& query, const QueryJob& job,
                                                bool witness, rt::TimePoint now, Wanted wanted) {
  for (;;) {
    auto best = workers.end();
    for (auto worker = workers.begin(); worker != workers.end(); ++worker) {
      if (worker->available() && wanted(*worker) &&
          (best == workers.end() || worker->last_given < best->last_given)) {
        best = worker;
      }
    }
    if (best == workers.end()) {
      return false;
    }
    if (give(*best, query, job, witness, now)) {
      return true;
    }
    forget(best);  // its connection has ended
    workers.erase(best);
  }
}

WorkerPool::WorkerPool(const std::string& listen, const link::LinkKey& key, ObjectDigest object,
                       std::uint32_t seed, const SolverOptions& solver)
    : state_(std::make_unique<State>(std::move(object), key, seed, solver)) {
  listen_as_simulator(state_->router,
                      link::parse_address(listen, link::PortZero::kAllowed, link::Reach::kNetwork),
                      key);
}

WorkerPool::~WorkerPool() = default;

std::string WorkerPool::address() const { return state_->router.get(zmq::sockopt::last_endpoint); }

void WorkerPool::wait(rt::TimePoint until) {
  const auto whole_ms = std::chrono::floor<std::chrono::milliseconds>(until - rt::Clock::now());
  if (whole_ms > std::chrono::milliseconds(0)) {  // ZeroMQ waits in whole ones
    wait_for_message(state_->router, whole_ms);
  } else {
    rt::sleep_until(until);
  }
}

void WorkerPool::poll(rt::TimePoint now) {
  state_->authenticator.answer();
  for (int i = 0; i < kMaxMessagesPerPoll; ++i) {
    const auto frames = receive(state_->router);
    if (!frames) {
      break;
    }
    state_->take(frames->front(), frames->size() == kRouterFrames ? frames->back() : "", now);
  }
  for (auto worker = state_->workers.begin(); worker != state_->workers.end();) {
    if (worker->given && now - worker->given->since > kPatience) {
      state_->take_back(*worker);
    }
    if (now - worker->last_heard > kSilence) {
      state_->forget(worker);
      worker = state_->workers.erase(worker);
    } else {
      ++worker;
    }
  }
}

bool WorkerPool::available() const noexcept {
  return std::ranges::any_of(state_->workers, &Worker::available);
}

bool WorkerPool::give(const link::Query& query, const QueryJob& job, rt::TimePoint now) {
  return state_->give_to_longest_waiting(query, job, false, now,
                                         [](const Worker&) { return true; });
}

bool WorkerPool::give_to_witness(const link::Query& query, const QueryJob& job, WorkerId first,
                                 rt::TimePoint now) {
  return state_->give_to_longest_waiting(query, job, true, now, [first](const Worker& worker) {
    return worker.id != first && !worker.on_probation();
  });
}

std::optional<WorkerPool::Answered> WorkerPool::next_answer() {
  return take_front(state_->answers);
}

std::optional<WorkerPool::TakenBack> WorkerPool::next_taken_back() {
  return take_front(state_->taken_back);
}

void WorkerPool::judge(WorkerId id, Verdict verdict) {
  Worker* const worker = state_->find(id);
  if (worker == nullptr) {
    return;
  }
  worker->unjudged -= worker->unjudged > 0 ? 1 : 0;  // forget_jobs() may have run in between
  if (verdict == Verdict::kRight) {
    worker->note(false);
    ++state_->statistics.right;
  } else if (verdict == Verdict::kWrong) {
    state_->blame(*worker);
  }
}

void WorkerPool::count_late(WorkerId id) {
  ++state_->statistics.late;
  --state_->statistics.answered;
  if (Worker* const worker = state_->find(id); worker != nullptr) {
    ++worker->record.late;
    --worker->record.answers;
  }
}

void WorkerPool::forget_jobs() {
  for (Worker& worker : state_->workers) {
    worker.given.reset();
    worker.unjudged = 0;
  }
  state_->answers.clear();
  state_->taken_back.clear();
}

WorkerStatistics WorkerPool::statistics() const {
  WorkerStatistics statistics = state_->statistics;
  statistics.strangers = state_->authenticator.strangers();
  statistics.workers = state_->former;
  for (const Worker& worker : state_->workers) {
    if (statistics.workers.size() < WorkerStatistics::kMaxRecords) {
      statistics.workers.push_back(worker.record);
    }
  }
  return statistics;
}

}  // namespace forcegrid::simulator
