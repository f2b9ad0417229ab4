// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

#include "forcegrid/core/pair_force_method.h"
#include "forcegrid/kriging/kriging_factor.h"
#include "forcegrid/kriging/sample_spacing.h"
#include "forcegrid/pair/pair_kernel.h"
#include "forcegrid/pair/pair_simd.h"

namespace forcegrid::pair {

struct PairFieldSettings {
  PairKernel kernel;
  double nugget_N2 = 1e-6;  ///< variance of the noise of a sample, per component
  int samples = 32;         ///< capacity of the dictionary, 2 to PairField::kMaxSamples
  /// How many of the newest samples keep their stiffness as data, 0 to PairField::kMaxStiffness.
  int stiffness_samples = 0;
  double stiffness_noise_N_per_m = 0.3;      ///< least standard deviation of a number of dF/dp,
  double relative_stiffness_noise = 0.0005;  ///< and of its norm, added in squares
  kriging::SampleSpacing spacing;            ///< of distances in R^6
  double surprise = 25.0;  ///< from this normalised squared innovation on, old samples are doubted
};

/// What the field said of a sample before it took it.
struct PairInnovation {
  bool predicted = false;   ///< there was something to predict from
  double error_N = 0.0;     ///< |F - prediction|
  double normalised = 0.0;  ///< e^T V^-1 e / 6
  bool surprised = false;
};

/// Kriging over the positions of two tools: PairKernel's covariance over a dictionary of samples,
/// six rows each, and 21 more for each of the newest that have a stiffness,
///
///   alpha = (K + diag(nugget + q_i))^-1 F,   F(p) = sum_i K(p, p_i) alpha_i
///
/// A stiffness is symmetric in a field with an energy, so what a sample has is averaged with its
/// transpose. Its variance is the sum of that of the settings, of q_i / (l/3)^2, since a force that
/// is doubted by some newtons makes the slope over a third of l doubtful as well, and of what the
/// last samples show of it:
///
///   max(0, sum_k 0.95^k (|F' - F - (J + J') dp / 2|^2 - 18 nugget)) / (6 sum_k 0.95^k |dp|^2)
///
/// over the steps dp from each sample to the next that are shorter than l/4. So a simulator whose
/// derivative is off is trusted as far as it explains its own forces.
///
/// Dictionary, doubt and surprise are those of kriging::DictionaryField in R^6: the newest sample
/// is transient; a full dictionary drops the one that is near others, far from the tools or
/// doubted; a normalised squared innovation N above `surprise` adds |e|^2/6 (1 - surprise/N)
/// exp(-d^2/(2 (2 l)^2)) to the noise q_i of the samples.
///
/// A sample is taken in pieces: begin() and then prepare() until it returns false. Until then
/// read() answers from the samples before. Fitted in double, read in single precision.
/// Failure: kinks within l of the samples; forces that depend on more than both positions.
/// Source: Rasmussen and Williams, Gaussian Processes for Machine Learning, 2006, chapter 2.
/// Real-time: no allocation, lock or throw. Threads: one.
class PairField {
 public:
  static constexpr int kMaxSamples = 48;
  static constexpr int kMaxStiffness = 4;
  static constexpr int kAppendsAPiece = 4;  ///< of six rows; at most half as many of a stiffness

  /// @param settings must be usable: positive nugget, lengths and spacings.
  explicit PairField(const PairFieldSettings& settings) noexcept;

  const PairFieldSettings& settings() const noexcept { return settings_; }
  int sample_count() const noexcept { return sample_count_; }
  int row_count() const noexcept { return factor_.rows(); }

  /// Forgets everything.
  void clear() noexcept;

  /// Begins to take a sample. Needs ready().
  /// @param positions_m relative to where the tools touched. @param forces_N on the tools.
  /// @param stiffness_N_per_m  dF/dp there, finite; null: unknown.
  void begin(const PairVector& positions_m, const PairVector& forces_N,
             const Matrix6* stiffness_N_per_m = nullptr) noexcept;

  /// Does the next piece: the prediction; the change of the dictionary, that is the removal of up
  /// to two samples and the appending of one; half of its stiffness; or the weights. After a
  /// surprise also those of a whole factorisation, kAppendsAPiece samples each. @returns false if
  /// nothing was left.
  bool prepare() noexcept;
  bool ready() const noexcept { return stage_ == Stage::kReady; }

  /// Whether anybody will call read(). As long as nobody does, the weights are put off; call this
  /// with true, and prepare(), before read() is called again.
  void expect_reads(bool expected) noexcept;

  /// Of the sample that was taken last, once the field is ready().
  const PairInnovation& innovation() const noexcept { return innovation_; }

  /// Whether a sample has been taken completely, so that there is something to read.
  bool readable() const noexcept { return lanes_used_ > 0; }

