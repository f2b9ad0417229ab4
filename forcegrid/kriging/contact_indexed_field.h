// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <array>
#include <cstddef>
#include <cstdint>

#include "forcegrid/kriging/contact_kernel.h"
#include "forcegrid/kriging/kriging_factor.h"
#include "forcegrid/kriging/kriging_field.h"
#include "forcegrid/kriging/kriging_simd.h"

namespace forcegrid::kriging {

/// Kriging with ContactKernel's covariance: one field for all places where an object was touched.
/// So a place is known from the first cycle of the next contact on if it, or its neighbourhood, was
/// touched before.
///
///   alpha = (K + diag(nugget + q_i))^-1 F,   F(d) = sum_i K((d, c), (d_i, c_i)) alpha_i
///
/// at the present contact point c. For reading, g(c, c_i) goes into the weights, and all terms that
/// are linear or belong to the origin go into one matrix and one more radial term (kriging_simd.h).
///
/// Memory. Each of the last kContacts contacts keeps up to kKept samples. If there is no room for
/// another contact, the older one of the two nearest to each other is dropped.
///
/// Working set. At most kMaxSamples samples are in the factor: those of this contact and, to begin
/// with, as many as there is room for from the kNeighbours nearest contacts. They are chosen one by
/// one as the one with the largest
///
///   g(c, c_i) min_j D^2(i, j) / (|d_i|^2 + 4 |c - c_i|^2 + (10 mm)^2) / (1 + q_i / (10 nugget)),
///   D^2 = |d_i - d_j|^2 + (l / (2 lc))^2 |c_i - c_j|^2
///
/// where answers to queries along the path of another contact count a twentieth. The set is made in
/// bounded pieces, see prepare(). Until it is ready, the field reads from the last one at the new
/// contact point. The same holds for a factor that a surprise has made obsolete. The dictionary of
/// the contact itself is DictionaryField's, with D instead of the distance: transient newest
/// sample, spacing, refreshing, surprise (the doubt of other contacts' samples counts g^2, and an
/// answer to a query doubts nothing that the tool has felt in this contact). The sample with the
/// least of the value above, taken at the tool, makes room.
///
/// The zero. A contact whose samples contradict F = 0 at the contact point has its own offset b ~
/// N(0, kOffset_N2): the covariance of its samples with each other grows by that. The offset is
/// accepted on a surprise if it raises the evidence of all samples by more than kOffsetGain nats,
///
///   gain = b^T G^-1 b / (2 s2) - ln|G kOffset_N2| / 2,   G = I / kOffset_N2 + X^T X,   b = X^T y,
///
/// X = L^-1 U with U the identity in this contact's rows, L the factor, y = L^-1 F; nothing else is
/// doubted then. Objects whose contacts have needed an offset begin with one.
///
/// Failure: as DictionaryField; forces that depend on the path; the very first contact, unless
/// queries explored its surroundings before it.
/// Source: docs/kriging.md. Real-time: nothing allocates, locks or throws. Threads: one.
class ContactIndexedField final : public Field {
 public:
  /// One lane more than samples is read: the origin's.
  static constexpr int kMaxSamples = 47;
  static constexpr int kKept = 24;
  static constexpr int kContacts = 128;
  static constexpr int kNeighbours = 8;
  static constexpr double kOffset_N2 = 1.0;
  static constexpr double kOffsetGain = 5.0;

  /// @param settings must be usable: positive nugget, lengths and spacings, 2 <= samples <=
  ///        kMaxSamples. Of its kernel l and kappa are used.
  explicit ContactIndexedField(const FieldSettings& settings) noexcept;

  const FieldSettings& settings() const noexcept override { return settings_; }
  const ContactKernel& kernel() const noexcept { return kernel_; }
  std::size_t memory_bytes() const noexcept override { return sizeof(*this); }
  int sample_count() const noexcept override { return fit_due_ ? slot_count_ : fitted_count_; }
  int row_count() const noexcept override { return factor_.rows(); }
  void enter_contact(std::uint64_t contact, const Eigen::Vector3d& point_W) noexcept override;
  bool prepare() noexcept override;
  bool ready() const noexcept override { return preparing_ == Preparing::kReady; }
  /// Puts off the weights of the samples.
  void expect_reads(bool expected) noexcept override;
  /// Ignores late samples of an earlier contact.
  Innovation take(const Observation& observation) noexcept override;
  /// For later contacts: at most kKept samples of this one that are apart (SampleSpacing).
  void remember(const Observation& observation) noexcept override;
  Reading read(const Eigen::Vector3d& position_m, const History& history) const noexcept override;
  Eigen::Matrix3d stiffness_N_per_m(const Eigen::Vector3d& position_m,
                                    const History& history) const noexcept override;
  double deviation_N(const Eigen::Vector3d& position_m,
                     const History& history) const noexcept override;

  int contacts_kept() const noexcept { return contact_count_; }
  /// Whether this contact's samples have contradicted the zero at its point.
  bool has_offset() const noexcept { return offset_N2_ > 0.0; }

