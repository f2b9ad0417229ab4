// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <optional>
#include <string>
#include <vector>

namespace forcegrid::cli {

using Triple = std::array<double, 3>;

/// One instant of the run; vectors in the workspace frame W, in m and N.
struct FigureRow {
  double time_s = 0.0;  ///< since contact
  Triple position_W_m{};
  std::optional<Triple> reference_W_N;  ///< reference force, when it was computed
  std::vector<Triple> method_W_N;       ///< one per method
};

/// Writes `directory`/forces.csv. @returns its name.
/// @throws std::runtime_error naming the file, the reason and the remedy.
std::string write_figure_data(const std::string& directory,
                              const std::vector<std::string>& method_names,
                              const std::vector<FigureRow>& rows);

/// Draws forces.svg and forces.png from `directory`/forces.csv of the same rows with gnuplot. The
/// upper panels show the tool's position, each method's force along z and the reference force
/// (Figure 7 of the paper). The lower panel shows the methods' errors (Figure 8).
/// @returns the files written; none for fewer than two rows.
/// @throws std::runtime_error naming the file or program, the reason and the remedy.
///         rt::Interrupted, and then neither picture is there.
std::vector<std::string> draw_figures(const std::string& directory,
                                      const std::vector<std::string>& method_names,
                                      const std::vector<FigureRow>& rows);

}  // namespace forcegrid::cli
