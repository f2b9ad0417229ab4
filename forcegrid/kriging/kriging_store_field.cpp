// SPDX-License-Identifier: Apache-2.0
#include "forcegrid/kriging/kriging_store_field.h"

#include <algorithm>
#include <cmath>

#include "forcegrid/kriging/dictionary_rules.h"

namespace forcegrid::kriging {
namespace {

constexpr float kReach_m2 = 1e-4F;
constexpr float kFar_m2 = 1.0F;  // for a sample without any other
constexpr double kLeastScaleChange = 1e-6;
constexpr float kRounding = 1.0001F;  // rounding of the same distance, summed in another order
constexpr int kNoSample = -1;

}  // namespace

StoreField::StoreField(const FieldSettings& settings, SampleStore& store, bool writes) noexcept
    : working_(settings), store_(&store), writes_(writes) {}

Innovation StoreField::take(const Observation& observation) noexcept {
  const Innovation innovation = working_.take(observation);
  if (writes_) {
    if (std::abs(innovation.scale - 1.0) > kLeastScaleChange) {
      store_->scale_other_contacts(observation.contact, innovation.scale);
    }
    if (innovation.surprised && !observation.from_query) {
      store_->doubt(observation.position_m, innovation.doubt_N2, settings().doubt_reach_m());
    }
    if (!innovation.surprised || !observation.from_query) {  // no answer against the path is kept
      store_->admit(observation);
    }
  }
  return innovation;
}

// Lists the working set, and the store's samples around where the tool will be, with the weights of
// their distances.
void StoreField::list(const Eigen::Vector3d& tool_m, const Eigen::Vector3d& ahead_m) noexcept {
  const Eigen::Vector3f tool = tool_m.cast<float>();
  const Eigen::Vector3f ahead = ahead_m.cast<float>();
  const auto per_doubt = static_cast<float>(0.1 / settings().nugget_N2);
  const auto weight = [&](const Eigen::Vector3f& at_m, float doubt_N2, bool from_query) {
    const float away_m2 = std::min((at_m - tool).squaredNorm(), (at_m - ahead).squaredNorm());
    const float near = 1.0F / (away_m2 + kReach_m2);
    return (from_query ? static_cast<float>(kQueryValue) : 1.0F) * near * near /
           (1.0F + doubt_N2 * per_doubt);
  };
  set_.count = 0;
  newest_ = -1;
  working_.for_each_sample([&](const Working::Kept& kept) {
    if (kept.newest) {
      newest_ = set_.count;
    }
    const Eigen::Vector3f at_m = kept.position_m.cast<float>();
    set_.add(at_m, weight(at_m, static_cast<float>(kept.doubt_N2), kept.from_query),
             static_cast<std::uint32_t>(kept.slot));
  });
  std::array<std::uint32_t, kMostCandidates> numbers;
  const int count = store_->gather(ahead_m, kMaxSamples, kMostCandidates, numbers.data());
  around_.count = 0;
  for (int i = 0; i < count; ++i) {
    const std::uint32_t number = numbers[static_cast<std::size_t>(i)];
    const Eigen::Vector3f at_m = store_->position_m(number);
    around_.add(at_m, weight(at_m, store_->doubt_N2(number), store_->from_query(number)), number);
  }
}

// Squared distance from a place to the nearest sample of the working set except `except`.
float StoreField::least_m2(const Eigen::Vector3f& at_m, int except) const noexcept {
  float least = kFar_m2;
  for (int i = 0; i < set_.count; ++i) {
    const auto s = static_cast<std::size_t>(i);
    const float dx = set_.x_m[s] - at_m.x();
    const float dy = set_.y_m[s] - at_m.y();
    const float dz = set_.z_m[s] - at_m.z();
    const float d2 = dx * dx + dy * dy + dz * dz;
    least = i != except && d2 < least ? d2 : least;
  }
  return least;
}

void StoreField::measure() noexcept {
  for (int i = 0; i < set_.count; ++i) {
    const auto s = static_cast<std::size_t>(i);
    set_.nearest_m2[s] = least_m2({set_.x_m[s], set_.y_m[s], set_.z_m[s]}, i);
  }
  // Loops over the samples of the set, so that the candidates are processed lane by lane.
  std::fill_n(around_.nearest_m2.begin(), around_.count, kFar_m2);
  for (int i = 0; i < set_.count; ++i) {
    const auto s = static_cast<std::size_t>(i);
    const float x_m = set_.x_m[s];
    const float y_m = set_.y_m[s];
    const float z_m = set_.z_m[s];
    for (std::size_t c = 0; c < static_cast<std::size_t>(around_.count); ++c) {
      const float dx = around_.x_m[c] - x_m;
      const float dy = around_.y_m[c] - y_m;
      const float dz = around_.z_m[c] - z_m;
      around_.nearest_m2[c] = std::min(around_.nearest_m2[c], dx * dx + dy * dy + dz * dz);
    }
  }
}

// Removes a sample from the working set; distances to it are measured again.
void StoreField::take_out(int index) noexcept {
  const auto o = static_cast<std::size_t>(index);
  const Eigen::Vector3f at_m(set_.x_m[o], set_.y_m[o], set_.z_m[o]);
  working_.drop(static_cast<int>(set_.number[o]));
  set_.remove(index);
  if (newest_ == set_.count) {
    newest_ = index;
  }
  const auto was_nearest = [&at_m](const auto& places, std::size_t i) {
    const Eigen::Vector3f p_m(places.x_m[i], places.y_m[i], places.z_m[i]);
    return (p_m - at_m).squaredNorm() <= places.nearest_m2[i] * kRounding;
  };
  for (int i = 0; i < set_.count; ++i) {
    const auto s = static_cast<std::size_t>(i);
    if (was_nearest(set_, s)) {
      set_.nearest_m2[s] = least_m2({set_.x_m[s], set_.y_m[s], set_.z_m[s]}, i);
    }
  }
  for (int i = 0; i < around_.count; ++i) {
    const auto c = static_cast<std::size_t>(i);
    if (was_nearest(around_, c)) {
      around_.nearest_m2[c] = least_m2({around_.x_m[c], around_.y_m[c], around_.z_m[c]}, kNoSample);
    }
  }
}

// Adds a candidate to the working set, which has room.
void StoreField::put_in(int candidate) noexcept {
  const auto c = static_cast<std::size_t>(candidate);
  const StoredSample sample = store_->sample(around_.number[c]);
  Observation observation;
  observation.position_m = sample.position_m;
  observation.force_N = sample.force_N;
  observation.from_query = sample.from_query;
  observation.contact = sample.contact;
  const int slot = working_.bring_in(observation, sample.doubt_N2);
  const Eigen::Vector3f at_m(around_.x_m[c], around_.y_m[c], around_.z_m[c]);
  const auto nearer = [&at_m](auto& places) {
    for (std::size_t i = 0; i < static_cast<std::size_t>(places.count); ++i) {
      const float dx = places.x_m[i] - at_m.x();
      const float dy = places.y_m[i] - at_m.y();
      const float dz = places.z_m[i] - at_m.z();
      places.nearest_m2[i] = std::min(places.nearest_m2[i], dx * dx + dy * dy + dz * dz);
    }
  };
  nearer(set_);
  const float nearest_m2 = around_.nearest_m2[c];
  set_.add(at_m, around_.weight[c], static_cast<std::uint32_t>(slot));
  set_.nearest_m2[static_cast<std::size_t>(set_.count - 1)] = nearest_m2;
  around_.remove(candidate);
  nearer(around_);
}

Followed StoreField::follow(const Eigen::Vector3d& tool_m,
                            const Eigen::Vector3d& ahead_m) noexcept {
  while (working_.prepare()) {
  }
  list(tool_m, ahead_m);
  measure();
  const auto spacing_m2 = static_cast<float>(settings().spacing.metres * settings().spacing.metres);
  int exchanged = 0;
  for (; exchanged < kExchanges; ++exchanged) {
    const bool full = set_.count >= settings().samples;
    int best = kNoSample;
    float best_value = 0.0F;
    for (int c = 0; c < around_.count; ++c) {
      const auto i = static_cast<std::size_t>(c);
      const float value = around_.nearest_m2[i] * around_.weight[i];
      if (value > best_value && (full || around_.nearest_m2[i] >= spacing_m2)) {
        best_value = value;
        best = c;
      }
    }
    if (best == kNoSample) {
      break;
    }
    if (full) {
      int worst = kNoSample;
      float worst_value = best_value / static_cast<float>(kGain);
      for (int s = 0; s < set_.count; ++s) {
        const auto i = static_cast<std::size_t>(s);
        const float value = set_.nearest_m2[i] * set_.weight[i];
        if (s != newest_ && value < worst_value) {
          worst_value = value;
          worst = s;
        }
      }
      if (worst == kNoSample) {
        break;
      }
      take_out(worst);
    }
    put_in(best);
  }
  if (exchanged > 0) {
    working_.apply_changes();
  }
  return {exchanged > 0, exchanged == kExchanges};
}

}  // namespace forcegrid::kriging
