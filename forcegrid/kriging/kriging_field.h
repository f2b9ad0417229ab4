// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <span>

#include "forcegrid/kriging/kriging_factor.h"
#include "forcegrid/kriging/kriging_kernel.h"
#include "forcegrid/kriging/kriging_simd.h"
#include "forcegrid/kriging/sample_spacing.h"

namespace forcegrid::kriging {

/// Capacity of the dictionary on a device's own processor.
inline constexpr int kSmallSamples = 16;

struct FieldSettings {
  Kernel kernel;
  double nugget_N2 = 1e-5;    ///< variance of the noise of a sample's force, per axis
  double fitted_share = 1.0;  ///< of the nugget, in a fit that may be close (DictionaryField)
  int samples = 32;           ///< capacity of the dictionary, up to the field's
  int stiffness_samples = 0;  ///< how many of the newest samples keep their stiffness as data
  /// How many samples of one place a full dictionary averages, the newer ones counting more. 1:
  /// none; the newest replaces the one before.
  int averaged = 1;
  int few_samples = 1;             ///< a dictionary of less than these keeps closer ones
  SampleSpacing averaged_spacing;  ///< that tells places apart then

  /// With history features in the kernel, |dP| includes the difference of the histories.
  SampleSpacing spacing;

  double stiffness_noise_N_per_m = 1.0;     ///< standard deviation of a component of dF/dP,
  double relative_stiffness_noise = 0.002;  ///< and of its norm, added in squares
  double surprise = 25.0;  ///< from this normalised squared innovation on, old samples are doubted

  /// The spacing of the samples of a dictionary that has `count`.
  SampleSpacing spacing_among(int count) const noexcept {
    return spacing.of_few(std::min(1.0, static_cast<double>(count) / few_samples));
  }

  /// [m] At this distance from a surprise, samples are doubted by a factor exp(-1/2) less.
  double doubt_reach_m() const noexcept { return 2.0 * kernel.length_m; }
};

/// [N] Quantities that a force may depend on besides the position, each column in newtons: the
/// tool's velocity times kViscousTerm_Ns_per_m, and the force itself through three low-pass
/// filters.
inline constexpr int kPathTerms = 4;
inline constexpr double kViscousTerm_Ns_per_m = 10.0;
using PathTerms = Eigen::Matrix<double, 3, kPathTerms>;

/// What samples of an object that moves carry along (SteadyMotion).
inline constexpr int kMotionTerms = 7;

/// A sample as a field takes it: positions relative to the contact point.
struct Observation {
  Eigen::Vector3d position_m = Eigen::Vector3d::Zero();
  Eigen::Vector3d force_N = Eigen::Vector3d::Zero();
  History history = History::Zero();
  bool has_stiffness = false;
  float noise_N2 = 0.0F;  ///< variance of the force per axis, besides the field's own noise
  Vector6d stiffness_N_per_m = Vector6d::Zero();  ///< in the order of kStiffnessRow
  bool from_query = false;
  bool unfinished = false;  ///< the simulator had not converged
  double time_s = 0.0;      ///< of the servo's clock
  /// How much the force has risen since the simulator's previous answer, if that was of this
  /// contact.
  bool has_rise = false;
  Eigen::Vector3d rise_N = Eigen::Vector3d::Zero();
  PathTerms terms_N = PathTerms::Zero();
  std::uint64_t contact = 0;  ///< number of the contact that it was made in
  /// [m] That contact's point in the workspace frame, where position_m is zero.
  Eigen::Vector3d origin_W = Eigen::Vector3d::Zero();
};

/// The result of taking in an observation.
struct Innovation {
  bool predicted = false;  ///< false: the field knew nothing before
  double error_N = 0.0;    ///< |force - prediction|
  /// Square of the error in units of its predicted variance, averaged over the axes; 0 unless
  /// predicted.
  double normalised = 0.0;
  /// [nats] Logarithm of the predicted density of the error, but for its constant; 0 unless
  /// predicted, and of fields that state no variance.
  double likelihood_nats = 0.0;
  bool surprised = false;  ///< `normalised` above FieldSettings::surprise
  bool explained = false;  ///< by a one-sided constraint that was found, not by doubt
  /// It is not known yet whether it can be explained: prepare() goes on, then taken() tells.
  bool unfinished = false;
  double doubt_N2 = 0.0;  ///< variance added to samples there, or to this answer
  double scale = 1.0;     ///< factor that the forces of earlier contacts were multiplied by
};

/// What has been found out in a contact about what is known of earlier ones.
struct ContactScale {
  double factor = 1.0;     ///< that their forces were multiplied by, since the contact began
  double deviation = 0.0;  ///< standard deviation
};

/// The result of one piece of Field::follow().
struct Followed {
  bool changed = false;  ///< the field's answers differ from those before
  bool more = false;     ///< there may be more to do
};

/// A field's answer at a position.
struct Reading {
  Eigen::Vector3d force_N = Eigen::Vector3d::Zero();
  double nearest_m2 = 0.0;  ///< squared distance of the nearest sample; huge without any
};

/// A conservative force field through a small dictionary of samples, behind an interface that hides
/// its sizes. All positions are relative to the contact point.
/// Real-time: nothing allocates, locks or throws after construction. Threads: one.
class Field {
 public:
  virtual ~Field() = default;
  virtual const FieldSettings& settings() const noexcept = 0;
  virtual std::size_t memory_bytes() const noexcept = 0;
  virtual int sample_count() const noexcept = 0;
  virtual int row_count() const noexcept = 0;

