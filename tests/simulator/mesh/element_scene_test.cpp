// SPDX-License-Identifier: Apache-2.0
// Scenes whose objects are finite elements, as their authors write them, and what is refused.
#include <gtest/gtest.h>
#include <unistd.h>

#include <Eigen/Geometry>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <string>
#include <utility>
#include <vector>

#include "simulator/mesh/error.h"
#include "simulator/mesh/gmsh_file.h"
#include "simulator/mesh/scene.h"
#include "simulator/mesh/tetrahedra.h"
#include "tests/simulator/element_block.h"

namespace forcegrid::simulator {
namespace {

// Two regular-looking halves of a wedge of 20 mm, in two physical groups; its numbers are mm.
const std::string kNodes =
    "$MeshFormat\n2.2 0 8\n$EndMeshFormat\n"
    "$PhysicalNames\n2\n3 1 \"soft\"\n3 2 \"stiff\"\n$EndPhysicalNames\n"
    "$Nodes\n5\n1 0 0 0\n2 20 0 0\n3 0 20 0\n4 8 8 20\n5 20 20 10\n$EndNodes\n";
const std::string kElements = "$Elements\n2\n1 4 2 1 1 1 2 3 4\n2 4 2 2 2 2 5 3 4\n$EndElements\n";
const std::string kMaterial =
    "model = \"neo_hookean\"\nyoungs_modulus_Pa = 5000.0\npoissons_ratio = 0.45\n"
    "density_kg_per_m3 = 1060.0\n";
const std::string kWhole = "[object.material]\n" + kMaterial;

class ElementScene : public testing::Test {
 public:
  ~ElementScene() override { std::filesystem::remove_all(folder_); }

 protected:
  ElementScene()
      : folder_(std::filesystem::temp_directory_path() /
                ("forcegrid_element_scene_" + std::to_string(::getpid()))) {
    std::filesystem::create_directories(folder_);
  }

  std::string write(const std::string& materials, const std::string& keys = "",
                    const std::string& mesh = kNodes + kElements) {
    std::ofstream(folder_ / "wedge.msh") << mesh;
    const std::string file = (folder_ / "scene.toml").string();
    std::ofstream(file) << "description = \"A wedge\"\npatch_radius_m = 0.03\n"
                        << "[[object]]\nshape = \"mesh\"\nfile = \"wedge.msh\"\nunit = \"mm\"\n"
                        << "fixed_below_m = 0.001\n"
                        << keys << materials;
    return file;
  }

  std::string refusal(const std::string& file) {
    try {
      make_scene(file);
    } catch (const Error& error) {
      return error.what();
    }
    return "it was accepted";
  }

  void expect_refused(const std::string& file, const std::vector<std::string>& parts) {
    const std::string text = refusal(file);
    for (const std::string& part : parts) {
      EXPECT_NE(text.find(part), std::string::npos) << "'" << part << "' is not in: " << text;
    }
  }

