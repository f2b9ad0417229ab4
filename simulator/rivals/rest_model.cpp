// SPDX-License-Identifier: Apache-2.0
#include "simulator/rivals/rest_model.h"

#include <Eigen/IterativeLinearSolvers>
#include <Eigen/OrderingMethods>
#include <Eigen/SparseCholesky>
#include <algorithm>
#include <string>
#include <utility>

#include "rt/checkpoint.h"
#include "simulator/mesh/error.h"
#include "simulator/mesh/tangent_stiffness.h"

namespace forcegrid::simulator {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::SparseMatrix;
using Eigen::Vector3d;

constexpr double kRestTolerance = 1e-10;
// Unit loads solved at a time: a row of them is two cache lines.
constexpr int kLoadsAtOnce = 16;
using Loads = Eigen::Matrix<double, Eigen::Dynamic, kLoadsAtOnce, Eigen::RowMajor>;
using Factor =
    Eigen::SimplicialLDLT<SparseMatrix<double>, Eigen::Lower, Eigen::NaturalOrdering<int>>;

// An order of elimination that keeps L sparse: halves of the object along its longest axis, each
// ordered the same way, and last the vertices that separate them.
// Source: George, Nested dissection of a regular finite element mesh, SIAM J. Numer. Anal. 10(2),
// 1973.
class Dissection {
 public:
  explicit Dissection(const SpringMesh& mesh)
      : rest_W_(mesh.rest_position_W), neighbours_(rest_W_.size()), half_(rest_W_.size(), 0) {
    for (const Spring& spring : mesh.springs) {
      neighbours_[static_cast<std::size_t>(spring.a)].push_back(spring.b);
      neighbours_[static_cast<std::size_t>(spring.b)].push_back(spring.a);
    }
    for (const Tetrahedron& element : mesh.tetrahedra) {
      for (const std::int32_t a : element.vertex) {
        for (const std::int32_t b : element.vertex) {
          if (a != b) {
            neighbours_[static_cast<std::size_t>(a)].push_back(b);
          }
        }
      }
    }
  }

  // Appends `vertices` to `order`.
  void append(std::vector<std::int32_t> vertices, std::vector<std::int32_t>& order) {
    if (vertices.size() <= kLeaf) {
      order.insert(order.end(), vertices.begin(), vertices.end());
      return;
    }
    Vector3d low_W = rest_W(vertices.front());
    Vector3d high_W = low_W;
    for (const std::int32_t vertex : vertices) {
      low_W = low_W.cwiseMin(rest_W(vertex));
      high_W = high_W.cwiseMax(rest_W(vertex));
    }
    Index axis = 0;
    (high_W - low_W).maxCoeff(&axis);
    const auto middle = vertices.begin() + static_cast<std::ptrdiff_t>(vertices.size() / 2);
    std::nth_element(vertices.begin(), middle, vertices.end(),
                     [this, axis](std::int32_t a, std::int32_t b) {
                       return std::pair(rest_W(a)[axis], a) < std::pair(rest_W(b)[axis], b);
                     });
    const std::int32_t mark = ++marks_;
    std::vector<std::int32_t> far(middle, vertices.end());
    for (const std::int32_t vertex : far) {
      half_[static_cast<std::size_t>(vertex)] = mark;
    }
    std::vector<std::int32_t> near;
    std::vector<std::int32_t> between;
    for (auto vertex = vertices.begin(); vertex != middle; ++vertex) {
      const auto& around = neighbours_[static_cast<std::size_t>(*vertex)];
      const bool touches = std::any_of(around.begin(), around.end(), [&](std::int32_t other) {
        return half_[static_cast<std::size_t>(other)] == mark;
      });
      (touches ? between : near).push_back(*vertex);
    }
    append(std::move(near), order);
    append(std::move(far), order);
    order.insert(order.end(), between.begin(), between.end());
  }

 private:
  static constexpr std::size_t kLeaf = 8;

  const Vector3d& rest_W(std::int32_t vertex) const {
    return rest_W_[static_cast<std::size_t>(vertex)];
  }

