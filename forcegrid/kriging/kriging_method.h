#pragma once

#include <array>
#include <cstdint>
#include <limits>
#include <memory>
#include <vector>

#include "forcegrid/core/force_method.h"
#include "forcegrid/kriging/history.h"
#include "forcegrid/kriging/kriging_field.h"
#include "forcegrid/kriging/kriging_store.h"
#include "forcegrid/core/method_options.h"

namespace forcegrid {

/// A conservative force field learnt from the samples (kriging::DictionaryField), or a bank of such
/// fields that are told the same samples and of which the one that predicts best is felt.
///
///   F(P) = sum_i K(P - c, p_i) alpha_i,   p_i = P_i - c_i relative to the contact point
///
/// - `kriging`: one field, squared exponential kernel of 30 mm, 32 samples, nugget 1e-5 N^2. Needs:
/// force.
/// - `kriging-tangent`: the same, and the four newest samples' stiffness as data of the field's
///   derivative (sigma_J = 1 N/m + 0.2 %). Needs: force and stiffness; samples without are taken.
/// - `kriging-hinge`: the same as `kriging`, and up to two second objects, walls that push back,
///   learnt where the force has a kink (kriging::UnilateralConstraintField). Good as a member of a bank, risky
///   alone where surprises have other causes than walls. Needs: force; stiffness is not used.
/// - `kriging-store`: one field as `kriging` over the 32 most useful of up to 8192 samples
///   (kriging::StoreField, kriging::SampleStore), which are exchanged as the tool moves. Needs:
///   force.
/// - `kriging-bank`: nuggets 1e-6, 1e-5, 1e-4 and 1e-3 for objects of different noise; Matern 7/2
///   of 15 mm for kinks; three with history features for objects that remember (kf = 0.03 N^2 with
///   lags of 10, 100, 1000 ms; kf = 1 with 5, 30, 200 ms and nuggets 1e-5 and 1e-4), 48 samples
///   each; an answer to a query counts as given to a tool at rest. The first four use the two
///   newest samples' stiffness if samples carry it. Score of each member: the squared one-step
///   prediction error, averaged over samples by 0.85 old + 0.15 new; another member takes over when
///   its score is below 0.9 of the present one's, and the difference at that moment fades out
///   within some 10 ms. The errors of the kinks' and history members, which are worse than the
///   others wherever they are not needed, count three times, but not those of a history member that
///   has been better for long: over 12 samples (0.92 old + 0.08 new, 20 at least) its squared error
///   is below 0.8 of the best of the first four's, and that is above 10 mN squared. The ninth member
///   is `kriging-hinge`'s
///   field. It takes over at once when it explains by a wall what surprised it, unless it is
///   surprised often (twice in half a second) or its score was above ten times the present one's;
///   that sample, which none could know, is not scored. While it knows walls and is not surprised
///   often its errors count a fifth, and a twentieth once two samples have proven it: it foretold
///   them with less than a tenth of the squared error of any other. Otherwise they count three
///   times. Needs: force.
///
/// - `kriging-contact`: one field with the contact point as a further coordinate
///   (kriging::ContactIndexedField), nugget 1e-5 N^2, 47 samples: a place that was touched before, or
///   whose neighbourhood was, is known from the first cycle of a contact on. Needs: force and
///   contact point; while a contact is expected it asks for forces there. Where the contact point
///   is not finite, the first sample's position is taken for it.
///
/// - `auto`: the bank's members but "kinks" and "slowly viscous", which win nothing beside the
///   others, and four more. "memory" is `kriging-store`'s field. "places" is `kriging-contact`'s;
///   its errors count twice. "unfinished" (kriging::LagField) takes only the samples of a simulator
///   that has not converged, "relaxing" (kriging::RelaxationField) is for objects that resist and
///   relax; the errors of both count three times ("relaxing" as history members: unless it has been
///   better for long), and those of "memory" within half a second of its last surprise.
///   A record is kept of the errors in the first 0.3 s of contacts, from when a force is felt. A
///   contact begins with the record's scores and the member that has known such instants best; but
///   with "places" if at least four answers about it came before, or if that member's deviation
///   4 mm above the contact point is below 0.15 N and its record not above twice the best one.
///   "memory" takes over where its deviation ahead of the tool is less than a third of the felt
///   member's. Needs: force; contact point and requests before contact if they can be had.
///
/// Work: a sample costs each field one piece, a change of some rows of its factor and the weights.
/// A piece is done in one call of work(), that of the field being felt first. Until then it answers
/// as before, so a piece never makes a cycle longer than one fit does. With a store, pieces that
/// exchange up to three samples each follow a sample, and a motion of 3 mm beyond where the field
/// was prepared for: 50 ms ahead of the tool. They end when there is nothing worth it, at the
/// latest after kMostPieces. Contact: positions are relative to the contact point, and what was
/// learnt is kept from one contact to the next; an object grabbed again is known at once if it is
/// as stiff there.
///
/// force(): kUnknown before any sample and beyond 3 * 30 mm from all of them, force fading to zero
/// from 2 * 30 mm on; kPartlyKnown while nothing of this contact has arrived, where the force
/// fades, and where the uncertainty is above kKnown_N; kOk otherwise. The uncertainty is the
/// field's posterior standard deviation, exact at two points that are updated with every sample:
/// where the tool was then, and where it would be at the next one. Between and beyond them it is
/// linear along that line, grows with the distance from it by the same slope, and is at least half
/// a sample's noise.
///
/// Requests: see plan_request(). Options used: nugget, samples, spacing_m, spacing_N (the bank:
/// spacing_m and spacing_N; the store: up to 48 samples and 5 mm).
/// Real-time: as ForceMethod. Cost and memory: docs/kriging.md. Failure: the first two sample
/// periods of the first contact; kinks; see DictionaryField.
class KrigingMethod final : public ForceMethod {
 public:
  enum class Kind { kForceOnly, kTangent, kHinge, kStore, kBank, kContact, kAuto };

