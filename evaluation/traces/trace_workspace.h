// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>

#include "evaluation/traces/pair_trace.h"
#include "evaluation/traces/trace.h"
#include "forcegrid/core/grid_geometry.h"

namespace forcegrid::evaluation {

/// The box that grid methods have on a trace unless another one is asked for: 0 to 0.16, 0.12 and
/// 0.12 m, with 49 cells along each axis.
GridGeometry default_trace_workspace();

/// Positions of servo instants and samples that lie outside `grid`.
std::size_t positions_outside(const GridGeometry& grid, const Trace& trace);

/// The box of all positions of a trace, 30 mm wider on every side, with 49 cells along each axis.
GridGeometry box_around(const Trace& trace);

/// Positions of servo instants of either tool that lie outside `grid`.
std::size_t positions_outside(const GridGeometry& grid, const PairTrace& trace);

/// `grid` if it holds every position of both tools of the trace, else box_around() them.
GridGeometry workspace_of(const PairTrace& trace, const GridGeometry& grid);

}  // namespace forcegrid::evaluation
