// SPDX-License-Identifier: Apache-2.0
#include "simulator/mesh/obj_file.h"

#define TINYOBJLOADER_USE_DOUBLE  // as the library that is linked
#include <tiny_obj_loader.h>

#include <charconv>
#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <fstream>
#include <sstream>
#include <string_view>

#include "simulator/mesh/error.h"

namespace forcegrid::simulator {
namespace {

constexpr std::size_t kFewestCorners = 3;

void check_coordinates(std::istringstream& words, const std::string& where) {
  for (int axis = 0; axis < 3; ++axis) {
    std::string word;
    char* end = nullptr;
    const bool given = static_cast<bool>(words >> word);
    const double value = given ? std::strtod(word.c_str(), &end) : 0.0;
    if (!given || *end != '\0' || !std::isfinite(value)) {
      throw Error(where + "a vertex without three finite coordinates; correct it");
    }
  }
}

// "7", "7/1", "7//2", "-1": a vertex's number, or how far back it stands.
void check_corner(const std::string& word, std::int64_t vertices_before, std::int64_t vertices,
                  const std::string& where) {
  const std::string_view digits = std::string_view(word).substr(0, word.find('/'));
  std::int64_t number = 0;
  const auto [stop, error] = std::from_chars(digits.data(), digits.data() + digits.size(), number);
  if (error != std::errc{} || stop != digits.data() + digits.size()) {
    throw Error(where + "a face with a corner '" + word +
                "', which names no vertex; write its number, from 1 on");
  }
  if (number == 0 || number > vertices || -number > vertices_before) {
    throw Error(where + "a face names vertex " + std::to_string(number) + " of " +
                std::to_string(number < 0 ? vertices_before : vertices) +
                (number < 0 ? " before it" : "") + "; correct the index");
  }
}

void check_face(std::istringstream& words, std::int64_t vertices_before, std::int64_t vertices,
                const std::string& where) {
  std::size_t corners = 0;
  for (std::string word; words >> word && word.front() != '#'; ++corners) {
    check_corner(word, vertices_before, vertices, where);
  }
  if (corners < kFewestCorners) {
    throw Error(where + "a face of " + std::to_string(corners) +
                " corners; give it three or more, or remove it");
  }
}

// Calls `visit(keyword, words, where)` for each line that says something.
template <typename Visit>
void for_each_line(const std::string& file, Visit visit) {
  std::ifstream stream(file);
  std::string line;
  for (int number = 1; std::getline(stream, line); ++number) {
    std::istringstream words(line);
    std::string keyword;
    if (words >> keyword) {
      visit(keyword, words, "mesh file " + file + ":" + std::to_string(number) + ": ");
    }
  }
}

// tinyobjloader takes what it can't read as a coordinate for 0, leaves out a face of two corners
// and wraps an index that is too large for it.
void check_lines(const std::string& file) {
  std::int64_t vertices = 0;
  for_each_line(
      file, [&](const std::string& keyword, std::istringstream& words, const std::string& where) {
        if (keyword == "v") {
          check_coordinates(words, where);
          ++vertices;
        }
      });
  std::int64_t before = 0;
  for_each_line(
      file, [&](const std::string& keyword, std::istringstream& words, const std::string& where) {
        before += keyword == "v" ? 1 : 0;
        if (keyword == "f") {
          check_face(words, before, vertices, where);
        }
      });
}

}  // namespace

MeshFile read_obj(const std::string& file) {
  check_lines(file);
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