  /// A contact begins, or is expected, at `point_W`; from then on positions in reads are relative
  /// to it. For fields that distinguish places or know something that is fixed in the workspace;
  /// the others learn of a contact from its first observation.
  virtual void enter_contact(std::uint64_t contact, const Eigen::Vector3d& point_W) noexcept {
    static_cast<void>(contact);
    static_cast<void>(point_W);
  }
  /// Does one bounded piece of the work that enter_contact(), take() or begin_with() have left.
  /// Until all is done, read() uses the previous state. @returns false if nothing was left.
  virtual bool prepare() noexcept { return false; }
  virtual bool ready() const noexcept { return true; }

  /// Of the present contact; as if all contacts were alike for a field that looks for no factor.
  virtual ContactScale contact_scale() const noexcept { return {}; }

  /// Whether it knows of walls beyond the object, where no smooth field is right.
  virtual bool knows_walls() const noexcept { return false; }

  /// Call once per servo cycle with the present terms, for fields that use them.
  virtual void observe(const PathTerms& terms_N) noexcept { static_cast<void>(terms_N); }

  /// Takes in one observation. In order: predict there; doubt old samples if that failed; decide on
  /// the sample before; make room; add the new one; fit. Bounded: usually three to nine rows of the
  /// dictionary's factor, at most a full factorisation, which a field that nobody reads leaves to
  /// prepare(). Call it when ready(); else it first does what was left.
  virtual Innovation take(const Observation& observation) noexcept = 0;

  /// The whole result of the last take() that was unfinished, once the field is ready().
  virtual Innovation taken() const noexcept { return {}; }

  /// Begins anew with these observations, oldest first, without evaluating them: for a field that
  /// has not taken samples for a while. One factorisation, as in take().
  /// @returns false, and changes nothing, if a field of this kind can only take() them.
  virtual bool begin_with(std::span<const Observation> observations) noexcept {
    static_cast<void>(observations);
    return false;
  }
  virtual bool can_begin_with() const noexcept { return false; }
  /// Whether anybody will call read() or stiffness_N_per_m(). As long as nobody does, a field may
  /// put off what only these need; call this with true before they are called again.
  virtual void expect_reads(bool expected) noexcept { static_cast<void>(expected); }
  /// Keeps an observation for later without fitting it, for fields with a store.
  virtual void remember(const Observation& observation) noexcept { static_cast<void>(observation); }

  virtual Reading read(const Eigen::Vector3d& position_m,
                       const History& history) const noexcept = 0;