  struct Reading {
    PairVector forces_N;
    double nearest_m;  ///< distance of the nearest sample in R^6
  };
  /// Needs readable().
  Reading read(const PairVector& positions_m) const noexcept;

  /// [N/m] dF/dp of read(), 6x6 and symmetric: its off-diagonal blocks are how each tool's force
  /// changes with the other's position.
  Matrix6 stiffness_N_per_m(const PairVector& positions_m) const noexcept;

 private:
  static constexpr int kRows = 6;
  static constexpr int kMaxRows = kRows * kMaxSamples + kStiffnessNumbers * kMaxStiffness;
  static constexpr int kMaxBlocks = kMaxSamples + kStiffnessParts * kMaxStiffness;
  static constexpr int kNone = -1;
  static constexpr int kStride = kMaxSamples;
  static_assert(kStride % kPairLanes == 0);
  static_assert(kMaxStiffness <= kPairFewLanes);
  using Factor = kriging::GrowingCholesky<kMaxRows>;

  enum class Stage : std::uint8_t { kReady, kPredict, kChange, kAppend, kFit };

  /// A slot of the dictionary, as kriging/dictionary_rules.h expects it.
  struct Stored {
    PairVector position_m;
    PairVector force_N;
    PairVector first_position_m;
    PairVector first_force_N;
    double doubt_N2 = 0.0;
    bool used = false;
    std::array<double, kStiffnessNumbers> stiffness_N_per_m{};
  };

  /// Consecutive rows of the factor: a sample's force, or a part of its stiffness.
  struct Block {
    static constexpr int kForce = -1;
    std::int16_t slot;
    std::int16_t part;
    int rows() const noexcept { return part == kForce ? kRows : part_size(part); }
  };

  const Block& block(int i) const noexcept { return blocks_[static_cast<std::size_t>(i)]; }
  const Stored& of_block(int i) const noexcept {
    return stored_[static_cast<std::size_t>(block(i).slot)];
  }
  double stiffness_variance(const Stored& sample) const noexcept;
  void check_stiffness() noexcept;
  void solve_covariances(const PairVector& position_m, int part) noexcept;
  void predict() noexcept;
  void doubt_samples(const PairVector& error_N) noexcept;
  void settle_transient() noexcept;
  void make_room() noexcept;
  void append_new() noexcept;
  void end_change() noexcept;
  void append_next() noexcept;
  void append_some() noexcept;
  void limit_stiffness() noexcept;
  void remove_blocks(int first, int count) noexcept;
  void remove(int slot) noexcept;
  void begin_factor() noexcept;
  void fit() noexcept;
  PairTerms terms() const noexcept;

  PairFieldSettings settings_;
  std::array<Stored, kMaxSamples> stored_{};
  /// In the order of the factor's rows; a sample's stiffness follows its force.
  std::array<Block, kMaxBlocks> blocks_{};
  int block_total_ = 0;
  int block_count_ = 0;  ///< of them in the factor
  int sample_count_ = 0;
  int transient_ = kNone;
  int takes_since_factorisation_ = 0;

  Stage stage_ = Stage::kReady;
  bool reads_expected_ = true;
  bool fit_due_ = false;  ///< the weights are not of the dictionary
  PairVector new_position_m_ = PairVector::Zero();
  PairVector new_force_N_ = PairVector::Zero();
  bool new_has_stiffness_ = false;
  std::array<double, kStiffnessNumbers> new_stiffness_N_per_m_{};

  // Of the sample before the newest.
  bool has_before_ = false;
  PairVector before_m_ = PairVector::Zero();
  PairVector before_N_ = PairVector::Zero();
  std::array<double, kStiffnessNumbers> before_N_per_m_{};
  double unexplained_N2_ = 0.0;  ///< see check_stiffness()
  double moved_m2_ = 0.0;
  bool factor_stale_ = false;  ///< samples' noise has changed: the factor must be made anew
  bool solved_ = false;        ///< x_ is of the new position and the present rows
  PairInnovation innovation_;

  Factor factor_;
  Factor::Columns x_;
  std::array<double, kMaxRows + kriging::kLanePadding> alpha_{};

  // As PairTerms.
  alignas(64) std::array<std::array<float, kStride>, 12> lanes_{};
  alignas(64) std::array<std::array<float, kPairFewLanes>, 6 + kStiffnessNumbers> few_lanes_{};
  int lanes_used_ = 0;
  int few_used_ = 0;
  Eigen::Matrix<float, 6, 6> linear_N_per_m_ = Eigen::Matrix<float, 6, 6>::Zero();
  Eigen::Matrix<float, 6, 1> constant_N_ = Eigen::Matrix<float, 6, 1>::Zero();
};

}  // namespace forcegrid::pair