  /// @param options nugget, spacings and samples, which must be usable: make_force_method() checks.
  KrigingMethod(Kind kind, const MethodOptions& options);

  const char* name() const noexcept override;
  MethodNeeds needs() const noexcept override;
  std::size_t memory_bytes() const noexcept override;
  /// Queues the sample. Samples out of contact, not finite, or older than the newest are ignored;
  /// answers to queries may come in any order. A stiffness that is not finite is left out.
  void take_sample(const Sample& sample) noexcept override;
  void observe(double time_s, const Eigen::Vector3d& position_W) noexcept override;
  void contact_made(std::uint32_t epoch, const Eigen::Vector3d& point_W) noexcept override;
  void contact_lost() noexcept override;
  void expect_contact(double time_s, const Eigen::Vector3d& point_W) noexcept override;
  /// A piece counts as half the square of its field's rows.
  int work(int budget) noexcept override;
  /// Asks along the predicted motion, up to three sample periods ahead, or 6 mm beside the tool:
  /// where the force is least known, the nearer the better; at none where it is known to better
  /// than kAsk_N, nor again where it has just been asked. Costs four deviation_N(). Before an
  /// expected contact (`kriging-contact` and `auto`): at the first of thirteen fixed displacements
  /// from its point where that is so, at the cost of a deviation_N() each.
  bool plan_request(double time_s, const Eigen::Vector3d& position_W,
                    Eigen::Vector3d& wanted_W) noexcept override;
  [[nodiscard]] ForceEstimate force(double time_s,
                                    const Eigen::Vector3d& position_W) const noexcept override;

  /// Pieces of exchanges in a row, see above.
  static constexpr int kMostPieces = 4;
  /// [N] Uncertainty up to which a force counts as known.
  static constexpr double kKnown_N = 0.3;
  /// [N] Uncertainty from which on a request is worth it.
  static constexpr double kAsk_N = 0.1;

  /// "smooth" (nugget 1e-5 N^2), "exact" (1e-6), "noisy" (1e-4), "very noisy" (1e-3), "kinks",
  /// "slowly viscous", "viscous", "noisy viscous", "walls" of the bank; "memory", "unfinished",
  /// "relaxing", "places" of auto, which has no "kinks" and no "slowly viscous".
  std::span<const char* const> members() const noexcept override {
    return {names_.data(), members_.size() > 1 ? members_.size() : 0};
  }

  /// `samples_passed_over`: see samples_skipped().
  std::span<const NamedCounter> counters() const noexcept override { return {&passed_over_, 1}; }

  int member_count() const noexcept { return static_cast<int>(members_.size()); }
  int active_member() const noexcept { return static_cast<int>(active_); }
  const kriging::Field& member(int index) const noexcept {
    return *members_[static_cast<std::size_t>(index)].field;
  }
  // For a method that reads the felt field in its own way.