  const std::vector<Vector3d>& rest_W_;
  std::vector<std::vector<std::int32_t>> neighbours_;
  std::vector<std::int32_t> half_;  // the mark of the last far half that a vertex was in
  std::int32_t marks_ = 0;
};

// The unknowns of `nodes`, three each.
std::vector<Index> unknowns_of(const FreeCoordinates& coordinates,
                               const std::vector<std::int32_t>& nodes) {
  std::vector<Index> unknowns;
  for (const std::int32_t node : nodes) {
    const auto vertex = static_cast<std::size_t>(node);
    if (node < 0 || vertex >= coordinates.first.size() || coordinates.first[vertex] < 0) {
      throw Error("rest model: vertex " + std::to_string(node) +
                  " is fixed or missing; name free vertices");
    }
    for (Index c = 0; c < 3; ++c) {
      unknowns.push_back(coordinates.first[vertex] + c);
    }
  }
  return unknowns;
}

void check_size(const FreeCoordinates& coordinates) {
  const auto vertices = static_cast<std::size_t>(coordinates.count / 3);
  if (vertices > kMostFactorisedVertices) {
    throw Error("rest model: the object has " + std::to_string(vertices) +
                " free vertices, and the factor of its stiffness would take gigabytes; take an "
                "object of at most " +
                std::to_string(kMostFactorisedVertices) +
                " or a method that does not factorise it");
  }
}

// K in an order of its free vertices, factorised, and where each unknown is in that order.
struct OrderedFactor {
  Eigen::PermutationMatrix<Eigen::Dynamic, Eigen::Dynamic, int> place;
  Factor factor;
};

void factorise(const SpringMesh& mesh, const FreeCoordinates& coordinates,
               const std::vector<std::int32_t>& order, OrderedFactor& result) {
  result.place.resize(coordinates.count);
  int next = 0;
  for (const std::int32_t vertex : order) {
    for (Index c = 0; c < 3; ++c) {
      result.place.indices()[coordinates.first[static_cast<std::size_t>(vertex)] + c] = next++;
    }
  }
  const SparseMatrix<double> stiffness =
      tangent_stiffness_W(mesh, coordinates, mesh.rest_position_W);
  SparseMatrix<double> ordered(coordinates.count, coordinates.count);
  ordered.selfadjointView<Eigen::Lower>() =
      stiffness.selfadjointView<Eigen::Lower>().twistedBy(result.place);
  rt::checkpoint();
  result.factor.compute(ordered);
  if (result.factor.info() != Eigen::Success || !(result.factor.vectorD().minCoeff() > 0.0)) {
    throw Error(
        "rest model: the stiffness at rest is not positive definite, so the rest shape is no "
        "stable equilibrium; fix more vertices or give the object home springs");
  }
}

std::vector<std::int32_t> free_vertices(const FreeCoordinates& coordinates) {
  std::vector<std::int32_t> vertices;
  for (std::size_t i = 0; i < coordinates.first.size(); ++i) {
    if (coordinates.first[i] >= 0) {
      vertices.push_back(static_cast<std::int32_t>(i));
    }
  }
  return vertices;
}

// The columns of L that unit loads on `rows` reach, in rising order: the rows and their ancestors
// in the elimination tree. All others stay zero forward, and are not asked for backward.
std::vector<Index> reached_columns(const SparseMatrix<double>& lower,
                                   const std::vector<Index>& rows) {
  std::vector<std::uint8_t> reached(static_cast<std::size_t>(lower.cols()), 0);
  for (Index column : rows) {
    while (column >= 0 && reached[static_cast<std::size_t>(column)] == 0) {
      reached[static_cast<std::size_t>(column)] = 1;
      Index parent = -1;
      for (SparseMatrix<double>::InnerIterator entry(lower, column); entry && parent < 0; ++entry) {
        parent = entry.row() > column ? entry.row() : -1;
      }
      column = parent;
    }
  }
  std::vector<Index> columns;
  for (Index j = 0; j < lower.cols(); ++j) {
    if (reached[static_cast<std::size_t>(j)] != 0) {
      columns.push_back(j);
    }
  }
  return columns;
}

// x := (L D L^T)^-1 x on the rows `columns`, which must be closed under ancestors.
void substitute(const SparseMatrix<double>& lower, const Eigen::VectorXd& diagonal,
                const std::vector<Index>& columns, Loads& x) {
  for (const Index j : columns) {
    const Eigen::Matrix<double, 1, kLoadsAtOnce> here = x.row(j);
    for (SparseMatrix<double>::InnerIterator entry(lower, j); entry; ++entry) {
      if (entry.row() > j) {
        x.row(entry.row()) -= entry.value() * here;
      }
    }
  }
  for (auto column = columns.rbegin(); column != columns.rend(); ++column) {
    Eigen::Matrix<double, 1, kLoadsAtOnce> here = x.row(*column) / diagonal[*column];
    for (SparseMatrix<double>::InnerIterator entry(lower, *column); entry; ++entry) {
      if (entry.row() > *column) {
        here -= entry.value() * x.row(entry.row());
      }
    }
    x.row(*column) = here;
  }
}

}  // namespace

std::vector<std::int32_t> vertices_within(const SpringMesh& mesh, const Vector3d& point_W,
                                          double radius_m) {
  std::vector<std::int32_t> vertices;
  for (std::size_t i = 0; i < mesh.rest_position_W.size(); ++i) {
    if (mesh.fixed[i] == 0 && (mesh.rest_position_W[i] - point_W).norm() <= radius_m) {
      vertices.push_back(static_cast<std::int32_t>(i));
    }
  }
  return vertices;
}

