// SPDX-License-Identifier: Apache-2.0
#include "simulator/run_simulator.h"

#include <poll.h>
#include <sys/resource.h>

#include <algorithm>
#include <cerrno>
#include <chrono>
#include <cmath>
#include <cstring>
#include <memory>
#include <optional>
#include <ostream>
#include <random>
#include <utility>
#include <variant>

#include "link/simulator_endpoint.h"
#include "log/log.h"
#include "rt/checkpoint.h"
#include "rt/clock.h"
#include "rt/percentiles.h"
#include "rt/thread.h"
#include "rt/vectors.h"
#include "simulator/control_socket.h"
#include "simulator/impaired_link.h"
#include "simulator/loop_parts.h"
#include "simulator/mesh/column_cut.h"
#include "simulator/mesh/error.h"
#include "simulator/mesh/scene.h"
#include "simulator/predicted_contact.h"
#include "simulator/reference/model_choice.h"
#include "simulator/shared_loop.h"
#include "simulator/surface_stream.h"
#include "simulator/touch/solver_choice.h"
#include "simulator/touch/solver_contact.h"
#include "simulator/workers/loading.h"
#include "simulator/workers/query_scheduler.h"

namespace forcegrid::simulator {
namespace {

constexpr double kMaxRate_Hz = SimulatorControls::kMostRate_Hz;
constexpr int kMaxNice = 19;
constexpr auto kStopCheck = std::chrono::milliseconds(50);
constexpr auto kWorkerPoll = std::chrono::milliseconds(2);
constexpr double kWall_N_per_m = 1000.0;
constexpr double kCutOverPatch = 1.5;
constexpr double kAbove_m = 0.01;  // of the surface, from where a tool touches again

void check(const SimulatorOptions& options) {
  if (!(options.rate_Hz > 0.0 && options.rate_Hz <= kMaxRate_Hz)) {
    throw Error("simulator: rate is " + std::to_string(options.rate_Hz) +
                " Hz; give more than 0 and at most " + std::to_string(kMaxRate_Hz));
  }
  if (!options.link_conditions.usable()) {
    throw Error("simulator: delay " + std::to_string(options.link_conditions.delay_s) +
                " s, jitter " + std::to_string(options.link_conditions.jitter_s) + " s, loss " +
                std::to_string(options.link_conditions.loss) + "; give delay and jitter of 0 to " +
                std::to_string(LinkConditions::kMostDelay_s) + " s, and a loss of 0 to 1");
  }
  if (options.nice < 0 || options.nice > kMaxNice) {
    throw Error("simulator: nice is " + std::to_string(options.nice) + "; give 0 to " +
                std::to_string(kMaxNice));
  }
  if (options.tools == 0) {
    throw Error("simulator: --tools 0: a simulator serves 1 to " +
                std::to_string(link::kMostTools) + " tools");
  }
  if (options.tools > 1) {
    check_several_tools(options);
  }
}

std::unique_ptr<WorkerPool> make_pool(const SimulatorOptions& options, const Scene& scene,
                                      const SolverOptions& solver, const ToolOptions& tool) {
  if (options.workers.empty()) {
    return nullptr;
  }
  if (tool.slides()) {
    throw Error(
        "simulator: --workers: the force on a sliding tool depends on its path, which workers do "
        "not "
        "have; leave --workers out or use --contact sticky");
  }
  if (tool.turns) {
    throw Error(
        "simulator: --workers: workers know a tool that stays upright; leave --workers or "
        "--tool-turns out");
  }
  if (options.key_files.empty()) {
    throw Error(
        "simulator: workers need a key; make one with 'forcegrid keygen FILE' and give --key FILE "
        "here and to each worker");
  }
  return std::make_unique<WorkerPool>(options.workers,
                                      link::LinkKey::load(options.key_files.front()),
                                      digest_of(scene), std::random_device{}(), solver);
}

class Loop {
 public:
  Loop(const SimulatorOptions& options, const Scene& scene, const SolverChoice& solver,
       const ToolOptions& tool)
      : options_(options),
        scene_(scene),
        solver_(solver),
        tool_(tool),
        endpoint_(options.listen, kServoSilence, access_of(options)),
        contact_(make_solver_contact(scene, solver, tool, options.rate_Hz)),
        predicted_(scene, tool),
        impaired_([this](const ImpairedLink::Message& message) { send(message); },
                  options.link_conditions, options.link_seed),
        controls_{.rate_Hz = options.rate_Hz, .link = options.link_conditions},
        period_(rt::from_seconds(1.0 / options.rate_Hz)) {
    make_scheduler(scene);
    if (!options.control.empty()) {
      control_ = std::make_unique<ControlSocket>(
          options.control, [this](const SimulatorControls& wanted) { return admits(wanted); });
    }
    if (!options.surface.empty()) {
      surface_ = std::make_unique<SurfaceStream>(scene.mesh, options.surface);
    }
    summary_.scene = scene.name;
    summary_.tool = tool.shape;
    summary_.contact = tool.contact;
    summary_.listening = link::to_string(endpoint_.address());
    summary_.vertices = contact_->vertex_count();
    summary_.springs = contact_->spring_count();
    summary_.solver = to_string(solver.kind);
    summary_.solver_why = solver.why;
    summary_.rate_Hz = options.rate_Hz;
    summary_.workers_at = scheduler_->pool() == nullptr ? "" : scheduler_->pool()->address();
  }

