// SPDX-License-Identifier: Apache-2.0
#include <cstdio>

#include "forcegrid/methods.h"
#include "link/simulator_endpoint.h"

int main() {
  forcegrid::MethodOptions grid;
  grid.grid.max_W.setConstant(0.1);
  grid.grid.cells.setConstant(10);
  grid.influence_radius_m = 0.02;
  const auto method = forcegrid::make_force_method("forcegrid", grid);
  method->contact_made(1, Eigen::Vector3d::Zero());
  forcegrid::Sample sample;
  sample.position_W.setConstant(0.05);
  sample.force_W = Eigen::Vector3d(0.0, 0.0, -1.0);
  method->take_sample(sample);
  while (method->work(1000) > 0) {
  }
  const double force_N = method->force(0.0, sample.position_W).force_W.z();
  const forcegrid::link::SimulatorEndpoint servo("127.0.0.1:0");
  std::printf("%.3f N, listening on port %d\n", force_N, servo.port());
  return force_N == -1.0 && servo.port() != 0 ? 0 : 1;
}
