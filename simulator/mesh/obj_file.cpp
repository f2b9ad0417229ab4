// SPDX-License-Identifier: Apache-2.0
#include "simulator/mesh/obj_file.h"

#define TINYOBJLOADER_USE_DOUBLE  // as the library that is linked
#include <tiny_obj_loader.h>

#include <array>
#include <charconv>
#include <cmath>
#include <cstdint>
#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <sstream>
#include <streambuf>
#include <string_view>
#include <system_error>

#include "rt/checkpoint.h"
#include "simulator/mesh/error.h"

namespace forcegrid::simulator {
namespace {

constexpr std::size_t kFewestCorners = 3;
constexpr int kLinesToCheckpoint = 4096;

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

// "7", "7/1", "7//2", "-1": a vertex's number, or how many vertices back it is.
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

std::size_t size_of(const std::string& file) {
  std::error_code unknown;
  const std::uintmax_t size_bytes = std::filesystem::file_size(file, unknown);
  return unknown ? 0 : size_bytes;
}

// Calls `visit(keyword, words, where)` for each line with content.
template <typename Visit>
void for_each_line(const std::string& file, Visit visit) {
  std::ifstream stream(file);
  std::string line;
  const std::size_t size_bytes = size_of(file);
  std::size_t read_bytes = 0;
  for (int number = 1; std::getline(stream, line); ++number) {
    read_bytes += line.size() + 1;
    if (number % kLinesToCheckpoint == 0) {
      rt::checkpoint(read_bytes, size_bytes);
    }
    std::istringstream words(line);
    std::string keyword;
    if (words >> keyword) {
      visit(keyword, words, "mesh file " + file + ":" + std::to_string(number) + ": ");
    }
  }
}

// tinyobjloader reads an invalid coordinate as 0, drops a face of two corners, and wraps an index
// that is too large.
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

// A file's bytes with a checkpoint at each block, for tinyobjloader, which has none.
class FileWithCheckpoints : public std::streambuf {
 public:
  explicit FileWithCheckpoints(const std::string& file)
      : stream_(file, std::ios::binary), size_bytes_(size_of(file)) {}

 protected:
  int_type underflow() override {
    rt::checkpoint(read_bytes_, size_bytes_);
    stream_.read(block_.data(), static_cast<std::streamsize>(block_.size()));
    const std::streamsize count = stream_.gcount();
    read_bytes_ += static_cast<std::size_t>(count);
    setg(block_.data(), block_.data(), block_.data() + count);
    return count == 0 ? traits_type::eof() : traits_type::to_int_type(block_.front());
  }

 private:
  std::ifstream stream_;
  std::size_t size_bytes_;
  std::size_t read_bytes_ = 0;
  std::array<char, 65536> block_{};
};

}  // namespace

MeshFile read_obj(const std::string& file) {
  check_lines(file);
  FileWithCheckpoints bytes(file);
  std::istream stream(&bytes);
  tinyobj::attrib_t attributes;
  std::vector<tinyobj::shape_t> shapes;
  std::vector<tinyobj::material_t> materials;
  std::string warnings;
  std::string problem;
  constexpr bool kTriangulate = true;
  const bool read = tinyobj::LoadObj(&attributes, &shapes, &materials, &warnings, &problem, &stream,
                                     nullptr, kTriangulate);
  if (!read || !problem.empty()) {
    throw Error("mesh file " + file + ": can't be read: " + problem + "; export it as OBJ again");
  }
  MeshFile mesh;
  const std::vector<tinyobj::real_t>& numbers = attributes.vertices;
  for (std::size_t i = 0; i + 2 < numbers.size(); i += 3) {
    mesh.vertex.emplace_back(numbers[i], numbers[i + 1], numbers[i + 2]);
  }
  for (const tinyobj::shape_t& shape : shapes) {
    const std::vector<tinyobj::index_t>& index = shape.mesh.indices;
    for (std::size_t i = 0; i + 2 < index.size(); i += 3) {
      mesh.triangles.push_back(
          {index[i].vertex_index, index[i + 1].vertex_index, index[i + 2].vertex_index});
    }
  }
  return mesh;
}

}  // namespace forcegrid::simulator
