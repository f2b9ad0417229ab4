// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <string>
#include <vector>

#include "paper/claims.h"
#include "paper/results.h"

namespace forcegrid::paper {

/// All results as JSON; docs/paper.md explains the keys.
std::string paper_json(const Results& results, const std::vector<Claim>& claims,
                       const PaperOptions& options);

/// The page: claims, pictures and tables. `pictures` are the texts of figure7.svg, figure8.svg,
/// resolutions.svg and discrimination.svg.
std::string paper_html(const Results& results, const std::vector<Claim>& claims,
                       const std::vector<std::string>& pictures);

/// Writes claims.csv, figure7.csv, comparison.csv, resolutions.csv, discrimination.csv, shapes.csv,
/// their pictures, paper.json and index.html into `options.out`, which is created if missing.
/// @returns the files written, the page last.
/// @throws evaluation::ChartError, evaluation::FileError naming the file, the reason and the
///         remedy.
std::vector<std::filesystem::path> write_report(const Results& results,
                                                const PaperOptions& options);

}  // namespace forcegrid::paper
