// SPDX-License-Identifier: Apache-2.0
#include "forcegrid/kriging/kriging_store.h"

#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <random>
#include <vector>

#include "forcegrid/kriging/kriging_store_field.h"
#include "forcegrid/kriging/store_follower.h"
#include "forcegrid/kriging/tool_motion.h"
#include "forcegrid/method_variant.h"
#include "forcegrid/methods.h"

namespace forcegrid::kriging {
namespace {

using Eigen::Vector3d;
using Eigen::Vector3f;

constexpr unsigned kSeed = 17;
const History kNoHistory = History::Zero();

// A smooth conservative field over a large space: the gradient of a sum of cosines of 0.12 m.
Vector3d force_N(const Vector3d& p) {
  const Vector3d k[] = {{52.0, 10.0, 4.0}, {-20.0, 45.0, 12.0}, {8.0, -15.0, 50.0}};
  Vector3d force = -60.0 * p;
  for (int i = 0; i < 3; ++i) {
    force += 2.0 / 52.0 * std::sin(k[i].dot(p) + i) * k[i];
  }
  return force;
}

Observation observe(const Vector3d& position_m, const Vector3d& force) {
  Observation o;
  o.position_m = position_m;
  o.force_N = force;
  return o;
}

std::vector<Vector3d> scattered(int count, double size_m, unsigned seed = kSeed) {
  std::mt19937 random(seed);
  std::uniform_real_distribution<double> uniform(-size_m, size_m);
  std::vector<Vector3d> result;
  for (int i = 0; i < count; ++i) {
    result.emplace_back(uniform(random), uniform(random), uniform(random));
  }
  return result;
}

// The rule of admission over a plain list.
class PlainStore {
 public:
  SampleStore::Admission admit(const Observation& o, const SampleStore::Settings& settings) {
    const double per_force = settings.spacing.metres / settings.spacing.newtons;
    const auto distance_m = [&](const Vector3f& position, const Vector3f& force) {
      return std::max((position.cast<double>() - o.position_m).norm(),
                      per_force * (force.cast<double>() - o.force_N).norm());
    };
    Kept* nearest = nullptr;
    for (Kept& each : kept) {
      if (distance_m(each.position_m, each.force_N) < settings.spacing.metres &&
          (nearest == nullptr || distance_m(each.position_m, each.force_N) <
                                     distance_m(nearest->position_m, nearest->force_N))) {
        nearest = &each;
      }
    }
    const Vector3f position_m = o.position_m.cast<float>();
    const Vector3f force = o.force_N.cast<float>();
    if (nearest == nullptr) {
      kept.push_back({position_m, force, position_m, force});
      return SampleStore::Admission::kAdded;
    }
    if (std::max(distance_m(nearest->first_m, nearest->first_N),
                 distance_m(nearest->position_m, nearest->force_N)) <
        0.3 * settings.spacing.metres) {
      nearest->position_m = position_m;
      nearest->force_N = force;
      return SampleStore::Admission::kReplaced;
    }
    return SampleStore::Admission::kKnown;
  }

