// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <unistd.h>

#include <filesystem>
#include <fstream>
#include <string>

#include "gtest/gtest.h"

namespace forcegrid::paper {

/// A cube of 100 vertices as a scene's file, so small that everything with it is quick.
/// @param spread  of the springs' stiffness around `stiffness_N_per_m`.
inline std::string tiny_scene(const std::string& name, double stiffness_N_per_m, double spread) {
  const std::filesystem::path folder =
      ::testing::TempDir() + "tiny_scenes_" + std::to_string(getpid());
  std::filesystem::create_directories(folder);
  const std::filesystem::path file = folder / (name + ".toml");
  std::ofstream(file) << "description = \"Cube of 100 vertices\"\npatch_radius_m = 0.012\n"
                         "[[object]]\nshape = \"block\"\nvertex_count = [5, 5, 4]\n"
                         "size_m = [0.1, 0.1, 0.1]\nlaw = \"linear\"\nseed = 1\n"
                      << "stiffness_N_per_m = " << stiffness_N_per_m
                      << "\nrandom_spread = " << spread << "\n";
  return file.string();
}

}  // namespace forcegrid::paper
