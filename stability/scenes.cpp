// SPDX-License-Identifier: Apache-2.0
#include "stability/scenes.h"

#include <stdexcept>

namespace forcegrid::stability {
namespace {

std::unique_ptr<VirtualObject> make_held(const BaseField& field) {
  return std::make_unique<TableObject>(field.table, field.stiffness_N_per_m, field.contact_point_W);
}

}  // namespace

const std::vector<Scene>& scenes() {
  using Fault = SimulatorFault;
  static const std::vector<Scene> all = {
      {"held", "a soft object that the tool holds", make_held},
      {"tapping", "contact with a surface is made and broken", make_tapping},
      {"touching", "an object of varying stiffness is touched, held and let go", make_touching},
      {"second_contact", "a wall of 1000 N/m behind the object", make_second_contact},
      {"cut", "stiffness drops to 60 and 30 %, unannounced",
       [](const BaseField& field) { return make_cut(field, false); }},
      {"cut_announced", "the same, each cut a new contact epoch",
       [](const BaseField& field) { return make_cut(field, true); }},
      {"slide", "the object slides 9 mm, unannounced",
       [](const BaseField& field) { return make_slide(field, false); }},
      {"slip_announced", "two slips of 5 mm, each a new contact epoch and point",
       [](const BaseField& field) { return make_slide(field, true); }},
      {"hysteresis", "the object with a parallel plastic slider", make_hysteresis},
      {"viscous", "the object with a parallel damper of 3 Ns/m", make_viscous},
      {"kelvin_voigt_5ms", "a Kelvin-Voigt object, damping time 5 ms",
       [](const BaseField& field) { return make_kelvin_voigt(field, 0.005); }},
      {"kelvin_voigt_20ms", "the same, 20 ms",
       [](const BaseField& field) { return make_kelvin_voigt(field, 0.02); }},
      {"kelvin_voigt_100ms", "the same, 100 ms",
       [](const BaseField& field) { return make_kelvin_voigt(field, 0.1); }},
      {"dynamic_5ms", "a block that moves by itself, damping time 5 ms",
       [](const BaseField& field) { return make_dynamic(field, 0.005); }},
      {"dynamic_20ms", "the same, 20 ms",
       [](const BaseField& field) { return make_dynamic(field, 0.02); }},
      {"dynamic_100ms", "the same, 100 ms",
       [](const BaseField& field) { return make_dynamic(field, 0.1); }},
      {"relaxation", "quasi-linear visco-elasticity, 80 ms and 0.8 s", make_relaxation},
      {"snap_through", "a shell that buckles by 1 mm", make_snap_through},
      {"unconverged", "the solver corrects 60 % of its error per tick", make_held,
       Fault::kUnconverged},
      {"pauses", "no answers for 0.2 s of every second", make_held, Fault::kPauses},
      {"restarts", "the same, and each time the contact is new", make_held, Fault::kRestarts},
      {"clock_jump", "time stamps jump by 0.5 s, and back", make_held, Fault::kClockJump},
      {"clock_skew", "the simulator's clock is 1 % fast", make_held, Fault::kClockSkew},
      {"noise", "30 mN of white noise", make_held, Fault::kNone, 0.03},
      {"bias", "every force is 0.1 N too large along x", make_held, Fault::kBias},
      {"outliers", "one answer in twenty is off by up to 2 N", make_held, Fault::kOutliers},
      {"not_finite", "one answer in twenty is not a number", make_held, Fault::kNotFinite}};
  return all;
}

const Scene& scene_of(const std::string& name) {
  std::string known;
  for (const Scene& scene : scenes()) {
    if (scene.name == name) {
      return scene;
    }
    known += (known.empty() ? "" : ", ") + scene.name;
  }
  throw std::invalid_argument("scene '" + name + "' is not known; use one of " + known);
}

}  // namespace forcegrid::stability
