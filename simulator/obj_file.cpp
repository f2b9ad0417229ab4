#define TINYOBJLOADER_USE_DOUBLE  // as the library that is linked
#include <tiny_obj_loader.h>

#include <cmath>
#include <cstdlib>
#include <fstream>
#include <sstream>

#include "simulator/error.h"
#include "simulator/mesh_file.h"

namespace forcegrid::simulator {
namespace {

// tinyobjloader takes what it can't read as a coordinate for 0.
void check_coordinates(const std::string& file) {
  std::ifstream stream(file);
  std::string line;
  for (int number = 1; std::getline(stream, line); ++number) {
    std::istringstream words(line);
    std::string word;
    if (!(words >> word) || word != "v") {
      continue;
    }
    for (int axis = 0; axis < 3; ++axis) {
      char* end = nullptr;
      const bool given = static_cast<bool>(words >> word);
      const double value = given ? std::strtod(word.c_str(), &end) : 0.0;
      if (!given || *end != '\0' || !std::isfinite(value)) {
        throw Error("mesh file " + file + ":" + std::to_string(number) +
                    ": a vertex without three finite coordinates; correct it");
      }
    }
  }
}

}  // namespace

MeshFile read_obj(const std::string& file) {
  check_coordinates(file);
  tinyobj::ObjReaderConfig config;
  config.triangulate = true;
  tinyobj::ObjReader reader;
  const bool read = reader.ParseFromFile(file, config);
  if (!read || !reader.Error().empty()) {
    throw Error("mesh file " + file + ": can't be read: " + reader.Error() +
                "; export it as OBJ again");
  }
  MeshFile mesh;
  const std::vector<tinyobj::real_t>& numbers = reader.GetAttrib().vertices;
  for (std::size_t i = 0; i + 2 < numbers.size(); i += 3) {
    mesh.vertex.emplace_back(numbers[i], numbers[i + 1], numbers[i + 2]);
  }
  for (const tinyobj::shape_t& shape : reader.GetShapes()) {
    const std::vector<tinyobj::index_t>& index = shape.mesh.indices;
    for (std::size_t i = 0; i + 2 < index.size(); i += 3) {
      mesh.triangles.push_back(
          {index[i].vertex_index, index[i + 1].vertex_index, index[i + 2].vertex_index});
    }
  }
  return mesh;
}

}  // namespace forcegrid::simulator
