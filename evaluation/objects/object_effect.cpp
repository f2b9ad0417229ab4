// SPDX-License-Identifier: Apache-2.0
#include "evaluation/objects/object_effect.h"

#include <algorithm>

namespace forcegrid::evaluation {

double ObjectEffect::cut_factor(double time_s) const noexcept {
  double factor = 1.0;
  for (const Cut& cut : cuts) {
    factor *= time_s >= cut.time_s ? cut.factor : 1.0;
  }
  return factor;
}

Eigen::Vector3d ObjectEffect::slid_W_m(double time_s) const noexcept {
  if (!(slide_end_s > slide_begin_s)) {
    return Eigen::Vector3d::Zero();
  }
  const double done =
      std::clamp((time_s - slide_begin_s) / (slide_end_s - slide_begin_s), 0.0, 1.0);
  return (done - 0.5) * slide_W_m;
}

const std::vector<NamedObjectEffect>& named_object_effects() {
  static const std::vector<NamedObjectEffect> all = [] {
    std::vector<NamedObjectEffect> list(5);
    list[0].name = "viscous";
    list[0].title = "3 Ns/m of viscosity";
    list[0].effect.viscosity_Ns_per_m = 3.0;
    list[1].name = "relaxing";
    list[1].title = "a force that relaxes to 60 %";
    list[1].effect.relaxations = {{0.25, 0.080}, {0.15, 0.8}};
    list[2].name = "cut";
    list[2].title = "cuts that leave 60 % at 7 s and 30 % at 13 s";
    list[2].effect.cuts = {{7.0, 0.6}, {13.0, 0.5}};
    list[3].name = "sliding";
    list[3].title = "a slide by 8 and -5 mm from 6 to 9 s";
    list[3].effect.slide_W_m = {0.008, -0.005, 0.0};
    list[3].effect.slide_begin_s = 6.0;
    list[3].effect.slide_end_s = 9.0;
    list[4].name = "unconverged";
    list[4].title = "a simulator that corrects 60 % of its error per tick";
    list[4].effect.solved_share = 0.6;
    return list;
  }();
  return all;
}

}  // namespace forcegrid::evaluation
