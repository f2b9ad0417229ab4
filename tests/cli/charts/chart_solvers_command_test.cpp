// SPDX-License-Identifier: Apache-2.0
// `forcegrid chart solvers` as its user starts it, with small objects in place of its scenes.

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <array>
#include <chrono>
#include <cstdint>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <map>
#include <nlohmann/json.hpp>
#include <string>
#include <utility>
#include <vector>

#include "tests/paper/tiny_scenes.h"
#include "tests/simulator/element_block.h"
#include "tests/support/program.h"

namespace forcegrid {
namespace {

using nlohmann::json;
using testing::fresh_folder;
using ::testing::HasSubstr;
using ::testing::Not;
using testing::Program;
using testing::text_of;

constexpr std::chrono::seconds kPatience{100};

void write_mesh(const std::string& file, const simulator::SpringMesh& mesh) {
  std::ofstream out(file);
  out << "$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$Nodes\n" << mesh.rest_position_W.size() << '\n';
  for (std::size_t i = 0; i < mesh.rest_position_W.size(); ++i) {
    out << i + 1 << ' ' << mesh.rest_position_W[i].transpose() << '\n';
  }
  out << "$EndNodes\n$Elements\n" << mesh.tetrahedra.size() << '\n';
  for (std::size_t e = 0; e < mesh.tetrahedra.size(); ++e) {
    out << e + 1 << " 4 2 1 1";
    std::array<std::int32_t, 4> corner = mesh.tetrahedra[e].vertex;
    const auto edge_m = [&](std::size_t k) -> Eigen::Vector3d {
      return mesh.rest_position_W[static_cast<std::size_t>(corner[k])] -
             mesh.rest_position_W[static_cast<std::size_t>(corner[0])];
    };
    if (edge_m(1).cross(edge_m(2)).dot(edge_m(3)) < 0.0) {  // half of them, by Kuhn's division
      std::swap(corner[2], corner[3]);
    }
    for (const std::int32_t vertex : corner) {
      out << ' ' << vertex + 1;
    }
    out << '\n';
  }
  out << "$EndElements\n";
}

void write_element_scene(const std::string& folder, const std::string& name) {
  std::ofstream(folder + "/" + name + ".toml")
      << "description = \"A block of elements\"\n[[object]]\nshape = \"mesh\"\nfile = \"" << name
      << ".msh\"\nunit = \"m\"\nfixed_below_m = 0.001\n[object.material]\n"
         "model = \"neo_hookean\"\nyoungs_modulus_Pa = 5500.0\npoissons_ratio = 0.45\n"
         "density_kg_per_m3 = 1060.0\n";
}

class ChartSolvers : public ::testing::Test {
 protected:
  // Where the command finds its scenes before all other places.
  void SetUp() override {
    scenes_ = fresh_folder("chart_solvers_scenes");
    std::filesystem::copy_file(paper::tiny_scene("stomach", 20.0, 0.3), scenes_ + "/stomach.toml");
    write_element_scene(scenes_, "liver");
    write_mesh(scenes_ + "/liver.msh",
               simulator::element_block({4, 4, 3}, 0.01,
                                        simulator::soft(simulator::ElementModel::kNeoHookean)));
    write_element_scene(scenes_, "liver_fine");  // whose mesh nobody has made
    ::setenv("FORCEGRID_SCENE_PATH", scenes_.c_str(), 1);
  }
  void TearDown() override { ::unsetenv("FORCEGRID_SCENE_PATH"); }

  int run(const std::vector<std::string>& more) {
    std::vector<std::string> arguments{"chart", "solvers", "--quick", "--sizes",
                                       "1000",  "--out",   folder_};
    arguments.insert(arguments.end(), more.begin(), more.end());
    Program program = Program::forcegrid(arguments);
    const auto status = program.wait(kPatience);
    error_ = program.standard_error();
    return status.value_or(-1);
  }

  std::string scenes_;
  std::string folder_ = fresh_folder("chart_solvers");
  std::string error_;
};

TEST_F(ChartSolvers, MeasuresElementsByDefaultAndLeavesOutAMeshThatIsNotThere) {
  ASSERT_EQ(run({}), 0) << error_;
  std::map<std::string, std::size_t> elements;
  std::map<std::string, int> solvers;
  const json chart = json::parse(text_of(folder_ + "/solvers.json"), nullptr, false);
  ASSERT_TRUE(chart.is_object());
  for (const json& row : chart.at("rows")) {
    elements[row.at("scene")] = row.at("tetrahedra");
    ++solvers[row.at("scene")];
    EXPECT_LT(row.at("error_rms_percent"), 2.0) << row;
  }
  EXPECT_EQ(elements, (std::map<std::string, std::size_t>{
                          {"block", 0U}, {"liver", 6U * 4U * 4U * 3U}, {"stomach", 0U}}));
  EXPECT_EQ(solvers["liver"], 3);
  EXPECT_THAT(error_, HasSubstr("liver_fine is left out: "));
  EXPECT_THAT(error_, HasSubstr("liver_fine.msh"));
  EXPECT_THAT(error_, Not(HasSubstr("liver is left out")));
}

TEST_F(ChartSolvers, AMissingMeshOfASceneThatIsNamedIsAnError) {
  EXPECT_NE(run({"--scenes", "stomach,liver_fine"}), 0);
  EXPECT_THAT(error_, HasSubstr("liver_fine.msh"));
  EXPECT_FALSE(std::filesystem::exists(folder_ + "/solvers.json"));
}

}  // namespace
}  // namespace forcegrid