  /// [N/m] dF/dP of read(), at the same history: how the force changes for a small step of the
  /// tool. Symmetric except for history features.
  virtual Eigen::Matrix3d stiffness_N_per_m(const Eigen::Vector3d& position_m,
                                            const History& history) const noexcept = 0;

  /// [N] Posterior standard deviation of a component of the force, averaged over the axes, scaled
  /// by the data's own spread if that is above the prior's. O(rows^2).
  virtual double deviation_N(const Eigen::Vector3d& position_m,
                             const History& history) const noexcept = 0;

  /// Does one bounded piece of work that improves the field where the tool is (`tool_m`) and will
  /// soon be (`ahead_m`). A field that is equally good everywhere has nothing to do.
  virtual Followed follow(const Eigen::Vector3d& tool_m, const Eigen::Vector3d& ahead_m) noexcept {
    static_cast<void>(tool_m);
    static_cast<void>(ahead_m);
    return {};
  }
};

/// Kriging with Kernel's covariance over at most kMaxSamples samples, the newest kMaxStiffness of
/// them with their stiffness:
///
///   alpha = (K + diag(nugget + q_i))^-1 F,   F(p) = sum_i K(p, p_i) alpha_i
///
/// Fitted in double precision, read in `Real`. For reading, the linear, constant and history parts
/// of the sum collapse to a symmetric matrix, a vector and one matrix per feature, so only the
/// radial part remains a sum over samples (kriging_simd.h).
///
/// Closeness. The simulator's forces have less noise than is safe to assume: where few samples, or
/// samples that the prior hardly expects, are fitted too closely, the field swings beyond them. So
/// the fit assumes settings().fitted_share of the nugget only while it has 24 samples and s2
/// (below) is small: below 0.5, 64 takes after the last factorisation at the earliest, for each
/// sample that comes, and above 0.75 for none any more. Surprises are judged by the whole nugget.
///
/// Dictionary. The newest sample is always in, but transient. When the next one comes, it stays if
/// it is apart from all others (SampleSpacing), replaces the nearest if that was doubted more or if
/// it repeats the place where that one began, and is dropped otherwise. (Without this bound a slow
/// motion would drag one sample along and lose what it had known.) While there are less than
/// settings().few_samples, closer ones are apart, too: a tool that moves by less than the spacing
/// would otherwise leave three samples, which tell no stiffness. A full dictionary drops the
/// sample with the least  min_j |p_i - p_j|^2 / (|p_i - P|^2 + (10 mm)^2) / (1 + q_i / (10
/// nugget)), where answers to queries count a twentieth.
///
/// Forgetting is gated by surprise: with the innovation e and V = (predictive covariance)
/// max(1, s2) + nugget I, s2 = F^T alpha / rows, a normalised square N = e^T V^-1 e / 3 above 25
/// adds  q_i += |e|^2/3 (1 - 25/N) exp(-|p_i - P|^2 / (2 (2 l)^2))  to the noise of every sample.
/// Forgetting by age instead would lose the directions that a resting hand doesn't explore, and
/// make the loop unstable.
///
/// Contacts. Another place of an object often has the same shape of stiffness, but stiffer or
/// softer. At a new contact everything known of earlier ones is assumed to be right but for one
/// factor s, N(1, v). A scalar Kalman filter learns s from the innovations e with the part m of the
/// prediction that comes from earlier contacts:
///
///   s - 1 = p m^T V^-1 e,   p = 1 / (1/v + m^T V^-1 m),   v <- p,
///
/// where V is inflated by the normalised square of the part of e that s does not explain. The
/// samples of the earlier contacts are multiplied by s, within 0.5 and 2. If the stiffness is data,
/// its innovation teaches s in the same way, and first, until v is below 1e-4: at the first touch
/// the force is zero and says nothing about s, but the stiffness does. v begins with the mean
/// square of the changes at earlier contacts, 0.03 at first and between 1e-4 and 0.09: on objects
/// that prove to be alike everywhere s stays at one.
///
/// Answers to queries join the dictionary where none of its samples is near; they are never the
/// transient newest sample.
///
/// Other data of the same samples, kTerms vectors each, may be carried along for an owner who
/// derives: y_j = L^-1 R_j beside y = L^-1 F. They are zero for a sample's stiffness.
///
/// Failure: kinks within l of the samples; forces that depend on more than position (the history
/// features are for those that depend on the path, UnilateralConstraintField for kinks).
/// Source: docs/kriging.md; Rasmussen and Williams, 2006, chapter 2.
template <typename Real, int kMaxSamples, int kMaxStiffness, int kTerms = 0>
class DictionaryField : public Field {
 public:
  /// @param settings must be usable: positive nugget, lengths and spacings, 2 <= samples <=
  ///        kMaxSamples, stiffness_samples <= kMaxStiffness.
  explicit DictionaryField(const FieldSettings& settings) noexcept;

