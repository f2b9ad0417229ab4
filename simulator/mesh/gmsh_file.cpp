// SPDX-License-Identifier: Apache-2.0
#include "simulator/mesh/gmsh_file.h"

#include <dlfcn.h>
#include <fcntl.h>
#include <unistd.h>

#include <cerrno>
#include <memory>
#include <system_error>
#include <unordered_map>

#include "rt/checkpoint.h"
#include "simulator/mesh/error.h"
#include "simulator/mesh/msh_header.h"

namespace forcegrid::simulator {
namespace {

// What is called of Gmsh's C interface, version 4.8. Debian's header comes only with a CAD kernel
// and its headers, which no build should need for a library that is loaded when a .msh file is
// read.
constexpr char kLibrary[] = "libgmsh.so.4.8";
using gmshInitialize = void(int argc, char** argv, int read_configuration, int* error);
using gmshOptionSetNumber = void(const char* name, double value, int* error);
using gmshOpen = void(const char* file, int* error);
using gmshLoggerGetLastError = void(char** text, int* error);
using gmshFree = void(void* memory);
using gmshFinalize = void(int* error);
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

// Gmsh's numbers for its element types.
enum GmshType { kLine = 1, kTriangle = 2, kTetrahedron = 4, kPoint = 15 };

struct Close {
  void operator()(void* library) const { ::dlclose(library); }
};

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

// libgmsh brings a CAD kernel and a window system and takes longer to load than the rest of the
// program takes to start, so it is loaded only here.
class Gmsh {
 public:
  explicit Gmsh(const std::string& file)
      : who_("mesh file " + file + ": "), stated_nodes_(stated_node_count(file, who_)) {
    library_.reset(::dlopen(kLibrary, RTLD_NOW | RTLD_LOCAL));
    if (!library_) {
      throw Error(who_ + kLibrary + " can't be loaded (" + ::dlerror() +
                  "); install Debian's libgmsh4.8 or convert the file to .obj");
    }
    int error = 0;
    function<gmshInitialize>("gmshInitialize")(0, nullptr, 0, &error);
    require(error == 0, "libgmsh does not start");
    function<gmshOptionSetNumber>("gmshOptionSetNumber")("General.Terminal", 0.0, &error);
    const OwnName name_in_gmsh(file, who_);
    function<gmshOpen>("gmshOpen")(name_in_gmsh.text().c_str(), &error);
    if (error != 0) {
      std::string reason = last_error();
      if (const auto at = reason.find(name_in_gmsh.text()); at != std::string::npos) {
        reason.replace(at, name_in_gmsh.text().size(), file);
      }
      finish();
      throw Error(who_ + "Gmsh can't read it (" + reason + "); save it as .msh again");
    }
  }
  ~Gmsh() { finish(); }
  Gmsh(const Gmsh&) = delete;
  Gmsh& operator=(const Gmsh&) = delete;

  MeshFile read() {
    MeshFile mesh;
    read_nodes(mesh);
    read_elements(mesh);
    check_node_count(mesh);
    if (!mesh.tetrahedra.empty()) {
      mesh.triangles.clear();
      read_regions(mesh);
    }
    return mesh;
  }

 private:
  template <typename Function>
  Function* function(const char* name) {
    void* const symbol = ::dlsym(library_.get(), name);
    require(symbol != nullptr, std::string("libgmsh has no ") + name);
    return reinterpret_cast<Function*>(symbol);
  }

  void require(bool good, const std::string& problem) const {
    if (!good) {
      throw Error(who_ + problem + "; install Debian's libgmsh4.8 or convert the file to .obj");
    }
  }

  std::string last_error() {
    char* text = nullptr;
    int error = 0;
    function<gmshLoggerGetLastError>("gmshLoggerGetLastError")(&text, &error);
    const std::string result = text != nullptr ? text : "no reason given";
    release(text);
    return result;
  }

  void release(void* memory) { function<gmshFree>("gmshFree")(memory); }

  void finish() noexcept {
    int error = 0;
    // The constructor has already refused a library without this function.
    if (void* const symbol = library_ ? ::dlsym(library_.get(), "gmshFinalize") : nullptr) {
      reinterpret_cast<gmshFinalize*>(symbol)(&error);
    }
    library_.reset();
  }

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
      throw Error(who_ + "elements of Gmsh's type " + std::to_string(other_type) +
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

  // Gmsh drops nodes that no element uses, and the first of two nodes with one number.
  void check_node_count(const MeshFile& mesh) const {
    const bool has_elements = !mesh.triangles.empty() || !mesh.tetrahedra.empty();
    if (has_elements && mesh.vertex.size() != stated_nodes_) {
      throw Error(who_ + "states " + std::to_string(stated_nodes_) +
                  " nodes, of which Gmsh keeps " + std::to_string(mesh.vertex.size()) +
                  "; remove those that no element uses, and give each a number of its own");
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

  std::string who_;
  std::size_t stated_nodes_;
  std::unique_ptr<void, Close> library_;
  std::unordered_map<std::size_t, std::int32_t> number_of_;      // Gmsh's tag of a node -> vertex
  std::unordered_map<std::size_t, std::size_t> tetrahedron_of_;  // Gmsh's tag of an element
};

}  // namespace

MeshFile read_gmsh(const std::string& file) { return Gmsh(file).read(); }

}  // namespace forcegrid::simulator
