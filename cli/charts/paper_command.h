#pragma once

#include <cstdint>
#include <functional>
#include <string>

namespace CLI {
class App;
}

namespace forcegrid::cli {

/// What `forcegrid paper` was asked for.
struct PaperCommandOptions {
  std::string out;
  std::string cache;  ///< folder of force tables; empty: forcegrid in the user's cache folder
  bool quick = false;
  unsigned jobs = 0;  ///< 0: one a processor
  std::uint64_t seed = 1;
};

/// Adds the subcommand `paper`, which sets `action`.
void add_paper(CLI::App& app, PaperCommandOptions& options, std::function<int()>& action);

/// Runs the forcegrid paper's experiments and writes them beside its figures and claims into
/// `options.out`, see docs/paper.md.
/// @returns the program's exit status, 0, also where something differs from the paper.
/// @throws std::exception with a sentence for the user.
int paper_command(const PaperCommandOptions& options);

}  // namespace forcegrid::cli