  const FieldSettings& settings() const noexcept override { return settings_; }
  std::size_t memory_bytes() const noexcept override { return sizeof(*this); }
  int sample_count() const noexcept override { return sample_count_; }
  int row_count() const noexcept override { return factor_.rows(); }
  void enter_contact(std::uint64_t /*contact*/, const Eigen::Vector3d& point_W) noexcept override {
    origin_W_ = point_W;
  }
  Innovation take(const Observation& observation) noexcept override;
  /// Of observations that are not apart (SampleSpacing), the newest is taken.
  bool begin_with(std::span<const Observation> observations) noexcept override;
  bool can_begin_with() const noexcept override { return true; }
  bool prepare() noexcept override {
    if (blocks_due_ == 0) {
      return false;
    }
    append_some();
    if (blocks_due_ == 0) {
      collapse();
    }
    return true;
  }
  bool ready() const noexcept override { return blocks_due_ == 0; }
  ContactScale contact_scale() const noexcept override {
    return {scale_, std::sqrt(scale_variance_)};
  }
  /// Puts off the weights of the samples, a fifth of the work of take(), and full factorisations.
  void expect_reads(bool expected) noexcept override {
    reads_expected_ = expected;
    if (expected) {
      finish();
      if (collapse_due_) {
        collapse();
      }
    }
  }
  Reading read(const Eigen::Vector3d& position_m, const History& history) const noexcept override;
  Eigen::Matrix3d stiffness_N_per_m(const Eigen::Vector3d& position_m,
                                    const History& history) const noexcept override;
  double deviation_N(const Eigen::Vector3d& position_m,
                     const History& history) const noexcept override;

  /// A sample of the dictionary as its owner sees it.
  struct Kept {
    int slot;
    Eigen::Vector3d position_m;
    Eigen::Vector3d force_N;
    double doubt_N2;
    bool from_query;
    bool newest;  ///< the transient one, which take() decides on
  };
  /// Calls `use` on each sample of the dictionary.
  template <typename Use>
  void for_each_sample(Use use) const noexcept {
    for (int slot = 0; slot < kMaxSamples; ++slot) {
      const Stored& s = stored_[static_cast<std::size_t>(slot)];
      if (s.used) {
        use(Kept{slot, s.position_m, s.force_N, s.doubt_N2, s.from_query, slot == transient_});
      }
    }
  }
  /// For an owner who changes the dictionary. drop() removes a sample. bring_in() adds one without
  /// comparing it with the others, which needs sample_count() < settings().samples, and returns its
  /// slot. apply_changes() must follow; until then the field's answers do not change.
  void drop(int slot) noexcept { remove_sample(slot); }
  int bring_in(const Observation& observation, double doubt_N2) noexcept {
    ++takes_since_factorisation_;
    const int slot = place(observation);
    stored_[static_cast<std::size_t>(slot)].doubt_N2 = doubt_N2;
    append_force(slot, false);
    return slot;
  }
  void apply_changes() noexcept {
    if (takes_since_factorisation_ >= kTakesBetweenFactorisations) {
      factorise();
    }
    collapse();
  }

  /// The sums that reading is made of, for tests of the lanes.
  RadialTerms<Real> radial_terms() const noexcept;

