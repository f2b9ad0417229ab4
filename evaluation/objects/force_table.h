// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <array>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <stdexcept>
#include <string>
#include <vector>

#include "evaluation/files/error.h"
#include "simulator/mesh/spring_mesh.h"

namespace forcegrid::evaluation {

/// The work was stopped on request; what is finished is kept.
class Stopped : public std::runtime_error {
 public:
  Stopped()
      : std::runtime_error("stopped; what was finished is kept: repeat the command to continue") {}
};

/// A box of equally spaced nodes over the displacements d = P - P_contact, in W.
/// The default covers x, y in +-21 mm and z in -6..+27 mm.
struct TableLattice {
  Eigen::Vector3d min_W_m{-0.021, -0.021, -0.006};
  double spacing_m = 0.003;
  std::array<int, 3> nodes{15, 15, 12};  ///< along x, y, z; each in 4..1000

  std::size_t node_count() const noexcept;
  /// Node (i, j, l) has the number i + nx (j + ny l).
  Eigen::Vector3d node_W_m(std::size_t number) const noexcept;
  Eigen::Vector3d max_W_m() const noexcept;
  /// @throws ChartError unless there are enough nodes and the spacing is positive.
  void check() const;
};

/// Force and stiffness of an object at rest under a tool, as a function of the tool's displacement
/// since the grab: the tensor product of cubic splines through the forces of a lattice,
///
///   F(d) = sum_ijl c_ijl B(x - i) B(y - j) B(z - l),   (x, y, z) = (d - min) / spacing
///
/// with the cubic B-spline B and not-a-knot ends. Twice continuously differentiable, exact at the
/// nodes, and for polynomials of up to third degree in each coordinate.
/// Source: de Boor, A Practical Guide to Splines (2001), chapters IV and XVII.
/// Threads: const after construction.
class ForceTable {
 public:
  /// @param forces_W [N] one per node, in the lattice's numbering.
  /// @throws ChartError for a lattice out of range, another number of forces, or a force that is
  ///         not finite.
  ForceTable(const TableLattice& lattice, const std::vector<Eigen::Vector3d>& forces_W);

  struct Value {
    Eigen::Vector3d force_W;      ///< [N]
    Eigen::Matrix3d stiffness_W;  ///< [N/m] dF/dd, the spline's own derivative
  };

  const TableLattice& lattice() const noexcept { return lattice_; }
  bool contains(const Eigen::Vector3d& displacement_W) const noexcept;
  /// [m] The nearest displacement that the table covers.
  Eigen::Vector3d clamped(const Eigen::Vector3d& displacement_W) const noexcept;

  /// @throws ChartError for a displacement that the table does not cover.
  Eigen::Vector3d force_W(const Eigen::Vector3d& displacement_W) const;
  Value at(const Eigen::Vector3d& displacement_W) const;

 private:
  struct Weights;
  Weights weights(const Eigen::Vector3d& displacement_W) const;

  TableLattice lattice_;
  std::array<std::size_t, 3> coefficients_{};      // along x, y, z: nodes + 2
  std::vector<Eigen::Vector3d> coefficients_W_N_;  // c, first index fastest
};

/// Called now and then on the calling thread: the fraction done in [0, 1], the time left [s].
using Progress = std::function<void(double done, double remaining_s)>;

struct TableOptions {
  TableLattice lattice;
  double patch_radius_m = 0.012;     ///< of the tool's grip, at the centre of the object's top
  double relative_tolerance = 1e-6;  ///< of the solver, in double precision
  double max_step_m = 1.5e-3;        ///< so that every node is reached on the branch from rest
  unsigned threads = 0;              ///< 0: one per processor
  std::filesystem::path cache;       ///< folder; made if it isn't there. Empty: no cache
  Progress progress;
  const std::atomic<bool>* cancel = nullptr;  ///< when set and true: Stopped is thrown soon
};

struct BuiltTable {
  ForceTable table;
  std::string key;              ///< of everything that the forces depend on, 16 hexadecimal digits
  bool from_cache = false;      ///< nothing had to be solved
  std::size_t unconverged = 0;  ///< nodes whose force missed the tolerance
  double elapsed_s = 0.0;       ///< of the solves of this call
};

/// What identifies a table: a hash of mesh, grip, solver settings and lattice.
std::string table_key(const simulator::SpringMesh& mesh, const TableOptions& options);

/// Solves the mesh at every node of the lattice, or takes the forces from the cache. The layers of
/// equal z are independent jobs, each begun at rest and kept in the cache as soon as it is
/// finished, so that an interrupted build goes on where it stopped.
/// @throws ChartError or FileError for a folder or file that can't be written, Stopped,
///         simulator::Error for a mesh that can't be solved.
BuiltTable build_table(const simulator::SpringMesh& mesh, const TableOptions& options);

/// How far a table is from the object itself.
struct TableDifference {
  std::size_t positions = 0;
  double rms_percent = 0.0;  ///< RMS of |F_table - F_live| in % of the RMS of |F_live|
  double max_N = 0.0;
  double live_rms_N = 0.0;
  std::size_t unconverged = 0;
  std::size_t branch_changes = 0;  ///< live solves that left their branch on the way
};

/// Solves the object at `displacements_W` [m], in this order, with the options' solver settings,
/// and compares. Kept in the cache, too.
/// @throws as build_table; ChartError for a displacement that the table does not cover.
TableDifference compare_with_live(const ForceTable& table, const simulator::SpringMesh& mesh,
                                  const std::vector<Eigen::Vector3d>& displacements_W,
                                  const TableOptions& options);

/// A hash of bytes that doesn't depend on platform or run: FNV-1a, 64 bit (Fowler, Noll, Vo).
class ContentHash {
 public:
  void add(const void* data, std::size_t size) noexcept;
  void add(double value) noexcept { add(&value, sizeof value); }
  void add(std::uint64_t value) noexcept { add(&value, sizeof value); }
  void add(const std::string& text) noexcept;
  std::string text() const;  ///< 16 hexadecimal digits

 private:
  std::uint64_t state_ = 0xcbf29ce484222325U;
};

/// Writes `text` to a file that appears under its name only when it is complete.
/// @throws FileError naming the file, the system's reason and the remedy.
void write_file(const std::filesystem::path& file, const std::string& text);

}  // namespace forcegrid::evaluation
