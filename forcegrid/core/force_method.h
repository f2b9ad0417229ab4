// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <optional>
#include <span>

namespace forcegrid {
#pragma GCC visibility push(default)

/// One answer of the simulator: the force that the object exerts on the tool at `position_W`.
/// W is the workspace frame; lengths in metres, forces in newtons, times in seconds of the servo's
/// clock.
struct Sample {
  double time_s = 0.0;  ///< when the tool was at `position_W`
  Eigen::Vector3d position_W = Eigen::Vector3d::Zero();
  Eigen::Vector3d force_W = Eigen::Vector3d::Zero();
  bool has_stiffness = false;
  Eigen::Matrix3d stiffness_W = Eigen::Matrix3d::Zero();  ///< dF/dP [N/m]
  std::uint32_t contact_epoch = 0;                        ///< a new number at every discontinuity
  Eigen::Vector3d contact_point_W = Eigen::Vector3d::Zero();
  double relative_residual = 0.0;
  bool converged = true;
  bool from_query = false;  ///< requested by the method, not sampled along the path
  /// The answer to a request before contact: for a tool that had touched at `contact_point_W`.
  bool before_contact = false;
  /// Samples of several tools with the same number are of one solution of their object; 0: unknown.
  std::uint64_t solution = 0;
  /// Beside one other tool that holds the object: how the force changes with that one's position,
  /// and the position it was computed for. For methods over two tools.
  bool has_influence = false;
  Eigen::Matrix3d influence_W = Eigen::Matrix3d::Zero();  ///< dF/dP_other [N/m]
  Eigen::Vector3d other_position_W = Eigen::Vector3d::Zero();
};

enum class EstimateStatus : std::uint8_t {
  kOk,
  kPartlyKnown,  ///< part of the answer still rests on the null force of an empty grid
  kUnknown,      ///< nothing known here yet; the force is zero
  kOutside,      ///< position beyond the method's workspace; the force is zero
  kNotFinite,    ///< position or result was not finite; the force is zero
};

/// Static text for messages and files, e.g. "outside the grid".
const char* to_string(EstimateStatus status) noexcept;

/// What a method needs from the simulator beyond forces along the path.
struct MethodNeeds {
  bool stiffness = false;  ///< samples with dF/dP; it can't use those without
  bool requests = false;   ///< answers at positions of its own choice, see plan_request()
  /// It makes requests for an expected contact as well, see expect_contact(), but works without.
  bool requests_before_contact = false;
  bool can_request = false;  ///< it makes requests if it may, but works without
};

/// A quantity that a method counts from construction on, e.g. samples that it could not use.
struct NamedCounter {
  const char* name = "";  ///< as a key of summaries, e.g. "samples_outside"; static text
  std::uint64_t value = 0;
};

/// Why a method that chooses between candidates renders the one it renders.
enum class ChoiceReason : std::uint8_t {
  kFirst,            ///< it is the one that the method begins with
  kPredictedBetter,  ///< it predicted the last samples better than the one before
  kFoundWall,        ///< it alone explains the force of a second object that the tool met
  kFirstTouches,     ///< a contact begins; it predicted the first instants of others best
  kRemembers,        ///< the tool returns to a place of long ago
  kKnownPlace,       ///< a contact begins where another one was
  kAskedBefore,      ///< a contact begins that it had asked about beforehand
  kBothTools,        ///< the positions of both tools are known, and so is the force there
  kOneTool,          ///< the other tool does not hold the object, or too little is known of both
  kWeaker,           ///< it alone explains a force: the same object, weaker than before
  kAsGood,           ///< the others fall asleep; it was nearly as good and assumes less noise
};
inline constexpr int kChoiceReasons = 1 + static_cast<int>(ChoiceReason::kAsGood);

/// Static text for messages and files, e.g. "predicted better".
const char* to_string(ChoiceReason reason) noexcept;

/// A method's answer for one position and time.
struct ForceEstimate {
  Eigen::Vector3d force_W = Eigen::Vector3d::Zero();  ///< [N] zero unless kOk or kPartlyKnown
  EstimateStatus status = EstimateStatus::kUnknown;
  /// [N] One standard deviation of the force's error; NaN for a method that does not know it.
  double uncertainty_N = std::numeric_limits<double>::quiet_NaN();
  /// For a method that chooses between candidates: the rendered one's index in candidates(), and
  /// the reason for the choice.
  std::uint8_t candidate = 0;
  ChoiceReason reason = ChoiceReason::kFirst;
};

/// Most candidates that a method has.
inline constexpr std::size_t kMaxCandidates = 16;

/// Bridges slow forces to a fast loop: takes the simulator's samples as they arrive (some 30 per
/// second) and gives a force at any time and position (at up to 4 kHz).
///
/// To write a method, derive from this class, implement the seven pure functions, five of which do
/// the work - take_sample(), contact_made(), contact_lost(), work() and force() - and add its name
/// in methods.cpp. Everything else has a default that fits a method without it. HoldMethod is the
/// smallest example. The other functions matter to methods that
/// - use the tool's path between samples: observe();
/// - ask the simulator for forces where they need them: plan_request(), expect_contact(), needs();
/// - choose between several fields: candidates();
/// - keep the mean cost of cycles within a budget: set_budget();
/// - count what they could not use: counters().
///
/// What the loop guarantees:
/// - One thread, the servo's, calls everything after construction. No two calls overlap.
/// - Each cycle calls, in this order: take_sample(), contact_made() and contact_lost() for what has
///   arrived since the last cycle; observe() and force(); plan_request() while requests can be
///   sent; work() with the rest of the cycle's budget.
/// - Times are of the servo's clock and never fall from one observe() or force() to the next.
///   Samples may be late, repeated or missing. Their values are checked by SampleGate in the loop,
///   but a method checks what it depends on itself: other callers have no gate.
/// - The loop limits force and slew, fades and stops; a method never has to.
///
/// What a method must ensure, in every function but the constructor:
/// - Real-time: no allocation, lock, exception, I/O or logging; every loop has a constant bound.
///   allocation_test.cpp fails a method that allocates.
/// - Work that takes longer than some microseconds is split into pieces and done by work().
/// - force() is const, never fails and is consistent at any moment between the other calls,
///   whatever work is pending. Every failure is a status, and the force is then zero.
///
/// W is the workspace frame; SI units; forces are those that the object exerts on the tool.
class ForceMethod {
 public:
  virtual ~ForceMethod() = default;