 protected:
  static constexpr int kMaxSamplesHeld = kMaxSamples;
  static constexpr int kMaxBlocks = kMaxSamples + kMaxStiffness;
  static constexpr int kMaxRows = 3 * kMaxSamples + 6 * kMaxStiffness;
  static constexpr int kLanes = padded(kMaxSamples, kLanePadding);
  static constexpr int kFewLanes = kMaxStiffness == 0 ? 4 : padded(kMaxStiffness, 4);
  static constexpr int kNone = -1;
  /// Rounding of the rotations adds up slowly; a fresh factorisation this often keeps it out.
  static constexpr int kTakesBetweenFactorisations = 1024;
  // Of the closeness; docs/kriging.md has the comparison.
  static constexpr int kEnoughSamples = 24;
  static constexpr int kTakesBeforeClose = 64;
  static constexpr double kLikelySquares = 0.5;
  static constexpr double kUnlikelySquares = 0.75;
  /// To a full factor, or as much work.
  static constexpr int kAppendsAPiece = 3;
  using Factor = GrowingCholesky<kMaxRows, kTerms>;
  using Terms = Eigen::Matrix<double, 3, kTerms>;

  struct Stored {
    Eigen::Vector3d position_m, force_N;
    Eigen::Vector3d first_position_m, first_force_N;  ///< before others replaced it
    History history;
    Vector6d stiffness_N_per_m;
    double doubt_N2 = 0.0;  ///< q
    double count = 1.0;     ///< samples that it is the average of: its variance is nugget / count
    std::uint64_t order = 0;
    bool from_query = false;
    std::uint64_t contact = 0;
    Eigen::Vector3d origin_W;
    bool used = false;
    bool close = false;  ///< taken by a close fit: its variance is fitted_share of that
  };
  /// Consecutive rows of the factor: a sample's force (3) or stiffness (6).
  struct Block {
    std::int16_t slot;
    bool stiffness;
    int rows() const noexcept { return stiffness ? 6 : 3; }
  };

  // For fields that carry other data along.

  /// That of a sample which goes into `slot`.
  virtual Terms terms_of(const Observation& observation, int slot) noexcept {
    static_cast<void>(slot);
    if constexpr (kTerms <= kPathTerms) {
      return observation.terms_N.template leftCols<kTerms>();
    } else {
      return Terms::Zero();
    }
  }
  /// As long as not, they cost nothing and are not to be read; see GrowingCholesky::clear_more().
  virtual bool carries_terms() const noexcept { return kTerms > 0; }

  // For fields that add features, forces with a few unknown weights, to the covariance. Features
  // are fitted when the weights are solved for, and stay the same until then.

  /// Solves for alpha_.
  virtual void solve_weights() noexcept { factor_.weights(alpha_.data()); }
  /// Called by take() with the observation's covariances with the rows, solved, before anything
  /// changes.
  virtual void predicted(const Observation& observation,
                         const typename Factor::Columns& x) noexcept {
    static_cast<void>(observation);
    static_cast<void>(x);
  }
  /// Adds to the mean and covariance of the force at `p`. Needs its covariances with the rows,
  /// solved.
  virtual void add_features(const Eigen::Vector3d& p, const Eigen::Vector3d& origin_W,
                            const typename Factor::Columns& x, Eigen::Vector3d& mean_N,
                            Eigen::Matrix3d& covariance_N2) const noexcept {
    static_cast<void>(p);
    static_cast<void>(origin_W);
    static_cast<void>(x);
    static_cast<void>(mean_N);
    static_cast<void>(covariance_N2);
  }
  /// The features' part of a sample's force.
  virtual Eigen::Vector3d feature_force_N(const Stored& sample) const noexcept {
    static_cast<void>(sample);
    return Eigen::Vector3d::Zero();
  }
  /// The part of |y|^2 that the features explain.
  virtual double explained_squares() const noexcept { return 0.0; }
  /// Whether to look for other features that explain a surprise, so that no sample needs to be
  /// doubted. Then take() ends here, and finish_surprise() must follow.
  virtual bool seeks_explanation(const Observation& observation, const Eigen::Vector3d& error_N,
                                 const Innovation& innovation) noexcept {
    static_cast<void>(observation);
    static_cast<void>(error_N);
    static_cast<void>(innovation);
    return false;
  }
  /// The rest of take(). Unless `innovation` is explained, samples are doubted, or the answer to a
  /// query: those of the tool's path tell more of where the tool is. If it is explained, the factor
  /// is in order, else it may be stale.
  void finish_surprise(const Observation& observation, const Eigen::Vector3d& error_N,
                       Innovation& innovation) noexcept {
    if (innovation.explained) {
      add(observation, true, true, takes_since_factorisation_ >= kTakesBetweenFactorisations);
      return;
    }
    innovation.doubt_N2 =
        error_N.squaredNorm() / 3.0 * (1.0 - settings_.surprise / innovation.normalised);
    Observation taken = observation;
    if (observation.from_query) {
      taken.noise_N2 += static_cast<float>(innovation.doubt_N2);
    } else {
      doubt_samples(observation.position_m, innovation.doubt_N2);
    }
    add(taken, false, true, true);
  }
  /// A sample that features depend on is the last to be removed.
  virtual bool features_need(int slot) const noexcept {
    static_cast<void>(slot);
    return false;
  }

