// SPDX-License-Identifier: Apache-2.0
#include "simulator/mesh/gmsh_file.h"

#include <fcntl.h>
#include <unistd.h>

#include <cerrno>
#include <numbers>
#include <system_error>
#include <unordered_map>
#include <vector>

#include "rt/checkpoint.h"
#include "simulator/mesh/error.h"
#include "simulator/mesh/gmsh_library.h"
#include "simulator/mesh/msh_header.h"

namespace forcegrid::simulator {
namespace {

// What is called of Gmsh's C interface.
using gmshOpen = void(const char* file, int* error);
using gmshModelMeshGetNodes = void(std::size_t** tags, std::size_t* tag_count, double** place,
                                   std::size_t* place_count, double** parameter,
                                   std::size_t* parameter_count, int dimension, int tag,
                                   int with_boundary, int with_parameters, int* error);
using gmshModelMeshGetElements = void(int** types, std::size_t* type_count, std::size_t*** tags,
                                      std::size_t** tag_counts, std::size_t* tags_count,
                                      std::size_t*** nodes, std::size_t** node_counts,
                                      std::size_t* nodes_count, int dimension, int tag, int* error);
using gmshModelGetPhysicalGroups = void(int** dimensions_and_tags, std::size_t* count,
                                        int dimension, int* error);
using gmshModelGetEntitiesForPhysicalGroup = void(int dimension, int tag, int** entities,
                                                  std::size_t* count, int* error);
using gmshModelGetPhysicalName = void(int dimension, int tag, char** name, int* error);
using gmshModelAdd = void(const char* name, int* error);
using gmshModelAddDiscreteEntity = int(int dimension, int tag, int* boundary,
                                       std::size_t boundary_count, int* error);
using gmshModelMeshAddNodes = void(int dimension, int tag, std::size_t* tags, std::size_t tag_count,
                                   double* place, std::size_t place_count, double* parameter,
                                   std::size_t parameter_count, int* error);
using gmshModelMeshAddElementsByType = void(int tag, int type, std::size_t* tags,
                                            std::size_t tag_count, std::size_t* nodes,
                                            std::size_t node_count, int* error);
using gmshModelMeshClassifySurfaces = void(double angle_rad, int boundary,
                                           int for_reparametrisation, double curve_angle_rad,
                                           int export_discrete, int* error);
using gmshModelMeshCreateGeometry = void(int* dimensions_and_tags, std::size_t count, int* error);
using gmshModelGetEntities = void(int** dimensions_and_tags, std::size_t* count, int dimension,
                                  int* error);
using gmshModelGeoAddSurfaceLoop = int(int* surfaces, std::size_t count, int tag, int* error);
using gmshModelGeoAddVolume = int(int* shells, std::size_t count, int tag, int* error);
using gmshModelGeoSynchronize = void(int* error);
using gmshModelMeshGenerate = void(int dimension, int* error);

// Gmsh's numbers for its element types.
enum GmshType { kLine = 1, kTriangle = 2, kTetrahedron = 4, kPoint = 15 };

// Another name of the file, such that no other file's name begins with it. If FILE.opt lies beside
// FILE, Gmsh runs it as a script, which may start programs, when it reads FILE.
class OwnName {
 public:
  explicit OwnName(const std::string& file, const std::string& who)
      : descriptor_(::open(file.c_str(), O_RDONLY | O_CLOEXEC)) {
    if (descriptor_ < 0) {
      throw Error(who + "open: " + std::generic_category().message(errno) +
                  "; write a file that can be read");
    }
  }
  ~OwnName() { ::close(descriptor_); }
  OwnName(const OwnName&) = delete;
  OwnName& operator=(const OwnName&) = delete;

  [[nodiscard]] std::string text() const { return "/proc/self/fd/" + std::to_string(descriptor_); }

 private:
  int descriptor_;
};

// Reads the mesh of Gmsh's present model.
class Model {
 public:
  explicit Model(const GmshLibrary& gmsh) : gmsh_(gmsh), who_(gmsh.who()) {}

  MeshFile read() {
    MeshFile mesh;
    read_nodes(mesh);
    read_elements(mesh);
    if (!mesh.tetrahedra.empty()) {
      mesh.triangles.clear();
      read_regions(mesh);
    }
    return mesh;
  }

 private:
  template <typename Function>
  Function* function(const char* name) const {
    return gmsh_.function<Function>(name);
  }
  void require(bool good, const std::string& problem) const { gmsh_.require(good, problem); }
  void release(void* memory) const { gmsh_.release(memory); }

