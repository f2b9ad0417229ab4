// SPDX-License-Identifier: Apache-2.0
#include "stability/pair_object.h"

#include "evaluation/scenarios/solved_pair.h"

namespace forcegrid::stability {
namespace {

class ScenePair final : public PairObject {
 public:
  ScenePair(const simulator::Scene& scene, double stiffness_N_per_m)
      : object_(scene.mesh, {}, scene.patch_radius_m) {
    object_.move(at_m_);
    scale_ = -stiffness_N_per_m / object_.stiffness_N_per_m().value()(2, 2);
  }

  PairVector forces_N(const PairVector& displacements_m) override {
    if (displacements_m != at_m_) {  // both sides ask for the same in a loop without ages
      at_m_ = displacements_m;
      object_.move(at_m_);
    }
    return scale_ * object_.forces_N();
  }

  std::optional<PairMatrix> stiffness_N_per_m() const override {
    std::optional<PairMatrix> stiffness = object_.stiffness_N_per_m();
    if (stiffness) {
      *stiffness *= scale_;
    }
    return stiffness;
  }

 private:
  evaluation::SolvedPair<float> object_;
  double scale_ = 1.0;
  PairVector at_m_ = PairVector::Zero();
};

}  // namespace

PairObjectMaker pair_object_of(const std::string& name) {
  if (name == kSprings) {
    return [](double stiffness_N_per_m) { return std::make_unique<SpringPair>(stiffness_N_per_m); };
  }
  const auto scene = std::make_shared<const simulator::Scene>(
      evaluation::make_elastic_scene(name, "a closed loop of two hands"));
  return [scene](double stiffness_N_per_m) {
    return std::make_unique<ScenePair>(*scene, stiffness_N_per_m);
  };
}

}  // namespace forcegrid::stability