  void covariances_of_force(const Eigen::Vector3d& p, const History& h,
                            typename Factor::Columns& x) const noexcept;
  void covariances_of_stiffness(const Eigen::Vector3d& p,
                                typename Factor::Columns& x) const noexcept;
  // s2 is the mean square of what the factor makes of the data, which the prior expects to be one.
  void decide_closeness() noexcept {
    if (settings_.fitted_share >= 1.0 || factor_.rows() == 0) {
      return;
    }
    const double s2 = (factor_.squares() - explained_squares()) / factor_.rows();
    const bool ends = s2 > kUnlikelySquares;
    const bool begins = sample_count_ >= kEnoughSamples && s2 < kLikelySquares &&
                        takes_since_factorisation_ >= kTakesBeforeClose;
    if (fits_closely_ ? ends : begins) {
      fits_closely_ = !fits_closely_;
      if (!fits_closely_) {
        // The sample that comes makes the factor anew. A fit becomes close sample by sample.
        takes_since_factorisation_ = kTakesBetweenFactorisations;
      }
    }
  }
  /// Of the rows just appended.
  template <int kRows>
  void append_terms(int slot) noexcept {
    if constexpr (kTerms > 0) {
      using RowTerms = Eigen::Matrix<double, kRows, kTerms>;
      if (!carries_terms()) {
        return;
      }
      if constexpr (kRows == 3) {
        factor_.template append_more<3>(x_, terms_N_[static_cast<std::size_t>(slot)]);
      } else {
        factor_.template append_more<kRows>(x_, RowTerms::Zero());
      }
    }
  }
  void append_force(int slot, bool solved) noexcept;
  void append_stiffness(int slot) noexcept;
  void remove_block(int block) noexcept;
  void remove_sample(int slot) noexcept;
  void factorise() noexcept {
    begin_factor();
    while (append_next()) {
    }
  }
  /// The factor begins anew; its blocks are appended one by one.
  void begin_factor() noexcept {
    for (Stored& stored : stored_) {
      stored.close = fits_closely_;
    }
    blocks_due_ += block_count_;
    block_count_ = 0;
    factor_.clear();
    takes_since_factorisation_ = 0;
  }
  /// @returns false if none was left.
  bool append_next() noexcept {
    if (blocks_due_ == 0) {
      return false;
    }
    --blocks_due_;
    const Block& block = blocks_[static_cast<std::size_t>(block_count_)];
    if (block.stiffness) {
      append_stiffness(block.slot);
    } else {
      append_force(block.slot, false);
    }
    return true;
  }
  /// One piece of those that are left.
  void append_some() noexcept {
    int squares = 0;  // an append's work
    while (squares < kAppendsAPiece * kMaxRows * kMaxRows && append_next()) {
      squares += factor_.rows() * factor_.rows();
    }
  }
  /// Does what prepare() would.
  void finish() noexcept {
    while (prepare()) {
    }
  }
  void finish_if_read() noexcept {
    if (reads_expected_) {
      blocks_due_ > 0 ? finish() : collapse();
    }
  }
  void append_later(int slot, bool stiffness) noexcept {
    blocks_[static_cast<std::size_t>(block_count_ + blocks_due_++)] = {
        static_cast<std::int16_t>(slot), stiffness};
  }
  void doubt_samples(const Eigen::Vector3d& around_m, double doubt_N2) noexcept;
  int place(const Observation& observation) noexcept;
  void add(const Observation& observation, bool explained, bool stale, bool fresh_needed) noexcept;
  void begin_contact(std::uint64_t contact) noexcept;
  void earlier_contacts(std::array<double, Factor::kStride>& f) const noexcept;
  template <int kCount>
  void scale_earlier_contacts(const typename Factor::Columns& x,
                              const std::array<double, Factor::kStride>& earlier,
                              const Eigen::Matrix<double, kCount, kCount>& variance,
                              Eigen::Matrix<double, kCount, 1>& error) noexcept;
  void scale_by_stiffness(const Observation& o) noexcept;
  double stiffness_variance(const Vector6d& stiffness_N_per_m, double doubt_N2) const noexcept;
  bool settle_transient() noexcept;
  void average_into(int slot, const Stored& n) noexcept;
  bool make_room(const Eigen::Vector3d& position_m) noexcept;
  void limit_stiffness() noexcept;
  void collapse() noexcept;
  double distance_m2(const Stored& a, const Eigen::Vector3d& position_m, const History& h,
                     const Eigen::Vector3d& force_N) const noexcept {
    return settings_.spacing.distance_m2(moved_m2(a, position_m, h),
                                         (a.force_N - force_N).squaredNorm());
  }
  /// [m^2] The same, whatever the forces are.
  double moved_m2(const Stored& a, const Eigen::Vector3d& position_m,
                  const History& h) const noexcept {
    const double moved_m2 = (a.position_m - position_m).squaredNorm();
    return settings_.kernel.history_gain > 0.0 ? moved_m2 + (a.history - h).squaredNorm()
                                               : moved_m2;
  }
  double data_scale() const noexcept;
  double variance_N2(const Eigen::Vector3d& position_m, const History& history) const noexcept;