  /// The contact point, or null while there is no contact, or nothing is known of it.
  const Eigen::Vector3d* origin_W() const noexcept {
    return in_contact_ && origin_known_ && members_[active_].field->sample_count() > 0 ? &origin_W_
                                                                                       : nullptr;
  }
  /// Where the tool will be half a sample period from now.
  Eigen::Vector3d soon_W() const noexcept {
    return (observed_ ? position_W_ : newest_sample_W_) + 0.5 * sample_period_s_ * velocity_W_;
  }
  /// How often the felt field has changed, and the last of these changes at which it was surprised
  /// or found another scale for earlier contacts.
  std::uint64_t fits() const noexcept { return fits_; }
  std::uint64_t surprised_fit() const noexcept { return surprised_fit_; }
  /// Adds uncertainty and status to a force that the felt field tells within kFade_m of a sample.
  void say_how_sure(const Eigen::Vector3d& position_W, ForceEstimate& estimate) const noexcept;
  /// Requests ask at the points of a lattice, relative to the contact point, from now on.
  void ask_on_lattice(const Eigen::Vector3d& corner_m, double spacing_m) noexcept {
    lattice_corner_m_ = corner_m;
    lattice_spacing_m_ = spacing_m;
  }
  /// [m] Beyond this distance from every sample the force fades.
  static constexpr double kFade_m = 0.060;

  /// The samples of kriging-store and auto; null for the others.
  const kriging::SampleStore* store() const noexcept { return store_.get(); }
  /// False when the store's memory could not be had; the method then must not be used.
  bool allocated() const noexcept { return store_ == nullptr || store_->allocated(); }
  /// Samples that members not being felt passed over because they were too far behind.
  std::uint64_t samples_skipped() const noexcept { return passed_over_.value; }

 private:
  static constexpr std::size_t kQueueLength = 32;
  static constexpr std::uint64_t kLongestBacklog = 8;
  static constexpr std::size_t kAsked = 16;
  /// What the errors of members that are needed seldom count: elsewhere a lucky run of theirs costs
  /// accuracy.
  static constexpr double kSpecialist = 3.0;
  static constexpr double kHandOver_s = 0.010;
  static constexpr double kExpected_s = 0.1;  ///< an expectation holds unless it is told again
  static constexpr double kNotTaken_N2 = std::numeric_limits<double>::max();
  static constexpr std::size_t kNobody = kMaxMembers;
  // Lags 0 to 2 belong to the bank's first member with history, 3 to 5 to the others.
  static constexpr ToolHistory::TimeConstants kTimeConstants_s = {0.010, 0.100, 1.000,
                                                                  0.005, 0.030, 0.200};
  static constexpr int kVelocityLag = 3;  ///< the shortest: the velocity times its constant

  struct Member {
    std::unique_ptr<kriging::Field> field;
    int first_lag = 0;  ///< of the history that its features begin with
    bool uses_history = false;
    std::uint64_t next = 0;  ///< number of the sample that it takes next
    double score_N2 = 0.0;
    double long_score_N2 = 0.0;  ///< over some seconds
    double handicap = 1.0;       ///< its squared errors count this many times
    double least_uncertainty_N = 0.0;
    double young_score_N2 = 0.0;  ///< of the first instants of contacts only
    bool finds_walls = false;
    bool keeps_all = false;        ///< a store of all samples, beside others
    bool knows_places = false;     ///< uses what was asked for before a contact
    bool uses_terms = false;       ///< PathTerms
    bool only_unfinished = false;  ///< takes samples of a simulator that has not converged only
    int proofs = 0;                ///< samples that only its walls explain
    double surprises = 0.0;        ///< fraction of the last samples that surprised it
  };
  struct Queued {
    kriging::Observation observation;  ///< without history
    ToolHistory::Lags lags = ToolHistory::Lags::Zero();
    bool lags_known = false;
    bool terms_known = false;
    bool scored = true;  ///< every member could predict it
    bool wall_found = false;
    bool before_contact = false;
    bool unfinished = false;  ///< the simulator has not converged
    bool young = false;       ///< of the first instants of a contact
    std::array<double, kMaxMembers> error_N2{};
  };
  struct Asked {
    double time_s = -1e300;
    Eigen::Vector3d position_W = Eigen::Vector3d::Zero();
  };

