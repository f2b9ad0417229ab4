// SPDX-License-Identifier: Apache-2.0
#include "forcegrid/kriging/contact_indexed_field.h"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <limits>

#include "forcegrid/kriging/dictionary_rules.h"

namespace forcegrid::kriging {
namespace {

constexpr double kPlaceReach = 4.0;  // |c - c_i|^2 against |d_i|^2 in the value of a sample
constexpr double kOffsetsForgotten = 0.2;
constexpr double kOffsetsExpected = 0.5;
constexpr float kOutOfReach_m = 1e3F;
constexpr double kMost = std::numeric_limits<double>::max();

}  // namespace

ContactIndexedField::ContactIndexedField(const FieldSettings& settings) noexcept
    : settings_(settings) {
  settings_.kernel.constant_N2 = 0.0;
  settings_.kernel.history_gain = 0.0;
  settings_.kernel.shape = RadialShape::kSquaredExponential;
  kernel_.field = settings_.kernel;
  const double ratio = kernel_.field.length_m / (2.0 * kernel_.place_m);
  place_weight_ = ratio * ratio;
  collapse();
}

double ContactIndexedField::data_scale() const noexcept {
  return std::max(1.0, factor_.squares() / std::max(1, factor_.rows()));
}

double ContactIndexedField::separation_m2(const Stored& a, const Eigen::Vector3d& position_m,
                                          const Eigen::Vector3d& point_W) const noexcept {
  return (a.position_m - position_m).squaredNorm() +
         place_weight_ * (a.point_W - point_W).squaredNorm();
}

double ContactIndexedField::distance_m2(const Stored& a, const Eigen::Vector3d& position_m,
                                        const Eigen::Vector3d& point_W,
                                        const Eigen::Vector3d& force_N) const noexcept {
  return settings_.spacing.distance_m2(separation_m2(a, position_m, point_W),
                                       (a.force_N - force_N).squaredNorm());
}

double ContactIndexedField::away_m2_of(double displacement_m2,
                                       const Eigen::Vector3d& point_W) const noexcept {
  return displacement_m2 + kPlaceReach * (point_W - point_W_).squaredNorm() + kEvictionReach_m2;
}

void ContactIndexedField::enter_contact(std::uint64_t contact,
                                        const Eigen::Vector3d& point_W) noexcept {
  if (fit_due_) {
    weigh();  // until the next factor is there
  }
  keep_contact();
  contact_ = contact;
  point_W_ = point_W;
  offset_N2_ = offsets_needed_ > kOffsetsExpected ? kOffset_N2 : 0.0;
  transient_ = kNone;
  preparing_ = Preparing::kSelecting;
  if (reads_expected_) {
    collapse();
  }
}

void ContactIndexedField::remember(const Observation& o) noexcept {
  const auto begin = remembered_.begin();
  const auto end = begin + remembered_count_;
  if (o.contact != contact_ || remembered_count_ == kKept ||
      std::any_of(begin, end, [&](const Stored& s) {
        return !settings_.spacing.apart(distance_m2(s, o.position_m, o.origin_W, o.force_N));
      })) {
    return;
  }
  Stored& s = remembered_[static_cast<std::size_t>(remembered_count_++)];
  s = {};
  s.position_m = o.position_m;
  s.force_N = o.force_N;
  s.point_W = o.origin_W;
  s.from_query = o.from_query;
}

// Thins the samples of the contact that ends to the most informative ones, and keeps them.
void ContactIndexedField::keep_contact() noexcept {
  std::array<const Stored*, kMaxSamples + kKept> own;
  int own_count = 0;
  for (const Stored& s : stored_) {
    if (s.used && s.contact == contact_ && s.kept == nullptr) {
      own[static_cast<std::size_t>(own_count++)] = &s;
    }
  }
  const bool fitted = own_count > 0;
  for (int i = 0; i < remembered_count_; ++i) {
    own[static_cast<std::size_t>(own_count++)] = &remembered_[static_cast<std::size_t>(i)];
  }
  remembered_count_ = 0;
  if (own_count == 0) {
    return;
  }
  if (fitted) {
    offsets_needed_ += kOffsetsForgotten * ((offset_N2_ > 0.0 ? 1.0 : 0.0) - offsets_needed_);
  }
  Contact& kept = room_for_contact();
  kept.point_W = point_W_;
  kept.offset_N2 = offset_N2_;
  kept.number = contact_;
  kept.count = 0;
  std::array<double, kMaxSamples + kKept> nearest_m2;
  nearest_m2.fill(kEvictionReach_m2);
  while (kept.count < std::min(own_count, kKept)) {
    int best = kNone;
    double best_value = 0.0;
    for (int i = 0; i < own_count; ++i) {
      const Stored& s = *own[static_cast<std::size_t>(i)];
      const double value = nearest_m2[static_cast<std::size_t>(i)] /
                           (s.position_m.squaredNorm() + kEvictionReach_m2) *
                           (s.from_query ? kQueryValue : 1.0) /
                           (1.0 + s.doubt_N2 / (kDoubtedNuggets * settings_.nugget_N2));
      if (value > best_value) {
        best_value = value;
        best = i;
      }
    }
    if (best == kNone) {
      break;
    }
    const Stored& chosen = *own[static_cast<std::size_t>(best)];
    kept.kept[static_cast<std::size_t>(kept.count++)] = {chosen.position_m, chosen.force_N,
                                                         chosen.point_W, chosen.doubt_N2};
    for (int i = 0; i < own_count; ++i) {
      double& nearest = nearest_m2[static_cast<std::size_t>(i)];
      nearest = std::min(nearest, separation_m2(*own[static_cast<std::size_t>(i)],
                                                chosen.position_m, chosen.point_W));
    }
    nearest_m2[static_cast<std::size_t>(best)] = 0.0;
  }
}

ContactIndexedField::Contact& ContactIndexedField::room_for_contact() noexcept {
  if (contact_count_ < kContacts) {
    return contacts_[static_cast<std::size_t>(contact_count_++)];
  }
  int oldest = 0;
  double nearest_m2 = kMost;
  for (int i = 0; i < contact_count_; ++i) {
    const Contact& a = contacts_[static_cast<std::size_t>(i)];
    for (int j = i + 1; j < contact_count_; ++j) {
      const Contact& b = contacts_[static_cast<std::size_t>(j)];
      const double d2 = (a.point_W - b.point_W).squaredNorm();
      if (d2 < nearest_m2) {
        nearest_m2 = d2;
        oldest = a.number < b.number ? i : j;
      }
    }
  }
  return contacts_[static_cast<std::size_t>(oldest)];
}

// Fills the working set from the contacts around the present one.
void ContactIndexedField::select() noexcept {
  std::array<int, kNeighbours> neighbour;
  std::array<double, kNeighbours> away_m2;
  int neighbours = 0;
  for (int i = 0; i < contact_count_; ++i) {
    const double d2 = (contacts_[static_cast<std::size_t>(i)].point_W - point_W_).squaredNorm();
    int at = neighbours;
    while (at > 0 && away_m2[static_cast<std::size_t>(at - 1)] > d2) {
      --at;
    }
    if (at >= kNeighbours) {
      continue;
    }
    neighbours = std::min(neighbours + 1, kNeighbours);
    for (int j = neighbours - 1; j > at; --j) {
      neighbour[static_cast<std::size_t>(j)] = neighbour[static_cast<std::size_t>(j - 1)];
      away_m2[static_cast<std::size_t>(j)] = away_m2[static_cast<std::size_t>(j - 1)];
    }
    neighbour[static_cast<std::size_t>(at)] = i;
    away_m2[static_cast<std::size_t>(at)] = d2;
  }

  struct Candidate {
    Contact* of;
    Kept* kept;
    double weight;
    double nearest_m2;
  };
  std::array<Candidate, kCandidates> candidates;
  int count = 0;
  for (int n = 0; n < neighbours; ++n) {
    Contact& contact = contacts_[static_cast<std::size_t>(neighbour[static_cast<std::size_t>(n)])];
    for (int k = 0; k < contact.count; ++k) {
      Kept& kept = contact.kept[static_cast<std::size_t>(k)];
      const double weight = kernel_.similarity(point_W_, kept.point_W) /
                            away_m2_of(kept.position_m.squaredNorm(), kept.point_W) /
                            (1.0 + kept.doubt_N2 / (kDoubtedNuggets * settings_.nugget_N2));
      candidates[static_cast<std::size_t>(count++)] = {&contact, &kept, weight, kEvictionReach_m2};
    }
  }
  sample_count_ = 0;
  for (Stored& s : stored_) {
    s.used = false;
  }
  while (sample_count_ < settings_.samples) {
    Candidate* best = nullptr;
    for (int i = 0; i < count; ++i) {
      Candidate& c = candidates[static_cast<std::size_t>(i)];
      if (c.weight * c.nearest_m2 > (best == nullptr ? 0.0 : best->weight * best->nearest_m2)) {
        best = &c;
      }
    }
    if (best == nullptr) {
      break;
    }
    slots_[static_cast<std::size_t>(sample_count_)] = static_cast<std::int16_t>(sample_count_);
    Stored& s = stored_[static_cast<std::size_t>(sample_count_++)];
    const Kept& kept = *best->kept;
    s = {};
    s.position_m = s.first_position_m = kept.position_m;
    s.force_N = s.first_force_N = kept.force_N;
    s.point_W = kept.point_W;
    s.with_origin = kernel_.with_origin(kept.position_m);
    s.similarity = kernel_.similarity(point_W_, kept.point_W);
    s.doubt_N2 = kept.doubt_N2;
    s.offset_N2 = best->of->offset_N2;
    s.contact = best->of->number;
    s.kept = best->kept;
    s.used = true;
    best->weight = 0.0;
    for (int i = 0; i < count; ++i) {
      Candidate& c = candidates[static_cast<std::size_t>(i)];
      c.nearest_m2 = std::min(c.nearest_m2, separation_m2(s, c.kept->position_m, c.kept->point_W));
    }
  }
}

bool ContactIndexedField::prepare() noexcept {
  switch (preparing_) {
    case Preparing::kReady:
      return false;
    case Preparing::kSelecting:
      select();
      begin_factor();
      return true;
    case Preparing::kFactorising:
      for (int i = 0; i < kSamplesAPiece && slot_count_ < sample_count_; ++i) {
        append_next(false);
      }
      if (slot_count_ == sample_count_) {
        preparing_ = Preparing::kReady;
        fit();
      }
      return true;
  }
  return false;
}

void ContactIndexedField::covariances(const Eigen::Vector3d& d, const Eigen::Matrix3d& d_origin,
                                      const Eigen::Vector3d& c,
                                      std::uint64_t contact) const noexcept {
  std::size_t row = 0;
  for (int b = 0; b < slot_count_; ++b) {
    const Stored& s = stored_[static_cast<std::size_t>(slots_[static_cast<std::size_t>(b)])];
    Eigen::Matrix3d k = kernel_.similarity(c, s.point_W) *
                        kernel_.force_force(d, d_origin, s.position_m, s.with_origin);
    if (s.contact == contact) {
      k.diagonal().array() += s.offset_N2;
    }
    for (std::size_t column = 0; column < 3; ++column) {
      for (int i = 0; i < 3; ++i) {
        x_.column[column][row + static_cast<std::size_t>(i)] = k(static_cast<int>(column), i);
      }
    }
    row += 3;
  }
}

Eigen::Matrix3d ContactIndexedField::own_covariance(const Eigen::Vector3d& d,
                                                    const Eigen::Matrix3d& d_origin,
                                                    double offset_N2) const noexcept {
  Eigen::Matrix3d own = kernel_.force_force(d, d_origin, d, d_origin);
  own.diagonal().array() += offset_N2;
  return own;
}

// The rows of the next slot.
void ContactIndexedField::append_next(bool solved) noexcept {
  const Stored& s =
      stored_[static_cast<std::size_t>(slots_[static_cast<std::size_t>(slot_count_)])];
  if (!solved) {
    covariances(s.position_m, s.with_origin, s.point_W, s.contact);
    factor_.solve(x_, 3);
  }
  Eigen::Matrix3d own = own_covariance(s.position_m, s.with_origin, s.offset_N2);
  own.diagonal().array() += settings_.nugget_N2 + s.doubt_N2;
  factor_.append<3>(x_, own, s.force_N, 0.5 * settings_.nugget_N2);
  ++slot_count_;
}

void ContactIndexedField::remove(int slot) noexcept {
  const auto end = slots_.begin() + sample_count_;
  const auto at = std::find(slots_.begin(), end, slot);
  factor_.remove(3 * static_cast<int>(at - slots_.begin()), 3);
  std::copy(at + 1, end, at);
  --slot_count_;
  --sample_count_;
  stored_[static_cast<std::size_t>(slot)].used = false;
  if (transient_ == slot) {
    transient_ = kNone;
  }
}

void ContactIndexedField::begin_factor() noexcept {
  factor_.clear();
  slot_count_ = 0;
  takes_since_factorisation_ = 0;
  preparing_ = Preparing::kFactorising;
}

// Needs the columns of x_ solved for the observation, whose conditional covariance is `v`.
double ContactIndexedField::offset_gain(const Eigen::Vector3d& error_N,
                                        const Eigen::Matrix3d& v) noexcept {
  for (std::size_t c = 0; c < 3; ++c) {
    offset_.column[c].fill(0.0);
  }
  std::size_t row = 0;
  for (int b = 0; b < slot_count_; ++b, row += 3) {
    const Stored& s = stored_[static_cast<std::size_t>(slots_[static_cast<std::size_t>(b)])];
    if (s.contact == contact_ && s.kept == nullptr) {
      for (std::size_t c = 0; c < 3; ++c) {
        offset_.column[c][row + c] = 1.0;
      }
    }
  }
  factor_.solve(offset_, 3);
  Eigen::Matrix3d g = Eigen::Matrix3d::Identity() / kOffset_N2;
  Eigen::Matrix3d explained = Eigen::Matrix3d::Identity();
  Eigen::Vector3d b = Eigen::Vector3d::Zero();
  const auto rows = static_cast<std::size_t>(factor_.rows());
  for (std::size_t r = 0; r < rows; ++r) {
    const Eigen::Vector3d u(offset_.column[0][r], offset_.column[1][r], offset_.column[2][r]);
    const Eigen::Vector3d k(x_.column[0][r], x_.column[1][r], x_.column[2][r]);
    g += u * u.transpose();
    b += factor_.y(static_cast<int>(r)) * u;
    explained -= k * u.transpose();
  }
  const Eigen::Matrix3d inverse = v.inverse();
  g += explained.transpose() * inverse * explained;
  b += explained.transpose() * (inverse * error_N);
  return 0.5 * b.dot(g.inverse() * b) / data_scale() -
         0.5 * std::log((kOffset_N2 * g).determinant());
}

// @returns true if the factor must be computed again.
bool ContactIndexedField::surprised(const Observation& o, const Eigen::Vector3d& error_N,
                                    const Eigen::Matrix3d& covariance_N2) noexcept {
  const double normalised =
      normalised_innovation(error_N, covariance_N2, data_scale(), settings_.nugget_N2);
  if (!(normalised > settings_.surprise)) {
    return false;
  }
  if (fit_due_) {
    weigh();
  }
  if (!has_offset()) {
    Eigen::Matrix3d own = covariance_N2;
    own.diagonal().array() += settings_.nugget_N2;
    if (offset_gain(error_N, own) > kOffsetGain) {
      offset_N2_ = kOffset_N2;
      for (Stored& s : stored_) {
        if (s.used && s.contact == contact_ && s.kept == nullptr) {
          s.offset_N2 = offset_N2_;
        }
      }
      return true;
    }
  }
  const double doubt_N2 = error_N.squaredNorm() / 3.0 * (1.0 - settings_.surprise / normalised);
  const double reach_m = 2.0 * settings_.kernel.length_m;
  for (Stored& s : stored_) {
    // An answer from elsewhere does not contradict what the tool has felt here.
    if (s.used && (s.kept != nullptr || s.from_query || !o.from_query)) {
      const double d2 = (s.position_m - o.position_m).squaredNorm();
      s.doubt_N2 +=
          doubt_N2 * s.similarity * s.similarity * std::exp(-0.5 * d2 / (reach_m * reach_m));
      if (s.kept != nullptr) {
        s.kept->doubt_N2 = s.doubt_N2;
      }
    }
  }
  return true;
}

void ContactIndexedField::settle_transient(bool& rows_moved) noexcept {
  if (transient_ == kNone) {
    return;
  }
  const int slot = transient_;
  const Stored& t = stored_[static_cast<std::size_t>(slot)];
  const Settled settled = settle_newest(
      stored_, slot, settings_.spacing, settings_.nugget_N2,
      [&](const Stored& s) { return distance_m2(s, t.position_m, t.point_W, t.force_N); });
  if (settled.fate != Settled::Fate::kGoes) {
    transient_ = kNone;
    if (settled.fate == Settled::Fate::kReplaces) {
      remove(settled.replaced);
      rows_moved = true;
    }
    return;
  }
  rows_moved = rows_moved || slots_[static_cast<std::size_t>(slot_count_ - 1)] != slot;
  remove(slot);
}

void ContactIndexedField::make_room(const Eigen::Vector3d& position_m, bool& rows_moved) noexcept {
  while (sample_count_ >= settings_.samples) {
    const int worst = least_valuable(
        stored_, transient_,
        [this](const Stored& a, const Stored& b) {
          return separation_m2(a, b.position_m, b.point_W);
        },
        [&](int slot, double nearest_m2) {
          const Stored& s = stored_[static_cast<std::size_t>(slot)];
          return s.similarity * nearest_m2 /
                 away_m2_of((s.position_m - position_m).squaredNorm(), s.point_W) /
                 (1.0 + s.doubt_N2 / (kDoubtedNuggets * settings_.nugget_N2)) *
                 (s.from_query ? kQueryValue : 1.0);
        });
    remove(worst);
    rows_moved = true;
  }
}

Innovation ContactIndexedField::take(const Observation& o) noexcept {
  while (prepare()) {
  }
  Innovation innovation;
  if (o.contact != contact_) {
    return innovation;
  }
  innovation.predicted = sample_count_ > 0;
  const Eigen::Matrix3d with_origin = kernel_.with_origin(o.position_m);
  covariances(o.position_m, with_origin, o.origin_W, o.contact);
  factor_.solve(x_, 3);
  const Eigen::Vector3d error_N = o.force_N - factor_.mean<3>(x_);
  innovation.error_N = error_N.norm();
  bool rows_moved = false;
  bool fresh_needed = ++takes_since_factorisation_ >= kTakesBetweenFactorisations;
  if (fresh_needed && fit_due_) {
    weigh();
  }
  innovation.surprised = surprised(
      o, error_N, own_covariance(o.position_m, with_origin, offset_N2_) - factor_.explained<3>(x_));
  fresh_needed = fresh_needed || innovation.surprised;
  if (o.from_query && std::any_of(stored_.begin(), stored_.end(), [&](const Stored& s) {
        return s.used &&
               !settings_.spacing.apart(distance_m2(s, o.position_m, o.origin_W, o.force_N));
      })) {
    if (fresh_needed) {
      begin_factor();
    }
    return innovation;
  }
  if (!o.from_query) {
    settle_transient(rows_moved);
  }
  make_room(o.position_m, rows_moved);
  int slot = 0;
  while (stored_[static_cast<std::size_t>(slot)].used) {
    ++slot;
  }
  Stored& s = stored_[static_cast<std::size_t>(slot)];
  s = {};
  s.position_m = s.first_position_m = o.position_m;
  s.force_N = s.first_force_N = o.force_N;
  s.point_W = o.origin_W;
  s.with_origin = with_origin;
  s.similarity = kernel_.similarity(point_W_, o.origin_W);
  s.offset_N2 = offset_N2_;
  s.contact = o.contact;
  s.from_query = o.from_query;
  s.used = true;
  slots_[static_cast<std::size_t>(sample_count_++)] = static_cast<std::int16_t>(slot);
  if (!o.from_query) {
    transient_ = slot;
  }
  if (fresh_needed) {
    begin_factor();
  } else {
    append_next(!rows_moved);
    fit();
  }
  return innovation;
}

void ContactIndexedField::expect_reads(bool expected) noexcept {
  reads_expected_ = expected;
  if (expected) {
    if (fit_due_) {
      weigh();
    }
    collapse();
  }
}

void ContactIndexedField::fit() noexcept {
  fit_due_ = !reads_expected_;
  if (!fit_due_) {
    weigh();
    collapse();
  }
}

// The weights of the present factor's samples.
void ContactIndexedField::weigh() noexcept {
  fit_due_ = false;
  factor_.weights(alpha_.data());
  fitted_count_ = slot_count_;
  for (std::size_t i = 0; i < static_cast<std::size_t>(slot_count_); ++i) {
    const Stored& s = stored_[static_cast<std::size_t>(slots_[i])];
    fitted_[i] = {s.position_m, {alpha_[3 * i], alpha_[3 * i + 1], alpha_[3 * i + 2]},
                  s.point_W,    s.with_origin,
                  s.offset_N2,  s.contact};
  }
}

// Computes the sums that do not depend on where the field is read, for the present contact point.
void ContactIndexedField::collapse() noexcept {
  Eigen::Matrix3d moment = Eigen::Matrix3d::Zero();
  Eigen::Vector3d origin = Eigen::Vector3d::Zero();
  Eigen::Vector3d sum = Eigen::Vector3d::Zero();
  Eigen::Vector3d constant = Eigen::Vector3d::Zero();
  const double inverse_length_per_m = 1.0 / kernel_.field.length_m;
  std::size_t lane = 0;
  const auto fill_lane = [&](const Eigen::Vector3d& position_m, const Eigen::Vector3d& weight) {
    for (std::size_t a = 0; a < 3; ++a) {
      lane_rows_[a][lane] =
          static_cast<float>(position_m[static_cast<int>(a)] * inverse_length_per_m);
      lane_rows_[3 + a][lane] = static_cast<float>(weight[static_cast<int>(a)]);
    }
    ++lane;
  };
  for (int i = 0; i < fitted_count_; ++i) {
    const Fitted& f = fitted_[static_cast<std::size_t>(i)];
    const Eigen::Vector3d weight = kernel_.similarity(point_W_, f.point_W) * f.weight;
    fill_lane(f.position_m, weight);
    origin -= f.with_origin * weight;
    sum += weight;
    moment += 0.5 * (weight * f.position_m.transpose() + f.position_m * weight.transpose());
    if (f.contact == contact_) {
      constant += f.offset_N2 * f.weight;
    }
  }
  fill_lane(Eigen::Vector3d::Zero(), origin);
  constant += sum + origin;  // what radial_sum() leaves out
  lanes_used_ = padded(static_cast<int>(lane), kLanePadding);
  while (lane < static_cast<std::size_t>(lanes_used_)) {
    fill_lane(Eigen::Vector3d::Constant(kOutOfReach_m), Eigen::Vector3d::Zero());
  }
  moment.diagonal().array() += moment.trace();
  linear_N_per_m_ = (kernel_.field.stiffness_variance() * moment).cast<float>();
  constant_N_ = constant.cast<float>();
}

RadialTerms<float> ContactIndexedField::radial_terms() const noexcept {
  RadialTerms<float> terms;
  terms.sample_rows = lane_rows_[0].data();
  terms.stride = kLanes;
  terms.samples = lanes_used_;
  terms.length_m = static_cast<float>(kernel_.field.length_m);
  terms.inverse_length_per_m = static_cast<float>(1.0 / kernel_.field.length_m);
  return terms;
}

Reading ContactIndexedField::read(const Eigen::Vector3d& position_m,
                                  const History& /*history*/) const noexcept {
  const Eigen::Vector3f p = position_m.cast<float>();
  const RadialSum<float> radial = radial_sum(radial_terms(), p.data());
  const Eigen::Vector3f rest = constant_N_ + linear_N_per_m_ * p;
  Reading reading;
  for (int a = 0; a < 3; ++a) {
    reading.force_N[a] = static_cast<double>(rest[a] + radial.force_N[a]);
  }
  reading.nearest_m2 = static_cast<double>(radial.nearest_m2);
  return reading;
}

Eigen::Matrix3d ContactIndexedField::stiffness_N_per_m(const Eigen::Vector3d& position_m,
                                                       const History& /*history*/) const noexcept {
  Eigen::Matrix3d j = linear_N_per_m_.cast<double>();
  const Eigen::Vector3f p = position_m.cast<float>();
  const RadialSlope<float> slope = radial_slope(radial_terms(), p.data());
  add_radial_stiffness(slope, j);
  return j;
}

double ContactIndexedField::deviation_N(const Eigen::Vector3d& position_m,
                                        const History& /*history*/) const noexcept {
  covariances(position_m, kernel_.with_origin(position_m), point_W_, contact_);
  factor_.solve(x_, 3);
  const double explained_N2 = factor_.explained<3>(x_).trace();
  const double variance_N2 =
      kernel_.prior_variance_N2(position_m) + offset_N2_ - explained_N2 / 3.0;
  return std::sqrt(std::max(variance_N2, 0.0) * data_scale());
}

}  // namespace forcegrid::kriging