  FieldSettings settings_;
  std::array<Stored, kMaxSamples> stored_{};
  std::array<Terms, kTerms == 0 ? 0 : kMaxSamples> terms_N_{};
  std::array<Block, kMaxBlocks> blocks_{};
  int block_count_ = 0;  ///< of them in the factor
  int blocks_due_ = 0;   ///< behind these, which prepare() appends
  int sample_count_ = 0;
  int transient_ = kNone;
  std::uint64_t next_order_ = 0;
  int takes_since_factorisation_ = 0;
  bool reads_expected_ = true;
  bool collapse_due_ = false;  ///< put off, since nobody reads
  bool fits_closely_ = false;
  std::uint64_t contact_ = 0;
  double scale_ = 1.0;           ///< s of this contact so far
  double scale_variance_ = 0.0;  ///< v; 0: there is no earlier contact
  double expected_scale_variance_ = 0.03;
  Eigen::Vector3d origin_W_ = Eigen::Vector3d::Zero();
  Factor factor_;
  mutable typename Factor::Columns x_;
  std::array<double, kMaxRows + kLanePadding> alpha_{};

  // What reading needs: the radial terms lane by lane, the rest collapsed.
  alignas(64) std::array<std::array<Real, kLanes>, 6> lane_rows_;    // as RadialTerms
  alignas(64) std::array<std::array<Real, kFewLanes>, 9> few_rows_;  // has them
  Real inverse_length_per_m_;
  int lanes_used_ = 0;
  int few_lanes_used_ = 0;
  Eigen::Matrix<Real, 3, 3> linear_N_per_m_;
  Eigen::Matrix<Real, 3, 1> constant_N_;
  std::array<Eigen::Matrix<Real, 3, 3>, kHistoryFeatures> history_N_per_m_;
};

}  // namespace forcegrid::kriging
