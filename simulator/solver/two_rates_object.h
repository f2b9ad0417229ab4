// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <thread>
#include <vector>

#include "simulator/mesh/spring_mesh.h"
#include "simulator/solver/elastic_object.h"
#include "simulator/solver/solver_report.h"

namespace forcegrid::simulator {

struct TwoRatesOptions {
  /// Each move: the region around the tool. Needs border_tolerance and most_vertices > 0.
  SolverOptions near{.border_tolerance = 1e-3, .most_vertices = 2500};
  /// The whole object, solved as often as the second thread can.
  SolverOptions whole{};
  /// False, for measurements and tests: the caller solves the whole object with solve_whole() and
  /// hand_over().
  bool own_thread = true;
};

/// An object that is solved at two rates. Each move solves a region of a bounded number of vertices
/// around the tool, so that its cost grows with what the tool disturbs and not with the object. On
/// a second thread a copy of the object is solved as a whole, again and again, each time for the
/// tool's place P_w at that moment. When a solution is ready, its difference from the region and
/// the vertices around it is added, for the tool's present place P:
///
///   S(P) += dS,   x(P) += x_whole(P_w) - x_near(P_w) + dS (P - P_w),   dS = S_whole(P_w) -
///   S_near(P_w)
///
/// Between two such corrections the object outside the region follows S, and the residual on the
/// border has a second-order effect (SolverOptions::border_tolerance). No move waits for the whole
/// object. The age of its solution grows with the object's size; its effect grows with the tool's
/// speed. Equilibrium::border_work_N measures it: above a tenth of the force,
/// Equilibrium::converged is false.
///
/// Source: the solver study, section on local solving.
///
/// Real-time: as ElasticObject; a move exchanges the neighbourhood, some thousand vertices, and
/// wakes the other thread, but neither allocates nor locks. An unstable state is left by a descent
/// in energy of the whole object within the move, see SolverOptions::max_recovery_steps.
/// Threads: one, besides its own, which runs at a nice value of 15. Memory: two objects.
class TwoRatesObject {
 public:
  /// Throws Error for a mesh that check() refuses or options out of range.
  explicit TwoRatesObject(const SpringMesh& mesh, const TwoRatesOptions& options = {});
  ~TwoRatesObject();
  TwoRatesObject(const TwoRatesObject&) = delete;
  TwoRatesObject& operator=(const TwoRatesObject&) = delete;

  std::size_t vertex_count() const noexcept { return near_.vertex_count(); }
  std::size_t spring_count() const noexcept { return near_.spring_count(); }

  /// Bytes of both objects, without what a move exchanges; only without own_thread, or when it is
  /// known to be idle.
  std::size_t memory_bytes() const noexcept {
    return sizeof *this - sizeof near_ - sizeof whole_ + near_.memory_bytes() +
           whole_.memory_bytes();
  }

  /// As ElasticObject::grab().
  int grab(const Eigen::Vector3d& point_W, double radius_m);
  void release() noexcept;
  bool grabbed() const noexcept { return near_.grabbed(); }

  /// As ElasticObject::move_to(), from the region alone. left_branch is also set where the whole
  /// object has left its branch.
  Equilibrium move_to(const Eigen::Vector3d& displacement_W) noexcept;

  /// As ElasticObject::copy_positions(), of the object that answers. Outside the region the
  /// vertices stand where the whole object's last solution has them, moved on along S.
  void copy_positions(const std::vector<std::int32_t>& vertices,
                      std::vector<Eigen::Vector3d>& position_W) const {
    near_.copy_positions(vertices, position_W);
  }

  /// Solutions of the whole object that moves have used, since construction.
  std::uint64_t whole_solutions() const noexcept { return whole_solutions_; }
  SolverReport report() const noexcept { return {.whole_solutions = whole_solutions_}; }

  // Without own_thread:

  /// Whether the last move requested a solution of the whole object. Until hand_over() no other
  /// does.
  bool whole_is_due() const noexcept { return turn_ == Turn::kWhole; }
  /// Solves the whole object, when whole_is_due().
  void solve_whole() noexcept;
  /// Makes the result of solve_whole() available to the next move.
  void hand_over() noexcept;

 private:
  // Who may touch `job_` and `whole_`.
  enum class Turn : int { kNear, kWhole, kQuit };

  struct Job {
    bool grab = false;  // take hold of point_W; else solve for was.displacement_W
    Eigen::Vector3d point_W = Eigen::Vector3d::Zero();
    double radius_m = 0.0;
    std::vector<std::int32_t> vertices;  // of the neighbourhood, in the mesh's numbering
    Neighbourhood was;                   // near_ there
    Neighbourhood is;                    // whole_ there
    bool held = false;                   // whole_ holds what near_ does
    bool solved = false;                 // `is` is good
    bool left_branch = false;
  };

  void run() noexcept;
  void take() noexcept;
  void ask(const Equilibrium& answer) noexcept;
  void grab_whole() noexcept;

  TwoRatesOptions options_;
  ElasticObject<float> near_;
  ElasticObject<float> whole_;
  Job job_;
  // A new grip, until the whole object's turn to take it comes.
  bool grip_waits_ = false;
  Eigen::Vector3d point_W_ = Eigen::Vector3d::Zero();
  double radius_m_ = 0.0;
  std::vector<std::int32_t> vertices_;
  bool jumped_ = false;  // the next answer is on another branch
  std::uint64_t whole_solutions_ = 0;
  std::atomic<Turn> turn_{Turn::kNear};
  std::jthread solver_;
};

}  // namespace forcegrid::simulator