  struct Kept {
    Vector3f position_m, force_N, first_m, first_N;
  };
  std::vector<Kept> kept;
};

TEST(SampleStore, AdmitsWhatAPlainListAdmits) {
  const SampleStore::Settings settings;
  SampleStore store(settings);
  PlainStore plain;
  std::mt19937 random(kSeed);
  std::normal_distribution<double> step_m(0.0, 0.0003);
  std::normal_distribution<double> noise_N(0.0, 0.015);
  int admissions[3] = {0, 0, 0};
  Vector3d at_m = Vector3d::Zero();
  for (int i = 0; i < 3000; ++i) {
    at_m += Vector3d(step_m(random), step_m(random), step_m(random));
    if (i % 500 == 499) {
      at_m = -at_m;  // back to where it has been, and across cells
    }
    const Observation o =
        observe(at_m, force_N(at_m) + Vector3d(noise_N(random), noise_N(random), noise_N(random)));
    const SampleStore::Admission admission = store.admit(o);
    ASSERT_EQ(admission, plain.admit(o, settings)) << "sample " << i << ", seed " << kSeed;
    ++admissions[static_cast<int>(admission)];
  }
  for (const int count : admissions) {
    EXPECT_GT(count, 20) << "each way was taken";
  }
  ASSERT_EQ(store.size(), plain.kept.size());
  for (std::uint32_t n = 0; n < store.size(); ++n) {
    const StoredSample sample = store.sample(n);
    EXPECT_EQ(sample.position_m, plain.kept[n].position_m.cast<double>());
    EXPECT_EQ(sample.force_N, plain.kept[n].force_N.cast<double>());
  }
}

TEST(SampleStore, GathersExactlyTheCellsAround) {
  SampleStore store(SampleStore::Settings{});
  for (const Vector3d& p : scattered(2500, 0.06)) {
    store.admit(observe(p, force_N(p)));
  }
  const auto cell = [](const Vector3d& p) {
    return Eigen::Vector3i((p / SampleStore::kCell_m).array().floor().cast<int>());
  };
  for (const Vector3d& centre : scattered(30, 0.07, kSeed + 1)) {
    for (const int enough : {0, 100000}) {
      std::vector<std::uint32_t> expected;
      for (std::uint32_t n = 0; n < store.size(); ++n) {
        const int apart = (cell(store.sample(n).position_m) - cell(centre)).cwiseAbs().maxCoeff();
        if (apart <= (enough > 0 ? 2 : 1)) {
          expected.push_back(n);
        }
      }
      std::vector<std::uint32_t> numbers(store.size());
      numbers.resize(static_cast<std::size_t>(
          store.gather(centre, enough, static_cast<int>(numbers.size()), numbers.data())));
      std::sort(numbers.begin(), numbers.end());
      EXPECT_EQ(numbers, expected) << "seed " << kSeed;
      std::uint32_t few[3];
      EXPECT_EQ(store.gather(centre, enough, 3, few),
                static_cast<int>(std::min<std::size_t>(3, expected.size())));
    }
  }
}

TEST(SampleStore, ThinsOutFarFromTheToolWhenItIsFull) {
  SampleStore::Settings settings;
  settings.capacity = 600;
  SampleStore store(settings);
  std::uint64_t added = 0;
  const auto explore = [&](const Vector3d& centre_m, unsigned seed) {
    for (const Vector3d& p : scattered(500, 0.012, seed)) {
      added += store.admit(observe(centre_m + p, force_N(centre_m + p))) ==
               SampleStore::Admission::kAdded;
    }
  };
  const Vector3d places_m[] = {{0.0, 0.0, 0.0}, {0.1, 0.0, 0.0}, {0.2, 0.0, 0.0}};
  for (unsigned i = 0; i < 3; ++i) {
    explore(places_m[i], kSeed + i);
  }
  EXPECT_EQ(store.size(), settings.capacity);
  EXPECT_EQ(store.thinned(), added - settings.capacity);
  int count[3] = {0, 0, 0};
  std::vector<Vector3d> kept;
  for (std::uint32_t n = 0; n < store.size(); ++n) {
    const StoredSample sample = store.sample(n);
    EXPECT_LT((sample.force_N - force_N(sample.position_m)).norm(), 1e-5);  // single precision
    ++count[static_cast<int>(std::lround(sample.position_m.x() / 0.1))];
    kept.push_back(sample.position_m);
  }
  // All places are still known, the last, where the tool is, best.
  EXPECT_GT(count[2], count[1]);
  EXPECT_GT(count[2], count[0]);
  for (int place = 0; place < 2; ++place) {
    EXPECT_GT(count[place], 60);
    // The remaining samples of a place cover it: no gap is wider than 8 of its 24 mm.
    for (const Vector3d& p : scattered(50, 0.010, kSeed + 9)) {
      double nearest_m = 1.0;
      for (const Vector3d& each : kept) {
        nearest_m = std::min(nearest_m, (places_m[place] + p - each).norm());
      }
      EXPECT_LT(nearest_m, 0.008) << "place " << place << ", seed " << kSeed;
    }
  }
  for (const Vector3d& centre : places_m) {  // all of them can be found
    std::uint32_t numbers[600];
    EXPECT_GT(store.gather(centre, 0, 600, numbers), 40);
  }
}

TEST(SampleStore, ReplacesADoubtedSampleAndKeepsAnUndoubtedOne) {
  SampleStore store(SampleStore::Settings{});
  store.admit(observe(Vector3d::Zero(), Vector3d(1.0, 0.0, 0.0)));
  const Observation beside =
      observe(Vector3d(0.0006, 0.0, 0.0), Vector3d(0.95, 0.0, 0.0));  // not a repetition
  EXPECT_EQ(store.admit(beside), SampleStore::Admission::kKnown);
  store.doubt(Vector3d(0.03, 0.0, 0.0), 1e-2, 0.06);
  EXPECT_NEAR(store.sample(0).doubt_N2, 1e-2 * std::exp(-0.125), 1e-8);  // (30/60)^2 / 2
  EXPECT_EQ(store.admit(beside), SampleStore::Admission::kReplaced);
  EXPECT_EQ(store.size(), 1u);
  EXPECT_EQ(store.sample(0).doubt_N2, 0.0);
  EXPECT_NEAR(store.sample(0).force_N.x(), 0.95, 1e-7);
}

TEST(SampleStore, ScalesTheForcesOfOtherContacts) {
  SampleStore store(SampleStore::Settings{});
  Observation o = observe(Vector3d::Zero(), Vector3d(1.0, 2.0, 3.0));
  o.contact = 1;
  store.admit(o);
  o.contact = 2;
  o.position_m.x() = 0.02;
  store.admit(o);
  store.scale_other_contacts(2, 1.25);
  EXPECT_NEAR((store.sample(0).force_N - 1.25 * o.force_N).norm(), 0.0, 1e-6);
  EXPECT_NEAR((store.sample(1).force_N - o.force_N).norm(), 0.0, 1e-6);
}

int follow_to_the_end(StoreField& field, const Vector3d& at_m) {
  int pieces = 1;
  while (field.follow(at_m, at_m).more && pieces < 1000) {
    ++pieces;
  }
  return pieces;
}

TEST(StoreField, EqualsADenseSolveOverItsWorkingSet) {
  FieldSettings settings;
  settings.samples = 40;
  SampleStore store(SampleStore::Settings{});
  StoreField field(settings, store, true);
  for (const Vector3d& p : scattered(400, 0.03)) {
    field.take(observe(p, force_N(p)));
    field.follow(p, p);
  }
  const Vector3d at_m(-0.015, 0.01, 0.02);
  EXPECT_LT(follow_to_the_end(field, at_m), 100);
  std::vector<DictionaryField<float, 48, 0>::Kept> set;
  field.for_each_sample([&set](const auto& kept) { set.push_back(kept); });
  ASSERT_EQ(set.size(), 40u);
  const auto n = static_cast<Eigen::Index>(3 * set.size());
  Eigen::MatrixXd k(n, n);
  Eigen::VectorXd f(n);
  for (std::size_t i = 0; i < set.size(); ++i) {
    const auto row = static_cast<Eigen::Index>(3 * i);
    f.segment<3>(row) = set[i].force_N;
    for (std::size_t j = 0; j < set.size(); ++j) {
      k.block<3, 3>(row, static_cast<Eigen::Index>(3 * j)) =
          settings.kernel.force_force(set[i].position_m, kNoHistory, set[j].position_m, kNoHistory);
    }
    k.diagonal().segment<3>(row).array() += settings.nugget_N2 + set[i].doubt_N2;
  }
  const Eigen::VectorXd alpha = k.llt().solve(f);
  for (const Vector3d& d : scattered(30, 0.01, kSeed + 3)) {
    Vector3d expected_N = Vector3d::Zero();
    for (std::size_t i = 0; i < set.size(); ++i) {
      expected_N +=
          settings.kernel.force_force(at_m + d, kNoHistory, set[i].position_m, kNoHistory) *
          alpha.segment<3>(static_cast<Eigen::Index>(3 * i));
    }
    EXPECT_LT((field.read(at_m + d, kNoHistory).force_N - expected_N).norm(), 5e-4)
        << "single precision";
  }
}

// Two places 0.12 m apart, explored one after the other: on return the first is known at once,
// which a dictionary of the same size has lost.
TEST(StoreField, ForgetsNothingWhileItIsElsewhere) {
  const FieldSettings settings;
  SampleStore store(SampleStore::Settings{});
  StoreField with_store(settings, store, true);
  DictionaryField<float, 32, 0> without(settings);
  const Vector3d places_m[] = {{-0.06, 0.0, 0.0}, {0.06, 0.0, 0.0}};
  for (unsigned place = 0; place < 2; ++place) {
    for (const Vector3d& p : scattered(300, 0.012, kSeed + place)) {
      const Vector3d at_m = places_m[place] + p;
      with_store.take(observe(at_m, force_N(at_m)));
      with_store.follow(at_m, at_m);
      without.take(observe(at_m, force_N(at_m)));
    }
  }
  EXPECT_LE(follow_to_the_end(with_store, places_m[0]), 40);
  EXPECT_EQ(with_store.sample_count(), settings.samples);
  double error_N2[2] = {0.0, 0.0};
  double reference_N2 = 0.0;
  for (const Vector3d& p : scattered(100, 0.010, kSeed + 5)) {
    const Vector3d at_m = places_m[0] + p;
    reference_N2 += force_N(at_m).squaredNorm();
    error_N2[0] += (with_store.read(at_m, kNoHistory).force_N - force_N(at_m)).squaredNorm();
    error_N2[1] += (without.read(at_m, kNoHistory).force_N - force_N(at_m)).squaredNorm();
  }
  EXPECT_LT(std::sqrt(error_N2[0] / reference_N2), 2e-3) << "seed " << kSeed;
  EXPECT_GT(std::sqrt(error_N2[1] / reference_N2), 1e-2) << "seed " << kSeed;
}

TEST(StoreField, ExchangesAFewSamplesAPieceAndComesToRest) {
  const FieldSettings settings;
  SampleStore store(SampleStore::Settings{});
  StoreField field(settings, store, true);
  for (const Vector3d& p : scattered(800, 0.03)) {
    field.take(observe(p, force_N(p)));
  }
  const auto positions_m = [&field] {
    std::vector<Vector3d> all;
    field.for_each_sample([&all](const auto& kept) { all.push_back(kept.position_m); });
    return all;
  };
  for (const Vector3d& at_m : scattered(10, 0.03, kSeed + 7)) {
    for (bool more = true; more;) {
      const std::vector<Vector3d> before = positions_m();
      more = field.follow(at_m, at_m).more;
      int gone = 0;
      for (const Vector3d& p : before) {
        const std::vector<Vector3d> now = positions_m();
        gone += std::find(now.begin(), now.end(), p) == now.end();
      }
      EXPECT_LE(gone, StoreField::kExchanges);
    }
    const std::vector<Vector3d> settled = positions_m();
    EXPECT_FALSE(field.follow(at_m, at_m).changed);
    EXPECT_EQ(positions_m(), settled);
  }
}

// A tool at rest, so that it is going nowhere else. The field has many samples around it to choose
// from, and deviates by whatever its samples give there.
TEST(StoreFollower, ExchangesNothingWhereTheFieldDeviatesByLessThanIsFine) {
  const FieldSettings settings;
  SampleStore store(SampleStore::Settings{});
  StoreField field(settings, store, true);
  for (const Vector3d& p : scattered(800, 0.03)) {
    field.take(observe(p, force_N(p)));
  }
  const Vector3d tool_W(0.01, -0.01, 0.005);
  ToolMotion motion;
  ASSERT_TRUE(motion.observe(0.0, tool_W));
  const double deviation_N = field.deviation_N(tool_W, kNoHistory);
  StoreFollower follower;
  EXPECT_FALSE(follower.due());
  follower.sample_taken();
  EXPECT_TRUE(follower.due());
  EXPECT_FALSE(follower.step(field, tool_W, Vector3d::Zero(), motion, 1.01 * deviation_N));
  EXPECT_FALSE(follower.due()) << "until the next sample";
  EXPECT_EQ(field.deviation_N(tool_W, kNoHistory), deviation_N);
  follower.sample_taken();
  EXPECT_TRUE(follower.step(field, tool_W, Vector3d::Zero(), motion, 0.99 * deviation_N));
  EXPECT_LT(field.deviation_N(tool_W, kNoHistory), deviation_N);
}

TEST(StoreField, TellsTheStoreWhatItDoubts) {
  const FieldSettings settings;
  SampleStore store(SampleStore::Settings{});
  StoreField field(settings, store, true);
  SampleStore untouched(SampleStore::Settings{});
  StoreField reader(settings, untouched, false);
  for (const Vector3d& p : scattered(100, 0.02)) {
    field.take(observe(p, force_N(p)));
    reader.take(observe(p, force_N(p)));
  }
  EXPECT_EQ(untouched.size(), 0u);
  const double before_N2 = store.sample(0).doubt_N2;
  const Vector3d at_m(0.001, 0.002, 0.003);
  const Innovation innovation = field.take(observe(at_m, 0.4 * force_N(at_m)));
  ASSERT_TRUE(innovation.surprised);
  const double away_m = (store.sample(0).position_m - at_m).norm();
  EXPECT_NEAR(store.sample(0).doubt_N2 - before_N2,
              innovation.doubt_N2 * std::exp(-0.5 * std::pow(away_m / 0.060, 2)),
              1e-5 * innovation.doubt_N2);
}

TEST(KrigingStore, RefusesOptionsThatCannotBeUsedAndTakesThoseThatCan) {
  EXPECT_THROW(parse_method_variant("kriging-store samples=49", {}), std::invalid_argument);
  MethodOptions options;
  options.spacing_m = 0.006;
  try {
    make_force_method("kriging-store", options);
    FAIL();
  } catch (const std::invalid_argument& error) {
    EXPECT_NE(std::string(error.what()).find("at most 5 mm"), std::string::npos) << error.what();
  }
  const MethodVariant variant = parse_method_variant("kriging-store samples=48", {});
  const auto method = make_force_method(variant.name, variant.options);
  EXPECT_STREQ(method->name(), "kriging-store");
  EXPECT_LT(method->memory_bytes(), 1u << 20);
}

}  // namespace
}  // namespace forcegrid::kriging
