// SPDX-License-Identifier: Apache-2.0
#include "simulator/mesh/scene.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <fstream>
#include <string>
#include <utility>
#include <vector>

#include "simulator/mesh/error.h"
#include "simulator/mesh/lattice_block.h"

namespace forcegrid::simulator {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::IsSupersetOf;

std::string file_with(const std::string& text) {
  const std::string file = ::testing::TempDir() + "scene_" + std::to_string(getpid()) + ".toml";
  std::ofstream(file) << text;
  return file;
}

std::string complaint(const std::string& name_or_file) {
  try {
    make_scene(name_or_file);
  } catch (const Error& error) {
    return error.what();
  }
  return "";
}

constexpr const char* kHead = "description = \"test\"\n";
constexpr const char* kObject =
    "[[object]]\n"
    "shape = \"block\"\n"
    "vertex_count = [3, 4, 5]\n"
    "size_m = [0.02, 0.06, 0.1]\n"
    "stiffness_N_per_m = 12.5\n";

TEST(Scene, KnowsItsNamesAndNamesTheNearestForAnUnknownOne) {
  EXPECT_THAT(scene_names(), IsSupersetOf({"block", "block_linear", "small", "small_linear"}));
  for (const char* wrong : {"blok", "Block", "block "}) {
    EXPECT_THAT(complaint(wrong),
                AllOf(HasSubstr("block, block_linear"), HasSubstr("the nearest is block"),
                      HasSubstr("unknown scene '" + std::string(wrong))));
  }
  EXPECT_THAT(complaint(""), HasSubstr("unknown scene ''"));
  EXPECT_THAT(complaint("no/such.toml"), HasSubstr("no/such.toml': no such file"));
  EXPECT_EQ(scene_name_problem("small"), "");
  EXPECT_EQ(scene_name_problem("some/file.toml"), "");
  EXPECT_THAT(scene_name_problem("smal"), HasSubstr("the nearest is small"));
}

TEST(Scene, LinearBlockIsTheBlockWithTheLinearLaw) {
  const SpringMesh linear = make_scene("block_linear").mesh;
  const SpringMesh cubic = make_scene("block").mesh;
  EXPECT_EQ(linear.laws.front().cubic_coefficient, 0.0);
  EXPECT_EQ(cubic.laws.front().cubic_coefficient, 5.0);
  ASSERT_EQ(linear.springs.size(), cubic.springs.size());
  EXPECT_EQ(linear.springs.back().stiffness_N_per_m, cubic.springs.back().stiffness_N_per_m);
}

TEST(Scene, EveryOneThatComesWithTheProgramCanBeMadeAndTouchedAtItsOrigin) {
  const Eigen::Vector3d origin_W(0.1, 0.2, 0.3);
  std::vector<std::string> names = scene_names();
#ifdef FORCEGRID_SANITIZED
  // libgmsh's own leaks and threads are none of the sanitizers' business.
  std::erase_if(names, [](const std::string& name) { return name.starts_with("liver"); });
#endif
  for (const std::string& name : names) {
    SCOPED_TRACE(name);
    const Scene scene = make_scene(name, origin_W);
    EXPECT_EQ(scene.name, name);
    EXPECT_FALSE(scene.description.empty());
    EXPECT_LT((scene.mesh.top_W - origin_W).norm(), 1e-12);
    int near = 0;
    for (std::size_t i = 0; i < scene.mesh.rest_position_W.size(); ++i) {
      near += scene.mesh.fixed[i] == 0 &&
                      (scene.mesh.rest_position_W[i] - origin_W).norm() <= scene.patch_radius_m
                  ? 1
                  : 0;
    }
    EXPECT_GE(near, 3) << "a patch that holds fewer could turn in the tool's grip";
  }
}

TEST(Scene, AFileGivesTheBlockThatItDescribes) {
  const Scene scene =
      make_scene(file_with(std::string(kHead) + "patch_radius_m = 0.03\n" + kObject +
                           "law = \"exponential\"\nexponent = 4.0\n"
                           "place_m = [0.01, 0.02, 0.03]\nseed = 7\n"
                           "random_spread = 0.2\ndiagonal_factor = 0.5\n"));
  LatticeBlockOptions options;
  options.vertex_count = {3, 4, 5};
  options.size_m = {0.02, 0.06, 0.1};
  options.top_centre_W = {0.01, 0.02, 0.03};
  options.stiffness_N_per_m = 12.5;
  options.seed = 7;
  options.random_spread = 0.2;
  options.diagonal_factor = 0.5;
  const SpringMesh expected = make_lattice_block(options);
  EXPECT_EQ(scene.patch_radius_m, 0.03);
  EXPECT_EQ(scene.mesh.rest_position_W, expected.rest_position_W);
  ASSERT_EQ(scene.mesh.springs.size(), expected.springs.size());
  for (std::size_t s = 0; s < expected.springs.size(); ++s) {
    EXPECT_EQ(scene.mesh.springs[s].stiffness_N_per_m, expected.springs[s].stiffness_N_per_m);
  }
  EXPECT_EQ(scene.mesh.laws.front().exponent, 4.0);
  EXPECT_EQ(scene.mesh.laws.front().cubic_coefficient, 0.0);
}

TEST(CoarserMesh, HasHalfTheVerticesPerAxisInTheSamePlace) {
  const std::string file = file_with(kHead + std::string(kObject) + "law = \"linear\"\n");
  const SpringMesh fine = make_scene(file).mesh;
  const SpringMesh coarse = make_coarser_mesh(file);
  EXPECT_EQ(coarse.rest_position_W.size(), 2U * 2U * 3U);
  EXPECT_EQ(coarse.top_W, fine.top_W);
  EXPECT_LT((coarse.rest_position_W.front() - fine.rest_position_W.front()).norm(), 1e-12);
  EXPECT_LT((coarse.rest_position_W.back() - fine.rest_position_W.back()).norm(), 1e-12);

  // A surface: a quarter of its vertices and springs, each home spring for four times the area.
  const SpringMesh organ = make_coarser_mesh("organ");
  EXPECT_EQ(organ.rest_position_W.size(), 2500U);
  EXPECT_EQ(organ.springs.size(), 8750U);
  double home_N_per_m = 0.0;
  for (const double each : organ.home_stiffness_N_per_m) {
    home_N_per_m += each;
  }
  EXPECT_NEAR(home_N_per_m, 10000 * 0.24, 1e-6);

  EXPECT_EQ(make_coarser_mesh("three_cubes").rest_position_W.size(), 3U * 4U * 4U * 4U);
  const std::string of_file = file_with(
      kHead + std::string("[[object]]\nshape = \"mesh\"\nfile = \"x.obj\"\nunit = \"m\"\n"
                          "fixed_below_m = 0.1\nstiffness_N_per_m = 1.0\nlaw = \"linear\"\n"));
  try {
    make_coarser_mesh(of_file);
    ADD_FAILURE() << "a coarser mesh of a file";
  } catch (const Error& error) {
    EXPECT_THAT(error.what(), HasSubstr("a mesh file of springs has no coarser form"));
  }
}

TEST(Scene, SeveralObjectsKeepTheirPlacesAndLaws) {
  const std::string second =
      "law = \"hardening\"\ncubic_coefficient = 5.0\n"
      "[[object]]\nshape = \"block\"\nvertex_count = [2, 2, 2]\nsize_m = [0.01, 0.01, 0.01]\n"
      "stiffness_N_per_m = 3.0\nplace_m = [0.1, 0.0, 0.0]\nlaw = \"linear\"\n";
  const SpringMesh mesh = make_scene(file_with(std::string(kHead) + kObject + second)).mesh;
  EXPECT_EQ(mesh.rest_position_W.size(), 60U + 8U);
  ASSERT_EQ(mesh.laws.size(), 2U);
  EXPECT_EQ(mesh.top_W, Eigen::Vector3d::Zero());
  for (const Spring& spring : mesh.springs) {
    EXPECT_EQ(spring.a < 60, spring.b < 60) << "a spring from one object to the other";
    EXPECT_EQ(spring.law, spring.a < 60 ? 0 : 1);
  }
  EXPECT_EQ(mesh.laws[0].cubic_coefficient, 5.0);
  EXPECT_EQ(mesh.laws[1].cubic_coefficient, 0.0);
  EXPECT_NEAR(mesh.rest_position_W.back().x(), 0.105, 1e-12);
}

std::string with_tool(const std::string& keys) {
  return std::string(kHead) + "[tool]\n" + keys + kObject + "law = \"linear\"\n";
}

TEST(Scene, ItsToolIsTheDefaultsWithItsOwnKeys) {
  const ToolOptions none =
      make_scene(file_with(std::string(kHead) + kObject + "law = \"linear\"\n")).tool;
  EXPECT_TRUE(none.is_sticky_point());
  const std::string file = file_with(
      with_tool("shape = \"grasper\"\ncontact = \"slide\"\nradius_m = 0.004\nlength_m = 0.03\n"
                "opening_rad = 0.9\nfriction = 0.1\ngrasp_N = 0.4\nlet_go_N = 2\n"));
  for (const ToolOptions& tool : {make_scene(file).tool, scene_tool(file)}) {
    EXPECT_EQ(tool.shape, "grasper");
    EXPECT_TRUE(tool.slides());
    EXPECT_EQ(tool.radius_m, 0.004);
    EXPECT_EQ(tool.length_m, 0.03);
    EXPECT_EQ(tool.opening_rad, 0.9);
    EXPECT_EQ(tool.friction, 0.1);
    EXPECT_EQ(tool.grasp_N, 0.4);
    EXPECT_EQ(tool.let_go_N, 2.0);
  }
  const ToolOptions some = scene_tool(file_with(with_tool("shape = \"sphere\"\n")));
  EXPECT_EQ(some.shape, "sphere");
  EXPECT_FALSE(some.slides());
  EXPECT_EQ(some.radius_m, ToolOptions().radius_m);
}

TEST(Scene, AToolMayTurnAndBeABlade) {
  const ToolOptions blade = scene_tool(file_with(
      with_tool("shape = \"blade\"\ncontact = \"slide\"\nlength_m = 0.03\nturns = true\n")));
  EXPECT_EQ(blade.shape, "blade");
  EXPECT_EQ(blade.length_m, 0.03);
  EXPECT_TRUE(blade.turns);
  EXPECT_FALSE(blade.needs_position_alone());
  const ToolOptions point = scene_tool(file_with(with_tool("turns = true\n")));
  EXPECT_TRUE(point.turns);
  EXPECT_FALSE(point.is_sticky_point());
  try {
    refuse_sliding_tool("mine", point, "a chart");
    FAIL() << "it was not refused";
  } catch (const Error& error) {
    EXPECT_THAT(error.what(), AllOf(HasSubstr("its tool turns"), HasSubstr("a chart needs")));
  }
}

TEST(Scene, AToolThatSlidesIsRefusedWhereForceHasToBeAFunctionOfThePosition) {
  EXPECT_NO_THROW(refuse_sliding_tool("small", scene_tool("small"), "a chart"));
  try {
    refuse_sliding_tool("small_slide", scene_tool("small_slide"), "a chart");
    FAIL() << "it was not refused";
  } catch (const Error& error) {
    EXPECT_THAT(error.what(), AllOf(HasSubstr("scene small_slide"), HasSubstr("a chart needs")));
  }
}

class BrokenTool : public ::testing::TestWithParam<std::pair<const char*, const char*>> {};

TEST_P(BrokenTool, IsRefusedWithFileLineKeyAndRemedy) {
  const auto [keys, words] = GetParam();
  const std::string file = file_with(with_tool(keys));
  for (const std::string& said : {complaint(file), [&file] {
                                    try {
                                      scene_tool(file);
                                    } catch (const Error& error) {
                                      return std::string(error.what());
                                    }
                                    return std::string();
                                  }()}) {
    EXPECT_THAT(said, AllOf(HasSubstr(file + ":"), HasSubstr("tool"), HasSubstr(words)));
  }
}

INSTANTIATE_TEST_SUITE_P(
    Edits, BrokenTool,
    ::testing::Values(
        std::pair("shape = \"ball\"\n", "'ball' is unknown"),
        std::pair("contact = \"slip\"\n", "the nearest is slide"),
        std::pair("radius_mm = 8\n", "the nearest is radius_m"),
        std::pair("radius_m = 0.008\n", "shape \"point\" has none"),
        std::pair("shape = \"sphere\"\nlength_m = 0.04\n", "write shape = \"capsule\""),
        std::pair("shape = \"capsule\"\ngrasp_N = 1\n", "write shape = \"grasper\""),
        std::pair("shape = \"sphere\"\nfriction = 0.3\n", "write contact = \"slide\""),
        std::pair("shape = \"sphere\"\nradius_m = 8\n", "8 is impossible"),
        std::pair("shape = \"sphere\"\nradius_m = nan\n", "not finite"),
        std::pair("shape = \"sphere\"\ncontact = \"slide\"\nfriction = -0.1\n",
                  "-0.1 is impossible"),
        std::pair("contact = \"slide\"\n", "a point has nothing to press with"),
        std::pair("shape = \"grasper\"\n", "a grasper presses before it grasps")));

struct Broken {
  const char* text;  ///< behind a good object without a law
  const char* complaint;
};

class BrokenScene : public ::testing::TestWithParam<Broken> {};

TEST_P(BrokenScene, IsRefusedWithFileLineKeyAndRemedy) {
  const std::string text = std::string(kHead) + kObject + GetParam().text;
  const std::string file = file_with(text);
  EXPECT_THAT(complaint(file),
              AllOf(HasSubstr(file + ":"), HasSubstr(GetParam().complaint), HasSubstr("write ")));
}

INSTANTIATE_TEST_SUITE_P(
    Edits, BrokenScene,
    ::testing::Values(
        Broken{"", "key 'object[1].law': missing"},
        Broken{"law = \"lineer\"\n", "'lineer' is unknown"},
        Broken{"law = \"lineer\"\n", "the nearest is linear"},
        Broken{"law = \"linear\"\nexponent = 4.0\n", "law \"linear\" has none"},
        Broken{"law = \"hardening\"\n", "key 'object[1].cubic_coefficient': missing"},
        Broken{"law = \"exponential\"\nexponent = -1\n", "-1 is impossible"},
        Broken{"law = \"linear\"\nstifness_N_per_m = 1\n", "the nearest is stiffness_N_per_m"},
        Broken{"law = \"linear\"\nrandom_spread = 1.5\n", "1.5 is impossible"},
        Broken{"law = \"linear\"\nplace_m = [0, 0]\n", "it has 2 elements"},
        Broken{"law = \"linear\"\nplace_m = [100, 0, 0]\n", "100 in place 1 is impossible"},
        Broken{"law = \"linear\"\nseed = 0.5\n", "wrong type"},
        Broken{"law = \"linear\"\n[[object]]\nlaw = \"linear\"\n",
               "key 'object[2].shape': missing"},
        Broken{"law = \"linear\"\n[[object]]\nshape = \"sphere\"\n", "'sphere' is unknown"},
        Broken{"law = \"linear\"\n[physics]\n", "key 'physics': unknown table"}));

TEST(Scene, AFileWithoutObjectsIsRefused) {
  EXPECT_THAT(complaint(file_with(kHead)), HasSubstr("key 'object': missing"));
  EXPECT_THAT(complaint(file_with(std::string(kHead) + "object = 3\n")),
              HasSubstr("it is not a list of tables"));
}

}  // namespace
}  // namespace forcegrid::simulator