Eigen::Matrix3d rest_stiffness_W(const SpringMesh& mesh, const std::vector<std::int32_t>& patch) {
  check(mesh);
  const FreeCoordinates whole(mesh);
  static_cast<void>(unknowns_of(whole, patch));
  SpringMesh held = mesh;
  for (const std::int32_t vertex : patch) {
    held.fixed[static_cast<std::size_t>(vertex)] = 1;
  }
  const SparseMatrix<double> stiffness = tangent_stiffness_W(mesh, whole, mesh.rest_position_W);
  MatrixXd moved = MatrixXd::Zero(whole.count, 3);  // 1 on the patch
  for (const std::int32_t vertex : patch) {
    moved.middleRows<3>(whole.first[static_cast<std::size_t>(vertex)]).setIdentity();
  }
  const MatrixXd loads = stiffness * moved;
  const FreeCoordinates others(held);
  MatrixXd on_others(others.count, 3);
  for (std::size_t i = 0; i < others.first.size(); ++i) {
    if (others.first[i] >= 0) {
      on_others.middleRows<3>(others.first[i]) = loads.middleRows<3>(whole.first[i]);
    }
  }
  if (others.count > 0) {
    const SparseMatrix<double> of_others = tangent_stiffness_W(held, others, mesh.rest_position_W);
    Eigen::ConjugateGradient<SparseMatrix<double>, Eigen::Lower | Eigen::Upper> solver;
    solver.setTolerance(kRestTolerance);
    solver.compute(of_others);
    const MatrixXd follow = solver.solve(on_others);
    if (solver.info() != Eigen::Success || !follow.allFinite()) {
      throw Error(
          "rest model: the stiffness at rest could not be solved for, so the rest shape is no "
          "stable equilibrium; fix more vertices or give the object home springs");
    }
    for (std::size_t i = 0; i < others.first.size(); ++i) {
      if (others.first[i] >= 0) {
        moved.middleRows<3>(whole.first[i]) = -follow.middleRows<3>(others.first[i]);
      }
    }
  }
  const MatrixXd balance = stiffness * moved;
  Eigen::Matrix3d force = Eigen::Matrix3d::Zero();
  for (const std::int32_t vertex : patch) {
    force -= balance.middleRows<3>(whole.first[static_cast<std::size_t>(vertex)]);
  }
  return force;
}

MatrixXd greens_functions_m_per_N(const SpringMesh& mesh, const std::vector<std::int32_t>& nodes) {
  check(mesh);
  const FreeCoordinates coordinates(mesh);
  check_size(coordinates);
  const std::vector<Index> unknowns = unknowns_of(coordinates, nodes);
  std::vector<std::int32_t> order;
  Dissection(mesh).append(free_vertices(coordinates), order);
  OrderedFactor ordered;
  factorise(mesh, coordinates, order, ordered);
  const SparseMatrix<double> lower = ordered.factor.matrixL().nestedExpression();
  const Eigen::VectorXd diagonal = ordered.factor.vectorD();
  std::vector<Index> row;  // of each node's unknown in the factor's order
  for (const Index unknown : unknowns) {
    row.push_back(ordered.place.indices()[unknown]);
  }
  const std::vector<Index> columns = reached_columns(lower, row);
  const auto count = static_cast<Index>(row.size());
  MatrixXd greens_m_per_N(count, count);
  Loads x = Loads::Zero(coordinates.count, kLoadsAtOnce);
  for (Index begin = 0; begin < count; begin += kLoadsAtOnce) {
    rt::checkpoint(static_cast<std::size_t>(begin), row.size());
    const Index loads = std::min<Index>(kLoadsAtOnce, count - begin);
    for (const Index j : columns) {
      x.row(j).setZero();
    }
    for (Index k = 0; k < loads; ++k) {
      x(row[static_cast<std::size_t>(begin + k)], k) = 1.0;
    }
    substitute(lower, diagonal, columns, x);
    for (Index i = 0; i < count; ++i) {
      greens_m_per_N.row(i).segment(begin, loads) =
          x.row(row[static_cast<std::size_t>(i)]).head(loads);
    }
  }
  return greens_m_per_N;
}

MatrixXd condensed_stiffness_N_per_m(const SpringMesh& mesh,
                                     const std::vector<std::int32_t>& nodes) {
  check(mesh);
  const FreeCoordinates coordinates(mesh);
  check_size(coordinates);
  const std::vector<Index> kept = unknowns_of(coordinates, nodes);
  SpringMesh without = mesh;
  for (const std::int32_t vertex : nodes) {
    without.fixed[static_cast<std::size_t>(vertex)] = 1;
  }
  // What is eliminated first, then the nodes.
  std::vector<std::int32_t> order;
  Dissection(mesh).append(free_vertices(FreeCoordinates(without)), order);
  const auto inner = static_cast<Index>(3 * order.size());
  order.insert(order.end(), nodes.begin(), nodes.end());
  OrderedFactor ordered;
  factorise(mesh, coordinates, order, ordered);
  const SparseMatrix<double> lower = ordered.factor.matrixL().nestedExpression();
  const auto count = static_cast<Index>(kept.size());
  MatrixXd left = MatrixXd::Identity(count, count);
  for (Index j = 0; j < count; ++j) {
    for (SparseMatrix<double>::InnerIterator entry(lower, inner + j); entry; ++entry) {
      if (entry.row() > inner + j) {
        left(entry.row() - inner, j) = entry.value();
      }
    }
  }
  return left * ordered.factor.vectorD().tail(count).asDiagonal() * left.transpose();
}

}  // namespace forcegrid::simulator
