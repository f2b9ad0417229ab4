// SPDX-License-Identifier: Apache-2.0
#include "stability/hand.h"

#include <stdexcept>

namespace forcegrid::stability {

const std::vector<Hand>& hands() {
  static const std::vector<Hand> all = {
      {"none", {0.0, 0.0, 0.0, "the device alone"}},
      {"light",
       {0.05, 2.5, 100.0,
        "prototype study; in the range of a finger (Hajian and Howe, J. Biomech. Eng. 119, 1997)"}},
      {"firm",
       {0.2, 10.0, 400.0,
        "prototype study; in the range of a stylus grip (Kuchenbecker, Park and Niemeyer, Proc. "
        "ASME IMECE 2003)"}},
      {"arm", profiles::arm_hand()}};
  return all;
}

const Hand& hand_of(const std::string& name) {
  std::string known;
  for (const Hand& hand : hands()) {
    if (hand.name == name) {
      return hand;
    }
    known += (known.empty() ? "" : ", ") + hand.name;
  }
  throw std::invalid_argument("hand '" + name + "' is not known; use one of " + known);
}

}  // namespace forcegrid::stability