  void read_nodes(MeshFile& mesh) {
    std::size_t* tags = nullptr;
    double* place = nullptr;
    double* parameter = nullptr;
    std::size_t tag_count = 0;
    std::size_t place_count = 0;
    std::size_t parameter_count = 0;
    int error = 0;
    function<gmshModelMeshGetNodes>("gmshModelMeshGetNodes")(
        &tags, &tag_count, &place, &place_count, &parameter, &parameter_count, -1, -1, 0, 0,
        &error);
    for (std::size_t i = 0; i < tag_count && 3 * i + 2 < place_count; ++i) {
      rt::checkpoint_at(i, tag_count);
      number_of_.emplace(tags[i], static_cast<std::int32_t>(mesh.vertex.size()));
      mesh.vertex.emplace_back(place[3 * i], place[3 * i + 1], place[3 * i + 2]);
    }
    release(tags);
    release(place);
    release(parameter);
    require(error == 0, "its nodes can't be read");
  }

  void read_elements(MeshFile& mesh) {
    int* types = nullptr;
    std::size_t type_count = 0;
    std::size_t** tags = nullptr;
    std::size_t* tags_size = nullptr;
    std::size_t tags_count = 0;
    std::size_t** nodes = nullptr;
    std::size_t* nodes_size = nullptr;
    std::size_t nodes_count = 0;
    int error = 0;
    function<gmshModelMeshGetElements>("gmshModelMeshGetElements")(
        &types, &type_count, &tags, &tags_size, &tags_count, &nodes, &nodes_size, &nodes_count, -1,
        -1, &error);
    int other_type = 0;
    std::size_t of_other_type = 0;  // its first element's number
    for (std::size_t k = 0; k < type_count; ++k) {
      if (types[k] == kTriangle) {
        add(nodes[k], nodes_size[k], mesh.triangles);
      } else if (types[k] == kTetrahedron) {
        for (std::size_t n = 0; n < tags_size[k]; ++n) {
          tetrahedron_of_.emplace(tags[k][n], mesh.tetrahedra.size() + n);
        }
        add(nodes[k], nodes_size[k], mesh.tetrahedra);
      } else if (types[k] != kLine && types[k] != kPoint) {
        other_type = types[k];
        of_other_type = tags_size[k] > 0 ? tags[k][0] : 0;
      }
      release(tags[k]);
      release(nodes[k]);
    }
    release(types);
    release(tags);
    release(tags_size);
    release(nodes);
    release(nodes_size);
    require(error == 0, "its elements can't be read");
    if (other_type != 0) {
      throw Error(who_ + "element " + std::to_string(of_other_type) + " is of Gmsh's type " +
                  std::to_string(other_type) +
                  "; mesh it with triangles or tetrahedra of the first order");
    }
  }

  // The physical groups of volumes.
  void read_regions(MeshFile& mesh) {
    constexpr int kVolumes = 3;
    int* groups = nullptr;
    std::size_t count = 0;
    int error = 0;
    function<gmshModelGetPhysicalGroups>("gmshModelGetPhysicalGroups")(&groups, &count, kVolumes,
                                                                       &error);
    require(error == 0, "its physical groups can't be read");
    if (count > 0) {
      mesh.region.assign(mesh.tetrahedra.size(), -1);
    }
    for (std::size_t g = 1; g < count; g += 2) {  // pairs of dimension and tag
      const int tag = groups[g];
      char* name = nullptr;
      function<gmshModelGetPhysicalName>("gmshModelGetPhysicalName")(kVolumes, tag, &name, &error);
      const std::string text = name != nullptr ? name : "";
      release(name);
      const auto region = static_cast<std::int32_t>(mesh.regions.size());
      mesh.regions.push_back(text.empty() ? std::to_string(tag) : text);
      int* entities = nullptr;
      std::size_t entity_count = 0;
      function<gmshModelGetEntitiesForPhysicalGroup>("gmshModelGetEntitiesForPhysicalGroup")(
          kVolumes, tag, &entities, &entity_count, &error);
      require(error == 0,
              "the volumes of its physical group " + mesh.regions.back() + " can't be read");
      for (std::size_t e = 0; e < entity_count; ++e) {
        mark_region(entities[e], region, mesh);
      }
      release(entities);
    }
    release(groups);
  }

