// SPDX-License-Identifier: Apache-2.0
#include "simulator/mesh/msh_header.h"

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstdint>
#include <cstring>
#include <fstream>
#include <sstream>

#include "simulator/mesh/error.h"

namespace forcegrid::simulator {
namespace {

constexpr double kFirstWithBlocks = 4.0;  // from this version on, nodes are stored in blocks

struct Format {
  double version = 1.0;  // of the legacy format, which does not state it
  bool binary = false;
  bool swapped = false;  // its byte order is not this machine's
};

bool begins_as_mesh(const std::string& line) {
  return line.starts_with("$MeshFormat") || line.starts_with("$NOD") ||
         line.starts_with("$Comments");
}

bool begins_nodes(const std::string& line) {
  return line.starts_with("$Nodes") || line.starts_with("$NOD") ||
         line.starts_with("$ParametricNodes");
}

Format read_format(std::istream& stream) {
  Format format;
  std::string line;
  std::getline(stream, line);
  int binary = 0;
  std::istringstream(line) >> format.version >> binary;
  format.binary = binary != 0;
  if (format.binary) {
    std::array<char, sizeof(std::int32_t)> bytes{};
    stream.read(bytes.data(), bytes.size());
    std::int32_t one = 0;
    std::memcpy(&one, bytes.data(), sizeof one);
    format.swapped = one != 1;
  }
  return format;
}

// The count of a section: "N", or from version 4 on "BLOCKS N ...", in binary as two numbers.
bool read_count(std::istream& stream, const Format& format, std::size_t& count) {
  const bool in_blocks = format.version >= kFirstWithBlocks;
  if (in_blocks && format.binary) {
    std::array<std::array<char, sizeof(std::uint64_t)>, 2> numbers{};
    for (auto& number : numbers) {
      stream.read(number.data(), number.size());
    }
    if (format.swapped) {
      std::ranges::reverse(numbers[1]);
    }
    std::uint64_t nodes = 0;
    std::memcpy(&nodes, numbers[1].data(), sizeof nodes);
    count = nodes;
    return static_cast<bool>(stream);
  }
  std::string line;
  std::getline(stream, line);
  std::istringstream words(line);
  std::size_t blocks = 0;
  return static_cast<bool>(in_blocks ? words >> blocks >> count : words >> count);
}

}  // namespace

std::size_t stated_node_count(const std::string& file, const std::string& who) {
  std::ifstream stream(file, std::ios::binary);
  std::string line;
  errno = 0;
  if (!stream || !std::getline(stream, line)) {
    throw Error(who + (errno != 0 ? std::strerror(errno) : "is empty") +
                "; write a file that can be read, or save it as .msh again");
  }
  if (!begins_as_mesh(line)) {
    throw Error(who +
                "is not a mesh: it begins neither with $MeshFormat nor with $NOD; save it as "
                ".msh again (a script of Gmsh's is not run)");
  }
  Format format;
  std::size_t nodes = 0;
  do {
    if (line.starts_with("$MeshFormat")) {
      format = read_format(stream);
    } else if (begins_nodes(line)) {
      std::size_t count = 0;
      if (!read_count(stream, format, count)) {
        throw Error(who + "its section " + line.substr(0, line.find('\r')) +
                    " does not begin with a number of nodes; save it as .msh again");
      }
      nodes += count;
    }
  } while (std::getline(stream, line));
  return nodes;
}

}  // namespace forcegrid::simulator