  std::filesystem::path folder_;
};

TEST_F(ElementScene, HasVolumeMassAndMaterialOfTheFile) {
  const Scene scene = make_scene(write(kWhole));
  ASSERT_EQ(scene.mesh.tetrahedra.size(), 2U);
  EXPECT_TRUE(scene.mesh.springs.empty());
  // 20 * 20 * 20 / 6 and the determinant of (0, 20, 10), (-20, 20, 0), (-12, 8, 20) / 6, in mm^3.
  const double first_mm3 = 8000.0 / 6.0;
  const double second_mm3 = std::abs(0.0 * 400.0 - 20.0 * -400.0 + 10.0 * (-160.0 + 240.0)) / 6.0;
  EXPECT_NEAR(element_volume_m3(scene.mesh), 1e-9 * (first_mm3 + second_mm3), 1e-15);
  double mass_kg = 0.0;
  for (const double each : scene.mesh.mass_kg) {
    mass_kg += each;
  }
  EXPECT_NEAR(mass_kg, 1060e-9 * (first_mm3 + second_mm3), 1e-12);
  EXPECT_EQ(scene.mesh.materials[0].model, ElementModel::kNeoHookean);
  EXPECT_TRUE(scene.warnings.empty());
}

TEST_F(ElementScene, RegionsHaveMaterialsOfTheirOwn) {
  const Scene scene = make_scene(
      write(kWhole +
            "[[object.region]]\ngroup = \"stiff\"\nmodel = \"stvk\"\n"
            "youngs_modulus_Pa = 20000.0\npoissons_ratio = 0.3\ndensity_kg_per_m3 = 1100\n"));
  ASSERT_EQ(scene.mesh.tetrahedra.size(), 2U);
  const auto material_of = [&scene](std::size_t element) {
    return scene.mesh.materials[static_cast<std::size_t>(scene.mesh.tetrahedra[element].material)];
  };
  EXPECT_EQ(material_of(0).youngs_modulus_Pa, 5000.0);
  EXPECT_EQ(material_of(1).youngs_modulus_Pa, 20000.0);
  EXPECT_EQ(material_of(1).model, ElementModel::kStVenantKirchhoff);
}

TEST_F(ElementScene, RefusesMaterialsThatCannotBe) {
  std::string half = kWhole;
  half.replace(half.find("0.45"), 4, "0.5");
  expect_refused(write(half), {"scene.toml:", "poissons_ratio", "0.4999"});
  std::string model = kWhole;
  model.replace(model.find("neo_hookean"), 11, "neohookean");
  expect_refused(write(model), {"scene.toml:", "'neohookean' is unknown", "neo_hookean"});
  expect_refused(write(kWhole, "stiffness_N_per_m = 3.0\n"),
                 {"scene.toml:", "stiffness_N_per_m", "leave it out"});
  expect_refused(write("[object.material]\nmodel = \"stvk\"\n"), {"youngs_modulus_Pa"});
}

TEST_F(ElementScene, RefusesRegionsWithoutAMaterialAndMaterialsWithoutARegion) {
  const std::string soft = "[[object.region]]\ngroup = \"soft\"\n" + kMaterial;
  expect_refused(write(soft), {"tetrahedron 2", "'stiff'", "no material"});
  expect_refused(write(kWhole + "[[object.region]]\ngroup = \"sof\"\n" + kMaterial),
                 {"no physical group of volumes 'sof'", "soft"});
  expect_refused(write(kWhole + soft + soft), {"'soft' has a material already"});
}

TEST_F(ElementScene, RefusesInvertedAndFlatElementsAndSliversByNumberAndPlace) {
  expect_refused(
      write(kWhole, "",
            kNodes + "$Elements\n2\n1 4 2 1 1 1 2 3 4\n2 4 2 2 2 5 2 3 4\n$EndElements\n"),
      {"tetrahedron 2 at (12, 12, 7.5) is inverted"});
  std::string thin = kNodes;
  thin.replace(thin.find("20 20 10"), 8, "10 9 5.01");  // all but in the plane of 2, 3 and 4
  expect_refused(write(kWhole, "", thin + kElements), {"tetrahedron 2 at", "is a sliver"});
}

TEST_F(ElementScene, RefusesASurfaceAndAWrongUnit) {
  expect_refused(write(kWhole, "",
                       "$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$Nodes\n3\n1 0 0 0\n2 20 0 0\n"
                       "3 0 20 9\n$EndNodes\n$Elements\n1\n1 2 2 1 1 1 2 3\n$EndElements\n"),
                 {"needs tetrahedra"});
  std::string file = write(kWhole);
  std::ifstream stream(file);
  std::string text((std::istreambuf_iterator<char>(stream)), {});
  text.replace(text.find("\"mm\""), 4, "\"m\"");
  std::ofstream(file) << text;
  expect_refused(file, {"20 m long", "write the unit"});
}

TEST_F(ElementScene, WarnsOfWhatNoTissueHas) {
  std::string stiff = kWhole;
  stiff.replace(stiff.find("5000.0"), 6, "2.1e11");
  const Scene scene = make_scene(write(stiff));
  ASSERT_EQ(scene.warnings.size(), 1U);
  EXPECT_NE(scene.warnings[0].find("scene.toml:10: youngs_modulus_Pa"), std::string::npos)
      << scene.warnings[0];
}

// Of simulator/scenes/liver.geo [mm]: two ellipsoids, the second turned and moved, less a sphere.
bool in_liver(const Eigen::Vector3d& place_mm) {
  const auto in_ellipsoid = [](const Eigen::Vector3d& place, const Eigen::Array3d& semi_axes) {
    return (place.array() / semi_axes).matrix().squaredNorm() < 1.0;
  };
  const Eigen::AngleAxisd turned(std::acos(-1.0) / 14.0, Eigen::Vector3d::UnitX());
  const bool right = in_ellipsoid(place_mm, {68.0, 82.0, 62.0});
  const bool left = in_ellipsoid(turned.inverse() * (place_mm - Eigen::Vector3d(6.0, 62.0, 14.0)),
                                 {52.0, 105.0, 36.0});
  const bool hollow = (place_mm - Eigen::Vector3d(30.0, 70.0, -95.0)).norm() < 92.0;
  return (right || left) && !hollow;
}

TEST(OwnScenes, TheLiverFillsItsGeometry) {
  constexpr double kStep_mm = 2.0;
  double volume_mm3 = 0.0;
  for (double x = -100.0; x < 100.0; x += kStep_mm) {
    for (double y = -100.0; y < 200.0; y += kStep_mm) {
      for (double z = -80.0; z < 80.0; z += kStep_mm) {
        volume_mm3 += in_liver({x, y, z}) ? kStep_mm * kStep_mm * kStep_mm : 0.0;
      }
    }
  }
  const auto expect_filled = [volume_mm3](const char* name, double elements, double tolerance) {
    const Scene scene = make_scene(name);
    // Chords cut a little off every arc.
    const double filled = 1e9 * element_volume_m3(scene.mesh) / volume_mm3;
    EXPECT_LT(filled, 1.0) << name;
    EXPECT_GT(filled, 1.0 - tolerance) << name;
    EXPECT_NEAR(static_cast<double>(scene.mesh.tetrahedra.size()), elements, 0.1 * elements)
        << name;
    EXPECT_TRUE(scene.warnings.empty()) << name;
  };
  expect_filled("liver", 5000.0, 0.02);
  expect_filled("liver_fine", 20000.0, 0.01);
}

TEST(OwnScenes, ACoarserLiverHasItsPlaceMaterialAndVolume) {
  const Scene scene = make_scene("liver");
  for (const auto& [fineness, least] :
       {std::pair(Fineness::kTwoThirds, 0.95), std::pair(Fineness::kHalf, 0.9)}) {
    const SpringMesh coarse = make_coarser_mesh("liver", Eigen::Vector3d::Zero(), fineness);
    EXPECT_LT(coarse.tetrahedra.size(), scene.mesh.tetrahedra.size() / 3);
    EXPECT_EQ(coarse.top_W, scene.mesh.top_W);
    EXPECT_EQ(coarse.materials[0].youngs_modulus_Pa, scene.mesh.materials[0].youngs_modulus_Pa);
    const double part = element_volume_m3(coarse) / element_volume_m3(scene.mesh);
    EXPECT_LT(part, 1.0);
    EXPECT_GT(part, least);
  }
}

TEST(MeshedAnew, ABoxKeepsItsVolumeInFewerElements) {
  const SpringMesh box = element_block({8, 8, 5}, 0.006, soft(ElementModel::kNeoHookean));
  MeshFile file;
  file.vertex = box.rest_position_W;
  for (const Tetrahedron& element : box.tetrahedra) {
    file.tetrahedra.push_back(element.vertex);
  }
  file.regions = {"all of it"};
  file.region.assign(file.tetrahedra.size(), 0);
  const MeshFile coarse = remeshed(file, 1.5, "box: ");
  EXPECT_LT(coarse.tetrahedra.size(), file.tetrahedra.size() / 2);
  EXPECT_EQ(coarse.regions, file.regions);
  EXPECT_EQ(coarse.region.size(), coarse.tetrahedra.size());
  SpringMesh made;
  made.rest_position_W = coarse.vertex;
  for (const auto& vertex : coarse.tetrahedra) {
    made.tetrahedra.push_back({.vertex = vertex});
  }
  EXPECT_NEAR(element_volume_m3(made), 0.048 * 0.048 * 0.030, 1e-12);

  const auto refusal = [](const MeshFile& mesh) -> std::string {
    try {
      remeshed(mesh, 1.5, "box: ");
    } catch (const Error& error) {
      return error.what();
    }
    return "it was accepted";
  };
  file.regions = {"soft", "stiff"};
  EXPECT_EQ(refusal(file),
            "box: it has several regions, so Gmsh can't mesh it anew from its surface");
  file.tetrahedra.clear();
  EXPECT_EQ(refusal(file),
            "box: it has no tetrahedra, so Gmsh can't mesh it anew from its surface");
}

}  // namespace
}  // namespace forcegrid::simulator