  void mark_region(int entity, std::int32_t region, MeshFile& mesh) {
    int* types = nullptr;
    std::size_t type_count = 0;
    std::size_t** tags = nullptr;
    std::size_t* tags_size = nullptr;
    std::size_t tags_count = 0;
    std::size_t** nodes = nullptr;
    std::size_t* nodes_size = nullptr;
    std::size_t nodes_count = 0;
    int error = 0;
    function<gmshModelMeshGetElements>("gmshModelMeshGetElements")(
        &types, &type_count, &tags, &tags_size, &tags_count, &nodes, &nodes_size, &nodes_count, 3,
        entity, &error);
    std::int32_t other = -1;
    for (std::size_t k = 0; k < type_count; ++k) {
      for (std::size_t n = 0; n < tags_size[k]; ++n) {
        if (const auto found = tetrahedron_of_.find(tags[k][n]); found != tetrahedron_of_.end()) {
          std::int32_t& its = mesh.region[found->second];
          other = its >= 0 && its != region ? its : other;
          its = region;
        }
      }
      release(tags[k]);
      release(nodes[k]);
    }
    release(types);
    release(tags);
    release(tags_size);
    release(nodes);
    release(nodes_size);
    require(error == 0, "its elements can't be read");
    if (other >= 0) {
      throw Error(who_ + "a volume belongs to the physical groups '" +
                  mesh.regions[static_cast<std::size_t>(other)] + "' and '" +
                  mesh.regions[static_cast<std::size_t>(region)] + "'; put it into one of them");
    }
  }

  template <std::size_t kCorners>
  void add(const std::size_t* node, std::size_t count,
           std::vector<std::array<std::int32_t, kCorners>>& elements) const {
    for (std::size_t i = 0; i + kCorners <= count; i += kCorners) {
      rt::checkpoint_at(i / kCorners, count / kCorners);
      std::array<std::int32_t, kCorners> element{};
      for (std::size_t k = 0; k < kCorners; ++k) {
        const auto found = number_of_.find(node[i + k]);
        element[k] = found != number_of_.end() ? found->second : -1;
      }
      elements.push_back(element);
    }
  }

