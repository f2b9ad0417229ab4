// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <Eigen/Geometry>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <vector>

#include "simulator/mesh/scene.h"
#include "simulator/mesh/tool_options.h"
#include "simulator/solver/elastic_object.h"
#include "simulator/touch/sticky_contact.h"

namespace forcegrid::simulator {

/// Several tools that stick to one object (SharedObject). Each touches as a single tool does
/// (StickyContact, StickingTool): by the surface at rest, and the vertices that it then holds are
/// those around its tip in the rest shape that no other tool holds, from where they are. Tools do
/// not touch each other.
///
/// A tool's force depends on the positions of all tools in contact. So a new epoch begins for a
/// tool in contact also when another one touches or lets go. Between these its force changes with
/// the other tools' motion, without a new epoch. Threads: one.
class SharedContact {
 public:
  using Answer = StickyContact::Answer;

  /// All tools have the shape of `options`.
  /// Throws Error for a tool that slides, and as SharedObject and StickyContact do.
  SharedContact(const Scene& scene, const SolverOptions& solver, const ToolOptions& options,
                std::size_t tools);
  ~SharedContact();
  SharedContact(const SharedContact&) = delete;
  SharedContact& operator=(const SharedContact&) = delete;

  /// How the tool is turned from the next move() on: tools that may turn (ToolOptions::turns) do so
  /// about their positions with what they hold. Others stay upright.
  void turn_to(std::size_t tool_number, const Eigen::Quaterniond& orientation_WT) noexcept;
  /// Where the tool is at the next solve(), [m]. Touches there if the rule says so.
  void move(std::size_t tool_number, const Eigen::Vector3d& position_W);
  /// Solves for all tools at once, where move() has put them; those that were not moved stay.
  void solve();
  /// The object's reaction to this tool since the last solve().
  const Answer& answer(std::size_t tool) const noexcept;
  /// [N/m] At the last solve(): d(force on `tool`)/d(position of `other`). Nothing unless both are
  /// in contact and the solution has converged.
  std::optional<Eigen::Matrix3d> stiffness_W(std::size_t tool, std::size_t other) const noexcept;

  /// What the object would answer this tool at `position_W` [m], with the other tools where they
  /// are; zero force if it is not in contact, or for a position that is not finite. Costs two
  /// solutions: there and back, so that the state is as before, to the solver's tolerance. If the
  /// object leaves its branch on the way, a new epoch begins for all tools in contact.
  Answer ask(std::size_t tool_number, const Eigen::Vector3d& position_W);

  /// Starts a new run of this tool: no contact, epoch 0. The object goes on under the others.
  void reset(std::size_t tool_number);
  /// Every tool lets go and the object is at rest; the tools' epochs go on.
  void start_over();

  bool in_contact(std::size_t tool) const noexcept;
  /// See ToolContact.
  std::optional<Eigen::Vector3d> expected_touch(std::size_t tool, const Eigen::Vector3d& position_W,
                                                const Eigen::Vector3d& velocity_W,
                                                double within_s) const noexcept;
  /// As ToolContact's: under all tools, as of the last solve() or touch.
  void copy_positions(const std::vector<std::int32_t>& vertices,
                      std::vector<Eigen::Vector3d>& position_W) const;
  std::size_t vertex_count() const noexcept;
  std::size_t spring_count() const noexcept;

 private:
  class State;
  std::unique_ptr<State> state_;
};

}  // namespace forcegrid::simulator
