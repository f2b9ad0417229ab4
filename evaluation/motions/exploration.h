// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <Eigen/Core>
#include <limits>
#include <vector>

#include "evaluation/objects/force_table.h"
#include "evaluation/traces/trace.h"

namespace forcegrid::evaluation {

/// Four minutes on a large object: nine tiles of 36 mm, 13 s in each, then all of them again along
/// other paths. The tool returns to each tile 117 s after it first entered it. The tiles form a
/// square of three by three around the first and are visited in a spiral.
inline constexpr int kTiles = 9;
inline constexpr int kTileVisits = 2 * kTiles;
inline constexpr double kTileSide_m = 0.036;
inline constexpr double kTileStay_s = 13.0;
inline constexpr double kExploration_s = kTileVisits * kTileStay_s;

/// [m] Centre of the tile of the visit 0..kTileVisits-1 (visit v is of tile v mod 9), relative to
/// the contact point and in its surface.
Eigen::Vector3d tile_centre_W_m(int visit);

/// [m] Centre of the motion at `time_s`. In the first second of a visit it moves from the previous
/// tile to the new one by minimum jerk.
Eigen::Vector3d exploration_centre_W_m(double time_s);

/// Force and stiffness of a large object at a displacement d from the contact point. It is composed
/// of a small object's table F_T and the same table turned by 90 degrees about z, both folded by
/// sines:
///
///   F(d) = sum_k a_k D_k F_k(g_k(d)) - F_0
///   g_k  = (A sin((x - o_kx) / A), A sin((y - o_ky) / A), z),   A = 20 mm
///   D_k  = diag(dg_k,i / dd_i),   F_1 = F_T,   F_2(g) = R F_T(R^T g)
///
/// The gradient of sum_k a_k U_k(g_k(d)), so conservative; smooth, and defined for all x and y. F_0
/// makes the force zero at d = 0.
/// Source: the method study's large workspace; shares and offsets were chosen here.
/// @throws ChartError for a table that does not cover x and y of +-20 mm, or z.
ForceTable::Value large_object(const ForceTable& table, const Eigen::Vector3d& displacement_W);

/// [m] The nearest displacement that large_object() covers: any x and y, z within the table.
Eigen::Vector3d clamped_to_large_object(const ForceTable& table,
                                        const Eigen::Vector3d& displacement_W) noexcept;

/// RMS of |F - F_o| in windows after the tool re-enters a tile on its second visit, in % of the RMS
/// of |F_o| over the whole trace. NaN if there is nothing to measure.
struct ReturnErrors {
  static constexpr double kNothing = std::numeric_limits<double>::quiet_NaN();
  double first_33ms_percent = kNothing;   ///< 0 to 33 ms after entering
  double to_100ms_percent = kNothing;     ///< 33 to 100 ms
  double to_500ms_percent = kNothing;     ///< 0.1 to 0.5 s
  double to_1s_percent = kNothing;        ///< 0.5 to 1 s
  double second_half_percent = kNothing;  ///< from the second visit to the first tile on
};

/// @param servo of the trajectory `exploration`, `contact_point_W` its contact point.
/// @param forces_W [N] one per servo instant.
ReturnErrors return_errors(const std::vector<ServoInstant>& servo,
                           const Eigen::Vector3d& contact_point_W,
                           const std::vector<Eigen::Vector3d>& forces_W);

}  // namespace forcegrid::evaluation