  const GmshLibrary& gmsh_;
  const std::string& who_;
  std::unordered_map<std::size_t, std::int32_t> number_of_;      // Gmsh's tag of a node -> vertex
  std::unordered_map<std::size_t, std::size_t> tetrahedron_of_;  // Gmsh's tag of an element
};

void open_file(const GmshLibrary& gmsh, const std::string& file) {
  const OwnName name_in_gmsh(file, gmsh.who());
  int error = 0;
  gmsh.function<gmshOpen>("gmshOpen")(name_in_gmsh.text().c_str(), &error);
  if (error != 0) {
    std::string reason = gmsh.last_error();
    if (const auto at = reason.find(name_in_gmsh.text()); at != std::string::npos) {
      reason.replace(at, name_in_gmsh.text().size(), file);
    }
    throw Error(gmsh.who() + "Gmsh can't read it (" + reason + "); save it as .msh again");
  }
}

// Gmsh drops nodes that no element uses, and the first of two nodes with one number.
void check_node_count(const MeshFile& mesh, std::size_t stated_nodes, const std::string& who) {
  const bool has_elements = !mesh.triangles.empty() || !mesh.tetrahedra.empty();
  if (has_elements && mesh.vertex.size() != stated_nodes) {
    throw Error(who + "states " + std::to_string(stated_nodes) + " nodes, of which Gmsh keeps " +
                std::to_string(mesh.vertex.size()) +
                "; remove those that no element uses, and give each a number of its own");
  }
}

// The surface of a mesh as a discrete surface of Gmsh's present model.
void add_surface(const GmshLibrary& gmsh, const MeshFile& mesh) {
  constexpr int kSurface = 1;
  int error = 0;
  gmsh.function<gmshModelAddDiscreteEntity>("gmshModelAddDiscreteEntity")(2, kSurface, nullptr, 0,
                                                                          &error);
  gmsh.require(error == 0, "Gmsh takes no surface");
  std::vector<std::size_t> corners;  // Gmsh counts from one
  std::vector<std::size_t> nodes;
  std::vector<double> places;
  std::vector<std::size_t> tag_of(mesh.vertex.size(), 0);
  for (const auto& face : outer_faces(mesh, gmsh.who())) {
    for (const std::int32_t corner : face) {
      const auto vertex = static_cast<std::size_t>(corner);
      if (tag_of[vertex] == 0) {
        tag_of[vertex] = vertex + 1;
        nodes.push_back(vertex + 1);
        const Eigen::Vector3d& place = mesh.vertex[vertex];
        places.insert(places.end(), place.data(), place.data() + 3);
      }
      corners.push_back(tag_of[vertex]);
    }
  }
  gmsh.function<gmshModelMeshAddNodes>("gmshModelMeshAddNodes")(
      2, kSurface, nodes.data(), nodes.size(), places.data(), places.size(), nullptr, 0, &error);
  gmsh.require(error == 0, "Gmsh takes no nodes");
  gmsh.function<gmshModelMeshAddElementsByType>("gmshModelMeshAddElementsByType")(
      kSurface, kTriangle, nullptr, 0, corners.data(), corners.size(), &error);
  gmsh.require(error == 0, "Gmsh takes no triangles");
}

// The discrete surface, cut into charts along its ridges, bounds one volume.
void make_geometry(const GmshLibrary& gmsh) {
  constexpr double kRidge_rad = 40.0 * std::numbers::pi / 180.0;
  int error = 0;
  gmsh.function<gmshModelMeshClassifySurfaces>("gmshModelMeshClassifySurfaces")(
      kRidge_rad, 1, 1, std::numbers::pi, 1, &error);
  if (error == 0) {
    gmsh.function<gmshModelMeshCreateGeometry>("gmshModelMeshCreateGeometry")(nullptr, 0, &error);
  }
  if (error != 0) {
    throw Error(gmsh.who() + "Gmsh makes no geometry of its surface (" + gmsh.last_error() + ")");
  }
  int* found = nullptr;
  std::size_t count = 0;
  gmsh.function<gmshModelGetEntities>("gmshModelGetEntities")(&found, &count, 2, &error);
  std::vector<int> charts;
  for (std::size_t i = 1; i < count; i += 2) {  // pairs of dimension and tag
    charts.push_back(found[i]);
  }
  gmsh.release(found);
  int loop = gmsh.function<gmshModelGeoAddSurfaceLoop>("gmshModelGeoAddSurfaceLoop")(
      charts.data(), charts.size(), -1, &error);
  if (error == 0) {
    gmsh.function<gmshModelGeoAddVolume>("gmshModelGeoAddVolume")(&loop, 1, -1, &error);
  }
  if (error == 0) {
    gmsh.function<gmshModelGeoSynchronize>("gmshModelGeoSynchronize")(&error);
  }
  if (error != 0) {
    throw Error(gmsh.who() + "Gmsh makes no volume of its surface (" + gmsh.last_error() + ")");
  }
}

double mean_edge(const MeshFile& mesh) {
  double sum = 0.0;
  for (const auto& element : mesh.tetrahedra) {
    for (std::size_t a = 0; a < 4; ++a) {
      for (std::size_t b = 0; b < a; ++b) {
        sum += (mesh.vertex[static_cast<std::size_t>(element[a])] -
                mesh.vertex[static_cast<std::size_t>(element[b])])
                   .norm();
      }
    }
  }
  return sum / (6.0 * static_cast<double>(mesh.tetrahedra.size()));
}

}  // namespace

MeshFile read_gmsh(const std::string& file) {
  const std::string who = "mesh file " + file + ": ";
  const std::size_t stated_nodes = stated_node_count(file, who);
  const GmshLibrary gmsh(who);
  open_file(gmsh, file);
  MeshFile mesh = Model(gmsh).read();
  check_node_count(mesh, stated_nodes, who);
  return mesh;
}

MeshFile remeshed(const MeshFile& mesh, double edge_factor, const std::string& who) {
  constexpr double kMeshAdapt = 1.0;  // the surface's mesher that leaves the fewest slivers
  if (mesh.tetrahedra.empty() || mesh.regions.size() > 1) {
    throw Error(who +
                (mesh.tetrahedra.empty() ? "it has no tetrahedra" : "it has several regions") +
                ", so Gmsh can't mesh it anew from its surface");
  }
  const GmshLibrary gmsh(who);
  int error = 0;
  gmsh.function<gmshModelAdd>("gmshModelAdd")("remeshed", &error);
  gmsh.require(error == 0, "Gmsh makes no model");
  add_surface(gmsh, mesh);
  make_geometry(gmsh);
  const double edge = edge_factor * mean_edge(mesh);
  gmsh.set_option("Mesh.MeshSizeMin", edge);
  gmsh.set_option("Mesh.MeshSizeMax", edge);
  gmsh.set_option("Mesh.MeshSizeExtendFromBoundary", 0.0);
  gmsh.set_option("Mesh.Algorithm", kMeshAdapt);
  gmsh.function<gmshModelMeshGenerate>("gmshModelMeshGenerate")(3, &error);
  if (error != 0) {
    throw Error(who + "Gmsh does not mesh it anew (" + gmsh.last_error() + ")");
  }
  MeshFile result = Model(gmsh).read();
  if (result.tetrahedra.empty()) {
    throw Error(who + "Gmsh fills its surface with no tetrahedra");
  }
  result.regions = mesh.regions;
  result.region.assign(mesh.region.empty() ? 0 : result.tetrahedra.size(), 0);
  check(result, who);
  return result;
}

}  // namespace forcegrid::simulator