  /// The method's name on the command line, e.g. "forcegrid"; static text.
  virtual const char* name() const noexcept = 0;

  /// Bytes that it holds, itself included; fixed from construction on.
  virtual std::size_t memory_bytes() const noexcept = 0;

  // --- The five functions that do the work. ---

  /// Takes one sample, or keeps it for work(). Non-finite samples and those older than the newest
  /// taken are ignored unless a method documents otherwise.
  virtual void take_sample(const Sample& sample) noexcept = 0;

  /// The tool touched an object, a new contact epoch: what was learnt before may no longer hold.
  /// @param point_W [m] where it touched; NaN if that is unknown.
  virtual void contact_made(std::uint32_t epoch, const Eigen::Vector3d& point_W) noexcept = 0;
  /// The tool came off the object: the force is zero until the next contact_made().
  virtual void contact_lost() noexcept = 0;

  /// Does pending work worth at most `budget` units, where one unit is the update of one vertex of
  /// a grid. Work that comes in larger pieces (a fit, eight vertices) exceeds the budget by at most
  /// one piece.
  /// @returns the units done; less than `budget` when nothing is left to do.
  virtual int work(int budget) noexcept = 0;

  /// The force at `position_W` [m] and time `time_s`.
  /// @returns kNotFinite for a position or time that is not finite; see EstimateStatus for the
  /// rest.
  [[nodiscard]] virtual ForceEstimate force(double time_s,
                                            const Eigen::Vector3d& position_W) const noexcept = 0;

  // --- For methods that need more. ---

  /// What the method needs from the simulator beyond forces along the path.
  virtual MethodNeeds needs() const noexcept { return {}; }

  /// The method's counters; their names and order never change. Valid as long as the method.
  virtual std::span<const NamedCounter> counters() const noexcept { return {}; }

  /// Names of the fields between which the method chooses, at most kMaxCandidates, fixed from
  /// construction on; empty if there is no choice.
  virtual std::span<const char* const> candidates() const noexcept { return {}; }

  /// The tool's time [s] and position [m], once per servo cycle whose position is plausible, before
  /// force().
  virtual void observe(double time_s, const Eigen::Vector3d& position_W) noexcept {
    static_cast<void>(time_s);
    static_cast<void>(position_W);
  }

  /// Out of contact: the tool will touch at `point_W` within some tenths of a second if it keeps
  /// its velocity. Called once per servo cycle for as long as that holds, by the caller that knows
  /// the surface.
  virtual void expect_contact(double time_s, const Eigen::Vector3d& point_W) noexcept {
    static_cast<void>(time_s);
    static_cast<void>(point_W);
  }

  /// Where to ask the simulator next, with the tool at `position_W`. Called once for each request
  /// that can be sent; the answer comes back through take_sample() with `from_query` set. Out of
  /// contact it is called only while a contact is expected; the answer is then the force on a tool
  /// that has touched there.
  /// @returns false, with `wanted_W` unchanged, if no request is worth its cost.
  virtual bool plan_request(double time_s, const Eigen::Vector3d& position_W,
                            Eigen::Vector3d& wanted_W) noexcept {
    static_cast<void>(time_s);
    static_cast<void>(position_W);
    static_cast<void>(wanted_W);
    return false;
  }

  /// The least that set_budget() takes, in bare trilinear reads a cycle: less pays for nothing.
  /// Nothing: the method keeps no budget. It never changes.
  virtual std::optional<double> least_budget_reads() const noexcept { return std::nullopt; }

  /// From now on a cycle may cost this much on average, in bare trilinear reads: at least
  /// least_budget_reads(); infinite: no limit. It decides when work() is done, and never changes
  /// what force() answers before the next work(). Without effect on a method without a budget.
  virtual void set_budget(double reads_per_cycle) noexcept { static_cast<void>(reads_per_cycle); }
};

#pragma GCC visibility pop
}  // namespace forcegrid