  void add_member(const char* name, const kriging::FieldSettings& settings, int first_lag);
  void add_constraint_member(const char* name, const kriging::FieldSettings& settings);
  void add_store_member(const char* name, const kriging::FieldSettings& settings);
  void add_lag_member(const char* name, const kriging::FieldSettings& settings);
  void add_relaxation_member(const char* name, const kriging::FieldSettings& settings);
  void add_contact_member(const char* name, kriging::FieldSettings settings);
  void add_bank(kriging::FieldSettings settings);
  kriging::History history_at(const Member& member,
                              const Eigen::Vector3d& position_W) const noexcept;
  Queued& queued(std::uint64_t number) noexcept { return queue_[number % kQueueLength]; }
  Member* next_to_work() noexcept;
  int take_one(Member& member) noexcept;
  static bool takes(const Member& member, const Queued& entry) noexcept;
  void note(Member& member, Queued& entry, const kriging::Innovation& innovation) noexcept;
  double rating(const Member& member) const noexcept;
  bool proven_by_path(const Member& member) const noexcept;
  std::size_t best_member() const noexcept;
  void choose_for_contact() noexcept;
  void prove(Member& member, const Queued& entry) noexcept;
  int prepare(Member& member, int budget) noexcept;
  void score() noexcept;
  void hand_over(std::size_t member, ChoiceReason reason) noexcept;
  bool may_follow() const noexcept;
  int follow() noexcept;
  void update_uncertainty() noexcept;
  double uncertainty_N(const Eigen::Vector3d& position_W) const noexcept;
  void set_origin(const Eigen::Vector3d& point_W) noexcept;
  bool asked_lately(double time_s, const Eigen::Vector3d& candidate_W) const noexcept;
  void note_asked(double time_s, const Eigen::Vector3d& wanted_W) noexcept;
  void remember_force() noexcept;
  void remember_place() noexcept;
  static kriging::PathTerms path_terms_N(const ToolHistory::Lags& tool_m,
                                         const ToolHistory::Lags& force_N) noexcept;
  bool plan_before_contact(double time_s, Eigen::Vector3d& wanted_W) noexcept;

  Kind kind_;
  std::unique_ptr<kriging::SampleStore> store_;  ///< of kriging-store and auto, else null
  std::vector<Member> members_;
  std::array<const char*, kMaxMembers> names_{};
  std::size_t active_ = 0;
  std::size_t follower_ = kNobody;     ///< the member that the store belongs to
  std::uint64_t long_scored_ = 0;      ///< samples in the members' long scores
  std::size_t remembering_ = kNobody;  ///< the member that uses PathTerms
  std::size_t places_ = kNobody;       ///< the member that tells contact points apart
  ChoiceReason reason_ = ChoiceReason::kFirst;
  ToolHistory history_;
  std::unique_ptr<ToolHistory> force_history_;  ///< of the felt force; null where none needs it

  std::array<Queued, kQueueLength> queue_{};
  std::uint64_t taken_ = 0;   ///< samples queued so far
  std::uint64_t scored_ = 0;  ///< samples whose errors are in the scores
  NamedCounter passed_over_{"samples_passed_over", 0};

  std::uint64_t contact_ = 0;  ///< contacts made so far
  bool in_contact_ = false;
  bool contact_state_known_ = false;
  bool origin_known_ = false;
  bool contact_sampled_ = false;  ///< the felt field has taken a sample of this contact
  std::uint64_t first_of_contact_ = 0;
  Eigen::Vector3d origin_W_ = Eigen::Vector3d::Zero();
  double contact_s_ = -1e300;   ///< when the contact began
  double expected_s_ = -1e300;  ///< when the contact was last expected
  int answers_before_ = 0;      ///< that came for the contact that is expected
  bool young_scored_ = false;
  bool risen_from_ = false;  ///< newest_force_N_ is of this contact
  Eigen::Vector3d newest_force_N_ = Eigen::Vector3d::Zero();
  double newest_sample_s_ = -1e300;
  Eigen::Vector3d newest_sample_W_ = Eigen::Vector3d::Zero();

  bool observed_ = false;
  double time_s_ = 0.0;
  Eigen::Vector3d position_W_ = Eigen::Vector3d::Zero();
  Eigen::Vector3d velocity_W_ = Eigen::Vector3d::Zero();
  double last_arrival_s_ = -1e300;
  double sample_period_s_ = 1.0 / 30.0;

  Eigen::Vector3d uncertain_from_W_ = Eigen::Vector3d::Zero();
  Eigen::Vector3d uncertain_direction_ = Eigen::Vector3d::Zero();
  double uncertainty_from_N_ = 0.0;
  double uncertainty_slope_N_per_m_ = 0.0;

  std::uint64_t fits_ = 0;
  std::uint64_t surprised_fit_ = 0;
  Eigen::Vector3d lattice_corner_m_ = Eigen::Vector3d::Zero();
  double lattice_spacing_m_ = 0.0;  ///< 0: requests ask anywhere

  int pieces_to_follow_ = 0;  ///< at most, until the felt field knows what there is around
  Eigen::Vector3d followed_to_W_ = Eigen::Vector3d::Zero();

  Eigen::Vector3d handed_over_N_ = Eigen::Vector3d::Zero();
  double handed_over_s_ = 0.0;

  std::array<Asked, kAsked> asked_{};
  std::size_t next_asked_ = 0;
  std::size_t next_around_ = 0;
};

}  // namespace forcegrid
