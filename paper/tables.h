// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

#include "paper/claims.h"
#include "paper/results.h"

namespace forcegrid::paper {

struct Cell {
  Cell(std::string words) : text(std::move(words)) {}     // NOLINT: rows are written as lists
  Cell(double value) : is_number(true), number(value) {}  // NOLINT
  std::string text;
  bool is_number = false;
  double number = 0.0;
};

/// A table for a CSV file or the page.
struct Table {
  std::vector<std::string> columns;  ///< names with units
  std::vector<std::vector<Cell>> rows;
};

/// Formats a CSV: texts in quotation marks, numbers with nine digits, empty cells for numbers that
/// are not finite.
std::string csv(const Table& table);

Table claims_table(const std::vector<Claim>& claims);
/// The curves of Figure 7: time, tool position along the normal, and the components along it of the
/// reference force and of the forces of figure_methods(). Forces act on the hand, positive towards
/// the object.
Table forces_table(const Figures& figures);
Table fifths_table(const Figures& figures);
Table comparison_table(const Comparison& comparison);
Table resolutions_table(const std::vector<ResolutionRow>& rows);
Table discrimination_table(const Discrimination& all);
Table shapes_table(const std::vector<ShapeDifference>& shapes);

}  // namespace forcegrid::paper