 private:
  static constexpr int kNone = -1;
  static constexpr int kMaxRows = 3 * kMaxSamples;
  static constexpr int kLanes = padded(kMaxSamples + 1, kLanePadding);
  static constexpr int kCandidates = kNeighbours * kKept;
  static constexpr int kSamplesAPiece = 8;
  static constexpr int kTakesBetweenFactorisations = 1024;
  using Factor = GrowingCholesky<kMaxRows>;
  enum class Preparing : std::uint8_t { kReady, kSelecting, kFactorising };

  struct Kept {
    Eigen::Vector3d position_m, force_N, point_W;
    double doubt_N2 = 0.0;
  };
  struct Contact {
    Eigen::Vector3d point_W;
    double offset_N2 = 0.0;
    std::uint64_t number = 0;
    int count = 0;
    std::array<Kept, kKept> kept;
  };
  struct Stored {
    Eigen::Vector3d position_m = Eigen::Vector3d::Zero();
    Eigen::Vector3d force_N = Eigen::Vector3d::Zero();
    Eigen::Vector3d first_position_m = Eigen::Vector3d::Zero();  ///< before others replaced it
    Eigen::Vector3d first_force_N = Eigen::Vector3d::Zero();
    Eigen::Vector3d point_W = Eigen::Vector3d::Zero();
    Eigen::Matrix3d with_origin = Eigen::Matrix3d::Zero();
    double similarity = 1.0;  ///< g to the present contact
    double doubt_N2 = 0.0;
    double offset_N2 = 0.0;
    std::uint64_t contact = 0;
    Kept* kept = nullptr;  ///< where an earlier contact's sample came from
    bool from_query = false;
    bool used = false;
  };
  /// The data that the lanes were made of, so that they can be made again for another contact point
  /// while the next factor is being made.
  struct Fitted {
    Eigen::Vector3d position_m, weight, point_W;
    Eigen::Matrix3d with_origin;
    double offset_N2;
    std::uint64_t contact;
  };

  void keep_contact() noexcept;
  Contact& room_for_contact() noexcept;
  void select() noexcept;
  void append_next(bool solved) noexcept;
  void remove(int slot) noexcept;
  void begin_factor() noexcept;
  void covariances(const Eigen::Vector3d& d, const Eigen::Matrix3d& d_origin,
                   const Eigen::Vector3d& c, std::uint64_t contact) const noexcept;
  Eigen::Matrix3d own_covariance(const Eigen::Vector3d& d, const Eigen::Matrix3d& d_origin,
                                 double offset_N2) const noexcept;
  bool surprised(const Observation& observation, const Eigen::Vector3d& error_N,
                 const Eigen::Matrix3d& covariance_N2) noexcept;
  double offset_gain(const Eigen::Vector3d& error_N, const Eigen::Matrix3d& v) noexcept;
  void settle_transient(bool& rows_moved) noexcept;
  void make_room(const Eigen::Vector3d& position_m, bool& rows_moved) noexcept;
  void fit() noexcept;
  void weigh() noexcept;
  RadialTerms<float> radial_terms() const noexcept;
  void collapse() noexcept;
  double away_m2_of(double displacement_m2, const Eigen::Vector3d& point_W) const noexcept;
  double separation_m2(const Stored& a, const Eigen::Vector3d& position_m,
                       const Eigen::Vector3d& point_W) const noexcept;
  double distance_m2(const Stored& a, const Eigen::Vector3d& position_m,
                     const Eigen::Vector3d& point_W, const Eigen::Vector3d& force_N) const noexcept;
  double data_scale() const noexcept;

  FieldSettings settings_;
  ContactKernel kernel_;
  double place_weight_ = 0.0;  ///< (l / (2 lc))^2

  std::array<Contact, kContacts> contacts_;
  int contact_count_ = 0;
  std::array<Stored, kKept> remembered_;  ///< of the present contact, not in the working set
  int remembered_count_ = 0;

  std::array<Stored, kMaxSamples> stored_;
  std::array<std::int16_t, kMaxSamples> slots_{};  ///< of the working set, in order of rows
  int sample_count_ = 0;                           ///< in the working set
  int slot_count_ = 0;                             ///< of these in the factor
  int transient_ = kNone;
  int takes_since_factorisation_ = 0;
  Preparing preparing_ = Preparing::kReady;
  bool reads_expected_ = true;
  bool fit_due_ = false;  ///< the weights of the present factor are put off

  std::uint64_t contact_ = 0;
  Eigen::Vector3d point_W_ = Eigen::Vector3d::Zero();
  double offset_N2_ = 0.0;
  double offsets_needed_ = 0.0;  ///< share of the recent contacts

  Factor factor_;
  mutable typename Factor::Columns x_;
  typename Factor::Columns offset_;
  std::array<double, kMaxRows + kLanePadding> alpha_{};

  std::array<Fitted, kMaxSamples> fitted_;
  int fitted_count_ = 0;
  alignas(64) std::array<std::array<float, kLanes>, 6> lane_rows_;  // as RadialTerms has them
  int lanes_used_ = 0;
  Eigen::Matrix3f linear_N_per_m_ = Eigen::Matrix3f::Zero();
  Eigen::Vector3f constant_N_ = Eigen::Vector3f::Zero();
};

}  // namespace forcegrid::kriging
