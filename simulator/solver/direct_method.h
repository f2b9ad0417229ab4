// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <atomic>
#include <thread>

#include "forcegrid/core/force_method.h"
#include "simulator/mesh/spring_mesh.h"
#include "simulator/solver/elastic_object.h"

namespace forcegrid::simulator {

struct DirectOptions {
  double patch_radius_m = 0.012;  ///< of the tool's grip; > 0
  /// Solver for one servo cycle. The next cycle corrects what the iterations leave over; the
  /// force's error is of second order in it.
  SolverOptions solver{.relative_tolerance = 1e-3,
                       .max_steps = 4,
                       .iterations_per_step = 2,
                       .max_iterations = 4,
                       .max_recovery_steps = 1,
                       .answer_first_below = 0.03};
  /// Solves for a new grip on a separate thread, so that the servo does not wait. Until that is
  /// done the force is zero and its status kUnknown. If false, contact_made() takes that long.
  bool grab_on_own_thread = true;
};

/// The simulator itself as a force method: it solves for the object's equilibrium at the tool's
/// position in every servo cycle.
///
///   F(P) = F(P_o) + J (P - P_o)     with P_o the position last observed
///
/// Needs: the object's mesh, in this process; samples are ignored. Cost per cycle: one evaluation
/// of all springs and at most DirectOptions::solver.max_iterations conjugate-gradient iterations,
/// see measured_cycle_s(). Memory: the object's. Uncertainty: the gap between the corrected and the
/// raw force. Fails if the object is too large for the cycle or is not known.
/// Source: the solver of ElasticObject, which documents its equations.
/// Real-time: observe() and force() neither allocate, lock nor throw and are bounded as above; so
/// is contact_made() with grab_on_own_thread. Threads: one, besides its own.
class DirectMethod final : public ForceMethod {
 public:
  /// @throws Error for a mesh or options that can't be used.
  explicit DirectMethod(const SpringMesh& mesh, const DirectOptions& options = {});
  ~DirectMethod() override;

  const char* name() const noexcept override { return "direct"; }
  std::size_t memory_bytes() const noexcept override;
  /// Does nothing: the force comes from the object.
  void take_sample(const Sample& sample) noexcept override;
  /// Grabs the object at rest around `point_W`. If no vertex is near, the force stays unknown.
  void contact_made(std::uint32_t epoch, const Eigen::Vector3d& point_W) noexcept override;
  void contact_lost() noexcept override;
  void observe(double time_s, const Eigen::Vector3d& position_W) noexcept override;
  int work(int budget) noexcept override;
  [[nodiscard]] ForceEstimate force(double time_s,
                                    const Eigen::Vector3d& position_W) const noexcept override;

  /// The answer of the last observe(), for its counts and residuals.
  const Equilibrium& equilibrium() const noexcept { return equilibrium_; }

  /// [s] Median time of observe(), measured on this processor: grabs the object at the top and
  /// moves it to and fro at 0.2 m/s for `cycles` cycles of `servo_period_s`. Not while the method
  /// is in use. Throws Error if the object can't be grabbed.
  double measured_cycle_s(double servo_period_s, int cycles = 60);

 private:
  // Who may touch the object, and what is to be done with it.
  enum class Turn : int { kServo, kGrab, kQuit };
  // What the servo knows of the tool.
  enum class Contact { kNeverHeard, kFree, kWaiting, kHeld };

  void grab() noexcept;
  void start_grab() noexcept;
  void run_grabs() noexcept;

  DirectOptions options_;
  ElasticObject<float> object_;
  Eigen::Vector3d top_W_;
  Eigen::Vector3d point_W_ = Eigen::Vector3d::Zero();         // of the contact
  Eigen::Vector3d wanted_point_W_ = Eigen::Vector3d::Zero();  // read by the thread that grabs
  Eigen::Vector3d observed_W_ = Eigen::Vector3d::Zero();
  Equilibrium equilibrium_;
  bool solved_ = false;  // equilibrium_ belongs to this contact
  bool holds_ = false;   // written by whoever has the turn
  Contact contact_ = Contact::kNeverHeard;
  std::atomic<Turn> turn_{Turn::kServo};
  std::jthread grabber_;
};

}  // namespace forcegrid::simulator
