#pragma once

#include <Eigen/Core>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <span>

namespace forcegrid {

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
  bool from_query = false;  ///< asked for by the method, not sampled along the path
  /// An answer that was asked for before contact: for a tool that had touched at `contact_point_W`.
  bool before_contact = false;
};

enum class EstimateStatus : std::uint8_t {
  kOk,
  kPartlyKnown,  ///< some of what the answer rests on is still the null force of an empty grid
  kUnknown,      ///< nothing known here yet; the force is zero
  kOutside,      ///< position beyond the method's workspace; the force is zero
  kNotFinite,    ///< position or result was not finite; the force is zero
};

/// Static text for messages and files, e.g. "outside the grid".
const char* to_string(EstimateStatus status) noexcept;

/// What a method needs from the simulator beyond forces along the path.
struct MethodNeeds {
  bool stiffness = false;  ///< samples with dF/dP; those without are of no use to it
  bool requests = false;   ///< answers at positions of its own choice, see plan_request()
  /// It makes requests for an expected contact as well, see expect_contact(); it can do without.
  bool requests_before_contact = false;
};

/// Something that a method counts since it was made, e.g. samples that it could not use.
struct NamedCounter {
  const char* name = "";  ///< as a key of summaries, e.g. "samples_outside"; static text
  std::uint64_t value = 0;
};

/// Why the member of a method that speaks does so.
enum class ChoiceReason : std::uint8_t {
  kFirst,            ///< it is the one that a method begins with
  kPredictedBetter,  ///< it has foretold the last samples better than the one before
  kFoundWall,     ///< it alone explains the force of a second object that the tool came up against
  kFirstTouches,  ///< a contact begins, and it has known the first instants of others best
  kRemembers,     ///< the tool goes where it was long ago
  kKnownPlace,    ///< a contact begins where another one was
  kAskedBefore,   ///< a contact begins that it has asked about on the way there
};

/// Static text for messages and files, e.g. "predicted better".
const char* to_string(ChoiceReason reason) noexcept;

struct ForceEstimate {
  Eigen::Vector3d force_W = Eigen::Vector3d::Zero();  ///< zero unless kOk or kPartlyKnown
  EstimateStatus status = EstimateStatus::kUnknown;
  /// [N] one standard deviation of the force's error, NaN for a method that can't tell.
  double uncertainty_N = std::numeric_limits<double>::quiet_NaN();
  /// Who speaks of a method that chooses between several fields, an index into candidates(); and why.
  std::uint8_t candidate = 0;
  ChoiceReason reason = ChoiceReason::kFirst;
};

/// Most members that a method has.
inline constexpr std::size_t kMaxCandidates = 16;

/// Bridges slow forces to a fast loop: takes in the simulator's samples as they arrive and gives a
/// force at any time and position. All of it runs on the servo thread.
/// Real-time: every function is bounded and neither allocates, locks nor throws; implementations
/// allocate in their constructors only. Threads: one.
class ForceMethod {
 public:
  virtual ~ForceMethod() = default;

  /// The method's name on the command line, e.g. "forcegrid".
  virtual const char* name() const noexcept = 0;

  virtual MethodNeeds needs() const noexcept { return {}; }

  /// Bytes that it holds, itself included; fixed from construction on.
  virtual std::size_t memory_bytes() const noexcept = 0;

  /// What the method counts; the names and their order never change. Valid as long as the method.
  virtual std::span<const NamedCounter> counters() const noexcept { return {}; }

  /// Names of the fields between which the method chooses, at most kMaxCandidates, fixed from
  /// construction on; empty where there is no choice.
  virtual std::span<const char* const> candidates() const noexcept { return {}; }

  /// Takes in one sample. Non-finite samples and those older than the newest taken in are ignored
  /// unless a method says otherwise. The method keeps what it can't use at once for work().
  virtual void take_sample(const Sample& sample) noexcept = 0;

  /// Tells the tool's time [s] and position once a servo cycle, before force().
  virtual void observe(double time_s, const Eigen::Vector3d& position_W) noexcept {
    static_cast<void>(time_s);
    static_cast<void>(position_W);
  }

  /// The tool touched an object (a new contact epoch) or came off it: what was learnt before may no
  /// longer hold.
  virtual void contact_made(std::uint32_t epoch, const Eigen::Vector3d& point_W) noexcept = 0;
  virtual void contact_lost() noexcept = 0;

  /// Out of contact: the tool, should it go straight on, will touch at `point_W` within some tenths
  /// of a second. Told once a servo cycle for as long as that is so, by whoever knows the surface.
  virtual void expect_contact(double time_s, const Eigen::Vector3d& point_W) noexcept {
    static_cast<void>(time_s);
    static_cast<void>(point_W);
  }

  /// Does pending work worth at most `budget` units, one unit being the update of one vertex of a
  /// grid. Work that comes in larger pieces (a fit, eight vertices) is done at most one piece
  /// beyond the budget.
  /// @returns the units done; less than `budget` when nothing is left to do.
  virtual int work(int budget) noexcept = 0;

  /// Where the simulator should be asked next, the tool being at `position_W`. Called once for each
  /// request that can be sent; the answer comes back through take_sample() with `from_query` set.
  /// Out of contact only while a contact is expected, and for a tool that has touched there.
  /// @returns false, leaving `wanted_W` alone, when nothing is worth asking.
  virtual bool plan_request(double time_s, const Eigen::Vector3d& position_W,
                            Eigen::Vector3d& wanted_W) noexcept {
    static_cast<void>(time_s);
    static_cast<void>(position_W);
    static_cast<void>(wanted_W);
    return false;
  }

  /// The force at `position_W` and time `time_s`. At any moment between the other calls the answer
  /// is consistent, whatever work is pending.
  [[nodiscard]] virtual ForceEstimate force(double time_s,
                                            const Eigen::Vector3d& position_W) const noexcept = 0;
};

}  // namespace forcegrid