  const SimulatorSummary& summary() const { return summary_; }

  void note_model(const std::optional<ModelChoice>& model) {
    if (!model) {
      return;
    }
    summary_.model = ModelUse{.tolerance_percent = *options_.material_tolerance_percent,
                              .chosen = model->trials[model->chosen].model,
                              .why = model->why,
                              .trials = {}};
    for (const ModelTrial& trial : model->trials) {
      summary_.model->trials.push_back({trial.model, trial.mean_ms, trial.error_percent});
    }
  }

  SimulatorSummary run(const std::atomic<bool>& stop, int stop_fd) {
    pollfd watched{stop_fd, POLLIN, 0};
    rt::TimePoint deadline = rt::Clock::now() + period_;
    // A negative descriptor is ignored by poll.
    while (!stop.load(std::memory_order_relaxed) && ::poll(&watched, 1, 0) <= 0) {
      const rt::TimePoint now = rt::Clock::now();
      impaired_.send_due(now);
      if (take_controls()) {
        deadline = std::min(deadline, now + period_);
      }
      if (now < deadline) {
        wait_until(deadline);
        continue;
      }
      tick();
      show_surface();
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
  void make_scheduler(const Scene& scene) {
    scheduler_.emplace(
        scene, solver_.options,
        QueryScheduler::Ports{
            .next_query = [this] { return endpoint_.next_query(); },
            .job_for = [this](const link::Query& query) { return job_for(query); },
            .reply = [this](const link::Query& query,
                            const StickyContact::Answer& answer) { reply(query, answer); }},
        make_pool(options_, scene, solver_.options, tool_));
  }

  // Workers have the whole object; a cut forgets how it moves.
  bool admits(const SimulatorControls& wanted) const {
    const bool changes_object = wanted.cut != controls_.cut;
    return !changes_object ||
           (scheduler_->pool() == nullptr && contact_->depends_on_position_alone() &&
            tool_.needs_position_alone() && scene_.mesh.load_W_N.empty());
  }

  // Cuts the object, or makes it whole. The tool holds it where it did, in a new epoch.
  void replace_object() {
    const bool held = contact_->in_contact() && contact_answer_;
    const Eigen::Vector3d point_W = held ? contact_answer_->point_W : scene_.mesh.top_W;
    cut_scene_.reset();
    if (controls_.cut) {
      cut_scene_ = scene_;
      cut_scene_->mesh =
          with_cut(scene_.mesh, {.centre_W = point_W,
                                 .half_width_m = kCutOverPatch * scene_.patch_radius_m,
                                 .depth_m = kCutOverPatch * 2.0 * scene_.patch_radius_m});
    }
    const Scene& scene = cut_scene_ ? *cut_scene_ : scene_;
    contact_ = make_solver_contact(scene, solver_, tool_, controls_.rate_Hz);
    make_scheduler(scene);
    if (surface_) {
      surface_->change(scene.mesh);
    }
    lost_epochs_ += epoch_;
    epoch_ = 0;
    if (held) {
      static_cast<void>(contact_->step(point_W + Eigen::Vector3d(0.0, 0.0, kAbove_m)));
      contact_answer_ = contact_->step(point_W);
      epoch_ = contact_answer_->epoch;
    }
  }

  // The wall pushes a tool that holds the object back down.
  void add_wall(StickyContact::Answer& answer) const {
    const double depth_m = answer.position_W.z() - controls_.wall_m;
    if (answer.in_contact && depth_m > 0.0) {
      answer.equilibrium.force_W.z() -= kWall_N_per_m * depth_m;
      answer.equilibrium.stiffness_W(2, 2) -= kWall_N_per_m;
    }
  }

  // Whether anything was changed.
  bool take_controls() {
    const SimulatorControls before = controls_;
    const std::size_t changes = control_ ? control_->receive(controls_) : 0;
    if (changes == 0) {
      return false;
    }
    if (controls_.cut != before.cut) {
      replace_object();
    } else if (controls_.wall_m != before.wall_m) {
      ++lost_epochs_;  // the force may jump
    }
    period_ = rt::from_seconds(1.0 / controls_.rate_Hz);
    impaired_.set(controls_.link);
    summary_.rate_Hz = controls_.rate_Hz;
    summary_.control_changes += changes;
    return true;
  }

  void wait_until(rt::TimePoint deadline) {
    if (scheduler_->solve_one(deadline)) {
      receive();
      return;
    }
    if (predicted_.wants_stiffness()) {
      predicted_.learn_stiffness([this](const QueryJob& job) { return scheduler_->solve_now(job); },
                                 epoch_ + lost_epochs_);
      receive();
      return;
    }
    rt::TimePoint wake = std::min(deadline, rt::Clock::now() + kStopCheck);
    wake = std::min(wake, impaired_.next().value_or(wake));
    if (scheduler_->pool() != nullptr) {
      scheduler_->pool()->wait(std::min(wake, rt::Clock::now() + kWorkerPoll));
    } else {
      rt::sleep_until(wake);
    }
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
    while (const auto state = endpoint_.next_tool_state()) {
      contact_->was_at(time_s(*state), rt::to_vector(state->position_W_m));
    }
    take_queries(news.queries);
    report_strangers();
    scheduler_->serve_workers(rt::Clock::now());
  }

  // Where force depends on the tool's path, a query has no answer.
  void take_queries(std::size_t waiting) {
    if (contact_->depends_on_position_alone()) {
      scheduler_->set_waiting(waiting);
      return;
    }
    while (endpoint_.next_query()) {
      ++summary_.queries_refused;
    }
    if (summary_.queries_refused > 0 && !warned_of_queries_) {
      warned_of_queries_ = true;
      log::warn("simulator",
                "simulator: queries are not answered: the force depends on the tool's path "
                "(contact slide, or a dynamic object) or orientation (--tool-turns); use a method "
                "without queries");
    }
  }

  // Logged once only, since a stranger could fill a disk.
  void report_strangers() {
    using link::SealStatus;
    const link::LinkStatistics& counted = endpoint_.statistics();
    const auto refused = [&](SealStatus status) {
      return counted.seal_refused[static_cast<std::size_t>(status)];
    };
    if (warned_of_strangers_ || counted.not_allowed + refused(SealStatus::kNotSealed) +
                                        refused(SealStatus::kUnknownKey) +
                                        refused(SealStatus::kForged) ==
                                    0) {
      return;
    }
    warned_of_strangers_ = true;
    log::warn("simulator", "simulator: datagrams are refused (" + link::drop_text(counted) +
                               "); if they are your servo's, give it this simulator's key, and "
                               "--allow its address");
  }

  void reset_contact() {
    contact_->reset();
    if (surface_) {
      surface_->touch();
    }
  }

  void begin_anew() {
    reset_contact();
    scheduler_->begin_anew();
    newest_.reset();
    impaired_.clear();
    contact_answer_.reset();
    predicted_.begin_anew();
    epoch_ = 0;
    lost_epochs_ = 0;
  }

  void tick() {
    receive();
    if (!newest_) {
      return;
    }
    link::ForceSample sample = link::answer_to(*newest_);
    link::SurfacePatch patch = link::patch_for(*newest_);
    const Eigen::Vector3d position_W = rt::to_vector(newest_->position_W_m);
    const Eigen::Vector3d velocity_W = rt::to_vector(newest_->velocity_W_m_per_s);
    contact_->tell_time(time_s(*newest_));
    turn_tool(*newest_);
    newest_.reset();
    const bool was_in_contact = contact_->in_contact();
    const rt::TimePoint start = rt::Clock::now();
    StickyContact::Answer answer = contact_->step(position_W);
    const double solve_s = rt::seconds(rt::Clock::now() - start);
    if (surface_) {
      surface_->touch();
    }
    if (!finite(answer.equilibrium)) {
      // The link would refuse it, and the state can no longer be trusted.
      ++summary_.not_finite;
      lost_epochs_ += answer.epoch;
      reset_contact();
      return;
    }
    add_wall(answer);
    epoch_ = answer.epoch;
    predicted_.look(*contact_, position_W, velocity_W);
    if (answer.in_contact) {
      count(answer, was_in_contact, 1e3 * solve_s);
      contact_answer_ = answer;
    }
    fill(sample, answer, options_.send_stiffness);
    if (predicted_.expected_W()) {
      sample.contact_point_W_m = rt::to_array(*predicted_.expected_W());
    }
    sample.solve_time_s = solve_s;
    sample.contact_epoch += lost_epochs_;
    patch.contact_epoch = sample.contact_epoch;
    const bool with_patch = !answer.in_contact && predicted_.cut(patch);
    const rt::TimePoint now = rt::Clock::now();
    impaired_.send(sample, now);
    if (with_patch) {
      impaired_.send(patch, now);
    }
  }

  // A device without a wrist leaves the tool upright.
  void turn_tool(const link::ToolState& state) {
    if (!state.has_orientation) {
      return;
    }
    const link::Quaternion& q = state.orientation_WT;
    contact_->turn_to(Eigen::Quaterniond(q[0], q[1], q[2], q[3]));
    if (!tool_.turns && !warned_of_orientation_) {
      warned_of_orientation_ = true;
      log::info("simulator",
                "simulator: the device tells its tool's orientation; the tool stays upright "
                "without --tool-turns");
    }
  }

  // After the sample was sent, which must not wait for it.
  void show_surface() {
    if (surface_) {
      show_timed(
          *surface_,
          [this](const std::vector<std::int32_t>& vertices, std::vector<Eigen::Vector3d>& at_W) {
            contact_->copy_positions(vertices, at_W);
          },
          surface_us_);
    }
  }

  void count(const StickyContact::Answer& answer, bool was_in_contact, double solve_ms) {
    const Equilibrium& equilibrium = answer.equilibrium;
    if (was_in_contact) {
      solve_us_.add(1e3 * solve_ms);
      iterations_ += static_cast<std::uint64_t>(equilibrium.iterations);
    } else {
      ++summary_.contacts;
      summary_.grab_max_ms = std::max(summary_.grab_max_ms, solve_ms);
    }
    summary_.unconverged += equilibrium.converged ? 0 : 1;
    summary_.branch_changes += equilibrium.left_branch ? 1 : 0;
    summary_.long_steps += contact_->report().long_step.value_or(false) ? 1 : 0;
    summary_.not_reached += equilibrium.reached ? 0 : 1;
    summary_.worst_relative_residual =
        std::max(summary_.worst_relative_residual, equilibrium.relative_residual);
  }

  // To the socket.
  void send(const ImpairedLink::Message& message) {
    std::uint64_t* count = &summary_.patches;
    link::SendStatus status = link::SendStatus::kSent;
    if (const auto* const sample = std::get_if<link::ForceSample>(&message)) {
      count = sample->query_id != 0 ? &summary_.replies : &summary_.answers;
      status = endpoint_.send(*sample);
    } else {
      status = endpoint_.send(std::get<link::SurfacePatch>(message));
    }
    ++(status == link::SendStatus::kSent ? *count : summary_.send_failures);
  }

  // The job for a query at the present state of contact.
  QueryJob job_for(const link::Query& query) const {
    QueryJob job;
    job.epoch = epoch_ + lost_epochs_;
    job.position_W = rt::to_vector(query.position_W_m);
    const bool held = contact_->in_contact() && contact_answer_;
    job.touching = held || predicted_.expected_W().has_value();
    if (job.touching) {
      job.point_W = held ? contact_answer_->point_W : *predicted_.expected_W();
    }
    return job;
  }

  void reply(const link::Query& query, StickyContact::Answer answer) {
    add_wall(answer);
    link::ForceSample sample = link::answer_to(query);
    fill(sample, answer, options_.send_stiffness);
    impaired_.send(sample, rt::Clock::now());
  }

  void finish() {
    summary_.dropped = link::drop_reasons(endpoint_.statistics());
    summary_.not_finite += scheduler_->counts().not_finite;
    summary_.unchecked = scheduler_->counts().unchecked;
    if (scheduler_->pool() != nullptr) {
      summary_.workers = scheduler_->pool()->statistics();
    }
    if (surface_) {
      summary_.surface = surface_use(*surface_, surface_us_);
    }
    summary_.delayed = impaired_.counts().delayed;
    summary_.lost_on_purpose = impaired_.counts().lost;
    summary_.link = impaired_.conditions();
    const SolverReport report = contact_->report();
    summary_.whole_solutions = report.whole_solutions.value_or(0);
    summary_.reduced = report.reduced.value_or(ReducedUse{});
    summary_.solve_mean_ms = 1e-3 * solve_us_.mean();
    summary_.solve_p50_ms = 1e-3 * solve_us_.at(0.5);
    summary_.solve_p99_ms = 1e-3 * solve_us_.at(0.99);
    summary_.solve_max_ms = 1e-3 * solve_us_.max();
    summary_.iterations_mean = solve_us_.count() == 0 ? 0.0
                                                      : static_cast<double>(iterations_) /
                                                            static_cast<double>(solve_us_.count());
  }

  SimulatorOptions options_;
  const Scene& scene_;              ///< as it was read, whole
  std::optional<Scene> cut_scene_;  ///< the same after a cut; nothing: it is whole
  SolverChoice solver_;
  ToolOptions tool_;
  bool warned_of_strangers_ = false;
  bool warned_of_queries_ = false;
  bool warned_of_orientation_ = false;
  link::SimulatorEndpoint endpoint_;
  std::unique_ptr<ToolContact> contact_;
  std::unique_ptr<SurfaceStream> surface_;  // null: nobody watches
  PredictedContact predicted_;
  std::optional<QueryScheduler> scheduler_;
  ImpairedLink impaired_;
  SimulatorControls controls_;
  std::unique_ptr<ControlSocket> control_;  // null: nobody changes anything
  rt::Duration period_;
  std::optional<link::ToolState> newest_;
  std::optional<StickyContact::Answer> contact_answer_;
  std::uint32_t epoch_ = 0;  ///< of the newest answer, without the lost ones
  std::uint32_t lost_epochs_ = 0;
  rt::Percentiles solve_us_;
  rt::Percentiles surface_us_;
  std::uint64_t iterations_ = 0;
  SimulatorSummary summary_;
};

// Exchanges the scene's object for a cheaper model of it.
ModelChoice exchange_model(const SimulatorOptions& options, const ToolOptions& tool, Scene& scene) {
  const std::string who = "simulator: --material-tolerance-percent: ";
  if (tool.slides()) {
    throw Error(who +
                "models are compared under a tool that holds the object; use --contact "
                "sticky or leave it out");
  }
  if (tool.turns) {
    throw Error(who + "models are compared under a tool that stays upright; leave one of them out");
  }
  if (!options.workers.empty()) {
    throw Error(who + "workers know the scene as written; leave one of them out");
  }
  if (!options.solver_kind && dynamics_of(scene.mesh) == MeshDynamics::kDamped) {
    throw Error(who + "models are compared in equilibrium, and scene " + scene.name +
                " has dampers; give --solver quasi_static or leave it out");
  }
  ModelChoice choice = choose_model(
      scene, {.tolerance_percent = *options.material_tolerance_percent,
              .rate_Hz = options.rate_Hz,
              .solver = options.solver_kind,
              .solver_options = options.solver,
              .coarser = [&options](Fineness fineness) {
                return make_coarser_mesh(options.scene, options.top_centre_W, fineness);
              }});
  for (const std::string& reason : choice.left_out) {
    log::info("model", "not tried: " + reason);
  }
  choice.within ? log::info("model", "model: " + choice.why)
                : log::warn("model", "model: " + choice.why);
  scene.mesh = choice.mesh;
  return choice;
}

// A tool that turns and sticks is solved on the whole object, at its equilibria.
void check_turning(const SimulatorOptions& options, const ToolOptions& tool) {
  if (tool.turns && !tool.slides() &&
      options.solver_kind.value_or(SolverKind::kQuasiStatic) != SolverKind::kQuasiStatic) {
    throw Error(std::string("simulator: solver ") + to_string(*options.solver_kind) +
                ": tools that turn use quasi_static; leave --solver or --tool-turns out");
  }
}

}  // namespace

SimulatorSummary run_simulator(const SimulatorOptions& options, std::ostream& out,
                               const std::atomic<bool>& stop, int stop_fd) {
  check(options);
  std::optional<rt::Supervised> loading(
      std::in_place,
      loading_supervision(options.scene, stop, options.say_loading ? &out : nullptr));
  const auto step = [&options](const std::string& what) {
    if (options.step) {
      options.step(what);
    }
  };
  step("Loading scene " + options.scene);
  Scene scene = make_scene(options.scene, options.top_centre_W);
  step("");
  if (!scene.note.empty()) {
    log::info("scene", "scene " + scene.name + ": " + scene.note);
  }
  for (const std::string& warning : scene.warnings) {
    log::warn("scene", warning);
  }
  const ToolOptions tool = options.tool.value_or(scene.tool);
  std::optional<ModelChoice> model;
  if (options.material_tolerance_percent) {
    step("Trying cheaper models of scene " + options.scene);
    model = exchange_model(options, tool, scene);
    step("");
  }
  const bool shared = options.tools > 1;
  check_turning(options, tool);
  const bool turns_and_sticks = tool.turns && !tool.slides();
  SolverChoice solver = choose_solver(model                        ? model->solver
                                      : shared || turns_and_sticks ? SolverKind::kQuasiStatic
                                                                   : options.solver_kind,
                                      scene.mesh.rest_position_W.size(), options.rate_Hz,
                                      options.solver, dynamics_of(scene.mesh));
  if (shared) {
    solver.why = "several tools always use it";
    if (dynamics_of(scene.mesh) == MeshDynamics::kDamped) {
      solver.why += "; masses and dampers are ignored";
    }
  }
  if (model) {
    solver.why = "as the model was tried";
  }
  if (tool.slides() && !shared) {
    if (options.solver_kind) {
      throw Error(std::string("simulator: solver ") + to_string(*options.solver_kind) +
                  ": tools that slide always use the solver pressed; leave --solver out");
    }
    solver.why = "tools that slide always use it";
    if (solver.kind == SolverKind::kDynamic) {
      solver.why += "; masses and dampers are ignored";
    }
    solver.kind = SolverKind::kPressed;
  }
  if (turns_and_sticks) {
    solver.why = "tools that turn always use it";
    if (dynamics_of(scene.mesh) == MeshDynamics::kDamped) {
      solver.why += "; masses and dampers are ignored";
    }
  }
  if (solver.kind == SolverKind::kDynamic && !options.workers.empty()) {
    throw Error(
        "simulator: --workers: workers solve equilibria, but this object is dynamic; leave "
        "--workers out or give --solver quasi_static");
  }
  log::info("solver", std::string("solver ") + to_string(solver.kind) + ": " + solver.why);
  step("Preparing the solver");
  std::optional<SharedLoop> shared_loop;
  std::optional<Loop> loop;
  if (shared) {
    shared_loop.emplace(options, scene, solver, tool);
  } else {
    loop.emplace(options, scene, solver, tool).note_model(model);
  }
  step("");
  rt::name_current_thread("fg-simulator");
  if (::setpriority(PRIO_PROCESS, 0, options.nice) != 0) {
    log::warn("simulator", "simulator: nice " + std::to_string(options.nice) + " was refused (" +
                               std::strerror(errno) +
                               "); it runs at the priority it was started with");
  }
  const SimulatorSummary& summary = shared ? shared_loop->summary() : loop->summary();
  loading.reset();
  out << "listening " << summary.listening << " scene " << summary.scene << " vertices "
      << summary.vertices << " springs " << summary.springs
      << (shared ? " tools " + std::to_string(options.tools) : "")
      << (summary.workers_at.empty() ? "" : " workers " + summary.workers_at) << std::endl;
  return shared ? shared_loop->run(stop, stop_fd) : loop->run(stop, stop_fd);
}

}  // namespace forcegrid::simulator
