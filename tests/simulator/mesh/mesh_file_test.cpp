// SPDX-License-Identifier: Apache-2.0
#include "simulator/mesh/mesh_file.h"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <unistd.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cstdint>
#include <filesystem>
#include <fstream>
#include <set>
#include <sstream>
#include <string>

#include "simulator/mesh/error.h"
#include "simulator/mesh/msh_header.h"
#include "simulator/mesh/scene.h"
#include "simulator/solver/elastic_object.h"
#include "tests/simulator/mesh/mesh_volume.h"

namespace forcegrid::simulator {
namespace {

using ::testing::AllOf;
using ::testing::HasSubstr;

std::string file_with(const std::string& ending, const std::string& text) {
  const std::string file = ::testing::TempDir() + "mesh_file_" + std::to_string(getpid()) + ending;
  std::ofstream(file) << text;
  return file;
}

// |x| + |y| + |z| = 1.
constexpr const char* kOctahedron =
    "v 1 0 0\nv -1 0 0\nv 0 1 0\nv 0 -1 0\nv 0 0 1\nv 0 0 -1\n"
    "f 1 3 5\nf 3 2 5\nf 2 4 5\nf 4 1 5\nf 3 1 6\nf 2 3 6\nf 4 2 6\nf 1 4 6\n";

// The unit cube in six tetrahedra around its diagonal (Kuhn), in Gmsh's format 2.2. Nodes are
// numbered 11 to 18: the bits of number - 11 are the coordinates.
std::string cube_of_tetrahedra() {
  std::ostringstream text;
  text << "$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$Nodes\n8\n";
  for (int corner = 0; corner < 8; ++corner) {
    text << 11 + corner << ' ' << (corner & 1) << ' ' << (corner >> 1 & 1) << ' ' << (corner >> 2)
         << '\n';
  }
  text << "$EndNodes\n$Elements\n6\n";
  const int orders[6][2] = {{1, 3}, {1, 5}, {2, 3}, {2, 6}, {4, 5}, {4, 6}};
  for (int t = 0; t < 6; ++t) {
    text << t + 1 << " 4 2 1 1 11 " << 11 + orders[t][0] << ' ' << 11 + orders[t][1] << " 18\n";
  }
  text << "$EndElements\n";
  return text.str();
}

std::string scene_of(const std::string& mesh_file, const std::string& more) {
  return file_with(".toml",
                   "description = \"mesh\"\npatch_radius_m = 0.03\n[[object]]\n"
                   "shape = \"mesh\"\nfile = \"" +
                       mesh_file + "\"\nstiffness_N_per_m = 20.0\nlaw = \"linear\"\n" + more);
}

TEST(MeshFile, AnOctahedronFromObjHasItsEdgesVolumeAndSize) {
  const std::string file = file_with(".obj", kOctahedron);
  const SpringMesh mesh = make_scene(scene_of(file, "unit = \"cm\"\nfixed_below_m = 0.001\n")).mesh;
  EXPECT_EQ(mesh.rest_position_W.size(), 6U);
  EXPECT_EQ(mesh.springs.size(), 12U);  // V - E + F = 2
  EXPECT_EQ(mesh.triangles.size(), 8U);
  EXPECT_NEAR(volume_m3(mesh), 4.0 / 3.0 * 1e-6, 1e-18);  // 4/3 r^3
  EXPECT_EQ(std::count(mesh.fixed.begin(), mesh.fixed.end(), 1), 1);
  EXPECT_NEAR(mesh.rest_position_W[4].z(), 0.0, 1e-15) << "its tip is the scene's origin";
}

TEST(MeshFile, PolygonsOfAnObjAreCutAndASurfaceTurnedInwardIsTurnedOut) {
  const std::string cube =
      "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 0 0 1\nv 1 0 1\nv 1 1 1\nv 0 1 1\n"
      "f 1 2 3 4\nf 5 8 7 6\nf 1 5 6 2\nf 2 6 7 3\nf 3 7 8 4\nf 4 8 5 1\n";  // normals inward
  const SpringMesh mesh =
      make_scene(scene_of(file_with(".obj", cube), "unit = \"cm\"\nfixed_below_m = 0.0\n")).mesh;
  EXPECT_EQ(mesh.triangles.size(), 12U);
  EXPECT_EQ(mesh.springs.size(), 18U);
  EXPECT_NEAR(volume_m3(mesh), 1e-6, 1e-18);
}

TEST(MeshFile, ACubeOfTetrahedraFromGmshHasItsEdgesFacesAndVolume) {
  const std::string file = file_with(".msh", cube_of_tetrahedra());
  const MeshFile read = read_mesh_file(file);
  EXPECT_EQ(read.vertex.size(), 8U);
  EXPECT_EQ(read.tetrahedra.size(), 6U);
  const Scene scene = make_scene(scene_of(file, "unit = \"cm\"\nfixed_below_m = 0.0\n"));
  EXPECT_EQ(scene.mesh.springs.size(), 19U);  // 12 edges, 6 face diagonals, 1 through the middle
  EXPECT_EQ(scene.mesh.triangles.size(), 12U);
  EXPECT_NEAR(volume_m3(scene.mesh), 1e-6, 1e-18);
  ElasticObject<double> object(scene.mesh);
  EXPECT_EQ(object.grab(scene.mesh.top_W, 0.0075), 4);  // the top's corners, 7.07 mm away
  EXPECT_LT(object.move_to({0, 0, 1e-3}).force_W.z(), 0.0);
}

std::string complaint(const std::string& ending, const std::string& text) {
  try {
    read_mesh_file(file_with(ending, text));
  } catch (const Error& error) {
    return error.what();
  }
  return "";
}

std::string replaced(std::string text, const std::string& what, const std::string& with) {
  return text.replace(text.find(what), what.size(), with);
}

TEST(MeshFile, BrokenFilesAreRefusedByNameWithARemedy) {
  const std::string octahedron = kOctahedron;
  EXPECT_THAT(complaint(".obj", "v 0 0 0\n"), HasSubstr("no triangle and no tetrahedron"));
  EXPECT_THAT(complaint(".obj", replaced(octahedron, "v 0 0 1", "v 0 nan 1")),
              HasSubstr(".obj:5: a vertex without three finite coordinates"));
  EXPECT_THAT(complaint(".obj", replaced(octahedron, "v 0 0 1", "v 0 1")),
              HasSubstr(".obj:5: a vertex without"));
  EXPECT_THAT(
      complaint(".obj", replaced(octahedron, "f 1 4 6", "f 1 4 7")),
      AllOf(HasSubstr(".obj:14: a face names vertex 7 of 6"), HasSubstr("correct the index")));
  EXPECT_THAT(complaint(".obj", replaced(octahedron, "f 1 4 6", "f 1 4 -7")),
              HasSubstr(".obj:14: a face names vertex -7 of 6 before it"));
  EXPECT_THAT(complaint(".obj", replaced(octahedron, "f 1 4 6", "f 0 4 6")),
              HasSubstr("names vertex 0 of 6"));
  // 2^32 + 1 is 1 where indices have 32 bits.
  EXPECT_THAT(complaint(".obj", replaced(octahedron, "f 1 4 6", "f 4294967297 4 6")),
              HasSubstr("names vertex 4294967297 of 6"));
  EXPECT_THAT(complaint(".obj", replaced(octahedron, "f 1 4 6", "f 1 4 six")),
              HasSubstr("a corner 'six', which names no vertex"));
  EXPECT_THAT(complaint(".obj", replaced(octahedron, "f 1 4 6", "f 1 4")),
              HasSubstr(".obj:14: a face of 2 corners"));
  EXPECT_THAT(complaint(".obj", replaced(octahedron, "f 1 4 6", "f 1 4 4")),
              HasSubstr("triangle 8 has the same vertex twice"));
  EXPECT_THAT(complaint(".obj", "v 2 2 2\n" + octahedron), HasSubstr("belongs to no element"));
  EXPECT_THAT(complaint(".obj", replaced(octahedron, "v 0 -1 0", "v 0 1 0")),
              HasSubstr("vertices 3 and 4 lie at the same place"));
  EXPECT_THAT(complaint(".obj", replaced(octahedron, "v 0 -1 0", "v 0 0.9999999 0")),
              HasSubstr("vertices 3 and 4 lie at the same place"));
  EXPECT_THAT(complaint(".stl", octahedron), HasSubstr("unknown ending"));
  EXPECT_THAT(complaint(".msh", "this is no mesh\n"), HasSubstr("begins neither with $MeshFormat"));
  EXPECT_THAT(complaint(".msh", ""), HasSubstr("is empty"));
  const std::string cube = cube_of_tetrahedra();
  EXPECT_THAT(complaint(".msh", replaced(cube, "11 0 0 0", "11 nan 0 0")), HasSubstr("mesh file"));
  EXPECT_THAT(complaint(".msh", cube.substr(0, cube.find("$Elements"))),
              HasSubstr("no triangle and no tetrahedron"));
  EXPECT_THAT(complaint(".msh", replaced(cube, " 18\n", " 99\n")), HasSubstr("mesh file"));
  const std::string seven = replaced(cube, "$Elements\n6\n", "$Elements\n7\n");
  const std::string mixed =
      replaced(seven, "$EndElements", "77 7 2 1 1 11 12 13 14 15\n$EndElements");
  EXPECT_THAT(complaint(".msh", mixed), HasSubstr("element 77 is of Gmsh's type 7; mesh it with"));
  const std::string nine = replaced(cube, "$Nodes\n8\n", "$Nodes\n9\n");
  EXPECT_THAT(
      complaint(".msh", replaced(nine, "$EndNodes", "30 5 5 5\n$EndNodes")),
      HasSubstr("states 9 nodes, of which Gmsh keeps 8; remove those that no element uses"));
  EXPECT_THAT(complaint(".msh", replaced(nine, "$EndNodes", "11 0.5 0.5 0.5\n$EndNodes")),
              HasSubstr("give each a number of its own"));
  EXPECT_THAT(complaint(".msh", replaced(cube, "$Nodes\n8\n", "$Nodes\neight\n")),
              HasSubstr("does not begin with a number of nodes"));
  EXPECT_THROW(read_mesh_file("no/such.obj"), Error);
}

TEST(MeshFile, NothingInOrBesideAGmshFileIsRun) {
  const std::string folder = ::testing::TempDir() + "mesh_run_" + std::to_string(getpid());
  std::filesystem::create_directory(folder);
  const std::string mark = folder + "/was_run";
  const std::string script = "SystemCall \"touch '" + mark + "'\";\n";
  std::ofstream(folder + "/script.msh") << script;
  EXPECT_THROW(read_mesh_file(folder + "/script.msh"), Error);
  std::ofstream(folder + "/cube.msh") << cube_of_tetrahedra() << script;
  std::ofstream(folder + "/cube.msh.opt") << script;
  EXPECT_EQ(read_mesh_file(folder + "/cube.msh").vertex.size(), 8U);
  EXPECT_FALSE(std::filesystem::exists(mark));
  std::filesystem::remove_all(folder);
}

template <typename Number>
std::string bytes_of(Number number, bool swapped) {
  std::string bytes(reinterpret_cast<const char*>(&number), sizeof number);
  if (swapped) {
    std::reverse(bytes.begin(), bytes.end());
  }
  return bytes;
}

std::size_t stated_in(const std::string& text) {
  return stated_node_count(file_with(".msh", text), "mesh: ");
}

TEST(MshHeader, HasTheNumberOfNodesInEveryVersionOfTheFormat) {
  EXPECT_EQ(stated_in("$NOD\n17\n1 0 0 0\n"), 17U);  // version 1
  EXPECT_EQ(stated_in("$Comments\nby hand\n$EndComments\n$MeshFormat\r\n2.2 0 8\r\n"
                      "$EndMeshFormat\r\n$Nodes\r\n8\r\n"),
            8U);
  EXPECT_EQ(stated_in("$MeshFormat\n4 0 8\n$EndMeshFormat\n$Nodes\n2 33\n"), 33U);
  EXPECT_EQ(stated_in("$MeshFormat\n4.1 0 8\n$EndMeshFormat\n$Nodes\n3 77 1 90\n"), 77U);
  EXPECT_EQ(stated_in("$MeshFormat\n4.1 0 8\n$EndMeshFormat\n"), 0U);
  for (const bool swapped : {false, true}) {
    const std::string one = bytes_of(std::int32_t{1}, swapped) + "\n$EndMeshFormat\n$Nodes\n";
    EXPECT_EQ(stated_in("$MeshFormat\n2.2 1 8\n" + one + "8\n"), 8U);
    EXPECT_EQ(
        stated_in("$MeshFormat\n4.1 1 8\n" + one + bytes_of(std::uint64_t{3}, swapped) +
                  bytes_of(std::uint64_t{70000}, swapped) + bytes_of(std::uint64_t{1}, swapped)),
        70000U);
  }
}

std::string scene_complaint(const std::string& scene_file) {
  try {
    make_scene(scene_file);
  } catch (const Error& error) {
    return error.what();
  }
  return "";
}

TEST(MeshFile, AnObjectThatNobodyCanMeanIsRefused) {
  const std::string file = file_with(".obj", kOctahedron);
  EXPECT_THAT(scene_complaint(scene_of(file, "unit = \"m\"\nfixed_below_m = 0.1\n")),
              AllOf(HasSubstr("2 m long"), HasSubstr("write the unit")));
  EXPECT_THAT(scene_complaint(scene_of(file, "unit = \"furlong\"\nfixed_below_m = 0.1\n")),
              HasSubstr("'furlong' is unknown"));
  EXPECT_THAT(scene_complaint(scene_of(file, "fixed_below_m = 0.1\n")),
              HasSubstr("unit': missing"));
  EXPECT_THAT(scene_complaint(scene_of("missing.obj", "unit = \"cm\"\nfixed_below_m = 0.1\n")),
              HasSubstr("missing.obj: no such file"));
  const std::string turned = replaced(kOctahedron, "f 1 4 6", "f 4 1 6");
  EXPECT_THAT(scene_complaint(
                  scene_of(file_with(".obj", turned), "unit = \"cm\"\nfixed_below_m = 0.001\n")),
              HasSubstr("run the same way along the edge"));
  EXPECT_THAT(scene_complaint(
                  scene_of(file_with(".obj", kOctahedron), "unit = \"cm\"\nfixed_below_m = 0.5\n")),
              HasSubstr("all its vertices are fixed"));
}

TEST(MeshFile, APartThatNothingHoldsIsRefusedUnlessItHasHomeSprings) {
  std::ostringstream two;
  two << kOctahedron;
  for (const char* place : {"1 0", "-1 0", "0 1", "0 -1"}) {
    two << "v " << place << " 5\n";
  }
  two << "v 0 0 6\nv 0 0 4\nf 7 9 11\nf 9 8 11\nf 8 10 11\nf 10 7 11\n"
         "f 9 7 12\nf 8 9 12\nf 10 8 12\nf 7 10 12\n";
  const std::string file = file_with(".obj", two.str());
  const std::string more = "unit = \"cm\"\nfixed_below_m = 0.001\n";
  EXPECT_THAT(scene_complaint(scene_of(file, more)),
              AllOf(HasSubstr("the part with vertex 7"), HasSubstr("join it to the rest")));
  EXPECT_EQ(
      make_scene(scene_of(file, more + "home_stiffness_N_per_m = 1.0\n")).mesh.triangles.size(),
      16U);
}

TEST(MeshFile, APatchThatHoldsNothingIsRefused) {
  const std::string file = file_with(".msh", cube_of_tetrahedra());
  const std::string scene = scene_of(file, "unit = \"cm\"\nfixed_below_m = 0.0\n");
  std::ifstream stream(scene);
  std::string text{std::istreambuf_iterator<char>(stream), {}};
  std::ofstream(scene) << replaced(text, "patch_radius_m = 0.03", "patch_radius_m = 0.007");
  // The top's corners are 5 sqrt(2) mm away.
  EXPECT_THAT(scene_complaint(scene), AllOf(HasSubstr(":2: key 'patch_radius_m': it is 0.007,"),
                                            HasSubstr("0.00707"), HasSubstr("write more")));
}

}  // namespace
}  // namespace forcegrid::simulator
