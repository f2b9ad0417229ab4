// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>
#include <limits>
#include <memory>
#include <string>
#include <vector>

#include "forcegrid/core/force_method.h"
#include "simulator/mesh/spring_mesh.h"

namespace forcegrid::simulator {

/// A way to fast forces that knows the object's model and needs no samples, with what is known of
/// it beforehand.
struct Rival {
  const char* name;    ///< on the command line
  const char* source;  ///< whose idea it is, as the forcegrid paper's references number it
  const char* needs;
  const char* right_when;
};

/// penetration-depth, coarse-mesh, unit-responses, greens-functions, condensation, two-rates: what
/// sections 1 and 2 of the forcegrid paper compare it with, as far as it is not a method of
/// forcegrid/.
const std::vector<Rival>& rivals();

/// Whether rivals() has one of this name.
bool is_rival(const std::string& name);

struct MadeRival {
  std::unique_ptr<ForceMethod> method;
  /// [s] Wall time from the mesh to a method that can answer, as it was when its tables were made;
  /// NaN for a method without tables.
  double precompute_s = std::numeric_limits<double>::quiet_NaN();
};

/// Makes rivals of one object. Tables are made when they are first asked for, and shared by all
/// methods made of them; they live as long as one of these does.
/// Threads: one.
class RivalTables {
 public:
  /// @param coarser  makes a mesh of about half the vertices per axis of the same object, for
  ///        coarse-mesh; empty: that method can't be made.
  explicit RivalTables(std::function<SpringMesh()> coarser = {});
  ~RivalTables();
  RivalTables(RivalTables&&) noexcept;
  RivalTables& operator=(RivalTables&&) noexcept;

  /// @param mesh, patch_radius_m  the same in every call.
  /// Throws Error for an unknown name, and for an object that the method can't be made for, with
  /// the reason.
  MadeRival make(const std::string& name, const SpringMesh& mesh, double patch_radius_m);

 private:
  struct Tables;
  std::unique_ptr<Tables> tables_;
};

}  // namespace forcegrid::simulator
