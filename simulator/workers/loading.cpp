// SPDX-License-Identifier: Apache-2.0
#include "simulator/workers/loading.h"

#include <cmath>
#include <optional>
#include <ostream>

#include "rt/clock.h"

namespace forcegrid::simulator {

rt::Supervision loading_supervision(const std::string& scene, const std::atomic<bool>& stop,
                                    std::ostream* out) {
  rt::Supervision supervision{.stop = &stop};
  if (out != nullptr) {
    supervision.alive = [scene, out, begun = rt::Clock::now()](std::optional<double> done) {
      const double so_far_s = rt::seconds(rt::Clock::now() - begun);
      *out << "loading " << scene << ", " << std::lround(so_far_s) << " s";
      if (done && *done > 0.0) {
        *out << ", about " << std::lround(so_far_s * (1.0 / *done - 1.0)) << " s left";
      }
      *out << std::endl;
    };
  }
  return supervision;
}

}  // namespace forcegrid::simulator
