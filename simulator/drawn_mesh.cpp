// SPDX-License-Identifier: Apache-2.0
#include "simulator/drawn_mesh.h"

#include <algorithm>
#include <cstddef>
#include <utility>

namespace forcegrid::simulator {
namespace {

using view_link::Edge;

// Each edge of the elements once, lower vertex first.
std::vector<Edge> edges_of(const std::vector<Tetrahedron>& tetrahedra) {
  std::vector<Edge> edges;
  edges.reserve(6 * tetrahedra.size());
  for (const Tetrahedron& element : tetrahedra) {
    for (std::size_t i = 0; i < 4; ++i) {
      for (std::size_t j = i + 1; j < 4; ++j) {
        const auto [low, high] = std::minmax(element.vertex[i], element.vertex[j]);
        edges.push_back({static_cast<std::uint32_t>(low), static_cast<std::uint32_t>(high)});
      }
    }
  }
  std::sort(edges.begin(), edges.end());
  edges.erase(std::unique(edges.begin(), edges.end()), edges.end());
  return edges;
}

}  // namespace

DrawnSurface drawn_surface(const SpringMesh& mesh) {
  DrawnSurface surface;
  std::vector<bool> is_corner(mesh.rest_position_W.size(), false);
  for (const auto& triangle : mesh.triangles) {
    for (const std::int32_t vertex : triangle) {
      is_corner[static_cast<std::size_t>(vertex)] = true;
    }
  }
  std::vector<std::uint32_t> number(is_corner.size(), 0);
  for (std::size_t vertex = 0; vertex < is_corner.size(); ++vertex) {
    if (is_corner[vertex]) {
      number[vertex] = static_cast<std::uint32_t>(surface.vertices.size());
      surface.vertices.push_back(static_cast<std::int32_t>(vertex));
    }
  }
  surface.triangles.reserve(mesh.triangles.size());
  for (const auto& [a, b, c] : mesh.triangles) {
    surface.triangles.push_back({number[static_cast<std::size_t>(a)],
                                 number[static_cast<std::size_t>(b)],
                                 number[static_cast<std::size_t>(c)]});
  }
  return surface;
}

DrawnInside drawn_inside(const SpringMesh& mesh) {
  DrawnInside inside;
  view_link::InsideLines& lines = inside.lines;
  const auto is_whole = [](const Spring& spring) { return !spring.severed; };
  lines.springs =
      static_cast<std::uint32_t>(std::count_if(mesh.springs.begin(), mesh.springs.end(), is_whole));
  const std::vector<Edge> of_elements = edges_of(mesh.tetrahedra);
  lines.element_edges = static_cast<std::uint32_t>(of_elements.size());
  if (std::size_t{lines.springs} + of_elements.size() > view_link::kMostEdges) {
    return inside;
  }
  for (const Spring& spring : mesh.springs) {
    if (is_whole(spring)) {
      lines.edge.push_back(
          {static_cast<std::uint32_t>(spring.a), static_cast<std::uint32_t>(spring.b)});
    }
  }
  lines.edge.insert(lines.edge.end(), of_elements.begin(), of_elements.end());
  std::vector<bool> is_end(mesh.rest_position_W.size(), false);
  for (const Edge& edge : lines.edge) {
    is_end[edge[0]] = true;
    is_end[edge[1]] = true;
  }
  std::vector<std::uint32_t> number(is_end.size(), 0);
  for (std::size_t vertex = 0; vertex < is_end.size(); ++vertex) {
    if (is_end[vertex]) {
      number[vertex] = static_cast<std::uint32_t>(inside.vertices.size());
      inside.vertices.push_back(static_cast<std::int32_t>(vertex));
    }
  }
  for (Edge& edge : lines.edge) {
    edge = {number[edge[0]], number[edge[1]]};
  }
  lines.vertices = static_cast<std::uint32_t>(inside.vertices.size());
  return inside;
}

}  // namespace forcegrid::simulator
