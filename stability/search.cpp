// SPDX-License-Identifier: Apache-2.0
#include "stability/search.h"

#include <cmath>

namespace forcegrid::stability {

StiffnessLimit find_limit(const std::function<Behaviour(double)>& behaviour, double first_N_per_m) {
  StiffnessLimit limit;
  double unstable_N_per_m = std::nan("");
  for (double stiffness = first_N_per_m; stiffness <= StiffnessScan::kMost_N_per_m;
       stiffness *= 2.0) {
    limit.failure = behaviour(stiffness);
    if (limit.failure != Behaviour::kStable) {
      unstable_N_per_m = stiffness;
      break;
    }
    limit.largest_stable_N_per_m = stiffness;
  }
  if (limit.largest_stable_N_per_m == 0.0 && first_N_per_m > StiffnessScan::kLeast_N_per_m) {
    return find_limit(behaviour);
  }
  limit.beyond_scan = std::isnan(unstable_N_per_m);
  for (int i = 0;
       i < StiffnessScan::kBisections && !limit.beyond_scan && limit.largest_stable_N_per_m > 0.0;
       ++i) {
    const double middle = std::sqrt(limit.largest_stable_N_per_m * unstable_N_per_m);
    const Behaviour found = behaviour(middle);
    if (found == Behaviour::kStable) {
      limit.largest_stable_N_per_m = middle;
    } else {
      unstable_N_per_m = middle;
      limit.failure = found;
    }
  }
  limit.smallest_unstable_N_per_m = unstable_N_per_m;
  return limit;
}

}  // namespace forcegrid::stability
